"""docs/reference/stdlib.md from the docstrings of agentd/stdlib: `python -m tests.docs.stdlib_page`.

A docstring begins with its calls, ``.name(A[, B])``, a colon, and what they mean. A line
``?- QUERY gives X = 1; X = 2`` (or ``holds``, ``fails``) is an example; tests/docs/test_generated_pages.py asks each.
"""

import importlib
import inspect
import pkgutil
import re
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import agentd.stdlib
from agentd.mind.data.registry import ACTIONS, FUNCTIONS, InternalAction
from tests.docs.pages import ROOT

PAGE = ROOT / "docs/reference/stdlib.md"
_HEAD = """\
# Standard library

<!-- Written by `make reference` from the docstrings of agentd/stdlib. -->

Internal actions begin with a dot. Most may stand in a context, a rule or a query as well as in a body, and fail where
they do not hold. What *may wait* can only be a step of a plan. What has *solutions* gives one after another, as a
belief would. An argument of a wrong kind fails with `error(wrong_arguments)`; where this differs from Jason is told in
[the language](language.md#the-standard-library).

The examples are asked by the tests, with `door(open). door(closed).` believed.
"""
_CALLS = re.compile(r"((?:``[^`]+``(?:, )?)+)(?: as a value)?(?:: |, )(.*)", re.DOTALL)
_EXAMPLE = re.compile(r"\?- (?P<query>.*) (?:gives (?P<solutions>.*)|(?P<holds>holds|fails))")
_CONTROL = """
## Control

Jason's internal actions for control are statements: `for (B) { ... }`, `while (B) { ... }` and `if (B) { ... }` are the
shorter way to write them.

| call | meaning |
|---|---|
| `.foreach(B, { ... })` | the body for each solution of B |
| `.loop(B, { ... })` | the body as long as B holds |
| `.if_then_else(B, { ... }[, { ... }])` | the one or the other body |
| `.fork(and, { ... }, ...)`, `.fork(or, { ... }, ...)` | all bodies side by side, until all, or the first, have ended |
"""


@dataclass(frozen=True)
class Entry:
    """One function of the library, with all names under which it can be called."""

    names: tuple[str, ...]
    calls: str
    meaning: str
    examples: tuple[str, ...]
    marks: tuple[str, ...]


def entries(module: Any) -> Iterator[Entry]:
    """What a module of the library registers, in the order of its text."""
    actions = [(one.name, one.function, one) for all_of in ACTIONS.values() for one in all_of]
    functions = [(name, compute, None) for (name, _), compute in FUNCTIONS.items()]
    by_function: dict[Callable[..., Any], dict[str, InternalAction | None]] = {}
    for name, function, action in [*actions, *functions]:
        if function.__module__ == module.__name__:
            by_function.setdefault(function, {})[name] = action
    seen = set()
    for function, named in by_function.items():
        doc = inspect.getdoc(function) or ""
        if doc not in seen:  # maps, sets and queues share some
            seen.add(doc)
            yield _entry(tuple(named), doc, next(iter(named.values())))


def _entry(names: tuple[str, ...], doc: str, action: InternalAction | None) -> Entry:
    lines = doc.splitlines()
    examples = tuple(line for line in lines if line.startswith("?- "))
    text = " ".join(line for line in lines if line and line not in examples)
    reported = _CALLS.fullmatch(text)
    if reported is None:
        raise ValueError(f"{names[0]}: the docstring does not begin with ``{names[0]}(...)``: and its meaning")
    marks = [] if action is None else [*["solutions"] * action.backtracks, *["may wait"] * action.suspends]
    return Entry(names, reported[1], reported[2], examples, tuple(marks))


def examples() -> Iterator[tuple[str, str]]:
    """Each example: the query, and what it gives (`holds`, `fails`, or its solutions)."""
    for module in _modules():
        for entry in entries(module):
            for line in entry.examples:
                reported = _EXAMPLE.fullmatch(line)
                if reported is None:
                    raise ValueError(
                        f"{entry.names[0]}: an example is `?- QUERY gives X = 1; X = 2`, or holds, or fails"
                    )
                yield reported["query"], reported["solutions"] or reported["holds"]


def page() -> str:
    """The page."""
    parts = [_HEAD, _CONTROL]
    for module in _modules():
        rows = [_row(entry) for entry in entries(module)]
        if rows:
            title, _, rest = (inspect.getdoc(module) or "").splitlines()[0].removesuffix(".").partition(": ")
            intro = f"\n{rest[0].upper()}{rest[1:]}.\n" if rest and "``" not in rest else ""
            parts.append(f"\n## {title}\n{intro}\n| call | meaning | examples |\n|---|---|---|\n" + "".join(rows))
    return "".join(parts)


def _row(entry: Entry) -> str:
    marks = f" *{', '.join(entry.marks)}*" if entry.marks else ""
    shown = "<br>".join(_example(line) for line in entry.examples)
    cells = [_cell(entry.calls), _cell(f"{entry.meaning[0].upper()}{entry.meaning[1:]}") + marks, shown]
    return f"| {' | '.join(cells)} |\n"


def _example(line: str) -> str:
    reported = _EXAMPLE.fullmatch(line)
    assert reported is not None, line
    given = f"gives `{reported['solutions']}`" if reported["solutions"] else reported["holds"]
    return _cell(f"`{reported['query']}` {given}")


def _cell(text: str) -> str:
    return text.replace("``", "`").replace("|", "\\|")


def _modules() -> list[Any]:
    names = sorted(info.name for info in pkgutil.iter_modules(agentd.stdlib.__path__))
    modules = [importlib.import_module(f"agentd.stdlib.{name}") for name in names]
    return [module for module in modules if any(True for _ in _registered(module))]


def _registered(module: Any) -> Iterator[str]:
    for name, actions in ACTIONS.items():
        if any(action.function.__module__ == module.__name__ for action in actions):
            yield name
    for (name, _), compute in FUNCTIONS.items():
        if compute.__module__ == module.__name__:
            yield name


if __name__ == "__main__":
    PAGE.parent.mkdir(exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
    sys.exit(0)
