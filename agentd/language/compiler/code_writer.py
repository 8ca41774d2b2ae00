"""Writing generated Python: functions line by line, with every name and constant passed by reference.

No text of the user's program gets into the source: local names are numbered, and whatever a function needs (terms,
predicates, internal actions, other steps) is a numbered constant that the `Unit` binds when it is loaded into a mind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import lru_cache
from types import CodeType
from typing import Any, Final, NamedTuple

from msgspec import Struct, field

MOST_UNITS: Final = 1_000
"""Units whose code is kept for further ones with the same source."""


class Ref(Struct, frozen=True):
    """A constant that only a mind can provide: a predicate, the plans of a trigger, a step."""

    kind: str
    what: Any


class Unit:
    """A piece of generated source: some functions and the constants they name. Compiled once, loaded once per mind."""

    def __init__(self, title: str) -> None:
        self.title = title
        self.constants: dict[str, Any] = {}
        self._names: dict[Any, str] = {}
        self._functions: list[str] = []
        self._count = 0
        self._code: CodeType | None = None

    def name(self, prefix: str) -> str:
        """Return a new global name; no local is called alike."""
        self._count += 1
        return f"{prefix}_{self._count}"

    def constant(self, value: Any) -> str:
        """Return the name of a constant; equal references and the same object share one."""
        key: Any = value if isinstance(value, Ref | str) else id(value)
        if isinstance(value, float):
            key = ("float", repr(value))
        found = self._names.get(key)
        if found is None:
            found = self._names[key] = self.name("k")
            self.constants[found] = value
        return found

    def add(self, function: Function) -> None:
        """Add a complete function."""
        self._functions.append(function.source())

    def source(self) -> str:
        """Return the code."""
        return "\n".join(self._functions)

    def load(self, runtime: dict[str, Any], provide: Callable[[Ref], Any]) -> dict[str, Any]:
        """Execute the unit: a namespace with its functions. ``provide`` gives the object that a `Ref` means."""
        if self._code is None:
            self._code = _compiled(self.source(), self.title)
        namespace = dict(runtime)
        for name, value in self.constants.items():
            namespace[name] = provide(value) if isinstance(value, Ref) else value
        # Only source that this package wrote from a parsed tree; see the module's docstring.
        exec(self._code, namespace)  # noqa: S102
        return namespace


@lru_cache(MOST_UNITS)
def _compiled(source: str, title: str) -> CodeType:
    """Return the code of a unit: agents of one program have units alike."""
    return compile(source, f"<generated for {title}>", "exec")


class Line(NamedTuple):
    """A reserved line of a function."""

    number: int
    indent: int


class Function:
    """One function being written."""

    def __init__(self, unit: Unit, name: str, parameters: str) -> None:
        self.unit, self.name = unit, name
        self._lines: list[str | None] = [f"def {name}({parameters}):"]
        self.indent = 1
        self._locals = 0
        self.loops = 0
        """The number of loops that are open at this point: Python nests no more than 20."""

    def local(self, prefix: str = "v") -> str:
        """Return a new local name."""
        self._locals += 1
        return f"{prefix}{self._locals}"

    def emit(self, line: str) -> None:
        """Write a line."""
        self._lines.append("    " * self.indent + line)

    def reserve(self) -> Line:
        """Reserve a line that may turn out to be needed; see `fill`."""
        self._lines.append(None)
        return Line(len(self._lines) - 1, self.indent)

    def fill(self, line: Line, text: str) -> None:
        """Write the text of a line that was left open."""
        self._lines[line.number] = "    " * line.indent + text

    def uses(self, name: str) -> bool:
        """Return whether a name may occur in the lines written so far."""
        return any(name in line for line in self._lines if line is not None)

    @contextmanager
    def block(self, head: str) -> Iterator[None]:
        """Lines under ``head``, which ends with a colon."""
        self.emit(head)
        loop = head.startswith("for ")
        self.loops += loop
        self.indent += 1
        before = len(self._lines)
        yield
        if all(line is None for line in self._lines[before:]):
            self.emit("pass")
        self.indent -= 1
        self.loops -= loop

    def assign(self, expression: str, prefix: str = "v") -> str:
        """Put a value into a new local, unless it is a plain name already."""
        if expression.isidentifier():
            return expression
        name = self.local(prefix)
        self.emit(f"{name} = {expression}")
        return name

    def source(self) -> str:
        """Return the code."""
        lines = [line for line in self._lines if line is not None]
        if len(lines) == 1:
            lines.append("    pass")
        return "\n".join(lines)


def tuple_of(parts: list[str]) -> str:
    """Return the display of a tuple."""
    return f"({', '.join(parts)}{',' if len(parts) == 1 else ''})"


def targets_of(names: list[str]) -> str:
    """Return the left side that takes a tuple apart; there is at least one name."""
    return f"({names[0]},)" if len(names) == 1 else ", ".join(names)


FRAME_HEADER = 6
"""The places of a frame before its variables; see `agentd.mind.data.intention`."""


class StepCode(Struct):
    """A formula of a body: the function that runs it and the step that follows (by number; None ends the body)."""

    function: str
    syntax: Any
    next: int | None = None


class PlanCode(Struct):
    """The generated code of a plan, or of a body that runs inside a plan's frame."""

    unit: Unit
    slots: dict[str, int]
    """The place of each variable in a frame."""
    steps: list[StepCode] = field(default_factory=list)
    first: int | None = None
    size: int = FRAME_HEADER
    """The number of places of a frame."""
    bound: dict[str, bool] = field(default_factory=dict)
    tried: list[tuple[Any, tuple[str, ...]]] = field(default_factory=list)
    """The literals of the context in order, with their variables that have a value when they are tried; empty for
    plans that are selected without a trace."""

    def slot(self, name: str) -> int:
        """Return the place of a variable in the frame, new for a new one."""
        found = self.slots.get(name)
        if found is None:
            found = self.slots[name] = self.size
            self.size += 1
        return found

    def hidden_slot(self) -> int:
        """Return a place for something that is no variable of the program."""
        self.size += 1
        return self.size - 1
