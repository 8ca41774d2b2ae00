"""The files that a program includes, for the survey: read once per namespace, their faults among the findings."""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path

from agentd.check.finding_kinds import Kind, finding
from agentd.language.errors.suggestions import near
from agentd.language.parse import parse_file
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.nodes import Directive, InternalAction, Item, Position, String, Structure
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.runtime.program_paths import SourcePaths
from agentd.testing.discovery import OF_JASON
from schemas.files.findings import Finding


def near_file(name: str, beside: str) -> str:
    """``; did you mean x.asl?`` where a program of nearly this name stands where that one was looked for."""
    wanted = Path(beside).parent / name
    try:
        there = [path.name for path in wanted.parent.iterdir() if path.suffix == ".asl" and path.is_file()]
    except (OSError, ValueError):
        return ""
    return near(wanted.name, there)


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
        """Whether a file could not be read: then nothing can be said of what the program lacks."""

    def __call__(self, what: Directive | InternalAction, namespace: str) -> Iterable[Item]:
        """The items of the file that a directive names, or an `.include` while the agent runs."""
        match what:
            case InternalAction(args=(String(name), *_)) if "\0" not in name:
                return self._items(name, self._file, namespace, what.position, at_run_time=True)
            case Directive(name=Structure(args=(String(name), *_))) if "\0" not in name:
                return self._items(name, what.position.file, namespace, what.position)
            case _:
                return ()  # told as a wrong directive

    def _items(
        self, name: str, beside: str, namespace: str, position: Position, *, at_run_time: bool = False
    ) -> Iterable[Item]:
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
            text = f'cannot include "{name}": {error.strerror or error}{near_file(name, beside)}'
            self._findings.append(finding(Kind.FILE, position, text))
        else:
            self._findings += program.warnings
            return program.items
        self.missing = True
        return ()
