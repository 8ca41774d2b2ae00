"""Read manifests (design section 12); all problems are reported together, each at its line."""

from __future__ import annotations

import re
import tomllib
from ast import literal_eval
from collections.abc import Callable, Iterable
from functools import lru_cache
from itertools import islice
from pathlib import Path
from typing import Any, TypeVar, get_args

import msgspec

from schemas.files.findings import Finding, Findings, did_you_mean, near_miss
from schemas.files.shipped_files import shipped, shipped_names
from schemas.files.text_files import near_file, other_kind, read_text
from schemas.files.toml_positions import line_of, toml_lines
from schemas.files.units import decode_hook
from schemas.files.validation import convert, misfits
from schemas.files.yaml_positions import MAX_FINDINGS
from schemas.manifest.model import (
    ActionDescription,
    ActionEntry,
    Argument,
    Field,
    FieldValue,
    Manifest,
    Parameter,
    ParameterType,
    PerceptEntry,
    Retry,
    RobotEntry,
    Value,
    Values,
)
from schemas.manifest.rules import RULES, name_problems
from schemas.wire.records import Order

__all__ = [
    "ActionDescription",
    "ActionEntry",
    "Argument",
    "Field",
    "FieldValue",
    "Manifest",
    "Parameter",
    "ParameterType",
    "PerceptEntry",
    "Retry",
    "RobotEntry",
    "Value",
    "Values",
    "find_manifest",
    "load_manifest",
    "read_document",
    "read_manifest",
]

S = TypeVar("S", bound=msgspec.Struct)
Check = Callable[[Manifest], Iterable[Finding]]
"""Check of a manifest by its drivers: `bridged.drivers.check_manifest`."""
TABLES = ("robot", "percepts", "actions", "orders")
_TWICE = re.compile(r"Cannot declare (\(.+\)) twice")
"""tomllib's error of a table that is there twice, with its name as a tuple."""
_SYNTAX_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")


def find_manifest(name: str, relative_to: Path | None = None) -> Path | None:
    """Return the file that a mission means by `name`: a path, or the bare name of a shipped manifest."""
    if "/" in name or name.endswith(".toml"):
        path = Path(name) if relative_to is None else relative_to / name
        return path if path.is_file() else None
    return shipped("manifests", f"{name}.toml")


def load_manifest(name: str | Path, relative_to: Path | None = None, check: Check | None = None) -> Manifest:
    """Read and check a manifest. Raises Findings with every problem, each at its line.

    `check` is asked for its findings too, of what is right where something else is wrong.
    """
    path = find_manifest(str(name), relative_to)
    if path is None:
        known = shipped_names("manifests", ".toml")
        hint = near_file(name if relative_to is None else relative_to / name) or near_miss(str(name), known)
        hint = hint or f"; expected a file or one of: {', '.join(known)}"
        raise Findings.about(name, f"no such manifest{hint}")
    if other := other_kind(path, ".toml"):
        raise Findings.about(name, f"expected a manifest in TOML; {other}")
    return _read_once(read_text(path), str(path), check)


@lru_cache(maxsize=16)
def _read_once(text: str, file: str, check: Check | None) -> Manifest:
    """Read a text that may have been read before: the robots of a fleet have few manifests, and none is changed."""
    return read_manifest(text, file, check)


def read_manifest(text: str, file: str, check: Check | None = None) -> Manifest:
    """Check the text of a manifest; `file` is what findings name. Raises Findings with every problem."""
    try:
        document = tomllib.loads(text)
        lines = toml_lines(text)
    except tomllib.TOMLDecodeError as error:
        raise Findings([_syntax_finding(str(error), text, file)]) from None
    except RecursionError:
        raise Findings.about(file, "nested too deeply") from None
    except ValueError as error:  # a date that there is not, an integer of 5000 digits
        raise Findings.about(file, str(error).partition(";")[0]) from None
    return read_document(document, file, lines, check)


def read_document(
    document: dict[str, Any], file: str, lines: dict[tuple[str, ...], int] | None = None, check: Check | None = None
) -> Manifest:
    """Check a manifest as the plain data that its TOML says. Raises Findings with every problem."""
    return _Reader(file, {} if lines is None else lines).manifest(document, check)


def _syntax_finding(message: str, text: str, file: str) -> Finding:
    place = _SYNTAX_PLACE.search(message)
    if place is None:
        return Finding(file, 0, 0, message)
    message = _TWICE.sub(lambda found: f"[{'.'.join(literal_eval(found[1]))}] is declared twice", message)
    line, column = (int(place[1]), int(place[2])) if place[1] else (text.count("\n") + 1, 0)
    return Finding(file, line, column, _SYNTAX_PLACE.sub("", message))


class _Reader:
    """Collects the problems of one manifest."""

    def __init__(self, file: str, lines: dict[tuple[str, ...], int]) -> None:
        self.file = file
        self.lines = lines
        self.problems: list[Finding] = []

    def manifest(self, document: dict[str, Any], check: Check | None) -> Manifest:
        for key in islice((key for key in document if key not in TABLES), MAX_FINDINGS):
            self.problem(f"there is no such table{did_you_mean(key, TABLES)}", key)
        robot = None
        if "robot" not in document:
            self.problem("a `[robot]` table with its `driver` is missing")
        else:
            robot = self.entry(RobotEntry, document["robot"], "robot")
        percepts = self.entries(PerceptEntry, document, "percepts")
        actions = self.entries(ActionEntry, document, "actions")
        orders = self.orders(document.get("orders", {}))
        if robot is not None:
            manifest = Manifest(
                robot=robot, percepts=percepts, actions=actions, orders=orders, file=self.file, lines=self.lines
            )
            if self.problems and check is not None:  # an order may name an action that is left out here
                self.problems += check(msgspec.structs.replace(manifest, orders={}))
            if not self.problems:
                return manifest
        raise Findings(self.problems)

    def problem(self, message: str, *path: str) -> None:
        text = f"{place(path)}: {message}" if path else message
        self.problems.append(Finding(self.file, line_of(self.lines, path), 0, text))

    def entries(self, kind: type[S], document: dict[str, Any], table: str) -> dict[str, S]:
        found = document.get(table, {})
        if not isinstance(found, dict):
            self.problem(f"expected tables `[{table}.NAME]`", table)
            return {}
        read: dict[str, S] = {}
        for name, content in found.items():
            before = len(self.problems)
            for problem in name_problems(table, name):
                self.problem(problem, table, name)
            entry = self.entry(kind, content, table, name)
            if entry is not None and len(self.problems) == before:
                read[name] = entry
        return read

    def entry(self, kind: type[S], content: object, *path: str) -> S | None:
        """Read one table; None if something is wrong with it."""
        if not isinstance(content, dict):
            self.problem(f"expected a table `[{'.'.join(path)}]`", *path)
            return None
        found = islice(misfits(content, kind, decode_hook), MAX_FINDINGS)
        wrong = [(tuple(map(str, one.path)), one.text) for one in found]
        bad = {where[0] for where, _ in wrong if where}
        try:
            entry = convert({field: value for field, value in content.items() if field not in bad}, kind, decode_hook)
        except msgspec.ValidationError:  # a field is missing, or is needed and wrong
            entry = None
        if entry is not None:
            for fields, rule in RULES[kind]:
                if not fields & bad:
                    wrong += rule(entry)
        for where, message in wrong:
            self.problem(message, *path, *where)
        return None if wrong else entry

    def orders(self, content: object) -> dict[Order, str]:
        if not isinstance(content, dict):
            self.problem("expected a table `[orders]`", "orders")
            return {}
        known: tuple[Order, ...] = get_args(Order)
        for name, text in content.items():
            if name not in known:
                self.problem(f"there is no such order{did_you_mean(name, known)}", "orders", name)
            elif not isinstance(text, str) or not text.strip():
                self.problem('expected an action with its arguments, such as `"cmd_vel(0, 0)"`', "orders", name)
        return {name: content[name] for name in known if isinstance(content.get(name), str)}


def place(path: Iterable[str]) -> str:
    """Return a path for people: `actions.goto.params[0].min`."""
    return "".join(f"[{step}]" if step.isdigit() else f".{step}" for step in path).removeprefix(".")
