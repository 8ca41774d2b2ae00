"""Part "scale": small fleets are served for real, what is counted is there, and the page says what the figures say."""

from __future__ import annotations

import dataclasses
import math

import pytest

from benchmarks import fits
from benchmarks.results import Origin
from benchmarks.scale import part as scale
from benchmarks.scale.daemons import Use
from benchmarks.scale.mission import Vehicles
from benchmarks.scale.run import Run, Spread, run

MISSED = {
    "actions timed out",
    "actions failed or refused",
    "percepts that grew stale",
    "percepts that did not come",
    "percepts that came after the status that refers to them",
    "heartbeats of a bridge late",
    "health records late",
    "datagrams lost before the bridge",
    "dropped by queues",
    "not readable",
    "lines logged as errors",
}


@pytest.mark.parametrize(("vehicles", "size", "agents"), [("talkers", 5, 5), ("copters", 1, 2)])
def test_all_of_a_small_fleet_are_served_and_what_is_missed_is_counted(
    vehicles: Vehicles, size: int, agents: int
) -> None:
    found = run(vehicles, size, seconds=3.0, settle=0.5)
    assert found.serving == agents
    assert set(found.missed) == MISSED
    assert found.missed["not readable"] == found.missed["dropped by queues"] == 0
    assert found.missed["actions failed or refused"] == 0
    assert found.percept.count > 0
    assert 0 < found.percept.p50 <= found.percept.p99 <= found.percept.worst
    assert found.asked.count > 0
    assert found.actions["succeeded"] > 0
    assert found.messages > 0
    for kind in ("commd", "bridged", "agentd", "talkers", *(("simulator",) if vehicles == "copters" else ())):
        assert found.use[kind].processes == 1
        assert found.use[kind].pss > 1
        assert found.use[kind].rss > 1
    assert 0 < found.pss() < 1000
    assert found.never_happened >= 0


def _run(vehicles: Vehicles, size: int, *, own_links: bool = False, busy: float = 50.0, each: float = 0.4) -> Run:
    use = {
        "commd": Use(1, 0.1 + 0.1 * size, 0, 40, 20 + 0.1 * size),
        "bridged": Use(size if own_links else 1, 0.24 + each * size, 0, 50, 27 + size),
        "agentd": Use(1, 0.2 + 0.3 * size, 0, 50, 26 + size),
        "talkers": Use(1, 0.1 * size, 0, 20, 10),
    }
    if vehicles == "copters":
        use["simulator"] = Use(size, 1.5 * size, 0, 38 * size, 20 * size)
    made = Run(vehicles, size, own_links, 10.0, serving=size + (vehicles == "copters"), busy=busy, use=use)
    made.percept, made.asked = Spread(100, 2.0, 5.0, 9.0), Spread(100, 8.0, 12.0, 20.0)
    made.lag = dict.fromkeys(("commd", "bridged", "agentd"), 2.0)
    made.missed = dict.fromkeys(sorted(MISSED), 0)
    return made


ORIGIN = Origin(**{
    field.name: {"str": "x", "int": 2, "float": 1.0, "dict[str, str]": {}, "float | None": None}[str(field.type)]
    for field in dataclasses.fields(Origin)
})  # fmt: skip


def _figures(**largest: float) -> scale.Figures:
    talkers = [_run("talkers", size) for size in (1, 10, 50)] + [_run("talkers", 100, **largest)]
    return scale.Figures([*talkers, _run("talkers", 10, own_links=True), _run("copters", 10)])


def test_the_page_says_at_which_size_what_is_outgrown_and_nothing_is_missed() -> None:
    figures = _figures()
    text = scale.blocks(ORIGIN, figures)["scale"]
    assert "`bridged` is outgrown first, at 249 UAVs" in text  # 0.24 + 0.4 n = 100
    assert "`commd` fills a core at 999 UAVs" in text
    assert "| the three together | 0.54 % | 0.80 % | size ^ 1.00 |" in text
    assert "full at 249 UAVs, when the daemons together fill all cores" in text  # 0.54 + 0.8 n = 200
    assert "At no size was there any of:" in text
    assert all(goal.met for goal in scale.goals(figures))


def test_what_is_missed_is_told_with_the_size_at_which_it_was() -> None:
    figures = _figures()
    largest = figures.of("talkers")[-1]
    largest.missed["actions timed out"] = 7
    largest.serving, largest.percept = 99, Spread(100, 80.0, 340.0, 900.0)
    text = scale.blocks(ORIGIN, figures)["scale"]
    assert "| UAVs | actions timed out |\n|---|---|\n| 100 talkers | 7 |" in text
    assert "from 100 UAVs on more than 1 of 100 positions are beliefs only after the next one has come" in text
    served, late, _ = scale.goals(figures)
    assert (served.met, served.found, served.why) == (False, "99, 7 missed", "actions timed out: 7")
    assert (late.met, late.found) == (False, "340 ms")


def test_sizes_at_which_no_core_was_left_do_not_tell_how_the_cost_grows() -> None:
    text = scale.blocks(ORIGIN, _figures(busy=99.0, each=0.01))["scale"]
    assert "through the sizes at which cores were left (1, 10, 50)" in text
    assert "`bridged` is outgrown first, at 249 UAVs" in text


def test_a_cost_that_grows_with_the_square_of_the_fleet_misses_its_goal() -> None:
    figures = _figures()
    for one in figures.of("talkers"):
        one.use["agentd"].cpu = 0.2 + 0.01 * one.size**2
    growth = scale.goals(figures)[-1]
    assert not growth.met
    assert "agentd" in growth.found


def test_pictures_are_drawn_of_all_rows() -> None:
    pictures = scale.pictures(_figures())
    assert set(pictures) == {"scale-cost", "scale-latency"}
    assert all(picture.startswith("<?xml") for picture in pictures.values())


def test_lines_and_powers_are_found_again() -> None:
    line = fits.line([(size, 3.0 + 0.5 * size) for size in (1, 10, 50, 100)])
    assert line.base == pytest.approx(3.0)
    assert line.each == pytest.approx(0.5)
    assert line.reaches(53.0) == pytest.approx(100.0)
    assert fits.line([(1, 4.0), (10, 4.0)]).reaches(5.0) == math.inf
    assert fits.power([(size, 3.0 + (size - 1) ** 1.5) for size in (1, 10, 50, 100)]) == pytest.approx(1.5)
    with pytest.raises(ValueError, match="two sizes"):
        fits.line([(5, 1.0), (5, 2.0)])
    with pytest.raises(ValueError, match="three sizes"):
        fits.power([(1, 1.0), (5, 2.0)])
