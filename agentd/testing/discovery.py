"""Finding the test plans: in the files named, and in the folders named those files that have some."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from pathlib import Path

from msgspec.structs import replace

from agentd.language.compiler.compile import CompiledProgram, DirectiveError, compile_program
from agentd.language.parse import parse_file
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.printer import source_text
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.language.syntax_tree.traversal import is_labelled, misspelt_words
from agentd.runtime.program_paths import SourcePaths
from agentd.testing.results import Unread
from schemas.files.text_files import read_bounded

LIBRARY = Path(__file__).parent / "assertions.asl"
"""The plans that every test program gets."""
_THE_GOAL = nodes.Structure("agentd_the_goal")
OF_JASON = Path(__file__).parent / "of_jason.asl"
"""Replacement for Jason's own test harness, for programs that include it."""
_HARNESS = frozenset({"tester_agent.asl", "test_assert.asl", "test_manager.asl"})
"""The files of Jason's own harness, which `agentd test` replaces; they are in one folder."""


@dataclass(frozen=True, slots=True)
class Case:
    """A test plan and the program that it runs in: the file's, without other test plans for the same goal."""

    name: str
    file: str
    """The file that was named; the plan may be in one that it includes."""
    plan: nodes.Plan
    program: CompiledProgram
    own_assertions: bool


class TestPaths(SourcePaths):
    """Where the files of test programs are. Jason's harness is not needed: what it does is done here."""

    __test__ = False  # no test of pytest's

    def find(self, path: str, beside: str) -> str:
        """Return the path of a file that the program `beside` names. Raises OSError."""
        if beside and Path(path).name in _HARNESS and self._is_of_jason(path, beside):
            return str(OF_JASON)
        return super().find(path, beside)

    def _is_of_jason(self, path: str, beside: str) -> bool:
        """Return whether a file named as of Jason's harness is that: in its jar, missing, or beside the others."""
        if path.startswith("$jasonJar/"):
            return True
        try:
            folder = Path(super().find(path, beside)).parent
        except OSError:
            return True
        return all((folder / name).is_file() for name in _HARNESS)


def find_cases(places: Iterable[str], paths: TestPaths, wanted: str | None) -> Iterator[Case | Unread]:
    """Yield the test plans of files and folders, in order, and what could not be read."""
    files: dict[str, bool] = {}
    for place in places:
        if Path(place).is_dir():
            closed: list[OSError] = []
            below = [Path(folder, name) for folder, _, names in os.walk(place, onerror=closed.append) for name in names]
            yield from (Unread(each.filename, f"{each.filename}: error: {each.strerror}") for each in closed)
            for file in sorted(below):
                if file.suffix == ".asl" and _has_marks(file):
                    files.setdefault(str(file), False)
        else:
            files[place] = True
    several = frozenset(map(os.path.realpath, files))
    for name, was_named in files.items():
        found = list(_of_file(name, paths, wanted, several))
        if not found and was_named and wanted is None:
            yield Unread(name, f"{name}: error: there is no test plan; mark one as @name[test] +!goal <- ...")
        yield from found


def _has_marks(file: Path) -> bool:
    """Return whether a file can have test plans: in a folder, no others are parsed."""
    try:
        text = read_bounded(file)
    except OSError:
        return True  # reported when it is read
    return b"@" in text and (b"test" in text or b"assert_" in text)


def _of_file(file: str, paths: TestPaths, wanted: str | None, several: frozenset[str]) -> Iterator[Case | Unread]:
    try:
        program = paths.compiled(file)
    except OSError as error:
        yield Unread(file, f"{file}: error: cannot read the program: {error.strerror or error}")
        return
    except (SyntaxErrors, DirectiveError) as error:
        yield Unread(file, str(error))
        return
    here = os.path.realpath(file)
    for plan in program.plans:
        standing = os.path.realpath(plan.position.file)
        if standing != here and standing in several:
            continue  # it is run with its own file
        if not is_labelled(plan, "test"):
            for word in [word for word, meant in misspelt_words(plan) if meant == "test"]:
                text = f"this plan is no test: did you mean `[test]`, not `[{word.functor}]`?"
                yield Unread(file, f"{word.position}: error: {text}")
            continue
        case = _case(file, plan, program)
        if isinstance(case, Unread) or wanted is None or wanted in case.name or fnmatchcase(case.name, wanted):
            yield case


def _case(file: str, plan: nodes.Plan, program: CompiledProgram) -> Case | Unread:
    trigger = plan.trigger
    if trigger.operator != "+" or trigger.goal != "!" or not isinstance(trigger.literal, nodes.Structure):
        written = f"{trigger.operator}{trigger.goal}{source_text(trigger.literal)}"
        return Unread(file, f"{plan.position}: error: a test is a plan for a goal, +!goal; this one is for {written}")
    bare = replace(trigger.literal, annotations=None)
    label = plan.label
    named = isinstance(label, nodes.Structure) and bool(label.functor)
    name = label.functor if named and isinstance(label, nodes.Structure) else source_text(bare)
    key = _key(plan)
    others = [p for p in program.plans if p is plan or not (is_labelled(p, "test") and _key(p) == key)]
    ours = {_key(p) for p in others if p.position.file == str(OF_JASON)}
    theirs = {_key(p) for p in others if p.position.file != str(OF_JASON)}
    spaces = {space for p in program.plans if (space := _namespace(p)) is not None} | {DEFAULT}
    assertions = [p for space in sorted(spaces) for p in _library(space).plans]
    library = [p for p in assertions if _key(p) not in theirs | ours]
    own_goals = tuple(g for g in program.goals if g.position.file == program.file)
    whole = replace(program, plans=(*(_aimed(p, bare) for p in library), *others), goals=own_goals)
    own_assertions = not theirs.isdisjoint(map(_key, assertions))
    return Case(name, file, plan, whole, own_assertions)


def _aimed(plan: nodes.Plan, goal: nodes.Structure) -> nodes.Plan:
    """Return a plan of the library, with the goal of the test in its place."""
    body = plan.body
    steps = [replace(s, term=goal) if isinstance(s, nodes.Step) and s.term == _THE_GOAL else s for s in body.formulas]
    return replace(plan, body=replace(body, formulas=tuple(steps)))


def _key(plan: nodes.Plan) -> tuple[str, str, str, int]:
    """Return the common part of plans for the same goal."""
    literal = plan.trigger.literal
    if not isinstance(literal, nodes.Structure):
        return plan.trigger.operator, plan.trigger.goal, "", -1
    return plan.trigger.operator, plan.trigger.goal, f"{_namespace(plan)}::{literal.functor}", len(literal.args)


def _namespace(plan: nodes.Plan) -> str | None:
    namespace = plan.trigger.literal.namespace
    return DEFAULT if namespace is None else namespace if isinstance(namespace, str) else None


@lru_cache(maxsize=100)
def _library(namespace: str) -> CompiledProgram:
    """Return the assertions, for the plans of a namespace."""
    return compile_program(parse_file(LIBRARY), namespace=namespace)
