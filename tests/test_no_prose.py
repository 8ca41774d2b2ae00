"""No program reads the prose of another: texts of records and errors are shown to people, never searched or compared.

What a program acts on is a code or a value. This test finds, in product code, each comparison, search or match on

- an attribute that holds text for people, or one of several texts that an attribute holds,
- the text of a caught error,
- anything, for a wording: a fixed text with a space in it, or each of a constant's texts.

Those below have a reason.
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PRODUCT = ("schemas", "commd", "agentd", "bridged", "argosy")
TEXTS = frozenset({"text", "reason", "error", "last_error", "why", "problem", "problems", "detail", "notes"})
"""Attributes of records, views and errors that hold text for people."""
COLLECTIONS = TEXTS | {"gaps", "warnings", "messages", "lines"}
"""Attributes that may hold several texts for people."""
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
        "schemas/files/validation.py: message.startswith('Invalid enum')",
        "schemas/files/validation.py: message.startswith('Expected `')",
        "schemas/files/validation.py: message.partition(', got')",
        "schemas/files/validation.py: ', got' not in plain",
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
        "argosy/why/decisions.py: one.error in WITHOUT_PLAN",
        "argosy/why/explain.py: failure.error in WITHOUT_PLAN",
        "argosy/why/explain.py: made.failure.error in WITHOUT_PLAN",
        "argosy/why/goal_explanation.py: one.error not in WITHOUT_PLAN",
        "argosy/why/wording.py: match failure.error",
    ),
    "a code: `trigger`, `context`, `error` or `choice`": (
        "agentd/mind/introspection/failure_report.py: rejected.why != 'context'",
        "agentd/standalone/decision_printer.py: rejected.why == 'context'",
        "argosy/why/wording.py: rejected.why != 'context'",
    ),
    "the belief that an operator wrote, in the language": (
        "agentd/runtime/operator_control.py: order.text.strip().removeprefix(sign)",
    ),
    "a term, shown without the source that stands beside it": (
        "argosy/watch/mind_page.py: belief.text.removesuffix(sources)",
        "argosy/fleet_model/timeline.py: event.text.removesuffix(f'[source({event.other})]')",
        "argosy/fleet_model/timeline.py: event.text.removesuffix(f'[source({agent})]')",
    ),
    "ArduPilot and PX4 give no code for it: a prefix of theirs, such as `PreArm:`": (
        "bridged/drivers/mavlink/session.py: status.text.startswith(self.flight.autopilot.pre_arm)",
        "bridged/drivers/mavlink/vehicle/status_texts.py: one.text.removeprefix(prefix)",
        "bridged/drivers/mavlink/vehicle/status_texts.py: one.text.startswith(prefix)",
    ),
    "ArduPilot gives no code for what is wrong": (
        "bridged/drivers/mavlink/actions/confirmation.py: part in one.lower()",
    ),
    "Zenoh gives no code for a failed handshake: it only logs it": ("commd/router/tls_rejections.py: part in text",),
    "its own text, shown where another word says that the run failed": (
        "argosy/run/end_conditions.py: self.text.removeprefix('failed: ')",
        "argosy/run/summary.py: plotted.stderr.strip().removeprefix('error: ')",
    ),
    "a formula, in the language": ("agentd/mind/introspection/decision_views.py: text.startswith('not (')",),
    "a field of a certificate": (
        "argosy/keys/key_index.py: str(subject.get('organizationalUnitName', '')).removeprefix('keys ')",
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
    tables = {
        node.targets[0].id
        for node in tree.body
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name)
        if any(_has_words(part, "") for part in ast.walk(node.value))
    }
    names = Names(
        {node.name for node in ast.walk(tree) if isinstance(node, ast.ExceptHandler) and node.name},
        {
            node.target.id
            for node in ast.walk(tree)
            if isinstance(node, ast.comprehension | ast.For)
            and isinstance(node.target, ast.Name)
            and isinstance(node.iter, ast.Attribute)
            and node.iter.attr in COLLECTIONS
        },
        {
            name.id
            for node in ast.walk(tree)
            if isinstance(node, ast.comprehension) and isinstance(node.iter, ast.Name) and node.iter.id in tables
            for name in ast.walk(node.target)
            if isinstance(name, ast.Name)
        },
    )
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = (node.left, *node.comparators)
            for left, operator, right in zip(sides, node.ops, sides[1:], strict=False):
                if isinstance(operator, ast.In | ast.NotIn):
                    found = _is_text(right, names) or (_is_text(left, names) and _holds_texts(right))
                    found = found or (_has_words(left, "") and not _holds_texts(right))
                    found = found or (isinstance(left, ast.Name) and left.id in names.wordings)
                else:
                    found = any(
                        _is_text(one, names) and _is_wording(other) for one, other in ((left, right), (right, left))
                    )
                if found:
                    yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            searched = node.func.attr in SEARCHES and node.args
            searched = searched and (_is_text(node.func.value, names) or _looks_for_words(node))
            matched = node.func.attr in PATTERNS and any(_is_text(one, names) for one in node.args)
            if searched or matched:
                yield node.lineno, ast.unparse(node)
        elif isinstance(node, ast.Match) and _is_text(node.subject, names):
            yield node.lineno, f"match {ast.unparse(node.subject)}"


class Names(NamedTuple):
    """Local names of texts for people."""

    caught: set[str]
    """Errors, whose `str` is such a text."""
    listed: set[str]
    """Texts, one of several."""
    wordings: set[str]
    """Texts of a constant."""


def _is_text(node: ast.AST, names: Names) -> bool:
    """Whether an expression is a text for people, or made of one: `one.reason`, `str(error)`, `one.text.lower()`."""
    match node:
        case ast.Attribute(attr=name):
            return name in TEXTS
        case ast.Name(id=name):
            return name in names.listed
        case ast.Call(func=ast.Name(id="str"), args=[ast.Name(id=name)]):
            return name in names.caught
        case ast.Call(func=ast.Name(id="str"), args=[inner]):
            return _is_text(inner, names)
        case ast.Call(func=ast.Attribute(value=inner)):
            return _is_text(inner, names)
        case ast.Subscript(value=inner):
            return _is_text(inner, names)
    return False


def _looks_for_words(search: ast.Call) -> bool:
    """Whether a search is for a wording, and not in a text that is made there."""
    assert isinstance(search.func, ast.Attribute)
    made_there = isinstance(search.func.value, ast.Constant | ast.JoinedStr)
    return _has_words(search.args[0], "x") and not made_there


def _has_words(node: ast.AST, value: str) -> bool:
    """Whether a fixed text has a letter and a space; `value` stands for each value that is put in."""
    match node:
        case ast.Constant(value=str(text)):
            pass
        case ast.JoinedStr(values=parts):
            text = "".join(str(one.value) if isinstance(one, ast.Constant) else value for one in parts)
        case _:
            return False
    return " " in text and any(map(str.isalpha, text))


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
        "[gap for gap in end.gaps if gap.startswith(f'{agent} ')]",
        "[gap for gap in end.gaps if 'uav' in gap]",
        "for gap in gaps_of(end):\n  gap.startswith(f'{agent} ')",
        "hint.startswith(', did you mean')",
        "'mailbox full' in answer",
        "CAUSES = 'mailbox full', 'no room'\nany(part in answer for part in CAUSES)",
    ],
)
def test_what_reads_a_text_is_found(line: str) -> None:
    assert len(list(reads(line))) == 1


@pytest.mark.parametrize(
    "line",
    [
        "one.reason or 'none'",
        "one.text == ''",
        "f'{one.reason}: {two.text}'",
        "one.code == 'x'",
        "f'{a} s'.removesuffix(' s')",
    ],
)
def test_what_shows_a_text_is_not_found(line: str) -> None:
    assert list(reads(line)) == []
