"""Small boards: their limits as the kernel keeps them, and what the page says of a flight that failed."""

from __future__ import annotations

import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks import results
from benchmarks.measurements import small_boards
from benchmarks.measurements.control_groups import ControlGroup, Limits, Usage, limited
from benchmarks.measurements.small_boards import BEAGLEBONE, BOARDS, FORMS, PI_3, Figures, Flown
from benchmarks.peers import PI_MB

BURN = "import time; e = time.monotonic() + 1\nwhile time.monotonic() < e: pass\nprint(time.process_time())"
EAT = "found = [bytearray(1_000_000) for _ in range(60)]; print('eaten')"


def _possible() -> bool:
    group = ControlGroup.made()
    if group is not None:
        group.remove()
    return group is not None


needs_groups = pytest.mark.skipif(not _possible(), reason="no control group can be made here")


def _run(group: ControlGroup, program: str) -> tuple[int, str]:
    command = group.command([sys.executable, "-I", "-S", "-c", program])
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=60, check=False)
    return done.returncode, done.stdout.strip()


@needs_groups
def test_a_process_gets_no_more_than_its_share_of_a_core() -> None:
    with limited(Limits(share=0.05)) as group:
        begun = time.monotonic()
        _, spent = _run(group, BURN)
        passed = time.monotonic() - begun
        assert 0 < float(spent) < 0.05 * passed + 0.3, "the bound has room for the first period"
        assert group.usage().throttled > 0


@needs_groups
def test_a_process_with_too_much_memory_is_killed_and_counted_and_another_is_not() -> None:
    with limited(Limits(memory=30)) as group:
        assert _run(group, EAT) == (-9, "")
        assert group.usage().killed == 1
    with limited(Limits(memory=300)) as group:
        assert _run(group, EAT) == (0, "eaten")
        usage = group.usage()
        assert usage.killed == 0
        assert 60 < usage.peak < 300


def test_a_group_of_version_2_is_told_its_limits_and_each_process_goes_to_a_core_of_its_own(tmp_path: Path) -> None:
    group = ControlGroup(tmp_path, tmp_path, 2)
    group.limit(Limits(memory=100, share=0.02, cores=2))
    written = {file.name: file.read_text() for file in tmp_path.iterdir()}
    assert written == {
        "memory.max": "100000000",
        "memory.swap.max": "0",
        "cpu.max": "1000 25000",
        "cgroup.subtree_control": "+cpu",
    }
    command = group.command(["true"])
    assert command[4:] == [str(tmp_path / "core-0" / "cgroup.procs"), "--", "true"]
    assert (tmp_path / "core-0" / "cpu.max").read_text() == "1000 50000"
    (tmp_path / "memory.current").write_text("42000000")
    (tmp_path / "memory.peak").write_text("43000000")
    (tmp_path / "memory.events").write_text("low 0\noom 1\noom_kill 1\n")
    (tmp_path / "cpu.stat").write_text("usage_usec 9\nthrottled_usec 1500000\n")
    (tmp_path / "core-0" / "cpu.stat").write_text("throttled_usec 500000\n")
    assert group.charged() == 42
    assert group.usage() == Usage(43, 2.0, 1)


def test_a_board_is_given_its_share_of_a_core_and_what_its_system_leaves() -> None:
    assert BEAGLEBONE.limits == Limits(384, 0.05, 1)
    assert PI_3.limits == Limits(PI_MB - 128, 0.069, 4)


def _figures() -> Figures:
    def flown(board: str, form: str, memory: float | None = None, share: float | None = None) -> Flown:
        return Flown(board, form, memory, share, 1, "a test", True, "", 5.0, 90.0, 70.0, 25.0, 3.0, 1.0, 0.1, 0)

    boards = [flown(board.title, form, 359.0, board.share) for board in BOARDS for form in FORMS]
    return Figures(boards, [flown("no limits", form) for form in FORMS], 6, 1.5)


def test_a_flight_that_failed_on_a_board_is_a_goal_that_is_missed() -> None:
    figures = _figures()
    assert [goal.met for goal in small_boards.goals(figures)] == [True, True]
    figures.boards[1] = replace(figures.boards[1], completed=False, why="out of memory")
    first, second = small_boards.goals(figures)
    assert (first.met, second.met) == (False, True)
    assert first.found == "three daemons: completed, 95 MB; `argosy board`: out of memory"
    assert first.why.startswith("`argosy board` held 95 MB at most and was held back for 1.0 s; ")
    assert (
        "(384 MB and 5% of a core here; no such board was at hand) | not completed |"
        in small_boards.in_short(figures)[0]
    )


def test_the_page_says_how_many_were_flown_at_once_and_what_is_not_modelled() -> None:
    text = small_boards.blocks(results.here("a test", 0.0), _figures())["small-boards"]
    assert "At most 6 flights were flown side by side, and their simulators; 1.5 cores" in text
    assert "were late by 0.10 s at worst" in text
    assert "Not modelled" in text
