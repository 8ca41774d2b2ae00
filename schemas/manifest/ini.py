"""Read the paper's pair of INI manifests, actions and perceptions.

`msg_type` and `dependencies` are ignored: nothing is imported or executed because of them. Lists are fields of a
message, and types of parameters:

    args        = mode, pose.position.x, status[](name, values[](key, value))
    params_type = float, int[], geometry_msgs/Point[](x, y), bool

Empty entries at the end of a list are ignored.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, TypeVar

from msgspec.structs import replace

from schemas.files.findings import Finding, did_you_mean
from schemas.files.ini_positions import DEFAULT, Option, Section, read_ini
from schemas.files.yaml_positions import MAX_FINDINGS
from schemas.manifest.model import Field, Parameter, ParameterType, Value
from schemas.manifest.rules import RESERVED, needs_default

MAX_DEPTH = 8
"""Nesting of lists of structures."""
TYPES: dict[str, ParameterType] = {
    "str": "string",
    "string": "string",
    "float": "float",
    "int": "int",
    "long": "int",
    "bool": "boolean",
    "list": "list",
}
"""Python's names of types in `params_type`, and the manifest's."""
ELEMENT: tuple[ParameterType, ...] = ("int", "float", "boolean", "string", "list")
"""Types of a field in a structure: `Type[](a, b)` names fields without types."""

_PATH = re.compile(r"[A-Za-z_]\w*(?:\.\w+)*", re.ASCII)
_LISTED = re.compile(r"([^\[\](),]*)\[\s*(\d*)\s*\]\s*(?:\((.*)\))?", re.ASCII | re.DOTALL)
_TYPE = re.compile(r"\w+(?:/\w+)*", re.ASCII)


class BadList(ValueError):
    """A list that cannot be read; the text says where and what was expected."""


def read_fields(text: str) -> tuple[str | Field, ...]:
    """Return the fields in `args`: paths, and lists of structures. Raises BadList."""
    return tuple(_field(entry, 0) for entry in split(text))


def read_names(text: str) -> tuple[str, ...]:
    """Return the paths in `params_name`. Raises BadList."""
    return tuple(_path(entry) for entry in split(text))


def read_defaults(text: str) -> tuple[tuple[str, str], ...]:
    """Return the fields in `defaults`, each with the text of its value. Raises BadList."""
    found: list[tuple[str, str]] = []
    for entry in split(text):
        path, equals, value = entry.partition("=")
        if not equals or not value.strip():
            raise BadList(f"expected a field and its value such as `width=3`, got `{entry}`")
        found.append((_path(path.strip()), value.strip()))
    return tuple(found)


def read_parameter(name: str, text: str) -> Parameter:
    """Return an action's parameter of the type in `text`. Raises BadList."""
    listed = _LISTED.fullmatch(text)
    if listed is None:
        if text in TYPES:
            return Parameter(name=name, type=TYPES[text])
        known = ", ".join(TYPES)
        raise BadList(f"no type `{text}`; expected one of {known}, a list such as `int[]` or `Type[](a, b)`")
    if listed[1] and not _TYPE.fullmatch(listed[1].strip()):
        raise BadList(f"`{listed[1].strip()}` is not the name of a type, in `{text}`")
    each = () if listed[3] is None else read_fields(listed[3])
    if listed[3] is not None and not each:
        raise BadList(f"expected fields between the brackets, in `{text}`")
    return Parameter(name=name, type="list", each=tuple(_element(field) for field in each))


def split(text: str) -> list[str]:
    """Split a list at the commas outside brackets, without empty entries at its end. Raises BadList."""
    entries, depth, start = [""], 0, 0
    for at, sign in enumerate(text):
        depth += (sign in "([") - (sign in ")]")
        if depth < 0:
            raise BadList(f"`{sign}` closes nothing, in `{text.strip()}`")
        if sign == "," and depth == 0:
            entries[-1] = text[start:at].strip()
            entries.append("")
            start = at + 1
    if depth:
        raise BadList(f"a bracket is not closed, in `{text.strip()}`")
    entries[-1] = text[start:].strip()
    while entries and not entries[-1]:
        entries.pop()
    if "" in entries:
        raise BadList(f"entry {entries.index('') + 1} of the list is empty, in `{text.strip()}`")
    return entries


def _field(text: str, depth: int) -> str | Field:
    if depth > MAX_DEPTH:
        raise BadList(f"nested deeper than {MAX_DEPTH}")
    if "[" not in text and "(" not in text:
        return _path(text)
    listed = _LISTED.fullmatch(text)
    if listed is None:
        raise BadList(f"expected a field such as `pose.position.x` or `status[](name, level)`, got `{text}`")
    path = _path(listed[1].strip())
    each = tuple(_field(entry, depth + 1) for entry in split(listed[3] or ""))
    if not each:
        raise BadList(f"`{text}`: expected its fields in brackets, or `{path}` for the whole list")
    return Field(field=path, each=each)


def _path(text: str) -> str:
    if not _PATH.fullmatch(text):
        raise BadList(f"`{text}` is not a field; expected a path such as `pose.position.x`")
    return text


def _element(field: str | Field) -> Parameter:
    if isinstance(field, str):
        return Parameter(name=field, type=ELEMENT)
    return Parameter(name=field.field, type="list", each=tuple(_element(one) for one in field.each))


ACTION_OPTIONS = ("method", "name", "msg_type", "dependencies", "params_name", "params_type", "defaults", "latch")
PERCEPT_OPTIONS = ("name", "msg_type", "dependencies", "args", "buf", "rate", "method")
ONLY_ACTIONS, ONLY_PERCEPTS = (
    frozenset({"params_name", "params_type", "defaults", "latch"}),
    frozenset({"args", "buf", "rate"}),
)
"""Options of one kind of file only."""
PAPERS_RATE = 30.0
"""Hz: the highest rate of the paper's bridge, used if `[DEFAULT]` has no `rate`."""
TRUE, FALSE = frozenset({"true", "yes", "t", "1"}), frozenset({"false", "no", "f", "0"})
"""Texts of a truth value, in lower case."""

Method = Literal["topic", "service"]
T = TypeVar("T")
_FUNCTOR = re.compile(r"[a-z]\w*", re.ASCII)
_ROS_NAME = re.compile(r"/?[\w.-]+(?:/[\w.-]+)*", re.ASCII)


@dataclass(frozen=True)
class IniPercept:
    """A section of the perceptions manifest."""

    name: str
    topic: str
    """Without its leading `/`."""
    args: tuple[str | Field, ...]
    buf: Literal["update", "add"]
    rate: float
    lines: Mapping[str, int]
    """Line of each option, and of the section under the empty name."""


@dataclass(frozen=True)
class IniAction:
    """A section of the actions manifest."""

    name: str
    method: Method
    target: str
    """The topic or service, without its leading `/`."""
    params: tuple[Parameter, ...]
    typed: bool
    """Whether `params_type` has their types; otherwise they are strings."""
    latch: bool
    lines: Mapping[str, int]
    wrong: bool = False
    """A finding about it exists; findings that follow from that are left out."""


def read_actions(text: str, file: str) -> tuple[list[IniAction], list[Finding]]:
    """Return the readable actions of an actions manifest, and all findings."""
    reader = _Reader(text, file, ACTION_OPTIONS)
    if not reader.is_of(ONLY_PERCEPTS, ONLY_ACTIONS, "a perceptions manifest"):
        return [], reader.findings
    return reader.entries(_action), reader.findings


def read_percepts(text: str, file: str) -> tuple[list[IniPercept], list[Finding]]:
    """Return the readable percepts of a perceptions manifest, and all findings."""
    reader = _Reader(text, file, PERCEPT_OPTIONS)
    if not reader.is_of(ONLY_ACTIONS, ONLY_PERCEPTS, "an actions manifest"):
        return [], reader.findings
    return reader.entries(_percept), reader.findings


def truth(text: str) -> bool | None:
    """Return the truth value of a text, or None."""
    small = text.strip().lower()
    return True if small in TRUE else False if small in FALSE else None


class _Reader:
    """Reads one of the two files."""

    def __init__(self, text: str, file: str, known: tuple[str, ...]) -> None:
        self.ini = read_ini(text, file)
        self.file, self.known = file, known
        self.table = "actions" if known is ACTION_OPTIONS else "percepts"
        self.findings = list(self.ini.findings)

    def is_of(self, theirs: frozenset[str], ours: frozenset[str], other: str) -> bool:
        """Whether this is the right file of the two. If it is the other one, that is the only finding."""
        given = {option for section in (self.ini.defaults, *self.ini.sections) for option in section.options}
        if given & theirs and not given & ours:
            order = "the actions come first: `manifest: [actions_manifest, perceptions_manifest]`"
            self.findings = [Finding(self.file, 0, 0, f"this is {other}; {order}")]
            return False
        return True

    def entries(self, read: Callable[[_Options], T | None]) -> list[T]:
        self._unknown(self.ini.defaults, f"[{DEFAULT}]")
        found: list[T] = []
        for section in self.ini.sections:
            if len(self.findings) >= MAX_FINDINGS:
                break
            if not _FUNCTOR.fullmatch(section.name):
                problem = f"`[{section.name}]`: expected the name of a belief or action, such as `[battery]`"
                self.findings.append(Finding(self.file, section.line, 0, problem))
            elif meaning := RESERVED[self.table].get(section.name):
                problem = f"`[{section.name}]` is a name of the bridge: {meaning}"
                self.findings.append(Finding(self.file, section.line, 0, problem))
            self._unknown(section, f"[{section.name}]")
            options = _Options(section, self.ini.defaults, self.file, self.findings)
            entry = read(options)
            if entry is not None:
                found.append(entry)
        return found

    def _unknown(self, section: Section, where: str) -> None:
        for name, option in section.options.items():
            if name not in self.known and len(self.findings) < MAX_FINDINGS:
                problem = f"{where}: no option `{name}`{did_you_mean(name, self.known)}"
                self.findings.append(Finding(self.file, option.line, 0, problem))


class _Options:
    """The options of one section, completed by those of `[DEFAULT]`."""

    def __init__(self, section: Section, defaults: Section, file: str, findings: list[Finding]) -> None:
        self.section, self.file, self.findings = section, file, findings
        self.options: dict[str, Option] = defaults.options | section.options
        self._reported: set[Finding] = set()
        self.lines = {"": section.line} | {name: option.line for name, option in self.options.items()}

    def problem(self, message: str, option: str = "") -> None:
        line = self.lines.get(option, self.section.line)
        what = f"[{self.section.name}] {option}".rstrip()
        finding = Finding(self.file, line, 0, f"{what}: {message}")
        if finding not in self._reported:
            self._reported.add(finding)
            self.findings.append(finding)

    def text(self, name: str) -> str:
        option = self.options.get(name)
        return option.value.strip() if option is not None else ""

    def ros_name(self) -> str:
        """Return the topic or service without its leading `/`; empty, with a finding, if it is not a ROS name."""
        text = self.text("name")
        if not text:
            self.problem("`name`, the topic or service, is missing", "name" if "name" in self.options else "")
        elif not _ROS_NAME.fullmatch(text):
            self.problem(f"expected the name of a topic or service such as `/turtle1/pose`, got `{text}`", "name")
        else:
            return text.removeprefix("/")
        return ""

    def one_of(self, name: str, known: tuple[str, ...], default: str = "") -> str:
        text = self.text(name) or default
        if not text:
            self.problem(f"`{name}` is missing; expected {' or '.join(known)}")
        elif text not in known:
            self.problem(f"expected {' or '.join(known)}, got `{text}`", name)
        return text

    def listed(self, name: str, read: Callable[[str], tuple[T, ...]]) -> tuple[T, ...]:
        try:
            return read(self.text(name))
        except BadList as error:
            self.problem(str(error), name)
            return ()


def _percept(options: _Options) -> IniPercept | None:
    topic = options.ros_name()
    options.one_of("method", ("topic",), "topic")
    buf = options.one_of("buf", ("update", "add"), "update")
    args = options.listed("args", read_fields)
    rate = _rate(options)
    if not topic:
        return None
    return IniPercept(options.section.name, topic, args, "add" if buf == "add" else "update", rate, options.lines)


def _rate(options: _Options) -> float:
    text = options.text("rate")
    if not text:
        return PAPERS_RATE
    try:
        rate = float(text)
    except ValueError:
        rate = math.nan
    if 0 < rate <= 1e6:
        return rate
    options.problem(f"expected a number of Hz above 0, got `{text}`", "rate")
    return PAPERS_RATE


def _action(options: _Options) -> IniAction | None:
    before = len(options.findings)
    target = options.ros_name()
    method = options.one_of("method", ("topic", "service"))
    latch = truth(options.text("latch") or "True")
    if latch is None:
        options.problem(f"expected True or False, got `{options.text('latch')}`", "latch")
    typed = "params_type" in options.options
    params = _parameters(options, typed)
    if not target:
        return None
    way: Method = "service" if method == "service" else "topic"
    wrong = len(options.findings) > before
    return IniAction(options.section.name, way, target, params, typed, bool(latch), options.lines, wrong)


def value_of(kind: ParameterType, text: str) -> Value | None:
    """Return the value of this type in a text, or None."""
    match kind:
        case "boolean":
            return truth(text)
        case "string":
            return text
        case "int" | "float":
            with suppress(ValueError):
                number = int(text) if kind == "int" else float(text)
                return number if math.isfinite(number) else None
    return None


def _parameters(options: _Options, typed: bool) -> tuple[Parameter, ...]:
    """Return the parameters in `params_name`, then those that only `defaults` has."""
    params = {param.name: param for param in _named_parameters(options, typed)}
    for name, text in options.listed("defaults", read_defaults):
        param = params[name] if name in params else _of_literal(name, text)
        value = next((one for kind in param.types if (one := value_of(kind, text)) is not None), None)
        if value is None:
            options.problem(f"expected `{name}`: {param.expected()}, got `{text}`", "defaults")
        params[name] = replace(param, default=value)
    found = tuple(params.values())
    for count in range(len(found)):
        if lacking := needs_default(found[: count + 1]):
            options.problem(lacking, "defaults")
    return found


def _of_literal(name: str, text: str) -> Parameter:
    """Return a parameter with the type of its default."""
    if value_of("float", text) is not None:
        return Parameter(name=name, type=("int", "float"))
    return Parameter(name=name, type="boolean" if text.lower() in ("true", "false") else "string")


def _named_parameters(options: _Options, typed: bool) -> tuple[Parameter, ...]:
    before = len(options.findings)
    names = options.listed("params_name", read_names)
    for repeated in sorted({name for name in names if names.count(name) > 1}):
        options.problem(f"`{repeated}` is repeated", "params_name")
    if not typed:
        return tuple(Parameter(name=name, type="string") for name in names)
    types = options.listed("params_type", lambda text: tuple(split(text)))
    if len(types) != len(names) and len(options.findings) == before:
        options.problem(f"{len(names)} names in `params_name`, {len(types)} types here", "params_type")
    read: list[Parameter] = []
    for name, kind in zip(names, types, strict=False):  # unequal numbers are reported above
        try:
            read.append(read_parameter(name, kind))
        except BadList as error:
            options.problem(str(error), "params_type")
    return tuple(read)
