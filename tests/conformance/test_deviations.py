"""The deviations from Jason as `docs/reference/language.md` lists them: the program of each row does what the row
says."""

import re
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from agentd.process import DEEPEST_CALLS
from agentd.runtime.program_paths import SourcePaths
from agentd.standalone.standalone_team import Team, VirtualClock

PAGE = Path(__file__).parents[2] / "docs/reference/language.md"
_CELL = re.compile(r"(?<!\\)\|")
_CODE = re.compile(r"`([^`]+)`")


class Row(NamedTuple):
    """A deviation: its program, the lines that it prints, and parts of what the log says."""

    name: str
    program: str
    prints: list[str]
    logged: list[str]


def _rows() -> list[Row]:
    section = PAGE.read_text(encoding="utf-8").partition("## Where Argosy differs on purpose")[2].partition("\n#")[0]
    table = [line for line in section.splitlines() if line.startswith("|")]
    return [_row(line) for line in table if not line.startswith(("| |", "|---"))]


def _row(line: str) -> Row:
    _, name, _, _, program, prints, _ = _CELL.split(line)
    printed, *logged = prints.split("; logged: ")
    return Row(
        name.strip(), "\n".join(_codes(program)), _codes(printed), [code for part in logged for code in _codes(part)]
    )


def _codes(cell: str) -> list[str]:
    return [code.replace("\\|", "|") for code in _CODE.findall(cell)]


ROWS = _rows()


def test_every_row_has_a_number_of_its_own_and_a_program_with_what_it_shows() -> None:
    assert [row.name for row in ROWS] == [f"D{number}" for number in range(1, len(ROWS) + 1)]
    assert len(ROWS) >= 21
    assert all(row.program and (row.prints or row.logged) for row in ROWS)


@pytest.mark.parametrize("row", ROWS, ids=[row.name for row in ROWS])
def test_a_program_of_the_table_does_what_its_row_says(
    row: Row, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bob.asl").write_text(row.program)
    printed: list[str] = []
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(max(limit, DEEPEST_CALLS))
    try:
        paths = SourcePaths()
        program = paths.compiled("bob.asl")
        team = Team([("bob", program)], out=printed.append, paths=paths, clock=VirtualClock(), folders=[tmp_path])
        assert team.run(60, True) == 0
    finally:
        sys.setrecursionlimit(limit)
    assert "".join(printed) == "".join(f"[bob] {line}\n" for line in row.prints)
    log = capsys.readouterr().err
    for part in row.logged:
        assert part in log
