"""Find mistakes in a program before it runs: `findings_of`, and the command `agentd check`."""

from __future__ import annotations

import json
import sys
from argparse import ArgumentParser, Namespace, RawDescriptionHelpFormatter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from agentd.check import rules_actions, rules_events, rules_loops, rules_variables
from agentd.check.external_knowledge import Arities, Elsewhere, look_for_packages, standard_library
from agentd.check.finding_kinds import Kind
from agentd.check.programs import Surveyed, read_subjects
from agentd.process import loading_notice
from agentd.runtime.program_paths import SourcePaths, read_folders
from agentd.standalone.command import add_path_argument
from agentd.testing.discovery import TestPaths
from schemas.files.findings import Finding, Findings
from schemas.manifest.model import Parameter, Values
from schemas.manifest.rules import BRIDGE_ACTION_ARITIES, BRIDGE_PERCEPTS

EXIT_DONE = 0
EXIT_FOUND = 1
EXIT_BAD_INPUT = 2


@dataclass(frozen=True, slots=True)
class Robot:
    """The actions and percepts of a robot: None if they are not known, an empty mapping if there are none."""

    actions: Arities | None = None
    percepts: Arities | None = None
    parameters: Mapping[str, Sequence[Parameter]] = field(default_factory=dict)
    """The arguments of actions, where their types are known."""
    values: Values = "typed"
    """`text`: arguments go out as their text, and a variable without a value as its name."""


def findings_of(surveyed: Surveyed, robot: Robot, elsewhere: Elsewhere) -> list[Finding]:
    """Return all findings about a program that has been surveyed, in the order of its file.

    Warnings of the parser are among them.
    """
    found = surveyed.survey
    unusable = look_for_packages(found)
    internal, functions = standard_library()
    findings = list(surveyed.findings)
    findings += rules_actions.internal_actions(found, internal, functions, unusable)
    if robot.actions is not None:
        findings += rules_actions.external_actions(found, robot.actions, internal)
        findings += rules_actions.action_types(found, robot.parameters, robot.values)
    else:
        findings += rules_actions.undotted_internal_actions(found, internal)
    if robot.percepts is not None:
        findings += rules_events.events_never_perceived(found, robot.percepts, elsewhere)
    else:
        findings += rules_events.unused_belief_plans(found, elsewhere)
    findings += rules_events.beliefs_never_added(found, robot.percepts, elsewhere)
    findings += rules_events.goals_without_plans(found, elsewhere)
    findings += rules_events.shadowed_plans(found)
    findings += rules_events.unused_plans(found, elsewhere)
    findings += rules_loops.busy_loops(found, elsewhere)
    for look in _LOOKS:
        findings += look(found)
    unchecked = rules_variables.named_variables(found, robot.actions or ()) if robot.values == "text" else frozenset()
    return sorted(one for one in set(findings) if one not in unchecked)


_LOOKS = (
    rules_actions.wrong_directives,
    rules_actions.directives_as_beliefs,
    rules_events.duplicate_labels,
    rules_events.misspelt_labels,
    rules_variables.singletons,
    rules_variables.unbound_variables,
    rules_loops.endless_asks,
    rules_actions.unknown_performatives,
    rules_actions.formulas_as_actions,
)
"""Checks that need only the program."""


# --- the command -----------------------------------------------------------------------------------------------------


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `agentd check`."""
    parser.formatter_class = RawDescriptionHelpFormatter
    parser.description = _DESCRIPTION
    parser.add_argument("files", nargs="+", metavar="FILE", help="program, or project file of Jason (.mas2j)")
    parser.add_argument(
        "--manifest",
        help="manifest of the robot, by its name or file, such as copter (default: all actions and percepts are "
        "taken as known)",
    )
    parser.add_argument(
        "--json", action="store_true", help="write the findings to stdout as a JSON array (default: to stderr as text)"
    )
    add_path_argument(parser)


_DESCRIPTION = """\
Look for mistakes in programs and start nothing. Several files are the agents of one team, and what they send to one
another is known. Exit code: 0 without errors (there may be warnings), 1 with errors, 2 if something cannot be read.
docs/reference/errors.md lists the kinds of findings and the fields of --json."""


def run(args: Namespace) -> int:
    """Check programs. Returns the exit code of the command's description."""
    try:
        robot = _robot(args.manifest)
        paths = read_folders(args.include_path, TestPaths)
    except (Findings, ValueError) as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    with loading_notice(args.files):
        shown = _check(args.files, robot, paths)
    if args.json:
        findings = [{name: getattr(one, name) for name in _FIELDS} for one in shown]
        print(json.dumps(findings, indent=2))
    else:
        for text in shown.values():
            print(text, file=sys.stderr)
    if any(one.kind == Kind.FILE.label and not one.line for one in shown):
        return EXIT_BAD_INPUT
    return EXIT_FOUND if any(one.severity == "error" for one in shown) else EXIT_DONE


_FIELDS = ("file", "line", "column", "severity", "kind", "message")
"""The fields of a finding with `--json`. They are stable; others may be added."""


def _robot(name: str | None) -> Robot:
    if name is None:
        return Robot()
    from schemas.manifest.loader import load_manifest

    manifest = load_manifest(name, Path.cwd())
    parameters = {action: entry.params for action, entry in manifest.actions.items()}
    actions = {**manifest.action_arities(), **BRIDGE_ACTION_ARITIES}
    percepts = {**BRIDGE_PERCEPTS, **manifest.percept_arities()}
    return Robot(actions, percepts, parameters, manifest.robot.values)


def _check(files: Sequence[str], robot: Robot, paths: SourcePaths) -> dict[Finding, str]:
    """Return the findings of all files and how they are shown, each once, in the order of the files."""
    subjects = read_subjects(files, paths)
    elsewhere = subjects.elsewhere()
    shown: dict[Finding, str] = {}
    for file in subjects.order:
        shown |= subjects.shown.get(file, {})
        if file in subjects.programs:
            shown |= {one: str(one) for one in findings_of(subjects.programs[file], robot, elsewhere)}
    return shown
