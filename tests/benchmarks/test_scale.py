"""Part "scale": what is missed, where something is outgrown, and what daemons report of themselves."""

from __future__ import annotations

import dataclasses

import pytest

from benchmarks.health import Records, errors, gaps, grown, late
from benchmarks.measurements import scale
from benchmarks.measurements.fleet import Run, Use
from benchmarks.results import Origin
from benchmarks.spread import Spread
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.records import Health

MISSED = ("actions timed out", "datagrams lost before the bridge")


def _spread(p50: float, p99: float, worst: float) -> Spread:
    return Spread(100, p50, p50, p99, worst)


def _run(size: int, *, own_links: bool = False) -> Run:
    use = {
        "commd": Use(1, 0.1 + 0.1 * size, 20 + 0.1 * size),
        "bridged": Use(size if own_links else 1, 0.24 + 0.4 * size, 27 + size),
        "agentd": Use(1, 0.2 + 0.3 * size, 26 + size),
        "talkers": Use(1, 0.1 * size, 10),
    }
    made = Run(size, own_links, 10.0, serving=size, busy=50.0, use=use)
    made.percept, made.asked = _spread(2.0, 5.0, 9.0), _spread(8.0, 12.0, 20.0)
    made.messages, made.percepts = 25.0 * size, 24.0 * size
    made.missed = dict.fromkeys(MISSED, 0)
    return made


ORIGIN = Origin(**{
    field.name: {"str": "x", "int": 2, "float": 1.0, "dict[str, str]": {}, "float | None": None}[str(field.type)]
    for field in dataclasses.fields(Origin)
})  # fmt: skip


def _figures() -> scale.Figures:
    return scale.Figures([*map(_run, (1, 10, 25, 50, 100)), _run(10, own_links=True)])


def test_what_lies_beyond_the_measured_sizes_is_told_as_that() -> None:
    figures = _figures()
    text = scale.blocks(ORIGIN, figures)["scale"]
    assert "nothing is outgrown up to 100 UAVs" in text
    assert "`bridged` comes first to 70 % of a core, at about 174 UAVs by the fit, beyond what was measured" in text
    assert "`commd` comes to 70 % of a core, all its threads together, at about 699 UAVs by the fit" in text
    assert "| the three together | 0.54 % | 0.80 % | 0% | size ^ 1.00 | 0% |" in text
    assert "together come to 70 % of them at about 174 UAVs" in text  # 0.54 + 0.8 n = 140
    assert "At no size was there any of:" in text
    assert all(goal.met for goal in scale.goals(figures))


def test_a_size_at_which_something_was_missed_is_where_it_is_outgrown() -> None:
    figures = _figures()
    figures.row()[3].missed["actions timed out"] = 7
    text = scale.blocks(ORIGIN, figures)["scale"]
    assert "this machine is outgrown at 50 UAVs" in text
    assert "actions timed out: 7" in text
    assert "nothing is outgrown" not in text


def test_what_is_missed_is_told_with_the_size_at_which_it_was_and_what_was_tried() -> None:
    figures = _figures()
    largest = figures.row()[-1]
    largest.missed["actions timed out"] = 7
    largest.serving, largest.percept, largest.in_time = 99, _spread(80.0, 340.0, 900.0), 0.75
    text = scale.blocks(ORIGIN, figures)["scale"]
    assert "| UAVs | actions timed out |\n|---|---|\n| 100 | 7 |" in text
    assert "outgrown at 100 UAVs" in text
    assert "agents that did not serve their vehicle: 1; 25.0% of the positions were no belief" in text
    served, late, lost, *_ = scale.goals(figures)
    assert (served.met, served.found) == (False, "99, 7 missed")
    assert (late.met, late.found) == (False, "75.0% (p99 of those that came: 340 ms)")
    assert (lost.met, lost.found) == (False, "0, 340 ms")
    for one in (served, late, lost):
        assert "the reason is not known" in one.why
        assert "Tried: " in one.why


def test_a_cost_that_grows_with_the_square_of_the_fleet_misses_its_goal() -> None:
    figures = _figures()
    for one in figures.row():
        one.use["agentd"].cpu = 0.2 + 0.01 * one.size**2
    growth = scale.goals(figures)[-1]
    assert not growth.met
    assert growth.found.startswith("size ^ 2.00 (agentd")
    assert "not known" in growth.why


def _records(*told: tuple[float, str, Health]) -> Records:
    bytes_of = codec(Health).encode
    return Records([(at, keys.health("f", name, one.daemon), bytes_of(one, "json")) for at, name, one in told])


def test_daemons_that_tell_nothing_are_late_and_what_is_lost_at_the_edges_counts() -> None:
    assert late(Records(), 0.0, 12.0) == 3
    assert grown(Records(), 0.0, 12.0)["agentd"].counts["drops"] == 0
    assert errors(Records(), 0.0, 12.0) == 0
    percepts = [{"a": f"boot:{seq}:00"} for seq in (10, 130)]
    first, last = (
        Health(daemon="bridged", pid=7, drops=drops, errors=drops, percepts=told)
        for drops, told in zip((1, 4), percepts, strict=True)
    )
    told = _records((9.0, "u", first), (21.0, "u", last), (9.0, "v", first), (21.0, "v", last))
    found = grown(told, 10.0, 20.0)["bridged"]
    assert found.counts["drops"] == 6, "between the last record before and the first behind"
    assert found.rates["percepts"] == pytest.approx(20.0)
    assert errors(told, 10.0, 20.0) == 3, "one process logs what both names tell"
    assert late(told, 10.0, 20.0) == 4, "neither said anything meanwhile, and commd and agentd nothing at all"


def test_a_vehicle_that_hears_no_heartbeat_has_missed_it() -> None:
    assert gaps([], 0.0, 10.0, 1.5) == 1
    assert gaps([float(second) for second in range(11)], 0.0, 10.0, 1.5) == 0
    assert gaps([1.0, 2.0, 3.0, 4.0], 0.0, 10.0, 1.5) == 1
