"""`make bench`: a part that fails hurts no other, nothing that was started outlives it, and errors are one line."""

from __future__ import annotations

import signal
import textwrap
import time
from pathlib import Path

import psutil
import pytest

from benchmarks import __main__ as command
from benchmarks import apart, results
from benchmarks.parts import PARTS, Goal, Part, Told, line_of_goals, table_of_goals
from tests.support.processes import Daemon

GOOD = """
    from dataclasses import dataclass
    from benchmarks.parts import Goal
    @dataclass
    class Figures:
        speed: float
    def measure(quick):
        return Figures(7.0 if quick else 1.0)
    def blocks(origin, figures):
        return {"good": f"{origin.line()}\\n\\nspeed {figures.speed}"}
    def pictures(figures):
        return {}
    def goals(figures):
        return [Goal("speed", "at least 9", f"{figures.speed}", figures.speed >= 9, "for want of trying")]
"""
FAILS = """
    from benchmarks.processes import BenchmarkFailed
    def measure(quick):
        raise BenchmarkFailed("nothing flies")
"""
RAISES = "def measure(quick): return 1 / 0"
NEEDS = "import a_package_that_nobody_has"
HANGS = """
    import subprocess, sys, time
    from pathlib import Path
    BESIDE = "setsid sleep 600 >/dev/null 2>&1 & echo $!"
    def measure(quick):
        child = subprocess.Popen(["sleep", "600"])
        orphan = subprocess.run(["sh", "-c", BESIDE], capture_output=True, text=True, check=True).stdout
        pids = Path(__file__).with_suffix(".new")
        pids.write_text(f"{child.pid} {orphan}")
        pids.rename(pids.with_suffix(".pids"))
        while True:
            try:
                time.sleep(600)
            except KeyboardInterrupt:
                if not STUBBORN:
                    raise
"""


@pytest.fixture(autouse=True)
def _known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of these tests can be imported by the processes that measure them."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for name, text in (("good", GOOD), ("fails", FAILS), ("raises", RAISES), ("needs", NEEDS)):
        (tmp_path / f"fake_{name}.py").write_text(textwrap.dedent(text))
    for name, stubborn in (("hangs", False), ("stubborn", True)):
        (tmp_path / f"fake_{name}.py").write_text(f"{textwrap.dedent(HANGS)}\nSTUBBORN = {stubborn}\n")


def _parts(*names: str) -> list[Part]:
    return [Part(name, f"fake_{name}", 0.01) for name in names]


def _started(tmp_path: Path, name: str) -> list[int]:
    return [int(pid) for pid in (tmp_path / f"fake_{name}.pids").read_text().split()]


def _there(pids: list[int]) -> list[int]:
    return [pid for pid in pids if psutil.pid_exists(pid) and psutil.Process(pid).status() != psutil.STATUS_ZOMBIE]


def test_an_unknown_part_is_told_with_those_that_are_known(capfd: pytest.CaptureFixture[str]) -> None:
    assert command.main(["nonsense"], _parts("good", "fails")) == 2
    assert capfd.readouterr().err == "error: no part is called nonsense; there are good, fails\n"


def test_a_try_shows_blocks_and_goals_and_writes_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--quick"], _parts("good")) == 0
    out, err = capfd.readouterr()
    assert "speed 7.0" in out
    assert 'Measured by `make bench ARGS="good --quick"`' in out
    assert "| speed | at least 9 | 7.0 | **missed** for want of trying |" in out
    assert "[1 of 1] good: a try" in err
    assert not (results.RESULTS / "good.json").exists()


def test_parts_that_fail_are_told_in_a_line_and_the_others_go_on(capfd: pytest.CaptureFixture[str]) -> None:
    assert command.main(["--quick"], _parts("fails", "raises", "needs", "good")) == 1
    out, err = capfd.readouterr()
    assert "error: fails: nothing flies\n" in err
    assert "ZeroDivisionError" in err
    assert "error: needs: No module named 'a_package_that_nobody_has'\n" in err
    assert err.endswith("error: not measured: fails, raises, needs\n")
    assert "[4 of 4] good" in err
    assert "speed 7.0" in out


@pytest.mark.parametrize("name", ["stubborn"])
def test_a_part_that_takes_too_long_is_ended_with_all_that_it_has_started(
    name: str, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(apart, "LEAST", 4.0)
    monkeypatch.setattr(apart, "GRACE", 1.0)
    assert command.main(["--quick"], [*_parts(name), Part("good", "fake_good", 1)]) == 1
    out, err = capfd.readouterr()
    assert f"error: {name}: not done after 4 s\n" in err
    assert f"note: {name} left processes behind, ended: " in err
    pids = _started(tmp_path, name)
    assert len(pids) == 2
    assert _there(pids) == []
    assert "speed 7.0" in out, "the next part is measured all the same"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGKILL])
def test_nothing_outlives_the_command(number: int, tmp_path: Path) -> None:
    (tmp_path / "fake_command.py").write_text(
        "import signal, sys\n"
        "from benchmarks.__main__ import main\n"
        "from benchmarks.parts import Part\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "sys.exit(main(['--quick'], [Part('hangs', 'fake_hangs', 1), Part('good', 'fake_good', 1)]))\n"
    )
    bench = Daemon("fake_command", environment={"PYTHONPATH": str(tmp_path)})
    part: list[int] = []
    try:
        _until(lambda: (tmp_path / "fake_hangs.pids").exists(), "the part has started what it starts")
        children = psutil.Process(bench.process.pid).children()
        part = [one.pid for one in children if "benchmarks.measuring" in one.cmdline()]
        assert len(part) == 1
        bench.signal(number)
        code = bench.ends()
        if number == signal.SIGKILL:  # nobody is left to end what the part had started apart; the part itself goes
            _until(lambda: not _there(part), "the part ends with the command")
        else:
            assert code == 130
            assert bench.text.endswith("ended; parts that were done before are in benchmarks/results")
            assert "good" not in bench.text.partition("]")[2], "no other part is begun"
            assert _there(part + _started(tmp_path, "hangs")) == []
    finally:
        bench.kill()
        for pid in _there(part + _started(tmp_path, "hangs")):
            psutil.Process(pid).kill()


def _until(condition: object, wish: str) -> None:
    assert callable(condition)
    end = time.monotonic() + 30
    while not condition():
        assert time.monotonic() < end, wish
        time.sleep(0.05)


def test_work_of_others_is_seen_and_our_own_is_not_taken_for_it() -> None:
    before = results.moment()
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        pass
    now = results.moment()
    assert now.busy > before.busy
    assert 0.5 < (now.own - before.own) / (now.at - before.at) <= 1.1 or results.others(before) > 0.2
    assert results.others(before) <= (now.busy - before.busy) / (now.at - before.at)


def test_results_of_another_shape_are_told(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    results.save("good", results.here("x", 0.0), {"pace": 1}, tmp_path)
    monkeypatch.setattr(results.load, "__defaults__", (tmp_path,))
    monkeypatch.syspath_prepend(tmp_path)
    (part,) = _parts("good")
    assert not command._shown(part)
    assert capfd.readouterr().err == "error: good: Object missing required field `speed`\n"
    assert command.goals_of(part) == []


def test_goals_stand_with_the_part_whose_they_are() -> None:
    goals = [Goal("p50", "4x", "3x", True), Goal("p99", "4x", "5x", False, "the disk; tried: nothing")]
    rows = table_of_goals([Told("loop", "#the-decision-loop", goals), Told("mail", "", goals[:1], busy=True)])
    assert rows[-3] == "| [loop](#the-decision-loop) | p50 | 4x | 3x | met |"
    assert rows[-2] == "| [loop](#the-decision-loop) | p99 | 4x | 5x | **missed** the disk; tried: nothing |"
    assert rows[-1] == "| mail | p50 | 4x | 3x | met (busy machine) |"


def test_a_goal_that_cannot_be_decided_is_not_told_as_met_and_one_without_a_reason_is_told_so() -> None:
    assert line_of_goals([Goal("a", "1", "2", False, "both sides", decided=False)])[-1].endswith(
        "| **not decided** both sides |"
    )
    assert line_of_goals([Goal("a", "1", "2", False)])[-1].endswith("| **missed** (no reason is given) |")


def test_all_parts_take_as_long_as_the_page_says_and_each_has_a_name_of_its_own() -> None:
    assert 80 < sum(part.minutes for part in PARTS) < 100, (
        "docs/measurements/benchmarks.md says about an hour and a half"
    )
    assert len({part.name for part in PARTS}) == len(PARTS)
