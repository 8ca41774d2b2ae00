"""Read YAML with positions, and convert it to models with msgspec's errors as findings.

Files are untrusted: only plain YAML of bounded size and depth, no tags that construct objects.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any, TypeVar, get_args

import msgspec
import yaml
from yaml.composer import Composer
from yaml.resolver import Resolver

from schemas.files.findings import Finding, Findings, did_you_mean
from schemas.files.validation import convert as _convert_value
from schemas.files.validation import is_struct

if yaml.__with_libyaml__:
    from yaml._yaml import CParser as _Parser  # five times as fast
else:

    class _Parser(yaml.reader.Reader, yaml.scanner.Scanner, yaml.parser.Parser):  # type: ignore[no-redef]
        def __init__(self, stream: str) -> None:
            yaml.reader.Reader.__init__(self, stream)
            yaml.scanner.Scanner.__init__(self)
            yaml.parser.Parser.__init__(self)


T = TypeVar("T")
Steps = tuple[str | int, ...]
Position = tuple[int, int]
MAX_DEPTH = 32
MAX_NODES = 10_000
MAX_FINDINGS = 100
TOO_LARGE = "nested too deeply or too large for a mission file"


class Positions:
    """Line and column of each value of a file, and of the key of each mapping entry."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.values: dict[Steps, Position] = {(): (1, 1)}
        self.keys: dict[Steps, Position] = {}

    def of(self, path: Steps) -> Position:
        """Return line and column of the value at `path`, or of the nearest value around it."""
        while path not in self.values:
            path = path[:-1]
        return self.values[path]

    def finding(self, path: Steps, message: str, *, at_key: bool = False) -> Finding:
        """Return a finding at the value (or the key) at `path`."""
        line, column = self.keys.get(path, self.of(path)) if at_key else self.of(path)
        return Finding(self.file, line, column, message)


def read_yaml(text: str, file: str) -> tuple[Any, Positions]:
    """Return the plain values of a YAML text and their positions. Raises Findings."""
    positions = Positions(file)
    try:
        root = _BoundedLoader(text).get_single_node()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = (mark.line + 1, mark.column + 1) if mark else (1, 1)
        raise Findings([Finding(file, *where, f"not YAML: {error.problem or error.context}")]) from None
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        raise Findings([Finding(file, 1, 1, f"not YAML: {str(error).splitlines()[0]}")]) from None
    reader = _Reader(positions)
    value = reader.read(root, (), 0) if root is not None else None
    if reader.findings:
        raise Findings(reader.findings)
    return value, positions


class _BoundedLoader(Composer, _Parser, Resolver):
    """Stops where a document becomes too deep or too large, before the rest is read."""

    def __init__(self, stream: str) -> None:
        _Parser.__init__(self, stream)
        Composer.__init__(self)
        Resolver.__init__(self)
        self._depth = self._nodes = 0

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        self._nodes += 1
        self._depth += 1
        if self._depth > 2 * MAX_DEPTH or self._nodes > 2 * MAX_NODES:  # keys are nodes, too
            mark: Any = getattr(self.peek_event(), "start_mark", None)
            raise yaml.composer.ComposerError(None, None, TOO_LARGE, mark)
        node: yaml.Node | None = super().compose_node(parent, index)
        self._depth -= 1
        return node


class _Reader:
    def __init__(self, positions: Positions) -> None:
        self.positions = positions
        self.findings: list[Finding] = []
        self.nodes = 0
        self.constructor = yaml.constructor.SafeConstructor()

    def read(self, node: yaml.Node, path: Steps, depth: int) -> Any:
        mark = node.start_mark
        self.positions.values[path] = (mark.line + 1, mark.column + 1)
        self.nodes += 1
        if depth > MAX_DEPTH or self.nodes > MAX_NODES:  # by aliases: what is written out, the loader has bounded
            if len(self.findings) < 1:
                self.findings.append(self.positions.finding(path, TOO_LARGE))
            return None
        if isinstance(node, yaml.MappingNode):
            return self.mapping(node, path, depth)
        if isinstance(node, yaml.SequenceNode):
            return [self.read(item, (*path, index), depth + 1) for index, item in enumerate(node.value)]
        try:
            value = self.constructor.construct_object(node)
        except (yaml.YAMLError, ValueError, OverflowError, LookupError, AttributeError):  # `!!bool x`, `!!timestamp x`
            value = node.value
            self.findings.append(self.positions.finding(path, f"`{node.value}` cannot be read as `{node.tag}`"))
        if isinstance(value, str | int | float | bool) or value is None:
            return value
        return node.value  # dates and other YAML extras are just text here

    def mapping(self, node: yaml.MappingNode, path: Steps, depth: int) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = str(key_node.value) if isinstance(key_node, yaml.ScalarNode) else "?"
            here = (*path, key)
            where = (key_node.start_mark.line + 1, key_node.start_mark.column + 1)
            if not isinstance(key_node, yaml.ScalarNode):
                self.findings.append(Finding(self.positions.file, *where, "expected a plain name as key"))
            elif key in found:
                self.findings.append(Finding(self.positions.file, *where, f"`{key}` is repeated"))
            self.positions.keys[here] = where
            found[key] = self.read(value_node, here, depth + 1)
        return found


_MESSAGE = re.compile(r"(.*?)(?: - at `(\$.*)`)?", re.DOTALL)
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")
_UNKNOWN = re.compile(r"Object contains unknown field `(.*)`")
_MISSING = re.compile(r"Object missing required field `(.*)`")


def convert(
    value: Any,
    model: type[T],
    positions: Positions,
    dec_hook: Callable[[type, Any], Any],
    at: Steps = (),
) -> tuple[T | None, list[Finding]]:
    """Return the model of the value at path `at` of a file, and all findings.

    msgspec stops at the first problem, so each problem is removed from the value and the rest is converted again.
    Convert mappings with free keys entry by entry: msgspec does not say in which entry a problem is.
    """
    findings: list[Finding] = []
    removed: set[Steps] = set()
    value = _copy(value)
    for _ in range(MAX_FINDINGS):
        try:
            found = _convert_value(value, model, dec_hook)
        except msgspec.ValidationError as error:
            path, finding = _explain(str(error), value, model, positions, at, removed)
            findings += [finding] if finding else []
            if not path:
                break
            removed.add(path)
            _cut(value, path)
        else:
            return (None if findings else found), findings
    return None, findings


def _explain(
    error: str, value: Any, model: type, positions: Positions, at: Steps, removed: set[Steps]
) -> tuple[Steps, Finding | None]:
    """Return the path to remove before the next attempt, and the finding."""
    split = _MESSAGE.fullmatch(error)
    assert split is not None
    message, path = split[1], _resolve(split[2] or "$", value)
    if unknown := _UNKNOWN.fullmatch(message):
        here = (*path, unknown[1])
        hint = did_you_mean(unknown[1], _fields(model, path))
        return here, positions.finding((*at, *here), f"unknown field `{unknown[1]}`{hint}", at_key=True)
    if missing := _MISSING.fullmatch(message):
        if (*path, missing[1]) in removed:
            return path, None
        name = ".".join(map(str, (*at, *path))) or "the file"
        return path, positions.finding((*at, *path), f"{name}: needs the field `{missing[1]}`", at_key=True)
    name = ".".join(map(str, (*at, *path))) or "the file"
    return path, positions.finding((*at, *path), f"{name}: {message[:1].lower()}{message[1:]}")


def _copy(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _copy(item) for key, item in value.items()}
    return [_copy(item) for item in value] if isinstance(value, list) else value


def _cut(value: Any, path: Steps) -> None:
    while path and isinstance(path[-1], int):  # a list goes as a whole: shorter, it would be wrong in another way
        path = path[:-1]
    for step in path[:-1]:
        value = value[step]
    del value[path[-1]]


def _resolve(where: str, value: Any) -> Steps:
    """Turn msgspec's `$.simulate.home[1]` into a path of steps that exist in the value."""
    found: list[str | int] = []
    for field, index in _STEP.findall(where.removeprefix("$")):
        step: str | int = field or (int(index) if index.isdigit() else "")
        try:
            value = value[step]
        except (KeyError, IndexError, TypeError):
            break
        found.append(step)
    return tuple(found)


def _fields(model: type, path: Steps) -> list[str]:
    """Return the field names of the struct at `path` of the model."""
    here: Any = model
    for step in path:
        types = {field.name: field.type for field in msgspec.structs.fields(here)} if is_struct(here) else {}
        options = [types.get(str(step)), *get_args(types.get(str(step)))]
        here = next((option for option in options if is_struct(option)), None)
    return [field.encode_name for field in msgspec.structs.fields(here)] if is_struct(here) else []
