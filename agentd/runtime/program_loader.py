"""An agent's program as its mission composes it: the .asl file, then the beliefs and goals of the mission file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Literal

from agentd.language.parse import parse_file, parse_formula, parse_program
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Belief, Formula, Goal, Item, Program
from schemas.files.findings import Finding, Findings
from schemas.files.yaml_positions import Steps
from schemas.mission.model import Mission


def compose(mission: Mission, agent: str, read: Callable[[Path], Program] = parse_file) -> Program:
    """Return the program of an agent of a mission; `read` reads its file.

    Raises Findings with everything that is wrong with it.
    """
    spec = mission.agents[agent]
    findings: list[Finding] = []
    items: list[Item] = []
    path = mission.relative(spec.program)
    program = Program(str(path))
    if path.is_file():
        try:
            program = read(path)
        except SyntaxErrors as errors:
            findings += errors.findings
    else:
        where = ("agents", agent, "program")
        findings.append(mission.positions.finding(where, f"agents.{agent}.program: there is no file {path}"))
    for index, text in enumerate(spec.beliefs):
        items += _item(mission, ("agents", agent, "beliefs", index), text, Belief, findings)
    _restart_goal(mission, agent, findings)
    for index, text in enumerate(spec.goals):
        items += _item(mission, ("agents", agent, "goals", index), "!" + text.strip().lstrip("!"), Goal, findings)
    if findings:
        raise Findings(findings)
    return replace(program, items=(*program.items, *items))


def _item(
    mission: Mission, steps: Steps, text: str, kind: type[Belief] | type[Goal], findings: list[Finding]
) -> tuple[Item, ...]:
    """Read one belief or goal that stands in the mission file."""
    try:
        found = read_item(text, mission.positions.file, kind)
    except SyntaxErrors as errors:
        findings.append(mission.positions.finding(steps, f"`{text}`: {errors.findings[0].message}"))
        return ()
    if not found:
        what = "belief such as `rescuers(2)`" if kind is Belief else "goal such as `fly_mission`"
        findings.append(mission.positions.finding(steps, f"`{text}`: expected one {what}"))
        return ()
    return found


def read_item(text: str, file: str, kind: type[Belief] | type[Goal]) -> tuple[Item, ...]:
    """Read one belief or goal that stands in a mission file; nothing if it is something else. Raises SyntaxErrors."""
    found = parse_program(text.strip().removesuffix(".") + ".", file).items
    return found if len(found) == 1 and isinstance(found[0], kind) else ()


def restart_goal(mission: Mission, agent: str) -> Goal | None:
    """Return the goal of `on_restart: goal(g)`, None if it is something else. Raises Findings for one that is none."""
    findings: list[Finding] = []
    goal = _restart_goal(mission, agent, findings)
    if findings:
        raise Findings(findings)
    return goal


def _restart_goal(mission: Mission, agent: str, findings: list[Finding]) -> Goal | None:
    text = mission.agents[agent].on_restart.strip()
    if not text.startswith("goal("):
        return None
    steps = ("agents", agent, "on_restart")
    inner = text.removeprefix("goal(").removesuffix(")").strip().lstrip("!")
    if not (text.endswith(")") and inner):
        findings.append(mission.positions.finding(steps, f"`{text}`: expected a goal such as `goal(recover)`"))
        return None
    items = _item(mission, steps, f"!{inner}", Goal, findings)
    return items[0] if items and isinstance(items[0], Goal) else None


def endings(mission: Mission, agent: str, field: Literal["done", "failed"]) -> dict[str, Formula]:
    """Return the `done` or `failed` formulas of this agent, by text. Raises Findings for one that does not parse."""
    formulas: dict[str, Formula] = {}
    findings: list[Finding] = []
    for index, ending in enumerate(mission.done if field == "done" else mission.failed):
        if ending.agent != agent:
            continue
        try:
            formulas[ending.formula] = parse_formula(ending.formula, mission.positions.file)
        except SyntaxErrors as errors:
            message = f"`{ending.formula}`: {errors.findings[0].message}"
            findings.append(mission.positions.finding((field, index), message))
    if findings:
        raise Findings(findings)
    return formulas
