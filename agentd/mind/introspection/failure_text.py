"""Descriptions of a failure: the failing formula as a term, the annotations for its handler, texts for people."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import Signature, signature
from agentd.language.terms.format import text
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.numbers import UndefinedNumber
from agentd.language.terms.terms import EMPTY, Code, List, Literal, Term, atom, deref
from agentd.mind.beliefs.term_copy import resolve, resolve_all
from agentd.mind.data.effects import Log
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import ARGS, RELEVANT, Event, Frame, Step, values_of
from agentd.mind.introspection.snapshots import short_text
from agentd.mind.plans.plan_library import Plan, Relevant
from agentd.mind.state import MindState

_LONGEST: Final = 200
_MOST_MEMBERS: Final = 10_000
"""A longer list is replaced by its length in the failing formula: copying and printing it would take too long."""

_ERROR, _MESSAGE = signature("error", 1), signature("error_msg", 1)
_CODE, _LINE, _SOURCE = signature("code", 1), signature("code_line", 1), signature("code_src", 1)
_FACTS: Final = frozenset((_ERROR, _MESSAGE, _CODE, _LINE, _SOURCE))


def code_of(step: Step, frame: Frame) -> Any:
    """Return the failing formula as a term, with the values of its variables put in."""
    formula = step.syntax
    values = {name: _shortened(value) for name, value in values_of(frame).items()}
    if isinstance(formula, nodes.Step):
        term = instantiate(formula.term, dict(values))
        try:
            term = resolve(term)
        except UndefinedNumber:
            pass
        except RecursionError:
            return brief(text(term))
        if not formula.operator.value or formula.operator is nodes.Operator.TEST:
            return term
    return Code(nodes.Body((formula,), formula.position), values, bare=True)


def _shortened(value: Term) -> Any:
    whole = deref(value)
    if type(whole) is List and whole is not EMPTY and (members := len(whole.items) - whole.at) > _MOST_MEMBERS:
        return f"[...] ({members} members)"
    return value


def as_they_are(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Return terms resolved, or, when one is cyclic or nested too deep for that, only their texts."""
    try:
        return resolve_all(terms)
    except (RecursionError, UndefinedNumber):
        return tuple(brief(text(term)) for term in terms)


def without_facts(annots: Iterable[Any]) -> list[Term]:
    """Return the annotations of a failure event that do not describe the failure."""
    return [a for a in annots if not (type(a) is Literal and a.sig in _FACTS)]


def brief(whole: str) -> str:
    """Return the beginning of the text of a term that may be very large."""
    return whole if len(whole) <= _LONGEST else f"{whole[:_LONGEST]}..."


def written(step: Step, code: Term) -> str:
    """Return a failing formula with its operator, for people."""
    operator = step.syntax.operator.value if isinstance(step.syntax, nodes.Step) else ""
    return text(code) if type(code) is Code else operator + text(code)


def goal_text(frame: Frame) -> str:
    """Return the goal or event that a frame answers, for people."""
    return event_text((frame[RELEVANT], frame[ARGS], (), None))


def event_text(event: Event) -> str:
    """Return an event without its annotations, for people."""
    return f"{event[0].text}{brief(text(Literal(event[0].sig, as_they_are(event[1]))))}"


def error_annots(failure: Failed, code: Term, line: int, source: str) -> tuple[Term, ...]:
    """Return annotations that describe a failure to its handler; ``line`` of ``source`` is from 1 (0: unknown)."""
    own = as_they_are(failure.annots)
    found = [Literal(_ERROR, (atom(failure.error),))]
    if not any(type(a) is Literal and a.sig is _MESSAGE for a in own):
        found.append(Literal(_MESSAGE, (failure.message or _no(failure.error, code),)))
    found += [Literal(_CODE, (code,)), Literal(_LINE, (float(line),)), Literal(_SOURCE, (source,))]
    return (*found, *own)


def _no(error: str, code: Term) -> str:
    """Return the message of an internal action that did not hold; empty for ``.fail`` and other failures."""
    if error != "ia_failed" or (type(code) is Literal and code.sig.functor == ".fail"):
        return ""
    return f"{short_text(code)} did not hold"


def facts_of(annots: tuple[Term, ...]) -> tuple[str, str]:
    """Return the error and the message among the annotations of a failure event."""
    facts = _facts(annots)
    return text(facts.get(_ERROR, atom("unknown"))), str(facts.get(_MESSAGE, ""))


def _facts(annots: tuple[Term, ...]) -> dict[Signature, Any]:
    return {a.sig: a.args[0] for a in as_they_are(annots) if type(a) is Literal and len(a.args) == 1}


def context_failed(mind: MindState, relevant: Relevant, plan: Plan | None, error: Exception) -> None:
    """Log that the context of a plan could not be computed; the other plans are tried."""
    what = "it is too deep" if isinstance(error, RecursionError) else str(error) or type(error).__name__
    position = None if plan is None else plan.syntax.position
    mind.effects.append(
        Log("warning", f"the context of a plan for {relevant!r} cannot be computed: {what}", at=position)
    )


def failure_of(annots: tuple[Term, ...]) -> tuple[Failed, nodes.Position | None]:
    """Return the failure that the annotations of an event ``-!g`` describe, and the line that it is on."""
    facts, (error, message) = _facts(annots), facts_of(annots)
    code = facts.get(_CODE, "")
    failed = Failed(error, message if message != _no(error, code) else "", code=code)
    line, source = facts.get(_LINE), facts.get(_SOURCE)
    known = type(line) is float and line > 0 and type(source) is str
    return failed, nodes.Position(str(source), int(line or 0), 0) if known else None
