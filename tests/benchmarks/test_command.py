"""`make bench`: a part that fails hurts no other, and errors are one line."""

import textwrap
from pathlib import Path

import pytest

from benchmarks import __main__ as command
from benchmarks import pages, results
from benchmarks.parts import PARTS, Part

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


@pytest.fixture(autouse=True)
def _known(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parts of these tests can be imported by the processes that measure them."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for name, text in (("good", GOOD), ("fails", FAILS), ("raises", RAISES), ("needs", NEEDS)):
        (tmp_path / f"fake_{name}.py").write_text(textwrap.dedent(text))


def _parts(*names: str) -> list[Part]:
    return [Part(name, f"fake_{name}", 0.01) for name in names]


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


def test_results_of_another_shape_are_told(
    capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    results.save("good", results.here("x", 0.0), {"pace": 1}, tmp_path)
    monkeypatch.setattr(results.load, "__defaults__", (tmp_path,))
    monkeypatch.syspath_prepend(tmp_path)
    (part,) = _parts("good")
    assert not command._write_part(part)
    assert capfd.readouterr().err == "error: good: Object missing required field `speed`\n"
    assert pages.found_of(part) is None


def test_all_parts_take_as_long_as_the_page_says_and_each_has_a_name_of_its_own() -> None:
    assert 100 < sum(part.minutes for part in PARTS) < 130, "docs/measurements/benchmarks.md says about two hours"
    assert len({part.name for part in PARTS}) == len(PARTS)
