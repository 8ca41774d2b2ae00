"""`argosy check`: check a mission and all files that it names, and report every mistake in one run."""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from agentd.check.command import Robot, findings_of
from agentd.check.external_knowledge import RAISED_BY_AGENTD, Elsewhere, from_team
from agentd.check.finding_kinds import FAILS_WHERE_REACHED, Kind, finding
from agentd.check.programs import Includes, Surveyed, included_by_rest, read_survey
from agentd.check.symbol_table import Survey
from agentd.language.compiler.compile import DirectiveError
from agentd.language.parse import parse_file, parse_literal
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import And, Directive, Formula, Not, Or, Program, Structure
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.language.syntax_tree.traversal import walk
from agentd.process import loading_notice
from agentd.runtime.program_loader import compose, endings
from agentd.runtime.program_paths import SourcePaths
from argosy.check.fleet_rules import check_boards, check_team
from argosy.check.plan_files import check_plans
from argosy.processes.mavlink_links import check_links, group_of
from argosy.processes.simulators import check_simulations, only_real
from bridged.bridge.robot_setup import prepare
from bridged.drivers.mavlink.vehicle.flight_modes import simulated_table
from bridged.drivers.registry import load_robot_manifest
from commd.process.process import EXIT_BAD_INPUT, EXIT_DONE
from schemas.files.findings import Finding, Findings, near_miss
from schemas.files.shipped_files import mission_file
from schemas.files.text_files import read_bounded
from schemas.files.yaml_positions import Positions, Steps, read_yaml
from schemas.humanize import count
from schemas.manifest.loader import Manifest
from schemas.manifest.rules import BRIDGE_ACTION_ARITIES, BRIDGE_PERCEPTS
from schemas.mission import model as mission_model
from schemas.mission.model import Ending, Limits, Mission, load_mission

MISSING_BELIEFS = frozenset((Kind.BELIEF_NEVER_ADDED.label, Kind.UNKNOWN_PERCEPT.label))
_FIELDS: tuple[Literal["done", "failed"], ...] = ("done", "failed")


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy check`."""
    parser.add_argument("mission", nargs="+", help="mission file")
    parser.add_argument("--json", action="store_true", help="print findings as a JSON array")


def run(args: Namespace) -> int:
    """Check missions. Returns 0 if none has an error, 2 otherwise."""
    findings: list[Finding] = []
    results: list[str] = []
    for path in args.mission:
        with loading_notice([path]):
            mission, found = check_mission(path)
        if mission is not None:
            found = sorted([*found, *_only_real(mission), *check_boards(mission)])
        findings += [one for one in found if one not in findings]
        results.append(f"{path}: {_result(mission, found)}")
    errors = sum(finding.severity == "error" for finding in findings)
    if args.json:
        fields = ("file", "line", "column", "severity", "message")
        print(json.dumps([{name: getattr(finding, name) for name in fields} for finding in findings], indent=2))
    else:
        for finding in findings:
            print(finding, file=sys.stderr)
        if len(results) > 1 or not errors:  # for a single file with errors the findings are enough
            print("\n".join(results))
    return EXIT_BAD_INPUT if errors else EXIT_DONE


def _only_real(mission: Mission) -> list[Finding]:
    findings = []
    for name, why in only_real(mission).items():
        text = f"{why}: this robot can only be flown with --real {','.join(group_of(mission, name))}"
        findings.append(mission.positions.finding(("robots", name, "link"), text))
    return [replace(finding, severity="warning") for finding in findings]


def _result(mission: Mission | None, found: list[Finding]) -> str:
    errors = sum(finding.severity == "error" for finding in found)
    if mission is None or errors:
        return count(errors, "error")
    contents = (("agent", mission.agents), ("robot", mission.robots), ("done formula", mission.done))
    return "ok: " + ", ".join(count(len(things), name) for name, things in contents)


def at_start(findings: Iterable[Finding]) -> list[Finding]:
    """Return findings as starting a mission judges them: an error that keeps no agent from starting is a warning."""
    return [
        replace(one, severity="warning") if one.severity == "error" and one.kind in FAILS_WHERE_REACHED else one
        for one in findings
    ]


def check_mission(path: str | Path, *, restarts: bool = False) -> tuple[Mission | None, list[Finding]]:
    """Return the mission, if it can be read at all, and everything that is wrong with it and with what it names.

    `restarts`: its dead daemons are started again, whatever the mission says.
    """
    mission, findings = None, list[Finding]()
    try:
        mission = load_mission(path)
    except Findings as found:
        findings += found.findings
    named = outline(mission_file(path))
    if named is None:
        return None, sorted(set(findings))
    if mission is not None:
        findings += check_links(mission)
        if not mission.done:
            text = "no `done`: the run can only fail, by its timeout or ctrl-C"
            findings.append(Finding(str(mission.path), 0, 0, text, "warning"))
    manifests = {robot: _manifest(named, robot, mission, findings) for robot in named.robots}
    if mission is not None:
        findings += check_simulations(mission, manifests)
    programs = {agent: _program(named, agent, mission, findings) for agent in named.agents}
    surveys = {name: read_survey(program, SourcePaths()) for name, program in programs.items() if program is not None}
    elsewhere = _elsewhere(mission, programs, surveys)
    for agent, surveyed in surveys.items():
        robot = named.agents[agent].robot
        manifest = manifests.get(robot) if robot is not None else None
        if robot is None or manifest is not None:  # against nothing, all would be unknown
            beliefs = elsewhere.beliefs | _declared(named.agents[agent].beliefs)
            findings += _against(surveyed, manifest, replace(elsewhere, beliefs=beliefs))
        if robot is not None and manifest is not None:
            limits = mission.robots[robot].limits if mission is not None else Limits()
            findings += check_plans(surveyed.survey, manifest, named.folder, limits)
            if mission is not None:
                findings += _without_orbit(surveyed.survey, manifest, mission.robots[robot])
    if mission is not None:
        of_programs = {name: one.survey for name, one in surveys.items()}
        findings += check_team(mission, of_programs, programs, restarts=restarts)
        findings += _endings(mission, programs, manifests)
    at_places = {  # a belief that is missing for several robots once: those findings differ in the hint alone
        (one.file, one.line, one.column, one.kind, "" if one.kind in MISSING_BELIEFS else one.message): one
        for one in sorted(findings, reverse=True)
    }
    return mission, sorted(at_places.values())


def _without_orbit(survey: Survey, manifest: Manifest, robot: mission_model.Robot) -> Iterator[Finding]:
    """Yield a warning for each orbit that a program asks of a simulated autopilot without a command for it."""
    if robot.simulate is None or manifest.robot.driver != "mavlink":
        return
    modes = simulated_table(robot.simulate.autopilot, manifest.robot.vehicle)
    for mention in survey.actions if modes.orbit is None else ():
        if (entry := manifest.actions.get(mention.name)) is not None and entry.confirm == "orbit":
            what = f"{robot.simulate.autopilot} has no command by which a {modes.vehicle} flies a circle"
            yield finding(Kind.UNAVAILABLE_ACTION, mention.position, f"the action {mention.name}: {what}", "warning")


def _manifest(named: Outline, robot: str, mission: Mission | None, findings: list[Finding]) -> Manifest | None:
    """Check what the bridge of a robot would refuse. Returns its manifest, if it can be read."""
    where: Steps = ("robots", robot, "manifest")
    name = named.robots[robot]
    try:
        if mission is not None:
            return prepare(mission, robot, None, 1.0)[1].manifest
        return load_robot_manifest(name, named.folder)
    except Findings as found:
        findings += [_placed(finding, where, name, named) for finding in found.findings]
    try:  # what else is wrong with the robot does not hide its manifest from the program
        return load_robot_manifest(name, named.folder)
    except Findings:
        return None


def _placed(finding: Finding, where: Steps, names: str | tuple[str, str], named: Outline) -> Finding:
    """Place the finding about an unreadable manifest at the mission's line that names it."""
    for name in (names,) if isinstance(names, str) else names:
        if finding.line == 0 and finding.file in (name, str(named.folder / name)):
            return named.positions.finding(where, f"`{name}`: {finding.message}")
    return finding


def _program(named: Outline, agent: str, mission: Mission | None, findings: list[Finding]) -> Program | None:
    """Return the program of an agent with what the mission adds to it, if it can be read."""
    if mission is not None:
        try:
            return compose(mission, agent, located=True)
        except Findings as found:
            findings += found.findings
        except (OSError, ValueError) as error:
            findings.append(_unreadable(named, agent, error))
    path = named.folder / named.agents[agent].program
    try:
        return parse_file(path)
    except SyntaxErrors as errors:
        findings += (*errors.findings, *included_by_rest(errors, SourcePaths()))
    except (OSError, ValueError) as error:
        if mission is None:
            findings.append(_unreadable(named, agent, error))
    return None


def _unreadable(named: Outline, agent: str, error: OSError | ValueError) -> Finding:
    if isinstance(error, DirectiveError):
        return Finding(error.position.file, error.position.line, 0, error.message)
    program, reason = named.agents[agent].program, error.strerror if isinstance(error, OSError) else error
    why = f"agents.{agent}.program: `{program}` cannot be read: {reason}"
    return named.positions.finding(("agents", agent, "program"), why)


def _declared(beliefs: tuple[str, ...]) -> set[tuple[str, int]]:
    """Return functor and arity of an agent's beliefs in a mission; `compose` reports those that do not parse."""
    found: set[tuple[str, int]] = set()
    for text in beliefs:
        with suppress(SyntaxErrors):
            literal = parse_literal(text.strip().removesuffix("."))
            found.add((literal.functor, len(literal.args)))
    return found


def _elsewhere(
    mission: Mission | None, programs: Mapping[str, Program | None], surveys: Mapping[str, Surveyed]
) -> Elsewhere:
    """Return what the team, itself included, and members without a program here may send to an agent."""
    team = from_team(surveyed.survey for surveyed in surveys.values())
    unseen = None in programs.values() or any(surveyed.created for surveyed in surveys.values())
    return replace(team, complete=False, open_beliefs=team.open_beliefs or unseen or _sends_by_hand(mission))


def _sends_by_hand(mission: Mission | None) -> bool:
    """Whether programs of the mission's clients, old nodes or people may send an agent any belief."""
    return mission is None or bool(mission.clients or mission.inject or mission.gateway)


def _against(surveyed: Surveyed, manifest: Manifest | None, elsewhere: Elsewhere) -> list[Finding]:
    """Check a program against its robot's actions and percepts, and the beliefs that others may send."""
    actions = {**manifest.action_arities(), **BRIDGE_ACTION_ARITIES} if manifest is not None else {}
    percepts = manifest.percept_arities() if manifest is not None else {}
    parameters = {name: entry.params for name, entry in manifest.actions.items()} if manifest is not None else {}
    values = manifest.robot.values if manifest is not None else "typed"
    robot = Robot(actions, {**BRIDGE_PERCEPTS, **percepts}, parameters, values)
    return findings_of(surveyed, robot, elsewhere)


def _endings(
    mission: Mission, programs: dict[str, Program | None], manifests: dict[str, Manifest | None]
) -> list[Finding]:
    """Return what is wrong with `done` and `failed`; a belief that no program or manifest mentions is a warning."""
    findings: list[Finding] = []
    known: set[tuple[str, int]] = {("true", 0), ("false", 0), *RAISED_BY_AGENTD, *BRIDGE_PERCEPTS.items()}
    for program in programs.values():
        known |= mentioned(program) if program is not None else set()
    for manifest in manifests.values():
        known |= set(manifest.percept_arities().items()) if manifest is not None else set()
    anything = None in programs.values() or None in manifests.values() or _sends_by_hand(mission)
    for field in _FIELDS:
        for index, one in enumerate(mission.done if field == "done" else mission.failed):
            beliefs = beliefs_of(_formula(mission, one, field, findings))
            for functor, arity in () if anything else sorted(beliefs - known):
                belief, others = f"{functor}/{arity}", [f"{name}/{number}" for name, number in known]
                where: Steps = (field, index) if (field, index) in mission.positions.values else (field,)
                found = mission.positions.finding(
                    where, f"{field}: no program ever believes `{belief}`{near_miss(belief, others)}"
                )
                findings.append(replace(found, severity="warning"))
    return findings


def _formula(mission: Mission, one: Ending, field: Literal["done", "failed"], findings: list[Finding]) -> Formula:
    """Return the formula of an ending, or one that asks for nothing if it does not parse."""
    try:
        return endings(mission, one.agent, field)[one.formula]
    except Findings as found:
        findings += [finding for finding in found.findings if finding not in findings]
    return Structure("true")


@dataclass(frozen=True)
class AgentOutline:
    """An agent's program, robot and beliefs."""

    program: str
    robot: str | None
    beliefs: tuple[str, ...]


@dataclass(frozen=True)
class Outline:
    """The programs and manifests that a mission file names."""

    agents: dict[str, AgentOutline]
    robots: dict[str, str | tuple[str, str]]
    """Each robot's manifest: a name, or the pair of INI files."""
    positions: Positions
    folder: Path
    """Base folder of the mission's relative paths."""


def outline(path: Path) -> Outline | None:
    """Return what a mission file names; None if it is not even YAML."""
    try:
        raw, positions = read_yaml(read_bounded(path).decode(), str(path))
    except (Findings, OSError, UnicodeDecodeError):
        return None
    if not isinstance(raw, dict):
        return None
    agents = {
        name: AgentOutline(
            values["program"],
            robot if isinstance(robot := values.get("robot"), str) else None,
            _texts(values.get("beliefs")),
        )
        for name, values in _mapping(raw.get("agents")).items()
        if isinstance(values, dict) and isinstance(values.get("program"), str)
    }
    robots: dict[str, str | tuple[str, str]] = {}
    for name, values in _mapping(raw.get("robots")).items():
        manifest = values.get("manifest") if isinstance(values, dict) else None
        if isinstance(manifest, str):
            robots[name] = manifest
        elif len(pair := _texts(manifest)) == 2:
            robots[name] = (pair[0], pair[1])
    return Outline(agents, robots, positions, path.parent)


def _texts(value: Any) -> tuple[str, ...]:
    return tuple(item for item in value if isinstance(item, str)) if isinstance(value, list) else ()


def _mapping(value: Any) -> dict[str, Any]:
    return value if isinstance(value, dict) else {}


def mentioned(program: Program) -> set[tuple[str, int]]:
    """Return functor and arity of every structure in a program and the files that it includes, anywhere."""
    includes = Includes(program.file, SourcePaths(), [])  # the survey reports what is wrong with them
    found: set[tuple[str, int]] = set()
    waiting: list[Any] = [program]
    while waiting:
        for node in walk(waiting.pop()):
            if isinstance(node, Structure):
                found.add((node.functor, len(node.args)))
            elif isinstance(node, Directive) and node.name.functor == "include":
                waiting += includes(node, DEFAULT)
    return found


def beliefs_of(formula: Formula) -> set[tuple[str, int]]:
    """Return functor and arity of the beliefs that a formula asks for."""
    found: set[tuple[str, int]] = set()
    waiting: list[Any] = [formula]
    while waiting:
        match waiting.pop():
            case Structure(functor=functor, args=args):
                found.add((functor, len(args)))
            case Not(operand=inner):
                waiting.append(inner)
            case And(left=left, right=right) | Or(left=left, right=right):
                waiting += (left, right)
            case _:
                pass
    return found
