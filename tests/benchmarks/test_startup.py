"""The starts of the daemons are measured: each serves, and the stretches of an agent's start are all there is of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import results
from benchmarks.serving import KINDS
from benchmarks.startup import part as startup
from benchmarks.startup.cold import copied, dropped


@pytest.fixture(scope="module")
def figures() -> startup.Figures:
    return startup.measured((startup.WARM,), 1)


def test_every_kind_of_process_is_started_and_serves(figures: startup.Figures) -> None:
    assert {one.name for one in figures.starts} == {one.name for one in KINDS}
    assert all(seconds > 0 for one in figures.starts for seconds in one.seconds)


def test_the_stretches_of_an_agents_start_come_one_after_the_other(figures: startup.Figures) -> None:
    stretches = figures.stretches[startup.WARM]
    assert list(stretches) == list(startup.STRETCHES)
    assert all(seconds >= 0 for seconds in stretches.values())
    assert stretches["imports"] > 0.01
    assert stretches["program"] > 0.001


def test_an_agent_takes_longer_to_its_first_plan_than_a_bare_process_to_its_session(figures: startup.Figures) -> None:
    assert figures.ratio("agentd", startup.WARM) > 1


def test_the_tables_show_what_was_measured(figures: startup.Figures) -> None:
    every = startup.Figures(
        [startup.Start(one.name, state, one.seconds) for one in figures.starts for state in startup.STATES],
        dict.fromkeys(startup.STATES, figures.stretches[startup.WARM]),
    )
    text = startup.blocks(results.here("make bench", 0.0), every)["startup"]
    assert (
        text.count(f"{figures.of('agentd', startup.WARM).median:.2f} s ({figures.ratio('agentd', startup.WARM):.1f})")
        == 3
    )
    assert "startup" in startup.pictures(every)


def test_files_are_dropped_from_the_page_cache_if_nobody_uses_them(tmp_path: Path) -> None:
    file = tmp_path / "some"
    file.write_bytes(b"x" * 1_000_000)
    cache = dropped([file])
    assert cache.size == pytest.approx(1.0, abs=0.01)
    assert cache.left <= cache.size


def test_a_copy_of_the_code_has_byte_code_only_if_it_is_compiled(tmp_path: Path) -> None:
    compiled, plain = copied(tmp_path / "compiled", compiled=True), copied(tmp_path / "plain", compiled=False)
    assert list((compiled / "schemas").rglob("*.pyc"))
    assert not list(plain.rglob("*.pyc"))
