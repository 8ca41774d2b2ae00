"""How a mission of agents is flown by the imperative programs instead: the same file with `clients` in their place."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import yaml

from schemas.mission.model import Agent, Mission, load_mission
from schemas.wire import term_text
from schemas.wire.terms import Atom, Structure, Term

PROGRAMS: Final = {
    "uav": ("single_uav", "mission done"),
    "scout": ("scout", "all are rescued"),
    "rescuer": ("rescuer", "resting"),
}
"""For each AgentSpeak program the imperative one, and what it says last when its part of the mission is done.

A rescuer that rests may be called again, and says so: the mission is done when these are the last lines of all.
"""


@dataclass(frozen=True)
class Program:
    """An imperative program in the place of an agent."""

    name: str
    board: str
    robot: str | None
    argv: tuple[str, ...]
    """It is ended by SIGINT, if it does not end by itself; in both cases its exit code is 0 when it has not failed."""
    done: str


def variant(original: Path, folder: Path, *, speed: float) -> Path:
    """Write a mission into a folder with its agents as clients, and all else as it was; returns the file.

    A client knows the speed only from the file. Raises Findings for a bad mission.
    """
    mission = load_mission(original)
    raw: dict[str, Any] = yaml.safe_load(mission.path.read_text(encoding="utf-8"))
    raw["clients"] = {name: {"board": agent.board, "robot": agent.robot} for name, agent in mission.agents.items()}
    raw |= {"agents": {}, "speed": speed}
    for name in ("done", "failed"):  # formulas over beliefs, which no program has
        raw.pop(name, None)
    for robot in raw["robots"].values():
        if (file := mission.relative(robot["manifest"])).is_file():
            robot["manifest"] = str(file.resolve())
    file = folder / mission.path.name
    file.write_text(yaml.safe_dump(raw, sort_keys=False), encoding="utf-8")
    return file


def programs(mission: Mission, file: Path, router_of: Callable[[str], str]) -> list[Program]:
    """Return the programs that fly a mission of agents by its variant `file`; `router_of` a board is its endpoint."""
    return [_program(name, agent, file, router_of(agent.board)) for name, agent in mission.agents.items()]


def _program(name: str, agent: Agent, file: Path, router: str) -> Program:
    module, done = PROGRAMS[Path(agent.program).stem]
    argv = (sys.executable, "-u", "-m", "benchmarks.imperative", module, str(file), name, router)
    return Program(name, agent.board, agent.robot, argv + tuple(map(_setting, agent.beliefs)), done)


def _setting(belief: str) -> str:
    """Return a belief as a program takes it: `height(10)` is `height=10`."""
    match term_text.read(belief):
        case Structure(functor, (value,)):
            return f"{functor}={json.dumps(_plain(value))}"
        case Structure(functor, values):
            return f"{functor}={json.dumps([_plain(value) for value in values])}"
    raise ValueError(f"{belief}: expected a fact with values")


def _plain(term: Term) -> Any:
    match term:
        case Atom(name):
            return name
        case list():
            return [_plain(one) for one in term]
    return term
