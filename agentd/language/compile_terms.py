"""Generates Python that builds terms, computes arithmetic, and matches values against patterns."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeAlias

from agentd.language import syntax
from agentd.language.emit import Function, Unit
from agentd.language.instantiate import instantiate
from agentd.language.order import sorted_annots
from agentd.language.signatures import DEFAULT, Signature, signature
from agentd.language.sources import SELF, is_source, told_by
from agentd.language.terms import EMPTY, List, Literal, atom

Scope: TypeAlias = dict[str, str]
"""Which Python local holds the value of each variable that has occurred; a variable not in it is free and new."""

Next: TypeAlias = Callable[[Scope], None]
"""Writes what comes after a success, with the variables known there."""


@lru_cache(maxsize=8192)
def shared_atom(name: str) -> Literal:
    """One object per atom of a program, so that generated code can compare by identity first."""
    return atom(name)


def is_plain_variable(node: Any) -> bool:
    return type(node) is syntax.Variable and node.annotations is None and not node.negated and node.namespace is None


def variables(node: Any, found: dict[str, None] | None = None) -> dict[str, None]:
    """The names of the variables in a syntax node, in order of occurrence, without anonymous ones."""
    if found is None:
        found = {}
    kind = type(node)
    if kind is syntax.Variable and not node.anonymous:
        found[node.name] = None
    if kind is tuple:
        for item in node:
            variables(item, found)
    elif hasattr(node, "__dataclass_fields__") and kind is not syntax.Position:
        for name in node.__dataclass_fields__:
            if name != "position":
                variables(getattr(node, name), found)
    return found


def is_constant(node: Any) -> bool:
    """Whether a node is a ground term that needs no computing: it can be made once."""
    match node:
        case syntax.Number() | syntax.String():
            return True
        case syntax.Structure(args=args, annotations=annots, namespace=namespace):
            if namespace is not None and not isinstance(namespace, str):
                return False
            return all(map(is_constant, args)) and (annots is None or is_constant(annots))
        case syntax.ListTerm(items=items, tail=tail):
            return all(map(is_constant, items)) and (tail is None or is_constant(tail))
        case syntax.Arithmetic():
            return _is_number(node)
    return False


def _is_plain_atom(node: Any) -> bool:
    plain = type(node) is syntax.Structure and not node.args and node.annotations is None and not node.negated
    return plain and node.namespace in (None, DEFAULT)


def _is_number(node: Any) -> bool:
    """Whether a node is a numeral, or arithmetic over numerals (but ``div``, which may have no value)."""
    if isinstance(node, syntax.Arithmetic):
        return node.operator != "div" and all(map(_is_number, node.operands))
    return isinstance(node, syntax.Number)


class TermCompiler:
    """Writes terms into one function. ``library`` knows the functions of the program."""

    def __init__(self, unit: Unit, function: Function, library: Any, depth: str) -> None:
        self.unit, self.function, self.library = unit, function, library
        self.depth = depth
        """The expression for the depth of new variables, ``""`` where no frame owns them."""
        self.linking = False
        """Whether free variables inside code in braces are to be linked to those of the plan (a pattern for ``=``)."""
        self.binds = False
        """Whether something written so far may bind a variable that existed before."""

    def constant(self, value: Any) -> str:
        return self.unit.constant(value)

    # --- building ---

    def build(self, node: syntax.Term, scope: Scope) -> str:
        """An expression for a term. Variables that are new get a cell and are added to ``scope``."""
        if is_constant(node):
            return self._constant_term(node)
        match node:
            case syntax.Variable():
                return self._variable(node, scope)
            case syntax.Structure():
                return self._structure(node, scope)
            case syntax.ListTerm(items=items, tail=tail):
                parts = [self.build(item, scope) for item in items]
                end = "EMPTY" if tail is None else self.build(tail, scope)
                return f"List({_tuple(parts)}, {end})" if parts else end
            case syntax.Arithmetic():
                return self._arithmetic(node, scope)
            case syntax.InternalAction(name=name, args=args):
                return self._call(name, args, scope)
            case syntax.Relation(operator=operator, left=left, right=right):
                return self._expression(operator, (left, right), scope)
            case syntax.And(left=left, right=right):
                return self._expression("&", (left, right), scope)
            case syntax.Or(left=left, right=right):
                return self._expression("|", (left, right), scope)
            case syntax.Not(operand=operand):
                return self._expression("not", (operand,), scope)
            case syntax.TriggerTerm(trigger=inner):
                for name in variables(inner):
                    self._variable(syntax.Variable(name), scope)
                return self._code(inner, scope)
            case syntax.PlanTerm(plan=inner):
                return self._code(inner, scope)
            case syntax.BodyTerm(body=inner) | syntax.RuleTerm(rule=inner):
                return self._code(inner, scope)
        raise TypeError(f"not a term: {node!r}")

    def _constant_term(self, node: Any) -> str:
        if _is_plain_atom(node) and not self.library.is_function(node.functor, 0):
            return self.constant(shared_atom(node.functor))
        term = self.library.constant(node)
        return "EMPTY" if term is EMPTY else self.constant(term)

    def _variable(self, node: syntax.Variable, scope: Scope) -> str:
        if node.anonymous:
            plain = self.new_variable(node.name)
        else:
            plain = scope.get(node.name) or self.new_variable(node.name)
            scope[node.name] = plain
        if is_plain_variable(node):
            return plain
        annots = "None" if node.annotations is None else self.pattern_annots(node.annotations, scope)
        return f"Open({plain}, {annots}, {node.negated}, {self.namespace(node.namespace, scope)})"

    def new_variable(self, name: str) -> str:
        depth = f", {self.depth}" if self.depth else ""
        return self.function.assign(f"Var({self.constant(name)}{depth})")

    def namespace(self, namespace: str | syntax.Variable | None, scope: Scope) -> str:
        if namespace is None:
            return "None"
        return self.constant(namespace) if isinstance(namespace, str) else self.build(namespace, scope)

    def _structure(self, node: syntax.Structure, scope: Scope) -> str:
        if self.library.is_function(node.functor, len(node.args)):
            return self._call(node.functor, node.args, scope)
        args = _tuple([self.build(a, scope) for a in node.args])
        annots = "" if node.annotations is None else ", " + self.annots(node.annotations, scope)
        if isinstance(node.namespace, syntax.Variable):
            sig = self.constant(signature(node.functor, len(node.args), node.negated))
            return f"qualify({self.build(node.namespace, scope)}, Literal({sig}, {args}{annots}))"
        return f"Literal({self.constant(signature_of(node))}, {args}{annots})"

    def annots(self, node: syntax.ListTerm | None, scope: Scope) -> str:
        """An expression for the annotations of a term."""
        if node is None or (not node.items and node.tail is None):
            return "()"
        if is_constant(node):
            return self.constant(constant_annots(node))
        parts = _tuple([self.build(item, scope) for item in node.items])
        if node.tail is None:
            return f"sorted_annots({parts})"
        return f"annots_with_tail({parts}, {self.build(node.tail, scope)})"

    def event_annots(self, node: syntax.ListTerm | None, scope: Scope) -> str:
        """As `annots`, with source(self) added if no source is named."""
        if node is None or (not node.items and node.tail is None):
            return "SELF"
        if is_constant(node):
            found = constant_annots(node)
            return self.constant(found if any(map(is_source, found)) else sorted_annots(found + SELF))
        return f"with_source({self.annots(node, scope)})"

    def pattern_annots(self, node: syntax.ListTerm, scope: Scope) -> str:
        """Annotations to look for: a tail takes the rest."""
        parts = [self.build(item, scope) for item in node.items]
        if node.tail is not None:
            parts.append(f"Rest({self.build(node.tail, scope)})")
        return _tuple(parts)

    def _expression(self, operator: str, operands: tuple[Any, ...], scope: Scope) -> str:
        return f"Expression({self.constant(operator)}, {_tuple([self.build(o, scope) for o in operands])})"

    def _code(self, inner: Any, scope: Scope) -> str:
        if self.linking:
            for name in variables(inner):
                self._variable(syntax.Variable(name), scope)
        known = [name for name in variables(inner) if name in scope]
        values = ", ".join(f"{self.constant(name)}: {scope[name]}" for name in known)
        return f"capture({self.constant(inner)}, {{{values}}})"

    def _call(self, name: str, args: tuple[Any, ...], scope: Scope) -> str:
        """A function of the program; what is no function stays a term."""
        if name == ".count" and len(args) == 1:
            return self.count(args[0], scope)
        built = [self.function.assign(self.build(a, scope)) for a in args]
        sig = self.constant(signature(name, len(args)))
        term = f"Literal({sig}, {_tuple(built)})"
        if not self.library.is_function(name, len(args)):
            return term
        called = self.library.function(name, len(args))
        return self.function.assign(f"call({self.constant(called)}, m, trail, {sig}, {_tuple(built)})")

    def count(self, query: Any, scope: Scope) -> str:
        """``.count(Query)`` as a function."""
        raise NotImplementedError

    def _arithmetic(self, node: syntax.Arithmetic, scope: Scope) -> str:
        operands = [self.function.assign(self.build(o, scope)) for o in node.operands]
        operator = self.constant(node.operator)
        if len(operands) == 1:
            (a,) = operands
            if node.operator == "+":
                return f"value({a})"
            return self.function.assign(f"-{a} if type({a}) is float else arithmetic(m, {operator}, {a})")
        a, b = operands
        if node.operator not in _DIRECT:
            return self.function.assign(f"arithmetic(m, {operator}, {a}, {b})")
        checks = [
            f"type({name}) is float" for name, part in zip(operands, node.operands, strict=True) if not _is_number(part)
        ]
        if node.operator == "/":
            checks.append(b)
        quick = f"{a} {node.operator} {b}"
        if checks:
            quick += f" if {' and '.join(checks)} else arithmetic(m, {operator}, {a}, {b})"
        return self.function.assign(quick)

    # --- matching ---

    def match(self, node: syntax.Term, value: str, scope: Scope, then: Next) -> None:
        """Write the unification of a pattern with a value (a local), the pattern being the left side."""
        if is_plain_variable(node):
            assert isinstance(node, syntax.Variable)
            if node.anonymous:
                then(scope)
            elif node.name not in scope:
                then({**scope, node.name: value})
            else:
                self._match_known(scope[node.name], value, scope, then)
            return
        if is_constant(node):
            self._match_constant(node, value, scope, then)
        elif type(node) is syntax.Structure and self._is_plain_structure(node):
            self._match_structure(node, value, scope, then)
        elif type(node) is syntax.ListTerm:
            self._match_list(node, value, scope, then)
        else:
            self.match_built(node, value, scope, then)

    def match_built(self, node: syntax.Term, value: str, scope: Scope, then: Next) -> None:
        """Build the pattern as a term and unify."""
        inner = dict(scope)
        built = self.build(node, inner)
        self.binds = True
        with self.function.block(f"if unify({built}, {value}, trail):"):
            then(self.settled(scope, inner))

    def settled(self, before: Scope, after: Scope) -> Scope:
        """The scope after a unification: cells made for it are read, so that what follows sees plain values."""
        settled = dict(after)
        for name, local in after.items():
            if name not in before:
                settled[name] = self.function.assign(f"deref({local})")
        return settled

    def _is_plain_structure(self, node: syntax.Structure) -> bool:
        return (
            node.annotations is None
            and not isinstance(node.namespace, syntax.Variable)
            and not self.library.is_function(node.functor, len(node.args))
        )

    def _match_known(self, known: str, value: str, scope: Scope, then: Next) -> None:
        if known == value:
            then(scope)
            return
        self.binds = True
        both = f"type({known}) is float and type({value}) is float"
        with self.function.block(f"if ({known} == {value} if {both} else unify({known}, {value}, trail)):"):
            then(scope)

    def _match_constant(self, node: Any, value: str, scope: Scope, then: Next) -> None:
        inner = dict(scope)
        constant = self.function.assign(self.build(node, inner))
        self.binds = True
        if isinstance(node, syntax.Structure | syntax.ListTerm):
            test = f"{value} is {constant} or (type({value}) is not float and unify({constant}, {value}, trail))"
        else:
            kind = "str" if isinstance(node, syntax.String) else "float"
            test = f"{value} == {constant} or (type({value}) is not {kind} and unify({constant}, {value}, trail))"
        with self.function.block(f"if {test}:"):
            then(scope)

    def _match_structure(self, node: syntax.Structure, value: str, scope: Scope, then: Next) -> None:
        sig = self.constant(signature_of(node))
        self.binds = True
        args = self.function.assign(
            f"{value}.args if type({value}) is Literal and {value}.sig is {sig}"
            f" else open_structure({value}, {sig}, trail)"
        )
        with self.function.block(f"if {args} is not None:"):
            locals_ = [self.function.local() for _ in node.args]
            self.function.emit(f"{_targets(locals_)} = {args}")
            self.match_all(list(zip(node.args, locals_, strict=True)), scope, then)

    def _match_list(self, node: syntax.ListTerm, value: str, scope: Scope, then: Next) -> None:
        if not node.items:
            self.match_built(node, value, scope, then)
            return
        self.binds = True
        pair = self.function.assign(f"open_list({value}, trail)")
        with self.function.block(f"if {pair} is not None:"):
            head, rest = self.function.local(), self.function.local()
            self.function.emit(f"{head}, {rest} = {pair}")
            if len(node.items) > 1:
                others: Any = syntax.ListTerm(node.items[1:], node.tail)
            else:
                others = syntax.ListTerm() if node.tail is None else node.tail
            self.match_all([(node.items[0], head), (others, rest)], scope, then)

    def match_all(self, pairs: list[tuple[Any, str]], scope: Scope, then: Next) -> None:
        """Match several patterns one after the other."""
        if not pairs:
            then(scope)
            return
        (node, value), others = pairs[0], pairs[1:]
        self.match(node, value, scope, lambda inner: self.match_all(others, inner, then))


_DIRECT = {"+", "-", "*", "/"}


def signature_of(node: syntax.Structure) -> Signature:
    """The signature of a literal whose namespace is known."""
    namespace = node.namespace if isinstance(node.namespace, str) else DEFAULT
    return signature(node.functor, len(node.args), node.negated, namespace or DEFAULT)


def _tuple(parts: list[str]) -> str:
    return f"({', '.join(parts)}{',' if len(parts) == 1 else ''})"


def _targets(names: list[str]) -> str:
    return f"({names[0]},)" if len(names) == 1 else ", ".join(names)


def constant_term(node: Any) -> Any:
    """The ground term of a constant node."""
    term = instantiate(node)
    if type(term) is Literal and is_source(term) and type(term.args[0]) is Literal and not term.annots:
        return told_by(term.args[0].sig.functor)[0]
    if isinstance(term, Literal | List):
        term.ground = True
    return term


def constant_annots(node: syntax.ListTerm) -> tuple[Any, ...]:
    """The annotations of a constant list; the same object for the same single source."""
    found = sorted_annots(
        constant_term(item)
        for item in (*node.items, *(node.tail.items if isinstance(node.tail, syntax.ListTerm) else ()))
    )
    if len(found) == 1 and is_source(found[0]) and type(found[0].args[0]) is Literal and not found[0].annots:
        return told_by(found[0].args[0].sig.functor)
    return found
