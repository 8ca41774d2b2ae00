"""What a beginner reads when a plan fails: the exact text of each situation of `tests/agentd/failure_reports`."""

from pathlib import Path

import pytest

from agentd.conversion.log_format import lines_of
from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program
from agentd.mind import Mind
from agentd.mind.data.effects import Log, PerformAction
from agentd.mind.data.inputs import ActionDone
from tests.agentd.minds import World

FOLDER = Path(__file__).parents[1] / "failure_reports"
SITUATIONS = sorted(FOLDER.glob("*.asl"))


def report(source: Path, folder: Path, decisions: int = 0) -> str:
    """Everything that is reported while a program runs, as `agentd run` shows it."""
    path = folder / "fly.asl"
    path.write_text(source.read_text())
    program = compile_program(parse_program(path.read_text(), str(path)))
    world = World(Mind("bob", program, agents=lambda: ["bob", "ann"], decisions=decisions)).settle()
    for action in world.of(PerformAction):
        name = action.name
        reason = "PreArm: need 3D fix" if name == "takeoff" else f"there is no environment that could perform {name}"
        world.feed(ActionDone(action.id, False, reason, "refused" if name == "takeoff" else ""))
    text = "".join(f"{line}\n" for note in world.of(Log) for line in lines_of(note))
    return text.replace(str(path), "fly.asl")


@pytest.mark.parametrize("situation", SITUATIONS, ids=lambda path: path.stem)
def test_a_failure_is_reported_in_these_words(situation: Path, tmp_path: Path) -> None:
    assert report(situation, tmp_path) == situation.with_suffix(".txt").read_text()


def test_recording_decisions_changes_no_report(tmp_path: Path) -> None:
    """The reasons that are found afterwards are those that a mind with records has noted."""
    for situation in SITUATIONS:
        if ".random" not in situation.read_text():  # asked once only, so without a record nobody knows
            assert report(situation, tmp_path, decisions=50) == report(situation, tmp_path), situation.stem
