"""Every mistake in a mission and its programs is told in its own words at its place; the words stand in one file."""

import re
from pathlib import Path

import pytest

from argosy.__main__ import main
from argosy.check.command import at_start, check_mission
from tests.argosy.check import test_check, test_fleet_rules

MISTAKES = Path(__file__).parents[2] / "data" / "mission_mistakes.txt"
"""Changes of a mission's files, `FILE: TEXT -> NEW TEXT`, and below them what `argosy check` says of it."""
CHANGE = re.compile(r"(\S+): (.*?) ?-> (.*)")
MISSIONS = {
    "survey.yaml": {"survey.yaml": test_check.MISSION, "scout.asl": test_check.PROGRAM},
    "pair.yaml": {
        "pair.yaml": test_fleet_rules.MISSION,
        "one.asl": test_fleet_rules.ONE,
        "two.asl": test_fleet_rules.TWO,
    },
}


def test_each_mistake_is_told_as_written_down_at_its_place(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shown = []
    for number, block in enumerate(MISTAKES.read_text(encoding="utf-8").split("\n\n")):
        changes = [line for line in block.splitlines() if not line.startswith("    ")]
        folder = tmp_path / str(number)
        folder.mkdir()
        mission = changed(folder, changes)
        shown.append("\n".join((*changes, *(f"    {line}" for line in told(mission, capsys)))))
    assert "\n\n".join(shown) + "\n" == MISTAKES.read_text(encoding="utf-8")


def changed(folder: Path, changes: list[str]) -> Path:
    """Write the mission of the changed files into a folder, changed so; return its file."""
    parts = [found.groups() for found in map(CHANGE.fullmatch, changes) if found is not None]
    assert len(parts) == len(changes), changes
    (name,) = (name for name, files in MISSIONS.items() if parts[0][0] in files)
    files = dict(MISSIONS[name])
    for file, old, new in ((file, *(text.replace(r"\n", "\n") for text in texts)) for file, *texts in parts):
        assert old in files.get(file, ""), file
        files[file] = files.get(file, "").replace(old, new) if old else new
    for file, text in files.items():
        (folder / file).write_text(text)
    return folder / name


def told(mission: Path, capsys: pytest.CaptureFixture[str]) -> list[str]:
    """What `argosy check` says of a mission, files without their folder, and whether it could start all the same."""
    code = main(["check", str(mission)])
    lines = (
        capsys.readouterr().err.replace(f"{mission.parent}/", "").replace(str(mission.parent), "FOLDER").splitlines()
    )
    assert code == (2 if any(": error: " in line for line in lines) else 0)
    starts = all(one.severity == "warning" for one in at_start(check_mission(mission)[1]))
    return [*lines, "it starts all the same"] if code and starts else lines
