"""Convert run-time terms to wire terms and back, for percepts, actions and mail."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from agentd.language.parse import parse_term
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.printer import source_text
from agentd.language.syntax_tree.signatures import DEFAULT, Signature, signature
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import PERCEPT
from agentd.language.terms.terms import (
    PER_PART,
    Code,
    Collection,
    Expression,
    List,
    Literal,
    Open,
    Rest,
    Var,
    atom,
    deref,
    make_list,
    split,
)
from agentd.language.terms.to_ast import NoSyntax, ToSyntax
from agentd.mind.beliefs.work_limit import MOST_STEPS, PARSING
from schemas.wire import terms as wire
from schemas.wire.records import Perception

MAX_DEPTH = 100
"""Nesting of terms that are sent: JSON readers have limits of their own."""
MOST_SOURCE = MOST_STEPS // PARSING
"""Characters of source text in a term that is received: to parse more takes longer than a formula may."""
MOST_NAMES = 1024
"""Names of percepts in the cache."""
_FLAT = frozenset((float, str))
"""What percepts mostly consist of."""


class BadTerm(ValueError):
    """A term that cannot be sent or received; the text says why."""


def to_wire(term: Any) -> wire.Term:
    """Return the wire form of a run-time term. Raises BadTerm for one that is nested too deeply (or without end)."""
    kind = type(term)
    if kind is float or kind is str:  # most arguments of actions
        return wire.number(term) if kind is float else term
    try:
        return _to_wire(term, 0, ToSyntax(MAX_DEPTH))
    except NoSyntax as bad:
        raise BadTerm(str(bad)) from None
    except RecursionError:  # code that holds code that holds code ...
        raise BadTerm("nested too deeply") from None


def from_wire(term: wire.Term) -> Any:
    """Return the run-time form of a wire term; equal variable names become one variable. Raises BadTerm."""
    kind = type(term)
    if kind is float or kind is str:  # most values of percepts
        return term
    return float(term) if kind is int else _from_wire(term, _Variables())  # type: ignore[arg-type]


class _Variables(dict[str, Any]):
    """The variables of a whole term, by name."""

    source = 0
    """Characters of source text in it so far."""


def perceived(perception: Perception) -> Literal:
    """Return the belief of a perception, with source(percept). Raises BadTerm for an invalid name."""
    arguments = tuple(map(from_wire, perception.parameters))
    return Literal(_belief(perception.name, len(arguments)), arguments, PERCEPT, _FLAT.issuperset(map(type, arguments)))


@lru_cache(MOST_NAMES)
def _belief(name: str, arity: int) -> Signature:
    """Return the signature of a percept. Raises BadTerm for an invalid name."""
    if not (name[:1].islower() and name.replace("_", "a").isalnum()):
        raise BadTerm(f"`{name}` is no name of a belief")
    return signature(name, arity)


def _to_wire(term: Any, depth: int, syntax: ToSyntax) -> wire.Term:
    """Convert a term that is `depth` levels deep in the message, 0 to `MAX_DEPTH`. Raises BadTerm.

    `syntax` gives different variables of the message different names.
    """
    if depth > MAX_DEPTH:
        raise BadTerm(f"nested deeper than {MAX_DEPTH}")
    syntax.count()
    term = deref(term)
    match term:
        case float():
            return wire.number(term)
        case str():
            syntax.count(len(term) // PER_PART)
            return term
        case Literal():
            return _literal(term, depth, syntax)
        case Var():
            return wire.Variable(syntax.names.of(term))
        case List():
            items, tail = split(term)
            sent = [_to_wire(item, depth + 1, syntax) for item in items]
            closed = type(tail) is List
            return sent if closed else wire.OpenList(tuple(sent), _to_wire(tail, depth + 1, syntax))
        case Code():
            return _code(term, syntax)
        case Expression() | Open():
            return _expression(term, depth, syntax)
        case Collection():
            return _collection(term, depth, syntax)
    raise BadTerm(f"a {type(term).__name__} cannot be sent")


def _several(terms: tuple[Any, ...], depth: int, syntax: ToSyntax) -> tuple[wire.Term, ...]:
    return tuple(_to_wire(term, depth + 1, syntax) for term in terms if type(term) is not Rest)


def _literal(term: Literal, depth: int, syntax: ToSyntax) -> wire.Term:
    sig = term.sig
    annotations = _several(term.annots, depth, syntax)  # what is left of a tail without value is nothing
    if not (term.args or annotations or sig.negated) and sig.namespace == DEFAULT:
        return {"true": True, "false": False}.get(sig.functor, wire.Atom(sig.functor))
    return wire.Structure(
        sig.functor,
        _several(term.args, depth, syntax),
        annotations,
        sig.negated,
        "" if sig.namespace == DEFAULT else sig.namespace,
    )


def _expression(term: Expression | Open, depth: int, syntax: ToSyntax) -> wire.Term:
    if isinstance(term, Open) and term.literal is None and isinstance(deref(term.variable), Var):
        return wire.Variable(
            syntax.names.of(deref(term.variable)),
            _several(term.annots or (), depth, syntax),
            term.negated,
            term.namespace if isinstance(term.namespace, str) else "",
        )
    text = source_text(syntax.term(term, depth))
    return wire.Source("expression", text if text.startswith("(") else f"({text})")


def _code(term: Code, syntax: ToSyntax) -> wire.Term:
    node = syntax.code(term.syntax, term.values)
    match node:
        case nodes.Plan():
            return wire.Source("plan", source_text(nodes.PlanTerm(node)))
        case nodes.Trigger():
            return wire.Source("trigger", source_text(nodes.TriggerTerm(node)))
        case nodes.Rule():
            return wire.Source("rule", source_text(nodes.RuleTerm(node)))
        case nodes.Body():
            return wire.Source("body", source_text(nodes.BodyTerm(node)))
    raise BadTerm(f"a {type(node).__name__} cannot be sent")


def _collection(term: Collection, depth: int, syntax: ToSyntax) -> wire.Term:
    if term.kind == "map":
        return wire.Map(tuple(_several(pair, depth, syntax) for pair in term.content.items()))  # type: ignore[misc]
    items = _several(tuple(term.content), depth, syntax)
    return wire.Set(items) if term.kind == "set" else wire.Queue(items, term.kind == "priority")


def _from_wire(term: wire.Term, values: _Variables) -> Any:
    """Return the term of the mind for one of the wire; `values` has the variables of the whole, by name."""
    match term:
        case bool():
            return atom("true" if term else "false")
        case int() | float():
            return float(term)
        case str():
            return term
        case list():
            return make_list([_from_wire(one, values) for one in term])
        case wire.Atom(name=name):
            return atom(name)
        case wire.Number(text=text):
            return float(text)
        case wire.Structure():
            sig = signature(term.functor, len(term.args), term.negated, term.namespace or DEFAULT)
            args = tuple([_from_wire(one, values) for one in term.args])
            return Literal(sig, args, sorted_annots([_from_wire(one, values) for one in term.annotations]))
        case wire.Variable():
            return _variable(term, values)
        case wire.OpenList(items=items, tail=tail):
            return make_list([_from_wire(item, values) for item in items], _from_wire(tail, values))
        case wire.Source():
            return _source(term, values)
        case wire.Map(entries=entries):
            return Collection("map", {_from_wire(key, values): _from_wire(value, values) for key, value in entries})
        case wire.Set(items=items):
            return Collection("set", [_from_wire(one, values) for one in items])
        case wire.Queue(items=items, priority=priority):
            return Collection("priority" if priority else "queue", [_from_wire(one, values) for one in items])


def _variable(term: wire.Variable, values: _Variables) -> Any:
    variable = Var(term.name) if term.name.startswith("_") else values.setdefault(term.name, Var(term.name))
    if not (term.annotations or term.negated or term.namespace):
        return variable
    noted = tuple([_from_wire(one, values) for one in term.annotations]) if term.annotations else None
    return Open(variable, noted, term.negated, term.namespace or None)


def _source(term: wire.Source, values: _Variables) -> Any:
    values.source += len(term.text)
    if values.source > MOST_SOURCE:
        raise BadTerm(f"it has more than {MOST_SOURCE} characters of code")
    try:
        return instantiate(parse_term(term.text, "<message>"), values)
    except SyntaxErrors as errors:
        raise BadTerm(f"`{term.text}`: {errors.findings[0].message}") from None
    except RecursionError:
        raise BadTerm("nested too deeply") from None
