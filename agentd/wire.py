"""Run-time terms to wire terms and back: what percepts, actions and mail carry."""

from __future__ import annotations

from dataclasses import fields, is_dataclass, replace
from typing import Any

from agentd.language import syntax
from agentd.language.errors import SyntaxErrors
from agentd.language.instantiate import instantiate
from agentd.language.order import sorted_annots
from agentd.language.parser import parse_term
from agentd.language.printer import source_text
from agentd.language.signatures import DEFAULT, signature
from agentd.language.sources import PERCEPT
from agentd.language.terms import Code, Collection, Expression, List, Literal, Open, Var, atom, deref, make_list, split
from schemas import terms as wire
from schemas.records import Perception

MAX_DEPTH = 100
"""Terms nested deeper are not sent: JSON readers have limits of their own."""


class BadTerm(ValueError):
    """A term that cannot cross the bus; says why."""


def to_wire(term: Any) -> wire.Term:
    """Return the wire form of a run-time term. Raises BadTerm for one that is nested too deeply (or without end)."""
    return _to_wire(term, 0)


def from_wire(term: wire.Term) -> Any:
    """Return the run-time form of a wire term; equal variable names become one variable. Raises BadTerm."""
    return _FromWire().term(term)


def perceived(perception: Perception) -> Literal:
    """Return the belief that a perception tells, with source(percept). Raises BadTerm for a name that is none."""
    if not (perception.name[:1].islower() and perception.name.replace("_", "a").isalnum()):
        raise BadTerm(f"`{perception.name}` is no name of a belief")
    arguments = tuple(map(from_wire, perception.parameters))
    return Literal(signature(perception.name, len(arguments)), arguments, PERCEPT)


def _to_wire(term: Any, depth: int) -> wire.Term:
    if depth > MAX_DEPTH:
        raise BadTerm(f"nested deeper than {MAX_DEPTH}")
    term = deref(term)
    match term:
        case float():
            return wire.number(term)
        case str():
            return term
        case Literal():
            return _literal(term, depth)
        case Var():
            return wire.Variable(_variable_name(term.name))
        case List():
            items, tail = split(term)
            sent = [_to_wire(item, depth + 1) for item in items]
            closed = type(tail) is List
            return sent if closed else wire.OpenList(tuple(sent), _to_wire(tail, depth + 1))
        case Code():
            return _code(term)
        case Expression() | Open():
            return _expression(term, depth)
        case Collection():
            return _collection(term, depth)
    raise BadTerm(f"a {type(term).__name__} cannot be sent")


def _variable_name(name: str) -> str:
    return name if name[:1].isupper() or name[:1] == "_" else f"_{name}"


def _several(terms: tuple[Any, ...], depth: int) -> tuple[wire.Term, ...]:
    return tuple(_to_wire(term, depth + 1) for term in terms)


def _literal(term: Literal, depth: int) -> wire.Term:
    sig = term.sig
    if not (term.args or term.annots or sig.negated) and sig.namespace == DEFAULT:
        return {"true": True, "false": False}.get(sig.functor, wire.Atom(sig.functor))
    return wire.Structure(
        sig.functor,
        _several(term.args, depth),
        _several(term.annots, depth),
        sig.negated,
        "" if sig.namespace == DEFAULT else sig.namespace,
    )


def _expression(term: Expression | Open, depth: int) -> wire.Term:
    if isinstance(term, Open) and term.literal is None and isinstance(deref(term.variable), Var):
        return wire.Variable(
            _variable_name(deref(term.variable).name),
            _several(term.annots or (), depth),
            term.negated,
            term.namespace if isinstance(term.namespace, str) else "",
        )
    text = source_text(_syntax(term, depth))
    return wire.Source("expression", text if text.startswith("(") else f"({text})")


def _code(term: Code) -> wire.Term:
    node = _with_values(term.syntax, term.values)
    match node:
        case syntax.Plan():
            return wire.Source("plan", source_text(syntax.PlanTerm(node)))
        case syntax.Trigger():
            return wire.Source("trigger", source_text(syntax.TriggerTerm(node)))
        case syntax.Rule():
            return wire.Source("rule", source_text(syntax.RuleTerm(node)))
        case syntax.Body():
            return wire.Source("body", source_text(syntax.BodyTerm(node)))
    raise BadTerm(f"a {type(node).__name__} cannot be sent")


def _collection(term: Collection, depth: int) -> wire.Term:
    if term.kind == "map":
        pairs = tuple((_to_wire(key, depth + 1), _to_wire(value, depth + 1)) for key, value in term.content.items())
        return wire.Map(pairs)
    items = _several(tuple(term.content), depth)
    return wire.Set(items) if term.kind == "set" else wire.Queue(items, term.kind == "priority")


def _with_values(node: Any, values: dict[str, Any]) -> Any:
    """Return a syntax tree with the variables that have values replaced by these."""
    if isinstance(node, syntax.Variable):
        return _syntax(values[node.name], 0) if node.name in values and node.annotations is None else node
    if isinstance(node, tuple):
        return tuple(_with_values(item, values) for item in node)
    if is_dataclass(node) and not isinstance(node, type) and not isinstance(node, syntax.Position):
        changed = {field.name: _with_values(getattr(node, field.name), values) for field in fields(node)}
        return replace(node, **changed)
    return node


def _syntax(term: Any, depth: int) -> Any:
    """Return the syntax that stands for a run-time term."""
    if depth > MAX_DEPTH:
        raise BadTerm(f"nested deeper than {MAX_DEPTH}")
    term = deref(term)
    match term:
        case float():
            return syntax.Number(term)
        case str():
            return syntax.String(term)
        case Var():
            return syntax.Variable(_variable_name(term.name))
        case Literal(sig=sig):
            return syntax.Structure(
                sig.functor,
                tuple(_syntax(argument, depth + 1) for argument in term.args),
                syntax.ListTerm(tuple(_syntax(one, depth + 1) for one in term.annots)) if term.annots else None,
                sig.negated,
                None if sig.namespace == DEFAULT else sig.namespace,
            )
        case List():
            items, tail = split(term)
            closed = type(tail) is List
            end = None if closed else _syntax(tail, depth + 1)
            return syntax.ListTerm(tuple(_syntax(item, depth + 1) for item in items), end)
        case Expression(operator=operator):
            return _operation(operator, tuple(_syntax(operand, depth + 1) for operand in term.operands))
        case Code():
            node = _with_values(term.syntax, term.values)
            kind = {syntax.Plan: syntax.PlanTerm, syntax.Trigger: syntax.TriggerTerm, syntax.Rule: syntax.RuleTerm}
            return kind.get(type(node), syntax.BodyTerm)(node)
    raise BadTerm(f"a {type(term).__name__} cannot be sent inside an expression")


def _operation(operator: str, operands: tuple[Any, ...]) -> Any:
    match operator:
        case "&":
            return syntax.And(*operands)
        case "|":
            return syntax.Or(*operands)
        case "not":
            return syntax.Not(*operands)
        case "+" | "-" | "*" | "/" | "**" | "div" | "mod":
            return syntax.Arithmetic(operator, operands)
    return syntax.Relation(operator, *operands)


class _FromWire:
    """Reads one term; its variables are shared by name, and new for each term read."""

    def __init__(self) -> None:
        self._values: dict[str, Any] = {}

    def term(self, term: wire.Term) -> Any:
        match term:
            case bool():
                return atom("true" if term else "false")
            case int() | float():
                return float(term)
            case str():
                return term
            case list():
                return make_list(map(self.term, term))
            case wire.Atom(name=name):
                return atom(name)
            case wire.Number(text=text):
                return float(text)
            case wire.Structure():
                return self._structure(term)
            case wire.Variable():
                return self._variable(term)
            case wire.OpenList(items=items, tail=tail):
                return make_list([self.term(item) for item in items], self.term(tail))
            case wire.Source():
                return self._source(term)
            case wire.Map(entries=entries):
                return Collection("map", {self.term(key): self.term(value) for key, value in entries})
            case wire.Set(items=items):
                return Collection("set", list(map(self.term, items)))
            case wire.Queue(items=items, priority=priority):
                return Collection("priority" if priority else "queue", list(map(self.term, items)))

    def _structure(self, term: wire.Structure) -> Literal:
        sig = signature(term.functor, len(term.args), term.negated, term.namespace or DEFAULT)
        return Literal(sig, tuple(map(self.term, term.args)), sorted_annots(map(self.term, term.annotations)))

    def _variable(self, term: wire.Variable) -> Any:
        variable = Var(term.name) if term.name.startswith("_") else self._values.setdefault(term.name, Var(term.name))
        if not (term.annotations or term.negated or term.namespace):
            return variable
        noted = tuple(map(self.term, term.annotations)) if term.annotations else None
        return Open(variable, noted, term.negated, term.namespace or None)

    def _source(self, term: wire.Source) -> Any:
        try:
            return instantiate(parse_term(term.text, "<message>"), self._values)
        except SyntaxErrors as errors:
            raise BadTerm(f"`{term.text}`: {errors.findings[0].message}") from None
        except RecursionError:
            raise BadTerm("nested too deeply") from None
