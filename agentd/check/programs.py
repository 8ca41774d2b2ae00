"""Reads the programs that are checked together: files with what they include, and the agents of project files."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

from msgspec import structs

from agentd.check.external_knowledge import Elsewhere, from_team
from agentd.check.finding_kinds import Kind, finding
from agentd.check.survey import survey
from agentd.check.symbol_table import Survey
from agentd.language.parse import parse_file
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.language.syntax_tree.traversal import is_labelled
from agentd.runtime.program_paths import SourcePaths
from agentd.testing.discovery import LIBRARY, OF_JASON
from schemas.files.findings import Finding, Findings
from schemas.files.text_files import near_file, read_bounded


class Includes:
    """Gives the items of included files, each once per namespace; what is wrong with them goes to ``findings``."""

    def __init__(self, file: str, paths: SourcePaths, findings: list[Finding]) -> None:
        self._file, self._paths, self._findings = file, paths, findings
        self._seen = {(os.path.abspath(file), DEFAULT)}
        self._includers: dict[str, frozenset[str]] = {}
        """By file, the files that lead to it: one of these cannot be included by it."""
        self.harness = False
        """Whether Jason's test harness is included, which `agentd test` takes the place of."""
        self.missing = False
        """Whether a file could not be read: then nothing is reported as missing in the program."""

    def __call__(self, what: nodes.Directive | nodes.InternalAction, namespace: str) -> Iterable[nodes.Item]:
        """The items of the file that a directive names, or an `.include` while the agent runs."""
        match what:
            case nodes.InternalAction(args=(nodes.String(name), *_)) if "\0" not in name:
                return self._items(name, self._file, namespace, what.position, at_run_time=True)
            case nodes.Directive(name=nodes.Structure(args=(nodes.String(name), *_))) if "\0" not in name:
                return self._items(name, what.position.file, namespace, what.position)
            case _:
                return ()  # reported as a wrong directive

    def _items(
        self, name: str, beside: str, namespace: str, position: nodes.Position, *, at_run_time: bool = False
    ) -> Iterable[nodes.Item]:
        try:
            path = self._paths.find(name, beside)
            key = (os.path.abspath(path), namespace)
            within = self._includers.get(os.path.abspath(position.file), frozenset()) | {os.path.abspath(position.file)}
            if key[0] in within and not at_run_time:
                text = f'cannot include "{name}": files include one another without end'
                self._findings.append(finding(Kind.FILE, position, text))
                return ()
            if key in self._seen:
                return ()
            self._seen.add(key)
            self._includers[key[0]] = within
            if path == str(OF_JASON):
                self.harness = True
                return ()
            program = parse_file(path)
        except SyntaxErrors as errors:
            self._findings += errors.findings
        except OSError as error:
            text = f'cannot include "{name}": {error.strerror or error}'
            self._findings.append(finding(Kind.FILE, position, text))
        else:
            self._findings += program.warnings
            return program.items
        self.missing = True
        return ()


@dataclass(frozen=True, slots=True)
class Surveyed:
    """A program with its survey, and what was found while its files were read."""

    survey: Survey
    findings: tuple[Finding, ...]
    created: tuple[str, ...] = ()
    """The files of the agents that it creates."""


def read_survey(program: nodes.Program, paths: SourcePaths) -> Surveyed:
    """Survey a program with the files that it includes."""
    findings = list(program.warnings)
    includes = Includes(program.file, paths, findings)
    found = survey(program.items, includes)
    if includes.missing:
        found.open_plans = found.open_beliefs = found.open_goals = True
    if includes.harness:
        _add_assertions(found, OF_JASON)
    if includes.harness or any(is_labelled(placed.plan, "test") for placed in found.plans):
        _add_assertions(found, LIBRARY)
    findings += _not_checked(found.late_files)
    created = tuple(_created(program.file, found, paths, findings))
    return Surveyed(found, tuple(findings), created)


def included_by_rest(errors: SyntaxErrors, paths: SourcePaths) -> list[Finding]:
    """Return what is wrong with the files that a program with syntax errors includes."""
    read = () if errors.rest is None else read_survey(errors.rest, paths).findings
    return [one for one in read if one.severity == "error"]


def _created(file: str, found: Survey, paths: SourcePaths, findings: list[Finding]) -> Iterator[str]:
    """Yield the files of the agents that a program creates; a missing one is added to the findings."""
    for name, position in found.created:
        try:
            yield paths.find(name, file)
        except (OSError, ValueError) as error:
            why = (error.strerror if isinstance(error, OSError) else None) or error
            text = f'cannot create an agent of "{name}": {why}'
            findings.append(finding(Kind.FILE, position, text))


def _not_checked(files: Sequence[nodes.InternalAction]) -> Iterator[Finding]:
    """Report once what is not checked because of files that are known only at run time."""
    if files:
        first = min(files, key=lambda call: (call.position.file, call.position.line, call.position.column))
        text = f"the file of {first.name} is not known before the run: "
        text += "beliefs that nothing adds and plans that nothing uses are not reported"
        if any(call.name == ".include" for call in files):
            text += ", goals without plans are warnings"
        yield finding(Kind.KNOWN_WHEN_RUN, first.position, text, "info")


def _add_assertions(found: Survey, file: Path) -> None:
    """Count the plans as there that `agentd test` adds to programs with test plans."""
    added = survey(parse_file(file).items)
    found.plans += added.plans
    found.open_goals |= added.open_goals


@dataclass(slots=True)
class Subjects:
    """Programs that were read, and the problems of those that were not, by file.

    ``order`` has the files in the order in which they were named; ``shown`` gives findings with the text that shows
    them.
    """

    order: list[str] = field(default_factory=list)
    programs: dict[str, Surveyed] = field(default_factory=dict)
    shown: dict[str, dict[Finding, str]] = field(default_factory=dict)
    incomplete: bool = False
    """Whether a program could not be read: then it is not known what it would send."""
    percepts_unknown: bool = False
    """Whether a project has an environment, whose percepts nobody knows."""
    programs_named: bool = False
    """Whether programs were named without a project: their environment is not known."""

    def elsewhere(self) -> Elsewhere:
        """Messages of the programs to one another."""
        if self.incomplete:
            return Elsewhere()
        found = from_team(surveyed.survey for surveyed in self.programs.values())
        return replace(
            found, open_beliefs=self.percepts_unknown or found.open_beliefs, no_percepts=not self.programs_named
        )


def read_subjects(files: Sequence[str], paths: SourcePaths) -> Subjects:
    """Read programs and projects."""
    subjects = Subjects()
    for file in files:
        if file.endswith(".mas2j"):
            _read_project(file, paths, subjects)
        else:
            subjects.programs_named = True
            _read(file, paths, (), subjects)
    _read_created(paths, subjects)
    return subjects


def _read(file: str, paths: SourcePaths, more: Iterable[nodes.Item], subjects: Subjects) -> None:
    """Read a program, with what else its agents begin with."""
    subjects.order.append(file)
    try:
        program = parse_file(file)
    except SyntaxErrors as errors:
        shown = {one: str(one) for one in included_by_rest(errors, paths)}
        _cannot_be_read(file, shown | {problem.finding: str(problem) for problem in errors.problems}, subjects)
    except OSError as error:
        unread = Finding(file, 0, 0, f"cannot be read: {error.strerror}{near_file(file)}", kind=Kind.FILE.label)
        _cannot_be_read(file, {unread: str(unread)}, subjects)
    else:
        program = structs.replace(program, items=(*program.items, *more))
        subjects.programs[file] = read_survey(program, paths)


def _read_created(paths: SourcePaths, subjects: Subjects) -> None:
    """Read the programs of the agents that those read create, and that these create."""
    known = {os.path.abspath(file) for file in subjects.order}
    pending = list(subjects.programs.values())
    while pending:
        for file in pending.pop().created:
            if os.path.abspath(file) not in known:
                known.add(os.path.abspath(file))
                _read(file, paths, (), subjects)
                pending += [subjects.programs[file]] if file in subjects.programs else []


def _cannot_be_read(file: str, shown: dict[Finding, str], subjects: Subjects) -> None:
    subjects.shown.setdefault(file, {}).update(shown)
    subjects.incomplete = True


def _read_project(file: str, paths: SourcePaths, subjects: Subjects) -> None:
    from agentd.jason_project.loader import items_of, project_paths, read_project
    from agentd.jason_project.project_parser import parse_project  # most checks are of programs

    try:
        findings = read_project(file, paths, False).warnings
    except SyntaxErrors as errors:
        findings = [finding for finding in errors.findings if finding.file == file]
    except Findings as errors:
        findings = errors.findings
    except OSError as error:
        findings = [Finding(file, 0, 0, f"cannot be read: {error.strerror}", kind=Kind.FILE.label)]
    named = [one if one.kind else replace(one, kind=Kind.PROJECT.label) for one in findings]
    shown = subjects.shown[file] = {one: str(one) for one in named}
    subjects.order.append(file)
    try:
        project = parse_project(read_bounded(file).decode("utf-8-sig"), file)
    except (SyntaxErrors, OSError, UnicodeDecodeError):
        subjects.incomplete = True
        return
    paths = project_paths(project, paths, [])  # their errors are reported by the project's reader
    subjects.percepts_unknown |= project.environment is not None
    for entry in project.agents:
        try:
            path = paths.find(entry.program.text, file)
        except OSError as error:
            subjects.incomplete = True
            text = f"cannot read the program of the agent {entry.name}: {error.strerror or error}"
            unread = finding(Kind.FILE, entry.position, text)
            if not any((one.file, one.line) == (unread.file, unread.line) for one in shown):  # by the project's reader
                shown[unread] = str(unread)
            continue
        more: list[nodes.Item] = []
        for option in entry.options:
            with suppress(Findings):  # reported by the project's reader
                more += items_of(option)
        if path not in subjects.programs:
            _read(path, paths, more, subjects)
