"""No program reads the prose of another: texts of records and errors are shown to people, never searched or compared.

What a program acts on is a code or a value. This test finds, in product code, each comparison, search or match on an
attribute that holds text for people, or on the text of a caught error; those below have a reason.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PRODUCT = ("schemas", "commd", "agentd", "bridged", "argosy")
TEXTS = frozenset({"text", "reason", "error", "last_error", "why", "problem", "problems", "detail", "notes"})
"""Attributes of records, views and errors that hold text for people."""
SEARCHES = frozenset(
    {
        "startswith", "endswith", "removeprefix", "removesuffix", "partition", "rpartition", "split", "rsplit",
        "find", "rfind", "index", "rindex", "count", "replace",
    }
)  # fmt: skip
PATTERNS = frozenset({"match", "search", "fullmatch", "sub", "subn", "findall", "finditer", "split"})
LANGUAGES = (
    "agentd/language/",
    "agentd/jason_project/",
    "agentd/editor/",
    "schemas/files/toml_positions.py",
    "schemas/wire/term_text.py",
)
"""Their `text` is the source text of programs, files and terms, which they are there to read."""
ALLOWED: dict[str, tuple[str, ...]] = {
    "msgspec's errors have no attributes": (
        "schemas/files/validation.py: str(error).partition(' - at `')",
        "schemas/manifest/loader.py: str(error).partition(';')",
    ),
    "cuts a text of Zenoh's for people: what follows are paths of its sources": (
        "commd/bus/bus.py: str(error).partition(' at /')",
        "commd/router/config.py: str(error).partition(' at /')",
    ),
    "OpenSSL's code": (
        "commd/bus/connect_diagnosis.py: error.reason == _TRY_LATER",
        "commd/bus/connect_diagnosis.py: error.reason in _OUR_DATES",
        "commd/bus/connect_diagnosis.py: error.reason in _OUR_NAME",
        "commd/bus/tls.py: error.reason == 'KEY_VALUES_MISMATCH'",
    ),
    "a code: the name that a program's handler sees": (
        "agentd/mind/execution/execution.py: failed.error == 'test_goal_failed'",
        "agentd/mind/execution/messages.py: failed.error == 'no_applicable'",
        "agentd/mind/introspection/failure_report.py: match failed.error",
        "agentd/mind/introspection/failure_report.py: failed.error in ('no_relevant', 'no_applicable')",
        "agentd/mind/introspection/failure_report.py: failed.error != 'action_failed'",
        "agentd/testing/runner.py: ended.error == FAILED",
        "argosy/why/decisions.py: failure.error in WITHOUT_PLAN",
        "argosy/why/decisions.py: failure.error == 'test_goal_failed'",
        "argosy/why/explain.py: made.failure.error in WITHOUT_PLAN",
        "argosy/why/goal_explanation.py: one.error not in WITHOUT_PLAN",
        "argosy/why/wording.py: match failure.error",
    ),
    "a code: `trigger`, `context`, `error` or `choice`": (
        "agentd/mind/introspection/failure_report.py: rejected.why != 'context'",
        "agentd/standalone/decision_printer.py: rejected.why != 'context'",
        "argosy/why/wording.py: rejected.why != 'context'",
    ),
    "the belief that an operator wrote, in the language": (
        "agentd/runtime/operator_control.py: order.text.strip().removeprefix(sign)",
    ),
    "a term, shown without the source that stands beside it": (
        "argosy/fleet_model/timeline.py: event.text.removesuffix(f'[source({event.other})]')",
        "argosy/fleet_model/timeline.py: event.text.removesuffix(f'[source({agent})]')",
    ),
    "ArduPilot and PX4 give no code for it: a prefix of theirs, such as `PreArm:`": (
        "bridged/drivers/mavlink/session.py: said.text.startswith(PRE_ARM)",
        "bridged/drivers/mavlink/vehicle/status_texts.py: one.text.removeprefix(prefix)",
        "bridged/drivers/mavlink/vehicle/status_texts.py: one.text.startswith(prefix)",
    ),
    "its own text, shown where another word says that the run failed": (
        "argosy/run/end_conditions.py: self.text.removeprefix('failed: ')",
    ),
    "shows no line twice": (
        "argosy/run/summary.py: entry.text not in ending.text",
        "argosy/run/summary.py: text not in ending.text",
    ),
}
"""Files and expressions by the reason why they do not read the prose of another program."""


def reads(source: str) -> Iterator[tuple[int, str]]:
    """Yield line and expression of each place where a text for people is compared, searched or matched."""
    tree = ast.parse(source)
    caught = {node.name for node in ast.walk(tree) if isinstance(node, ast.ExceptHandler) and node.name}
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = (node.left, *node.comparators)
            for left, operator, right in zip(sides, node.ops, sides[1:], strict=False):
                if isinstance(operator, ast.In | ast.NotIn):
                    found = _is_text(right, caught) or (_is_text(left, caught) and _holds_texts(right))
                else:
                    found = any(
                        _is_text(one, caught) and _is_wording(other) for one, other in ((left, right), (right, left))
                    )
                if found:
                    yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            searched = node.func.attr in SEARCHES and node.args and _is_text(node.func.value, caught)
            matched = node.func.attr in PATTERNS and any(_is_text(one, caught) for one in node.args)
            if searched or matched:
                yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.Match) and _is_text(node.subject, caught):
            yield node.lineno, f"match {ast.unparse(node.subject)}"


def _is_text(node: ast.AST, caught: set[str]) -> bool:
    """Whether an expression is a text for people, or made of one: `one.reason`, `str(error)`, `one.text.lower()`."""
    match node:
        case ast.Attribute(attr=name):
            return name in TEXTS
        case ast.Call(func=ast.Name(id="str"), args=[ast.Name(id=name)]):
            return name in caught
        case ast.Call(func=ast.Name(id="str"), args=[inner]):
            return _is_text(inner, caught)
        case ast.Call(func=ast.Attribute(value=inner)):
            return _is_text(inner, caught)
        case ast.Subscript(value=inner):
            return _is_text(inner, caught)
    return False


def _is_wording(node: ast.AST) -> bool:
    """Whether an expression is a fixed text that is not empty, or a constant's name."""
    match node:
        case ast.Constant(value=str(text)):
            return bool(text)
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return name.isupper()
    return False


def _holds_texts(node: ast.AST) -> bool:
    match node:
        case ast.Tuple(elts=parts) | ast.List(elts=parts) | ast.Set(elts=parts):
            return any(map(_is_wording, parts))
    return _is_wording(node)


@cache
def _found() -> dict[str, int]:
    found: dict[str, int] = {}
    for package in PRODUCT:
        for path in sorted((ROOT / package).rglob("*.py")):
            name = path.relative_to(ROOT).as_posix()
            if not name.startswith(LANGUAGES):
                found |= {f"{name}: {expression}": line for line, expression in reads(path.read_text())}
    return found


def _allowed() -> set[str]:
    return {place for places in ALLOWED.values() for place in places}


def test_no_program_compares_or_searches_the_text_of_another() -> None:
    wrong = [f"{place} (line {line})" for place, line in _found().items() if place not in _allowed()]
    assert wrong == [], "act on a code or a value instead; the text is for people"


def test_each_exception_is_still_needed() -> None:
    assert sorted(_allowed() - _found().keys()) == []


@pytest.mark.parametrize(
    "line",
    [
        'note.text.startswith("two vehicles")',
        '"mailbox full" in receipt.reason',
        'status.reason == "operator: hold"',
        "reply.error == UNANSWERED",
        'one.reason in ("a", "b")',
        "GROWING.sub('', note.text)",
        "re.match('x', reply.error.lower())",
        "match one.reason:\n  case 'wait(formula)': pass",
        "try: f()\nexcept ValueError as bad:\n  'nested too deeply' in str(bad)",
    ],
)
def test_what_reads_a_text_is_found(line: str) -> None:
    assert len(list(reads(line))) == 1


@pytest.mark.parametrize(
    "line", ["one.reason or 'none'", "one.text == ''", "f'{one.reason}: {two.text}'", "one.code == 'x'"]
)
def test_what_shows_a_text_is_not_found(line: str) -> None:
    assert list(reads(line)) == []
