"""Reads INI text with the line of each section and option, which Python's `configparser` does not report."""

from __future__ import annotations

import re
from dataclasses import dataclass, field

from schemas.files.findings import Finding

DEFAULT = "DEFAULT"
"""The section whose options hold in every other one."""
_SECTION = re.compile(r"\[([^\]]*)\]\s*")
_OPTION = re.compile(r"([^=:\s][^=:]*)[=:]\s*(.*)")
_REMARK = re.compile(r"(^|\s)[#;].*")


@dataclass(frozen=True)
class Option:
    """A value as it was written, on one line; continuation lines are joined by a space."""

    value: str
    line: int


@dataclass(frozen=True)
class Section:
    """A `[name]` and its options. Names of options are in lower case."""

    name: str
    line: int
    options: dict[str, Option] = field(default_factory=dict)


@dataclass(frozen=True)
class Ini:
    """The sections of a file in order, the options of `[DEFAULT]`, and the findings."""

    defaults: Section
    sections: tuple[Section, ...]
    findings: tuple[Finding, ...]


def read_ini(text: str, file: str) -> Ini:
    """Read `option = value` or `option: value` below `[sections]`; `#` and `;` begin remarks."""
    reader = _Reader(file)
    for number, line in enumerate(text.removeprefix("\ufeff").splitlines(), start=1):
        reader.line(number, line)
    defaults = reader.sections.pop(DEFAULT, Section(DEFAULT, 0))
    return Ini(defaults, tuple(reader.sections.values()), tuple(reader.findings))


class _Reader:
    """Takes one line after the other."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.sections: dict[str, Section] = {}
        self.findings: list[Finding] = []
        self._section: Section | None = None
        self._option, self._indent = "", 0

    def line(self, number: int, line: str) -> None:
        text = _REMARK.sub("", line).strip()
        if not text:
            return
        indent = len(line) - len(line.lstrip())
        if self._section is not None and self._option and indent > self._indent:
            option = self._section.options[self._option]
            self._section.options[self._option] = Option(f"{option.value} {text}".strip(), option.line)
        elif text.startswith("["):
            self._begin(number, text)
        else:
            self._take(number, text, indent)

    def _begin(self, number: int, text: str) -> None:
        self._option = ""
        found = _SECTION.fullmatch(text)
        name = found[1].strip() if found else ""
        if not name:
            self._problem(number, f"expected a section such as `[takeoff]`, got `{text}`")
            self._section = Section("", number)  # its options are read, and dropped with it
            return
        if earlier := self.sections.get(name):
            self._problem(number, f"`[{name}]` is repeated, first at line {earlier.line}")
            self._section = Section(name, number)
            return
        self._section = self.sections[name] = Section(name, number)

    def _take(self, number: int, text: str, indent: int) -> None:
        self._option = ""
        found = _OPTION.fullmatch(text)
        if found is None:
            self._problem(number, f"expected `option = value`, got `{text}`")
        elif self._section is None:
            self._problem(number, f"expected a section such as `[takeoff]` before `{text}`")
        elif earlier := self._section.options.get(name := found[1].rstrip().lower()):
            self._problem(number, f"`{name}` is repeated, first at line {earlier.line}")
        else:
            self._section.options[name] = Option(found[2], number)
            self._option, self._indent = name, indent

    def _problem(self, number: int, message: str) -> None:
        self.findings.append(Finding(self.file, number, 0, message))
