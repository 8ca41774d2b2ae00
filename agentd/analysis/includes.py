"""The files that a program includes, for the survey: read once per namespace, their faults among the findings."""

from __future__ import annotations

import os
from collections.abc import Iterable

from agentd.analysis.kinds import Kind, finding
from agentd.language.errors import SyntaxErrors
from agentd.language.parser import parse_file
from agentd.language.signatures import DEFAULT
from agentd.language.syntax import Directive, Item, String
from agentd.paths import SourcePaths
from schemas.findings import Finding


class Includes:
    """Gives the items of included files, each once per namespace; what is wrong with them goes to ``findings``."""

    def __init__(self, file: str, paths: SourcePaths, findings: list[Finding]) -> None:
        self._paths, self._findings = paths, findings
        self._seen = {(os.path.abspath(file), DEFAULT)}
        self.missing = False
        """Whether a file could not be read: then nothing can be said of what the program lacks."""

    def __call__(self, directive: Directive, namespace: str) -> Iterable[Item]:
        match directive.name.args:
            case (String(name), *_) if "\0" not in name:
                return self._items(name, namespace, directive)
            case _:
                return ()  # told as a wrong directive

    def _items(self, name: str, namespace: str, directive: Directive) -> Iterable[Item]:
        try:
            path = self._paths.find(name, directive.position.file)
            key = (os.path.abspath(path), namespace)
            if key in self._seen:
                return ()
            self._seen.add(key)
            program = parse_file(path)
        except SyntaxErrors as errors:
            self._findings += errors.findings
        except OSError as error:
            text = f'cannot include "{name}": {error.strerror or error}'
            self._findings.append(finding(Kind.FILE, directive.position, text))
        else:
            self._findings += program.warnings
            return program.items
        self.missing = True
        return ()
