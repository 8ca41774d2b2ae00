"""Reads manifests (design section 12): every problem at once, each at its line."""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from schemas.durations import decode_hook
from schemas.files import read_text
from schemas.findings import Finding, Findings
from schemas.manifest_entries import (
    ActionDescription,
    ActionEntry,
    Field,
    FieldValue,
    Manifest,
    Order,
    Parameter,
    ParameterType,
    PerceptEntry,
    Retry,
    RobotEntry,
    Value,
    Values,
)
from schemas.shipped import shipped, shipped_names
from schemas.toml_lines import line_of, toml_lines

__all__ = [
    "ActionDescription",
    "ActionEntry",
    "Field",
    "FieldValue",
    "Manifest",
    "Order",
    "Parameter",
    "ParameterType",
    "PerceptEntry",
    "Retry",
    "RobotEntry",
    "Value",
    "Values",
    "find_manifest",
    "load_manifest",
    "read_manifest",
]

S = TypeVar("S", bound=msgspec.Struct)
_FUNCTOR = re.compile(r"[a-z][A-Za-z0-9_]*")
_WRONG_FIELD = re.compile(r"at `\$\.([A-Za-z0-9_]+)")
_NAMED_FIELD = re.compile(r"field `([^`]+)`")
_SYNTAX_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")


def find_manifest(name: str, relative_to: Path | None = None) -> Path | None:
    """Return the file that a mission means by `name`: a path, or the bare name of a shipped manifest."""
    if "/" in name or name.endswith(".toml"):
        path = Path(name) if relative_to is None else relative_to / name
        return path if path.is_file() else None
    return shipped("manifests", f"{name}.toml")


def load_manifest(name: str | Path, relative_to: Path | None = None) -> Manifest:
    """Read and check a manifest. Raises Findings with every problem, each at its line."""
    path = find_manifest(str(name), relative_to)
    if path is None:
        known = ", ".join(shipped_names("manifests", ".toml"))
        raise Findings([Finding(str(name), 0, 0, f"no such manifest; expected a file or one of: {known}")])
    return read_manifest(read_text(path), str(path))


def read_manifest(text: str, file: str) -> Manifest:
    """Check the text of a manifest; `file` is what findings name. Raises Findings with every problem."""
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise Findings([_syntax_finding(str(error), text, file)]) from None
    except RecursionError:
        raise Findings([Finding(file, 0, 0, "nested too deeply")]) from None
    return _Reader(file, toml_lines(text)).manifest(document)


def _syntax_finding(said: str, text: str, file: str) -> Finding:
    place = _SYNTAX_PLACE.search(said)
    if place is None:
        return Finding(file, 0, 0, said)
    line, column = (int(place[1]), int(place[2])) if place[1] else (text.count("\n") + 1, 0)
    return Finding(file, line, column, said[: place.start()])


class _Reader:
    """Collects the problems of one manifest."""

    def __init__(self, file: str, lines: dict[tuple[str, ...], int]) -> None:
        self.file = file
        self.lines = lines
        self.problems: list[Finding] = []

    def manifest(self, document: dict[str, Any]) -> Manifest:
        for key in sorted(set(document) - {"robot", "percepts", "actions", "orders"}):
            self.problem(f"unknown table or key `{key}`, expected `robot`, `percepts`, `actions` or `orders`", key)
        robot = None
        if "robot" not in document:
            self.problem("a `[robot]` table with its `driver` is missing")
        else:
            robot = self.entry(RobotEntry, document["robot"], "robot")
        percepts = self.entries(PerceptEntry, document, "percepts")
        actions = self.entries(ActionEntry, document, "actions")
        for name, percept in percepts.items():
            self.check_percept(name, percept)
        for name, action in actions.items():
            self.check_action(name, action)
        if self.problems or robot is None:
            raise Findings(self.problems)
        return Manifest(robot=robot, percepts=percepts, actions=actions, file=self.file, lines=self.lines)

    def problem(self, message: str, *path: str) -> None:
        self.problems.append(Finding(self.file, line_of(self.lines, path), 0, message))

    def entries(self, kind: type[S], document: dict[str, Any], table: str) -> dict[str, S]:
        found = document.get(table, {})
        if not isinstance(found, dict):
            self.problem(f"expected tables `[{table}.NAME]`", table)
            return {}
        read: dict[str, S] = {}
        for name, content in found.items():
            if not _FUNCTOR.fullmatch(name):
                self.problem(f"`{name}`: expected the name of a belief or action, such as `battery`", table, name)
            entry = self.entry(kind, content, table, name)
            if entry is not None:
                read[name] = entry
        return read

    def entry(self, kind: type[S], content: object, *path: str) -> S | None:
        """Read one table, and go on after a wrong field so that the next ones are found too."""
        if not isinstance(content, dict):
            self.problem(f"expected a table `[{'.'.join(path)}]`", *path)
            return None
        left, wrong = dict(content), set[str]()
        while True:
            try:
                entry = msgspec.convert(left, kind, dec_hook=decode_hook)
            except msgspec.ValidationError as error:
                said = str(error)
                at = _WRONG_FIELD.search(said)
                named = at or _NAMED_FIELD.search(said)
                field = named[1] if named else ""
                if field not in left:
                    if field not in wrong:
                        self.problem(f"{'.'.join(path)}: {_plain(said)}", *path)
                    return None
                self.problem(f"{'.'.join((*path, field) if at else path)}: {_plain(said)}", *path, field)
                del left[field]
                wrong.add(field)
            else:
                return None if wrong else entry

    def check_percept(self, name: str, entry: PerceptEntry) -> None:
        where = ("percepts", name)
        for position in entry.key:
            if position >= entry.arity:
                self.problem(f"percepts.{name}.key: position {position} of {entry.arity} arguments", *where, "key")
        if entry.ttl is not None and entry.ttl <= 0:
            self.problem(f"percepts.{name}.ttl: expected more than 0 s", *where, "ttl")
        for field in entry.fields():
            if not all(field.field.split(".")):
                self.problem(f"percepts.{name}.args: `{field.field}` is not a field path", *where, "args")

    def check_action(self, name: str, entry: ActionEntry) -> None:
        where = ("actions", name)
        named = [parameter.name for parameter in entry.params]
        for repeated in sorted({one for one in named if named.count(one) > 1}):
            self.problem(f"actions.{name}.params: `{repeated}` stands there twice", *where, "params")
        for parameter in entry.params:
            low, high = parameter.min, parameter.max
            if any(bound is not None and not math.isfinite(bound) for bound in (low, high)):
                self.problem(f"actions.{name}.params: the range of `{parameter.name}` is not finite", *where, "params")
            if low is not None and high is not None and low > high:
                self.problem(f"actions.{name}.params: `{parameter.name}` has min above max", *where, "params")
        for field, value in entry.fields.items():
            refers = value.param if isinstance(value, FieldValue) and value.value is None else value
            if isinstance(refers, str) and refers not in named:
                known = ", ".join(named) or "none"
                self.problem(
                    f"actions.{name}.fields.{field}: no parameter `{refers}`; there is {known}", *where, "fields"
                )
        if entry.deadline <= 0:
            self.problem(f"actions.{name}.deadline: expected more than 0 s", *where, "deadline")
        if len(entry.ways()) != 1:
            self.problem(
                f"actions.{name}: expected one of `command`, `message`, `topic`, `service` and `call`, "
                f"got {' and '.join(f'`{way}`' for way in entry.ways()) or 'none of them'}",
                *where,
            )


def _plain(said: str) -> str:
    """msgspec's sentence without its path, which the finding already gives."""
    return said.partition(" - at `")[0].replace("Object ", "")
