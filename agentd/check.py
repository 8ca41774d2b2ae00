"""What can be told to be wrong with a program before it runs, and the command `agentd check`."""

from __future__ import annotations

import json
import os
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable
from pathlib import Path

from agentd.analysis.beliefs import beliefs_never_added, events_never_perceived
from agentd.analysis.calls import (
    Arities,
    endless_asks,
    external_actions,
    finding,
    formulas_as_actions,
    internal_actions,
)
from agentd.analysis.plans import goals_without_plans, unreachable_plans
from agentd.analysis.survey import DEFAULT, survey
from agentd.analysis.variables import singletons
from agentd.language.errors import SyntaxErrors
from agentd.language.parser import parse_file
from agentd.language.syntax import Directive, Item, Program, String
from schemas.findings import Finding, Findings

EXIT_DONE = 0
EXIT_BAD_INPUT = 2

STATEMENTS: dict[str, range | set[int]] = {
    ".foreach": {2},
    ".loop": {2},
    ".if_then_else": {2, 3},
    ".fork": range(2, 1 << 30),
}
"""Internal actions that the compiler reads as `for`, `while`, `if` and forks, with their numbers of arguments."""

OF_THE_DAEMONS = {"bridge": 1, "override": 1, "restarted": 1}
"""Beliefs that no manifest declares: `bridge(up)`, `override(Mode)`, `restarted(N)` (design sections 5 and 9)."""


def check_program(
    program: Program,
    actions: Arities | None = None,
    percepts: Arities | None = None,
    *,
    beliefs: Iterable[tuple[str, int]] = (),
    internal: Arities | None = None,
    functions: Arities | None = None,
) -> list[Finding]:
    """All findings about a program, in the order of its file; warnings of the parser are among them.

    ``actions`` and ``percepts`` are what the robot can do and tell: names with their number of arguments (or several
    numbers); None says that they are not known, an empty mapping that there are none. ``beliefs`` are names and
    arities that come from elsewhere (other agents). ``internal`` and ``functions`` are the internal actions and
    functions that exist; without them, those of the standard library. Included files are read and checked too.
    """
    findings = list(program.warnings)
    includes = _Includes(program.file, findings)
    found = survey(program.items, includes)
    if includes.missing:
        found.open_plans = found.open_beliefs = True
    known_actions, known_functions = _standard_library()
    findings += internal_actions(
        found, known_actions if internal is None else internal, known_functions if functions is None else functions
    )
    if actions is not None:
        findings += external_actions(found, actions)
    if percepts is not None:
        findings += events_never_perceived(found, percepts)
    findings += beliefs_never_added(found, percepts, beliefs)
    findings += goals_without_plans(found)
    findings += unreachable_plans(found)
    findings += singletons(found)
    findings += endless_asks(found)
    findings += formulas_as_actions(found)
    return sorted(set(findings))


def _standard_library() -> tuple[Arities, Arities]:
    """The internal actions and functions of the standard library, with the arguments that they take."""
    from agentd.stdlib.registry import ACTIONS, FUNCTIONS

    actions = {name: _union(action.arities for action in group) for name, group in ACTIONS.items()} | STATEMENTS
    functions: dict[str, set[int]] = {".count": {1}}
    for name, arity in FUNCTIONS:
        functions.setdefault(name, set()).add(arity)
    return actions, functions


def _union(ranges: Iterable[range]) -> range | set[int]:
    ranges = list(ranges)
    if len(ranges) == 1:
        return ranges[0]
    widest = max(ranges, key=len)
    return widest if len(widest) > 99 else {arity for each in ranges for arity in each}


class _Includes:
    """Reads the files that directives include, each once per namespace; what is wrong with them is a finding."""

    def __init__(self, file: str, findings: list[Finding]) -> None:
        self._findings = findings
        self._seen = {(os.path.abspath(file), DEFAULT)}
        self.missing = False

    def __call__(self, directive: Directive, namespace: str) -> Iterable[Item]:
        match directive.name.args:
            case (String(name), *_) if "\0" not in name:
                path = Path(directive.position.file).parent / name
            case _:
                self._findings.append(finding(directive.position, 'include needs a file: { include("file.asl") }'))
                return ()
        key = (os.path.abspath(path), namespace)
        if key in self._seen:
            return ()
        self._seen.add(key)
        return self._items(path, directive)

    def _items(self, path: Path, directive: Directive) -> Iterable[Item]:
        try:
            program = parse_file(path)
        except SyntaxErrors as errors:
            self._findings += errors.findings
        except OSError as error:
            self._findings.append(finding(directive.position, f"cannot include {path}: {error.strerror}"))
        else:
            self._findings += program.warnings
            return program.items
        self.missing = True
        return ()


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `agentd check`."""
    parser.add_argument("files", nargs="+", metavar="FILE", help="program to check")
    parser.add_argument("--manifest", help="manifest of the robot: a shipped one's name, or a file")
    parser.add_argument("--json", action="store_true", help="findings as a JSON array on stdout")


def run(args: Namespace) -> int:
    """Check programs. Returns 0 if none has an error, 2 otherwise."""
    try:
        actions, percepts = _manifest(args.manifest)
    except Findings as error:
        print(error, file=sys.stderr)
        return EXIT_BAD_INPUT
    findings: list[Finding] = []
    shown: list[str] = []
    for file in args.files:
        told, texts = _check_file(file, actions, percepts)
        findings += told
        shown += texts
    if args.json:
        fields = ("file", "line", "column", "severity", "message")
        print(json.dumps([{name: getattr(one, name) for name in fields} for one in findings], indent=2))
    else:
        for text in shown:
            print(text, file=sys.stderr)
    return EXIT_BAD_INPUT if any(one.severity == "error" for one in findings) else EXIT_DONE


def _manifest(name: str | None) -> tuple[Arities | None, Arities | None]:
    if name is None:
        return None, None
    from schemas.manifest import load_manifest

    manifest = load_manifest(name, Path.cwd())
    return manifest.action_arities(), {**manifest.percept_arities(), **OF_THE_DAEMONS}


def _check_file(file: str, actions: Arities | None, percepts: Arities | None) -> tuple[list[Finding], list[str]]:
    """The findings of a file, and how they are shown."""
    try:
        findings = check_program(parse_file(file), actions, percepts)
    except SyntaxErrors as errors:
        return list(errors.findings), [str(errors)]
    except OSError as error:
        findings = [Finding(file, 0, 0, f"cannot be read: {error.strerror}")]
    return findings, [str(one) for one in findings]
