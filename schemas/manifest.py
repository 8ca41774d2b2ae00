"""The manifest of a robot (design section 12): its percepts, its actions, and how each is translated.

A manifest is data: it names sources, fields, commands and ranges from closed vocabularies, and nothing in it is
executed. Which sources, commands and confirmations exist is the driver's to say (`bridged.drivers`).
"""

from __future__ import annotations

import math
import re
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import msgspec
from msgspec import Meta

from schemas.durations import Duration
from schemas.findings import Finding, Findings
from schemas.records import Record
from schemas.shipped import shipped, shipped_names
from schemas.toml_lines import line_of, toml_lines

Positive = Annotated[float, Meta(gt=0, le=1e6)]
Factor = Annotated[float, Meta(ge=-1e15, le=1e15)]
ParameterType = Literal["float", "int", "boolean", "string"]
Value = bool | int | float | str
S = TypeVar("S", bound=msgspec.Struct)

_FUNCTOR = re.compile(r"[a-z][A-Za-z0-9_]*")
_WRONG_FIELD = re.compile(r"at `\$\.([A-Za-z0-9_]+)")
_NAMED_FIELD = re.compile(r"field `([^`]+)`")
_SYNTAX_PLACE = re.compile(r" \(at (?:line (\d+), column (\d+)|end of document)\)$")


class _Entry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """A table of the manifest: an unknown field is an error, so that a typing mistake cannot pass unnoticed."""


class Field(_Entry, frozen=True, kw_only=True):
    """A value in a message of the robot: `value * scale + offset`."""

    field: str
    """Path in the message, such as `voltages.0`."""
    scale: Factor = 1.0
    offset: Factor = 0.0
    absent: float | None = None
    """The raw value by which the robot says that it does not know (65535, -1): then there is no percept."""


class PerceptEntry(_Entry, frozen=True, kw_only=True):
    """How one percept is made from what the robot says."""

    source: str
    """Message of the robot's protocol, such as `GLOBAL_POSITION_INT`."""
    args: tuple[str | Field, ...] = ()
    buf: Literal["update", "add"] = "update"
    """`update` replaces the belief, `add` keeps every one (events)."""
    key: tuple[Annotated[int, Meta(ge=0)], ...] = ()
    """Positions of the arguments that tell beliefs of this name apart; none = there is one."""
    rate: Positive | None = None
    """At most so many changes a second are told; also what a stream of the source is asked for."""
    ttl: Duration | None = None
    """The belief goes when its source has been silent for so long; none = it stays."""
    deadband: Annotated[float, Meta(ge=0)] = 0.0
    """Numbers that moved by no more than this, in the unit of the percept, are not a change."""

    @property
    def arity(self) -> int:
        """Number of arguments of the belief."""
        return len(self.args)

    def fields(self) -> tuple[Field, ...]:
        """The arguments in their long form."""
        return tuple(Field(field=arg) if isinstance(arg, str) else arg for arg in self.args)


class Parameter(_Entry, frozen=True, kw_only=True):
    """An argument of an action: what it must be."""

    name: str
    type: ParameterType | tuple[ParameterType, ...] = "float"
    unit: str = ""
    min: float | None = None
    max: float | None = None

    @property
    def types(self) -> tuple[ParameterType, ...]:
        """The types of which the argument must have one."""
        return (self.type,) if isinstance(self.type, str) else self.type

    def __str__(self) -> str:
        text = f"{self.name}: {' or '.join(self.types)}"
        if self.min is not None or self.max is not None:
            low = "" if self.min is None else f"{self.min:g}"
            high = "" if self.max is None else f"{self.max:g}"
            text += f" {low}..{high}"
        return f"{text} {self.unit}".rstrip()


class FieldValue(_Entry, frozen=True, kw_only=True):
    """What goes into a field of a command: an argument of the action, converted."""

    param: str
    scale: Factor = 1.0
    table: str = ""
    """The argument is looked up in this table of the driver, such as `modes`."""


class Retry(_Entry, frozen=True, kw_only=True):
    """How often a command is sent again when nothing answers. Wall seconds: they do not shrink with `speed`."""

    times: Annotated[int, Meta(ge=0, le=20)] = 3
    every: Duration = Duration(0.7)


class ActionEntry(_Entry, frozen=True, kw_only=True):
    """How one action is carried out, and how its success is known."""

    params: tuple[Parameter, ...] = ()
    command: str = ""
    """MAVLink command, such as `MAV_CMD_NAV_TAKEOFF`."""
    message: str = ""
    """MAVLink message to send instead of a command, such as `SET_POSITION_TARGET_GLOBAL_INT`."""
    frame: Literal["relative", "amsl"] | None = None
    """What an altitude counts from: home, or mean sea level."""
    fields: dict[str, Value | FieldValue] = {}
    """Fields of the command or message: a parameter's name, a number, or a conversion."""
    confirm: str
    """By which state of the robot success is known; one of those that the driver offers."""
    tolerance: Positive | None = None
    """How near is there, in metres; none = the confirmation's own."""
    deadline: Duration = Duration(60)
    retry: Retry = Retry()
    cancel: Literal["hold", "none"] = "none"
    """What the robot does when the action is cancelled or out of time; `none` = it goes on."""
    motion: bool = True
    """It moves the robot: one such action at a time."""
    supersedes: bool = False
    """It ends a motion that is running instead of being refused as busy."""

    @property
    def arity(self) -> int:
        """Number of arguments."""
        return len(self.params)


class RobotEntry(_Entry, frozen=True, kw_only=True):
    """What kind of robot this is."""

    driver: str
    vehicle: str = ""
    """Which of the driver's vehicle tables holds, such as `arducopter`."""
    link_loss: Duration = Duration(5)
    """Silence after which the robot counts as not connected; wall seconds at least."""


class Manifest(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """A robot, declaratively. Made by `load_manifest`."""

    robot: RobotEntry
    percepts: dict[str, PerceptEntry] = {}
    actions: dict[str, ActionEntry] = {}
    file: str = ""
    lines: dict[tuple[str, ...], int] = {}

    def finding(self, message: str, *path: str) -> Finding:
        """Return a finding at the line of the table or key at `path`, such as `"actions", "takeoff", "confirm"`."""
        return Finding(self.file, line_of(self.lines, path), 0, message)

    def percept_arities(self) -> dict[str, int]:
        """Each percept's name and number of arguments."""
        return {name: entry.arity for name, entry in self.percepts.items()}

    def action_arities(self) -> dict[str, int]:
        """Each action's name and number of arguments."""
        return {name: entry.arity for name, entry in self.actions.items()}


class ActionDescription(Record, frozen=True, kw_only=True):
    """What a bridge answers to a query for an action that is not a request to act: what the action is."""

    name: str
    signature: str
    """Such as `takeoff(altitude: float 1..120 m)`."""
    confirm: str = ""
    deadline: float = 0.0
    """Mission seconds."""
    problem: str = ""
    """What was wrong with the payload of the query."""


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
    try:
        text = path.read_bytes().decode()
    except OSError as error:
        raise Findings([Finding(str(path), 0, 0, f"cannot be read: {error.strerror}")]) from None
    except UnicodeDecodeError as error:
        line = path.read_bytes()[: error.start].count(b"\n") + 1
        raise Findings([Finding(str(path), line, 0, "expected UTF-8 text")]) from None
    return read_manifest(text, str(path))


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
        for key in sorted(set(document) - {"robot", "percepts", "actions"}):
            self.problem(f"unknown table or key `{key}`, expected `robot`, `percepts` or `actions`", key)
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
                entry = msgspec.convert(left, kind, dec_hook=_duration)
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
            refers = value.param if isinstance(value, FieldValue) else value
            if isinstance(refers, str) and refers not in named:
                known = ", ".join(named) or "none"
                self.problem(
                    f"actions.{name}.fields.{field}: no parameter `{refers}`; there is {known}", *where, "fields"
                )
        if entry.deadline <= 0:
            self.problem(f"actions.{name}.deadline: expected more than 0 s", *where, "deadline")
        if bool(entry.command) == bool(entry.message):
            self.problem(f"actions.{name}: expected either `command` or `message`", *where)


def _duration(expected: type, value: object) -> object:
    if expected is Duration:
        return Duration.read(value)
    raise NotImplementedError(f"no reading of {expected!r}")


def _plain(said: str) -> str:
    """msgspec's sentence without its path, which the finding already gives."""
    return said.partition(" - at `")[0].replace("Object ", "")
