"""Load an agent of a mission: compile its program and collect its settings.

The program is the .asl file, followed by the beliefs and goals of the mission file.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal
from zlib import crc32

from msgspec.structs import replace

from agentd.language.compiler.compile import CompiledProgram, DirectiveError, compile_program
from agentd.language.parse import parse_file, parse_formula, parse_program
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Belief, Formula, Goal, Item, Program
from agentd.trace.initial_state import Sources
from schemas.files.findings import Finding, Findings
from schemas.files.text_files import near_file
from schemas.files.yaml_positions import Steps
from schemas.manifest.loader import load_manifest
from schemas.mission.model import Mission

DECISIONS = 200
"""Decisions and failures that an agent remembers by default."""


@dataclass(frozen=True)
class Part:
    """What an agent is made of: its program, its robot and its settings in the mission."""

    name: str
    program: CompiledProgram
    robot: str | None = None
    done: dict[str, Formula] = field(default_factory=dict)
    failed: dict[str, Formula] = field(default_factory=dict)
    seed: int = 0
    """Of the run; that of the agent is `own_seed`."""
    on_restart: Goal | None = None
    """The goal to pursue after a restart instead of its pending goals."""
    decisions: int = DECISIONS
    """Number of its last decisions that the agent remembers; 0: none."""
    names_variables: bool = False
    """Whether the robot takes a free variable in an action by its name (`values = "text"` in its manifest)."""
    digest: bytes = b""
    """Digest of the program."""
    robot_elsewhere: str | None = None
    """The board of its robot, if that is another one than its own."""
    presence: bool = False
    """Whether it has the beliefs `online(Agent)[board(B)]`."""
    inject: bool = False
    """Whether operators may pause it and give it goals and beliefs."""
    sources: Sources | None = None
    """The texts of its program."""

    @property
    def own_seed(self) -> int:
        """Seed of this agent's random numbers: different for each agent of a run, the same in each process."""
        return self.seed + crc32(self.name.encode())


def prepare(mission: Mission, agent: str, seed: int, decisions: int = DECISIONS) -> Part:
    """Load an agent of a mission. Raises Findings with all mistakes of its program.

    `seed` is any integer, `decisions` the number of last decisions that the agent remembers, 0 or more.
    """
    spec = mission.agents[agent]
    as_text, elsewhere = False, None
    if spec.robot is not None:
        robot = mission.robots[spec.robot]
        named = robot.manifest
        as_text = not isinstance(named, str) or load_manifest(named, mission.path.parent).robot.values == "text"
        elsewhere = robot.board if robot.board != spec.board else None
    endings_here = (ending for ending in (*mission.done, *mission.failed) if ending.agent == agent)
    sources = Sources(
        main=str(mission.relative(spec.program)),
        mission=mission.positions.file,
        beliefs=tuple(spec.beliefs),
        goals=tuple(spec.goals),
        on_restart=spec.on_restart if spec.on_restart.strip().startswith("goal(") else "",
        formulas=tuple(ending.formula for ending in endings_here),
    )
    program = _compiled(compose(mission, agent, sources.parse_file), sources)
    text = repr((program.beliefs, program.goals, program.plans))
    return Part(
        agent,
        program,
        spec.robot,
        done=endings(mission, agent, "done"),
        failed=endings(mission, agent, "failed"),
        seed=seed,
        on_restart=restart_goal(mission, agent),
        decisions=decisions,
        names_variables=as_text,
        digest=hashlib.sha256(text.encode(errors="replace")).digest(),
        robot_elsewhere=elsewhere,
        presence=spec.presence,
        inject=mission.inject,
        sources=sources,
    )


def _compiled(program: Program, sources: Sources) -> CompiledProgram:
    """Compile a program. Raises Findings for a bad directive, or an included file that does not parse."""
    try:
        return compile_program(program, sources.parse_file)
    except SyntaxErrors as errors:
        raise Findings(errors.findings) from None
    except DirectiveError as error:
        where = error.position
        raise Findings([Finding(where.file, where.line, where.column, error.message)]) from None


def compose(
    mission: Mission, agent: str, read: Callable[[Path], Program] = parse_file, *, located: bool = False
) -> Program:
    """Return the program of an agent: its file, parsed by `read`, with the beliefs and goals of the mission file.

    `located`: these have their positions in that file, for findings; in a running program they do not depend on the
    rest of the mission. Raises Findings with all mistakes.
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
        kind = "a folder, not a program" if path.is_dir() else "no regular file (a pipe, socket or device)"
        why = f"{path} is {kind}" if path.exists() else f"there is no file {path}{near_file(path)}"
        findings.append(mission.positions.finding(where, f"agents.{agent}.program: {why}"))
    for index, text in enumerate(spec.beliefs):
        items += _item(mission, ("agents", agent, "beliefs", index), text, Belief, findings, located)
    try:
        restart_goal(mission, agent)
    except Findings as wrong:
        findings += wrong.findings
    for index, text in enumerate(spec.goals):
        items += _item(mission, ("agents", agent, "goals", index), _as_goal(text), Goal, findings, located)
    if findings:
        raise Findings(findings)
    return replace(program, items=(*program.items, *items))


def _as_goal(text: str) -> str:
    """Return a goal with its `!`, which the mission file may leave out."""
    return "!" + text.strip().lstrip("!")


def _item(
    mission: Mission,
    steps: Steps,
    text: str,
    kind: type[Belief] | type[Goal],
    findings: list[Finding],
    located: bool = False,
) -> tuple[Item, ...]:
    """Parse one belief or goal of the mission file."""
    try:
        found = read_item(text, mission.positions.file, kind, mission.positions.of(steps) if located else None)
    except SyntaxErrors as errors:  # their lines and columns are those of this text
        what = "belief" if kind is Belief else "goal"
        findings.append(mission.positions.finding(steps, f"in the {what} `{text}`: {errors.findings[0].message}"))
        return ()
    if not found:
        what = "belief such as `rescuers(2)`" if kind is Belief else "goal such as `fly_mission`"
        findings.append(mission.positions.finding(steps, f"`{text}`: expected one {what}"))
    return found


def read_item(
    text: str, file: str, kind: type[Belief] | type[Goal], at: tuple[int, int] | None = None
) -> tuple[Item, ...]:
    """Parse one belief or goal of a mission file; empty if the text is something else. Raises SyntaxErrors.

    ``at``: line and column of the text in that file; None = positions are those in the text itself.
    """
    found = parse_program(text.strip().removesuffix(".") + ".", file, at).items
    return found if len(found) == 1 and isinstance(found[0], kind) else ()


def recorded_program(main: Program, beliefs: Iterable[str], goals: Iterable[str], file: str) -> Program:
    """Return a program with the beliefs and goals of a mission file that was accepted before. Raises SyntaxErrors."""
    items: list[Item] = [*main.items]
    for text in beliefs:
        items += read_item(text, file, Belief)
    for text in goals:
        items += read_item(_as_goal(text), file, Goal)
    return replace(main, items=tuple(items))


def goal_of(on_restart: str) -> str:
    """Return the goal of `goal(g)` with its `!`; empty if the text has another form."""
    text = on_restart.strip()
    inner = text.removeprefix("goal(").removesuffix(")").strip().lstrip("!")
    return f"!{inner}" if inner and text.startswith("goal(") and text.endswith(")") else ""


def restart_goal(mission: Mission, agent: str) -> Goal | None:
    """Return the goal of `on_restart: goal(g)`, None for other settings. Raises Findings for an invalid goal."""
    text = mission.agents[agent].on_restart.strip()
    if not text.startswith("goal("):
        return None
    steps = ("agents", agent, "on_restart")
    findings: list[Finding] = []
    items: tuple[Item, ...] = ()
    if goal := goal_of(text):
        items = _item(mission, steps, goal, Goal, findings)
    else:
        findings.append(mission.positions.finding(steps, f"`{text}`: expected a goal such as `goal(recover)`"))
    if findings:
        raise Findings(findings)
    return items[0] if isinstance(items[0], Goal) else None


def endings(mission: Mission, agent: str, field: Literal["done", "failed"]) -> dict[str, Formula]:
    """Return the `done` or `failed` formulas of an agent by their texts. Raises Findings for invalid ones."""
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
