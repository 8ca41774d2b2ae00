"""The paper's pair of INI files, actions and perceptions, as they are written: what ROS would do with them is not here.

`msg_type` and `dependencies` are read over: nothing is imported or executed because of them. Pure.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Literal, TypeVar

from msgspec.structs import replace

from schemas.files.findings import Finding
from schemas.files.ini_positions import DEFAULT, Option, Section, read_ini
from schemas.files.yaml_positions import MAX_FINDINGS, did_you_mean
from schemas.manifest.ini_arguments import BadList, read_defaults, read_fields, read_names, read_parameter, split
from schemas.manifest.model import Field, Parameter, ParameterType, Value
from schemas.manifest.rules import RESERVED, needs_default

ACTION_OPTIONS = ("method", "name", "msg_type", "dependencies", "params_name", "params_type", "defaults", "latch")
PERCEPT_OPTIONS = ("name", "msg_type", "dependencies", "args", "buf", "rate", "method")
ONLY_ACTIONS, ONLY_PERCEPTS = (
    frozenset({"params_name", "params_type", "defaults", "latch"}),
    frozenset({"args", "buf", "rate"}),
)
"""Options by which a file shows which of the two it is."""
PAPERS_RATE = 30.0
"""Hz at which the paper's bridge told percepts again at most, where `[DEFAULT]` names no `rate`."""
TRUE, FALSE = frozenset({"true", "yes", "t", "1"}), frozenset({"false", "no", "f", "0"})
"""Texts that are a truth value, in small letters."""

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
    """Where its options stand; the section itself under the empty name."""


@dataclass(frozen=True)
class IniAction:
    """A section of the actions manifest."""

    name: str
    method: Method
    target: str
    """The topic or service, without its leading `/`."""
    params: tuple[Parameter, ...]
    typed: bool
    """Whether `params_type` says what they are; they are texts otherwise."""
    latch: bool
    lines: Mapping[str, int]
    wrong: bool = False
    """Something of it is told already as wrong; what follows from that need not be told."""


def read_actions(text: str, file: str) -> tuple[list[IniAction], list[Finding]]:
    """Return what an actions manifest declares as far as it reads, and everything that is wrong with it."""
    reader = _Reader(text, file, ACTION_OPTIONS)
    if not reader.is_of(ONLY_PERCEPTS, ONLY_ACTIONS, "a perceptions manifest"):
        return [], reader.findings
    return reader.entries(_action), reader.findings


def read_percepts(text: str, file: str) -> tuple[list[IniPercept], list[Finding]]:
    """Return what a perceptions manifest declares as far as it reads, and everything that is wrong with it."""
    reader = _Reader(text, file, PERCEPT_OPTIONS)
    if not reader.is_of(ONLY_ACTIONS, ONLY_PERCEPTS, "an actions manifest"):
        return [], reader.findings
    return reader.entries(_percept), reader.findings


def truth(text: str) -> bool | None:
    """Return the truth value that a text is, None if it is none."""
    small = text.strip().lower()
    return True if small in TRUE else False if small in FALSE else None


class _Reader:
    """One of the two files."""

    def __init__(self, text: str, file: str, known: tuple[str, ...]) -> None:
        self.ini = read_ini(text, file)
        self.file, self.known = file, known
        self.table = "actions" if known is ACTION_OPTIONS else "percepts"
        self.findings = list(self.ini.findings)

    def is_of(self, theirs: frozenset[str], ours: frozenset[str], other: str) -> bool:
        """Whether this is the right file of the two; if it is the other one, that is all there is to say."""
        said = {option for section in (self.ini.defaults, *self.ini.sections) for option in section.options}
        if said & theirs and not said & ours:
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
                said = f"`[{section.name}]`: expected the name of a belief or action, such as `[battery]`"
                self.findings.append(Finding(self.file, section.line, 0, said))
            elif meaning := RESERVED[self.table].get(section.name):
                said = f"`[{section.name}]` is a name of the bridge: {meaning}"
                self.findings.append(Finding(self.file, section.line, 0, said))
            self._unknown(section, f"[{section.name}]")
            options = _Options(section, self.ini.defaults, self.file, self.findings)
            entry = read(options)
            if entry is not None:
                found.append(entry)
        return found

    def _unknown(self, section: Section, where: str) -> None:
        for name, option in section.options.items():
            if name not in self.known and len(self.findings) < MAX_FINDINGS:
                said = f"{where}: no option `{name}`{did_you_mean(name, self.known)}"
                self.findings.append(Finding(self.file, option.line, 0, said))


class _Options:
    """The options of one section, with those of `[DEFAULT]` where it has none."""

    def __init__(self, section: Section, defaults: Section, file: str, findings: list[Finding]) -> None:
        self.section, self.file, self.findings = section, file, findings
        self.options: dict[str, Option] = defaults.options | section.options
        self._told: set[Finding] = set()
        self.lines = {"": section.line} | {name: option.line for name, option in self.options.items()}

    def problem(self, message: str, option: str = "") -> None:
        line = self.lines.get(option, self.section.line)
        what = f"[{self.section.name}] {option}".rstrip()
        finding = Finding(self.file, line, 0, f"{what}: {message}")
        if finding not in self._told:
            self._told.add(finding)
            self.findings.append(finding)

    def text(self, name: str) -> str:
        option = self.options.get(name)
        return option.value.strip() if option is not None else ""

    def ros_name(self) -> str:
        """The topic or service as it stands under the robot's prefix; empty if it is none."""
        said = self.text("name")
        if not said:
            self.problem("`name`, the topic or service, is missing", "name" if "name" in self.options else "")
        elif not _ROS_NAME.fullmatch(said):
            self.problem(f"expected the name of a topic or service such as `/turtle1/pose`, got `{said}`", "name")
        else:
            return said.removeprefix("/")
        return ""

    def one_of(self, name: str, known: tuple[str, ...], default: str = "") -> str:
        said = self.text(name) or default
        if not said:
            self.problem(f"`{name}` is missing; expected {' or '.join(known)}")
        elif said not in known:
            self.problem(f"expected {' or '.join(known)}, got `{said}`", name)
        return said

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
    said = options.text("rate")
    if not said:
        return PAPERS_RATE
    try:
        rate = float(said)
    except ValueError:
        rate = math.nan
    if 0 < rate <= 1e6:
        return rate
    options.problem(f"expected a number of Hz above 0, got `{said}`", "rate")
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
    """Return the value of a type that a text is, None if it is none."""
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
    """The parameters that the section names, and those of `defaults` that it does not name."""
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
    """A parameter of the type that the text of its default is."""
    if value_of("float", text) is not None:
        return Parameter(name=name, type=("int", "float"))
    return Parameter(name=name, type="boolean" if text.lower() in ("true", "false") else "string")


def _named_parameters(options: _Options, typed: bool) -> tuple[Parameter, ...]:
    before = len(options.findings)
    names = options.listed("params_name", read_names)
    for repeated in sorted({name for name in names if names.count(name) > 1}):
        options.problem(f"`{repeated}` stands there twice", "params_name")
    if not typed:
        return tuple(Parameter(name=name, type="string") for name in names)
    types = options.listed("params_type", lambda text: tuple(split(text)))
    if len(types) != len(names) and len(options.findings) == before:
        options.problem(f"{len(names)} names in `params_name`, {len(types)} types here", "params_type")
    read: list[Parameter] = []
    for name, kind in zip(names, types, strict=False):  # that there are as many is told above
        try:
            read.append(read_parameter(name, kind))
        except BadList as error:
            options.problem(str(error), "params_type")
    return tuple(read)
