"""Read YAML with positions, and convert it to models with msgspec's errors as findings.

Files are untrusted: only plain YAML of bounded size and depth, no tags that construct objects.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice
from typing import Any, TypeVar

import yaml
from yaml.composer import Composer
from yaml.resolver import Resolver

from schemas.files.findings import Finding, Findings
from schemas.files.validation import convert as _convert_value
from schemas.files.validation import misfits

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
        lines = [*text.split("\n"), ""]  # a mark may be behind the last line
        tab = mark is not None and lines[mark.line][mark.column :].startswith("\t")
        what = "a tab: indent with spaces" if tab else error.problem or error.context
        raise Findings([Finding(file, *where, f"not YAML: {what}")]) from None
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


def convert(
    value: Any, model: type[T], positions: Positions, dec_hook: Callable[[type, Any], Any]
) -> tuple[T | None, list[Finding]]:
    """Return the model of the values of a file, and all findings."""
    findings = []
    for path, text, at_key in islice(misfits(value, model, dec_hook), MAX_FINDINGS):
        name = ".".join(map(str, path)) or "the file"
        findings.append(positions.finding(path, f"{name}: {text}", at_key=at_key))
    return None if findings else _convert_value(value, model, dec_hook), findings
