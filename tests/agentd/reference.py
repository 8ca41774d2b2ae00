"""A reference for queries: SLD resolution as the book has it, over the parsed syntax, slow and plain.

It shares the parser and the classes of the syntax with agentd and nothing else: terms are syntax nodes, bindings are
dictionaries that are copied, variables are renamed for each use of a clause. What the dialect leaves open (two free
variables compared, cyclic terms, arithmetic on what is no number) raises `Undetermined`.
"""

import math
from collections.abc import Iterator
from itertools import count
from typing import Any, TypeAlias

from msgspec.structs import replace

from agentd.language.syntax_tree.nodes import (
    And,
    Arithmetic,
    Belief,
    InternalAction,
    ListTerm,
    Not,
    Number,
    Or,
    Relation,
    Rule,
    String,
    Structure,
    Variable,
)

Bindings: TypeAlias = dict[str, Any]

TRUE = Structure("true")
SELF = Structure("source", (Structure("self"),))
MOST_STEPS = 800
_RANKS = {Number: 0, String: 1, ListTerm: 2, Structure: 3, Variable: 4}


class Undetermined(Exception):
    """The dialect does not say what happens here, or it would take too long."""


class Reference:
    """Answers queries about the beliefs and rules of a program, in the order of the file."""

    def __init__(self, items: tuple[Any, ...]) -> None:
        self._clauses = [
            Rule(_sourced(item.literal), TRUE) if isinstance(item, Belief) else item
            for item in items
            if isinstance(item, Belief | Rule)
        ]
        self._names = count()
        self._steps = 0

    def answers(self, query: Any, shown: Any) -> list[str]:
        """The text of a term for each answer to a query."""
        self._steps = 0
        named: dict[str, Variable] = {}
        query, shown = self._fresh(query, named), self._fresh(shown, named)
        return [text(shown, found) for found in self.solve(query, {})]

    def solve(self, formula: Any, s: Bindings) -> Iterator[Bindings]:
        """One solution after another."""
        self._steps += 1
        if self._steps > MOST_STEPS:
            raise Undetermined("too many steps")
        match formula:
            case And(left=left, right=right):
                for found in self.solve(left, s):
                    yield from self.solve(right, found)
            case Or(left=left, right=right):
                yield from self.solve(left, s)
                yield from self.solve(right, s)
            case Not(operand=operand):
                if not list(self.solve(operand, s)):
                    yield s
            case Relation(operator="=", left=left, right=right):
                yield from _one(unify(left, right, s))
            case Relation(operator=operator, left=left, right=right):
                if _holds(operator, left, right, s):
                    yield s
            case InternalAction(name=name, args=args):
                yield from self._action(name, args, s)
            case Structure(functor="true" | "false", args=()):
                yield from _one(s if formula.functor == "true" else None)
            case Structure():
                yield from self._query(formula, s)
            case _:
                raise Undetermined(formula)

    def _action(self, name: str, args: tuple[Any, ...], s: Bindings) -> Iterator[Bindings]:
        match name, args:
            case ".member", (member, members):
                for item in _items(members, s):
                    yield from _one(unify(member, item, s))
            case ".length", (of, length):
                yield from _one(unify(length, Number(float(len(_items(of, s)))), s))
            case ".findall", (shown, query, result):
                found = ListTerm(tuple(resolved(shown, each) for each in self.solve(query, s)))
                yield from _one(unify(result, found, s))
            case ".count", (query, result):
                yield from _one(unify(result, Number(float(len(list(self.solve(query, s))))), s))
            case _:
                raise Undetermined(name)

    def _query(self, query: Structure, s: Bindings) -> Iterator[Bindings]:
        for clause in self._clauses:
            head = clause.head
            if (head.functor, len(head.args), head.negated) != (query.functor, len(query.args), query.negated):
                continue
            renamed = self._fresh(clause, {})
            found: Bindings | None = s
            for asked, given in zip(query.args, renamed.head.args, strict=True):
                if clause.body is not TRUE and _symbolic(asked, s):
                    raise Undetermined("arithmetic that is open when a rule is asked")
                found = None if found is None else unify(asked, given, found)
            for solution in () if found is None else self.solve(renamed.body, found):
                yield from _annotated(query.annotations, renamed.head.annotations, solution)

    def _fresh(self, node: Any, named: dict[str, Variable]) -> Any:
        """The same syntax with new variables."""

        def new(part: Any) -> Any:
            return self._fresh(part, named)

        match node:
            case Variable(name=name):
                if node.anonymous:
                    return Variable(f"V{next(self._names)}")
                return named.setdefault(name, Variable(f"V{next(self._names)}"))
            case Structure(args=args, annotations=annotations):
                return replace(node, args=tuple(map(new, args)), annotations=annotations and new(annotations))
            case InternalAction(args=args):
                return replace(node, args=tuple(map(new, args)))
            case ListTerm(items=items, tail=tail):
                return ListTerm(tuple(map(new, items)), tail and new(tail))
            case Arithmetic(operands=operands):
                return replace(node, operands=tuple(map(new, operands)))
            case And() | Or() | Relation():
                return replace(node, left=new(node.left), right=new(node.right))
            case Not(operand=operand):
                return Not(new(operand))
            case Rule(head=head, body=body):
                return Rule(new(head), body if body is TRUE else new(body))
        return node


def _sourced(literal: Structure) -> Structure:
    written = literal.annotations.items if literal.annotations else ()
    return replace(literal, annotations=ListTerm((*sorted(written, key=lambda a: text(a, {})), SELF)))


def _one(found: Bindings | None) -> Iterator[Bindings]:
    if found is not None:
        yield found


def _annotated(asked: ListTerm | None, there: ListTerm | None, s: Bindings) -> Iterator[Bindings]:
    if asked is None or not asked.items:
        yield s
        return
    for annotation in there.items if there else ():
        found = unify(asked.items[0], annotation, s)
        if found is not None:
            yield from _annotated(ListTerm(asked.items[1:]), there, found)


# --- terms -----------------------------------------------------------------------------------------------------------


def walk(term: Any, s: Bindings) -> Any:
    """The value of a variable, the result of arithmetic; lists as nothing, or one item and a tail."""
    while isinstance(term, Variable) and term.name in s:
        term = s[term.name]
    if isinstance(term, ListTerm):
        if not term.items:
            return term if term.tail is None else walk(term.tail, s)
        tail = ListTerm(term.items[1:], term.tail)
        return ListTerm(term.items[:1], tail)
    return _computed(term, s) if isinstance(term, Arithmetic) else term


def _computed(term: Arithmetic, s: Bindings) -> Any:
    values = [walk(operand, s) for operand in term.operands]
    if any(isinstance(value, Variable | Arithmetic) for value in values):
        return replace(term, operands=tuple(values))
    if not all(isinstance(value, Number) for value in values):
        raise Undetermined("arithmetic on what is no number")
    numbers = [value.value for value in values]
    match term.operator, numbers:
        case "+", [a, b]:
            return Number(a + b)
        case "-", [a, b]:
            return Number(a - b)
        case "*", [a, b]:
            return Number(a * b)
        case "-", [a]:
            return Number(-a)
        case "mod", [a, b] if b:
            return Number(math.fmod(a, b))
    raise Undetermined(term.operator)


def unify(left: Any, right: Any, s: Bindings) -> Bindings | None:
    """The bindings with which two terms are the same; None if there are none."""
    left, right = walk(left, s), walk(right, s)
    match left, right:
        case Variable(), Variable() if left.name == right.name:
            return s
        case Variable(), _:
            return _bound(left, right, s)
        case _, Variable():
            return _bound(right, left, s)
        case (Number(), Number()) | (String(), String()):
            return s if left.value == right.value else None
        case Structure(), Structure():
            if (left.functor, len(left.args), left.negated) != (right.functor, len(right.args), right.negated):
                return None
            return _all(left.args, right.args, s)
        case ListTerm(), ListTerm():
            if not left.items or not right.items:
                return s if left.items == right.items else None
            return _all((left.items[0], left.tail), (right.items[0], right.tail), s)
        case Arithmetic(), Arithmetic():
            same = left.operator == right.operator and len(left.operands) == len(right.operands)
            return _all(left.operands, right.operands, s) if same else None
    return None


def _all(lefts: tuple[Any, ...], rights: tuple[Any, ...], s: Bindings) -> Bindings | None:
    found: Bindings | None = s
    for left, right in zip(lefts, rights, strict=True):
        found = None if found is None else unify(left, right, found)
    return found


def _bound(variable: Variable, term: Any, s: Bindings) -> Bindings:
    if variable.name in _free(term, s):
        raise Undetermined("a cyclic term")
    return {**s, variable.name: term}


def _free(term: Any, s: Bindings) -> set[str]:
    term = walk(term, s)
    if isinstance(term, Variable):
        return {term.name}
    return {name for part in _parts(term) for name in _free(part, s)}


def _parts(term: Any) -> tuple[Any, ...]:
    match term:
        case Structure(args=args):
            return args
        case ListTerm(items=(head,), tail=tail):
            return (head, tail)
        case Arithmetic(operands=operands):
            return operands
    return ()


def _symbolic(term: Any, s: Bindings) -> bool:
    term = walk(term, s)
    return isinstance(term, Arithmetic) or any(_symbolic(part, s) for part in _parts(term))


def resolved(term: Any, s: Bindings) -> Any:
    """A term with its variables replaced by their values, throughout."""
    term = walk(term, s)
    match term:
        case Structure(args=args):
            return replace(term, args=tuple(resolved(arg, s) for arg in args))
        case ListTerm(items=(head,), tail=tail):
            return ListTerm((resolved(head, s),), resolved(tail, s))
        case Arithmetic(operands=operands):
            return replace(term, operands=tuple(resolved(operand, s) for operand in operands))
    return term


def _items(term: Any, s: Bindings) -> list[Any]:
    found = []
    term = walk(term, s)
    while isinstance(term, ListTerm) and term.items:
        found.append(term.items[0])
        term = walk(term.tail, s)
    if not isinstance(term, ListTerm):
        raise Undetermined("the members of what is no list")
    return found


def _holds(operator: str, left: Any, right: Any, s: Bindings) -> bool:
    if operator in ("==", "\\=="):
        return (_order(left, right, s) == 0) == (operator == "==")
    order = _order(left, right, s)
    return {"<": order < 0, "<=": order <= 0, ">": order > 0, ">=": order >= 0}[operator]


def _order(left: Any, right: Any, s: Bindings) -> int:
    """The standard order: numbers, strings, lists, structures, variables."""
    left, right = walk(left, s), walk(right, s)
    if isinstance(left, Arithmetic) or isinstance(right, Arithmetic):
        raise Undetermined("open arithmetic compared")
    if type(left) is not type(right):
        return _sign(_RANKS[type(left)], _RANKS[type(right)])
    match left, right:
        case Variable(), Variable():
            raise Undetermined("free variables compared")
        case (Number(), Number()) | (String(), String()):
            return _sign(left.value, right.value)
        case Structure(), Structure():
            by_name = _sign((left.functor, left.negated), (right.functor, right.negated))
            return by_name or _first(left.args, right.args, s) or _sign(len(left.args), len(right.args))
    if not left.items or not right.items:
        return _sign(len(left.items), len(right.items))
    return _first((left.items[0], left.tail), (right.items[0], right.tail), s)


def _first(lefts: tuple[Any, ...], rights: tuple[Any, ...], s: Bindings) -> int:
    return next((order for pair in zip(lefts, rights, strict=False) if (order := _order(*pair, s))), 0)


def _sign(left: Any, right: Any) -> int:
    return int(left > right) - int(left < right)


def text(term: Any, s: Bindings) -> str:
    """A term as it prints, each free variable as ``_``."""
    term = walk(term, s)
    match term:
        case Number(value=value):
            return str(int(value)) if value == int(value) else str(value)
        case String(value=value):
            return f'"{value}"'
        case Variable():
            return "_"
        case Structure(functor=functor, args=args):
            sign = "~" if term.negated else ""
            return sign + functor + (f"({','.join(text(arg, s) for arg in args)})" if args else "")
        case ListTerm():
            return _list_text(term, s)
        case Arithmetic(operator=operator, operands=(left, right)):
            return f"({text(left, s)}{operator}{text(right, s)})"
    raise Undetermined(term)


def _list_text(term: Any, s: Bindings) -> str:
    items = []
    while isinstance(term, ListTerm) and term.items:
        items.append(text(term.items[0], s))
        term = walk(term.tail, s)
    return f"[{','.join(items)}{'' if isinstance(term, ListTerm) else '|' + text(term, s)}]"
