"""The texts of docs/guides/why.md: a failed context, a failed action, dropped events, a message never answered."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.argosy.why.asked import agent, eventually, told
from tests.support.processes import running

PAGE = (Path(__file__).parents[3] / "docs/guides/why.md").read_text(encoding="utf-8")
SHOWN = {
    title: (program, text)
    for title, program, text in re.findall(
        r"^\*\*(.*?)\*\*.*?^```asl\n(.*?)^```\n\n```text\n(.*?)^```\n", PAGE, re.MULTILINE | re.DOTALL
    )
    if text.startswith("$ argosy why")
}
FLYING = """\
mission: why
agents:
  uav: {program: uav.asl, robot: uav1}
robots:
  uav1:
    manifest: copter
    link: udpin:127.0.0.1:PORT
    simulate: {vehicle: copter, home: [-27.604033, -48.518363, 21.0]}
done: "uav: state(_, _, true)"
speed: 5
"""
TEAM = """\
mission: why
boards: {pi1: {}, pi2: {}}
agents:
  uav: {program: uav.asl, board: pi1}
  base: {program: base.asl, board: pi1}
  boat: {program: base.asl, board: pi2}
done: "uav: never"
"""


def page(title: str) -> tuple[str, list[tuple[list[str], str]]]:
    """The program that the page shows, and each command with what it says."""
    program, text = SHOWN[title]
    asked = re.split(r"^\$ argosy why (.*)\n", text, flags=re.MULTILINE)[1:]
    commands = [command.replace("'", "").split() for command in asked[::2]]
    return program, list(zip(commands, [said.strip() + "\n" for said in asked[1::2]], strict=True))


def test_the_page_shows_what_it_should() -> None:
    assert list(SHOWN) == [
        "No plan could be chosen.",
        "An action failed.",
        "A plan was dropped.",
        "Events were dropped.",
        "A message is not answered.",
    ]


@pytest.mark.parametrize("title", ["No plan could be chosen.", "A plan was dropped.", "Events were dropped."])
def test_the_page_tells_why(title: str, tmp_path: Path, endpoint: str) -> None:
    program, [(command, said)] = page(title)
    with agent(tmp_path, endpoint, program):
        assert eventually(lambda: told(endpoint, *command), lambda text: text == said) == said


def test_the_page_tells_why_an_action_failed(tmp_path: Path, endpoint: str, free_port: Callable[[], int]) -> None:
    program, [(command, said)] = page("An action failed.")
    mission = FLYING.replace("PORT", str(free_port()))
    with agent(tmp_path, endpoint, program, mission=mission) as daemon:
        path = str(tmp_path / "why.yaml")
        with (
            running("bridged", "serve", path, "--state", str(tmp_path / "state"), "--router", endpoint),
            running("argosy", "simulate", path),
        ):
            daemon.says("takeoff(5) fails")
            text = eventually(lambda: told(endpoint, *command), lambda text: text == said, 15)
            mode = told(endpoint, "uav", "set_mode")
    assert text == said
    assert mode == (
        'S s ago (mission second T): the action set_mode("GUIDED") started, and S s later it succeeded.\n'
        "  It is at uav.asl:2, in the plan +!fly(H) (uav.asl:2).\n"
    )


def test_the_page_tells_where_a_question_is(tmp_path: Path, endpoint: str) -> None:
    program, [(command, said)] = page("A message is not answered.")
    program, _, other = program.partition("// base.asl\n")
    (tmp_path / "base.asl").write_text(other)
    with agent(tmp_path, endpoint, program, "uav", "base", mission=TEAM, board=("--board", "pi1")):
        assert eventually(lambda: told(endpoint, *command), lambda text: text == said, 15) == said
