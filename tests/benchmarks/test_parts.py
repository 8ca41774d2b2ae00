"""What parts of the benchmarks are made of: spreads, places of blocks, blocks of several parts."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from benchmarks import pages, results
from benchmarks.measurements import webpage as page
from benchmarks.measurements.board import Figures, Flown, Row, blocks, goals
from benchmarks.parts import Part
from benchmarks.processes import BenchmarkFailed
from benchmarks.spread import Spread, spread


def test_a_spread_tells_where_values_lie() -> None:
    assert spread([float(value) for value in range(200, 0, -1)]) == Spread(200, 100.5, 101, 199, 200)
    assert spread([3.0]) == Spread(1, 3, 3, 3, 3)
    with pytest.raises(ValueError, match="no values"):
        spread([])


def test_a_block_is_linked_by_the_heading_above_it(tmp_path: Path) -> None:
    (tmp_path / "docs").mkdir()
    (tmp_path / "README.md").write_text("# A\n<!-- figures a -->\n<!-- end of figures -->\n")
    (tmp_path / "docs" / "x.md").write_text(
        "# Page\n<!-- figures a -->\n<!-- end of figures -->\n"
        "## Start, and `memory`\n\n<!-- figures b -->\n<!-- end of figures -->\n"
    )
    assert pages.section("a", tmp_path) == "../x.md"
    assert pages.section("b", tmp_path) == "../x.md#start-and-memory"
    with pytest.raises(KeyError, match="c"):
        pages.section("c", tmp_path)


def test_where_there_is_no_browser_the_page_says_so_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(BenchmarkFailed, match=r"^no chromium on this machine: sudo apt install chromium$"):
        page.measure(True)


def _git(root: Path, *arguments: str) -> None:
    who = ("-c", "user.name=a", "-c", "user.email=a@b.c", "-c", "commit.gpgsign=false")
    subprocess.run(["git", *who, *arguments], cwd=root, check=True, capture_output=True)


def _commit(root: Path, file: str) -> str:
    (root / file).parent.mkdir(parents=True, exist_ok=True)
    (root / file).write_text(file)
    _git(root, "add", ".")
    _git(root, "commit", "-qm", file)
    return results.revision(root)


def test_code_that_is_new_or_changes_while_it_is_measured_belongs_to_no_revision(tmp_path: Path) -> None:
    assert results.revision(tmp_path) == "unknown"
    _git(tmp_path, "init", "-q")
    first = _commit(tmp_path, "agentd/a.py")
    assert re.fullmatch("[0-9a-f]{7}", first)
    assert results.told_revision(first, first, tmp_path) == first
    page = _commit(tmp_path, "docs/page.md")
    assert results.told_revision(first, page, tmp_path) == first, "a page is no code"
    (tmp_path / "benchmarks" / "results").mkdir(parents=True)
    (tmp_path / "benchmarks" / "results" / "mail.json").write_text("{}")
    assert results.revision(tmp_path) == page, "nor are results"
    (tmp_path / "benchmarks" / "new.asl").write_text("!a.")
    assert results.revision(tmp_path) == f"{page}+", "a file that git does not know can be measured, too"
    assert results.told_revision(page, f"{page}+", tmp_path) == f"{page}+"
    code = _commit(tmp_path, "benchmarks/new.asl")
    assert results.told_revision(page, code, tmp_path) == f"{page}+"


def _flown(pss: list[float]) -> Flown:
    return Flown(1, 16, pss, [65.5], 6.0)


def test_a_board_is_held_against_its_goal_at_its_highest() -> None:
    figures = Figures([Row("a board", _flown([87.0]), _flown([50.0, 61.0]))])
    (goal,) = goals(figures)
    assert (goal.found, goal.met) == ("61.0 MB", False)
    assert goal.why.startswith("three daemons hold 87.0 MB; ")
    block = blocks(results.here("make bench", 0.0), figures)["board"]
    assert "| `argosy board` | 1 | 16 | 55.5 (61.0) | 65.5 (65.5) | 6 % | **missed** |" in block


def test_what_is_told_of_boards_beside_the_papers_comes_from_results(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(results.load, "__defaults__", (tmp_path,))
    table = [Part("board", "benchmarks.measurements.board", 1)]
    paper = pages.of_several(table)["comparison-board"]
    assert "412 to 451 MB" in paper, "the paper's 393 to 430 MiB"
    assert "Argosy" not in paper, "nothing was measured yet"
    figures = Figures([Row("a board", _flown([87.4]), _flown([51.0]))])
    results.save("board", results.here("make bench", 0.0), figures, tmp_path)
    assert (
        "| Argosy, one process in flight | 51 MB (PSS); 66 MB if nothing else"
        in pages.of_several(table)["comparison-board"]
    )
