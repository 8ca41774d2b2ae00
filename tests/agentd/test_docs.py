"""The Python in the documentation runs and does what it says."""

import re
from pathlib import Path
from typing import Any

import pytest

from agentd import Environment
from agentd.mind.data import registry
from tests.agentd.teams import Stage, played

PAGE = Path(__file__).parents[2] / "docs" / "guides" / "extending.md"


def _blocks(section: str) -> list[tuple[str, str]]:
    """The fenced blocks of a section: language and text."""
    text = PAGE.read_text(encoding="utf-8").split(f"\n## {section}\n")[1].split("\n## ")[0]
    return re.findall(r"^```(\w*)[^\n]*\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)


def _run(section: str) -> dict[str, Any]:
    """Run all Python of a section, one block after another; the names that it made."""
    names: dict[str, Any] = {}
    for number, (language, text) in enumerate(_blocks(section)):
        if language == "python":
            exec(compile(text, f"{section}:{number}", "exec"), names)
    return names


def test_the_embedded_mind_prints_what_its_page_shows(capsys: pytest.CaptureFixture[str]) -> None:
    _run("Minds in your own program")
    shown = [text for language, text in _blocks("Minds in your own program") if language == "text"]
    assert capsys.readouterr().out == "".join(shown)


def test_the_room_of_the_page_on_environments_is_one_to_live_in() -> None:
    room: type[Environment] = _run("Environments")["Room"]
    assert played(
        {
            "bob": """
            !s.
            +!s <- ?door(closed); open; ?door(open); !pull(3); !pull(30);
                   .nano_time(A); walk_to(hall); .nano_time(B); ?at(P); .print(P, " after ", (B - A) / 1000000000).
            +!pull(N) <- pull(N).
            -!pull(N)[reason(R)] <- .print(R).
            """
        },
        environment=room(),
    ) == ["[bob] the environment has no action pull/1", "[bob] the handle came off", "[bob] hall after 2"]


def test_the_actions_of_the_page_on_extending_work(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "ACTIONS", dict(registry.ACTIONS))
    monkeypatch.setattr(registry, "FUNCTIONS", dict(registry.FUNCTIONS))
    _run("Internal actions and functions")
    stage = Stage(
        {
            "bob": """
            !s.
            +!s : compass.near(80, east)
              <- .print(compass.opposite(90)); compass.near(190, P); .print(P);
                 .findall(Q, compass.point(Q, D) & D > 100, L); .print(L);
                 !!look; compass.settle(2); .print(settled); !wrong.
            +!look <- .wait(100); .suspended(s, R); .print("waits for ", R).
            +!wrong <- compass.near(x, P).
            -!wrong[error(E), error_msg(M)] <- .print(E, ": ", M).
            """
        }
    )
    stage.run()
    assert stage.lines == [
        "[bob] 270",
        "[bob] south",
        "[bob] [south,west]",
        "[bob] waits for compass",
        "[bob] settled",
        "[bob] wrong_arguments: compass.near takes degrees first",
    ]
    assert stage.clock.now() == 2.0
