"""Generates Python that builds terms and computes arithmetic."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, TypeAlias

from agentd.language.compiler.code_writer import Function, Unit, tuple_of
from agentd.language.compiler.constants import (
    constant_annots,
    constant_term,
    is_constant,
    is_number,
    is_plain_atom,
    shared_atom,
    signature_of,
)
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import signature
from agentd.language.syntax_tree.traversal import is_plain_variable, parts, variables, with_parts
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import SELF, is_source
from agentd.language.terms.terms import EMPTY

Scope: TypeAlias = dict[str, str]
"""Which Python local holds the value of each variable that has occurred; a variable not in it is free and new."""


_DEEPEST_EXPRESSION = 30
"""Terms nested deeper than this are written as statements."""

_MOST_CHECKED = 2
"""Arguments of a literal at most that are checked where it is built: it is ground if they are numbers."""

_DIRECT = {"+", "-", "*", "/"}
"""The operators that Python computes alike when both operands are numbers."""


class Action(Protocol):
    """An internal action as the compiler sees it; see `agentd.mind.data.registry`."""

    function: Callable[..., Any]
    backtracks: bool
    suspends: bool
    names: int

    def guarded(self) -> Callable[..., Any]:
        """Return the function for contexts and rules, where an error only makes the condition false."""


class Library(Protocol):
    """What a program's mind knows of internal actions and functions."""

    has_meta: bool
    """Whether the program has plans for the states of goals, ``^!g``."""
    namespaced: bool
    """Whether literals of other namespaces than the default one may occur."""

    def is_function(self, name: str, arity: int) -> bool:
        """Return whether a function has this name and number of arguments."""

    def function(self, name: str, arity: int) -> Callable[..., Any]:
        """Return the function of this name and number of arguments."""

    def action(self, name: str, arity: int) -> Action | None:
        """Return the internal action of this name and number of arguments, if there is one."""

    def unknown_action(self, node: nodes.InternalAction) -> None:
        """Note an internal action that does not exist."""


class _Written(NamedTuple):
    """A part of a term: its node, its local if it has been written, whether it is a constant."""

    node: nodes.Term
    local: str
    constant: bool


class TermCompiler:
    """Writes terms into one function. ``library`` knows the functions of the program."""

    def __init__(self, unit: Unit, function: Function, library: Library, depth: str) -> None:
        self.unit, self.function, self.library = unit, function, library
        self.depth = depth
        """The expression for the depth of new variables, ``""`` where no frame owns them."""
        self._nesting = 0
        self.linking = False
        """Whether free variables inside code in braces are to be linked to those of the plan (a pattern for ``=``)."""

    def constant(self, value: Any) -> str:
        """Return the name of a constant."""
        return self.unit.constant(value)

    def build(self, node: nodes.Term, scope: Scope) -> str:
        """Return an expression for a term. Variables that are new get a cell and are added to ``scope``."""
        if is_constant(node):
            return self._constant_term(node)
        if self._nesting >= _DEEPEST_EXPRESSION:
            return self._build_deep(node, scope)
        self._nesting += 1
        try:
            return self._build(node, scope)
        finally:
            self._nesting -= 1

    def _build_deep(self, node: nodes.Term, scope: Scope) -> str:
        """As `build`, by a statement for each part, the innermost first: Python nests no deeper than 200 brackets."""
        work: list[tuple[nodes.Term, int]] = [(node, -1)]
        done: list[_Written] = []
        while work:
            part, count = work.pop()
            if count < 0:
                inner = parts(part)
                if inner:
                    work.append((part, len(inner)))
                    work.extend((p, -1) for p in reversed(inner))
                else:
                    done.append(_Written(part, "", is_constant(part)))
                continue
            built = done[len(done) - count :]
            del done[len(done) - count :]
            if all(w.constant for w in built) and isinstance(part, nodes.Structure | nodes.ListTerm):
                done.append(_Written(part, "", not isinstance(getattr(part, "namespace", None), nodes.Variable)))
                continue
            # A part that has been written is a local: a variable of an impossible name takes its place.
            names = {f"{w.local}.": w.local for w in built if w.local}
            scope.update(names)
            local = self.function.assign(self._build(with_parts(part, tuple(w.node for w in built)), scope))
            for name in names:
                del scope[name]
            done.append(_Written(nodes.Variable(f"{local}."), local, False))
        return done[0].local or self._build(done[0].node, scope)

    def _build(self, node: nodes.Term, scope: Scope) -> str:
        match node:
            case nodes.Variable():
                return self._variable(node, scope)
            case nodes.Structure():
                return self._structure(node, scope)
            case nodes.ListTerm(items=items, tail=tail):
                built = [self.build(item, scope) for item in items]
                end = "EMPTY" if tail is None else self.build(tail, scope)
                return f"List({tuple_of(built)}, {end})" if built else end
            case nodes.Arithmetic():
                return self._arithmetic(node, scope)
            case nodes.InternalAction(name=name, args=args):
                return self._call(name, args, scope)
            case nodes.Relation() | nodes.And() | nodes.Or() | nodes.Not():
                operator = node.operator if isinstance(node, nodes.Relation) else nodes.CONNECTIVES[type(node)]
                operands = [self.build(part, scope) for part in parts(node) or ()]
                return f"Expression({self.constant(operator)}, {tuple_of(operands)})"
            case nodes.TriggerTerm(trigger=inner):
                for name in variables(inner):
                    self._variable(nodes.Variable(name), scope)
                return self._code(inner, scope)
            case nodes.PlanTerm(inner) | nodes.BodyTerm(inner) | nodes.RuleTerm(inner):
                return self._code(inner, scope)
        raise TypeError(f"not a term: {node!r}")

    def _constant_term(self, node: nodes.Term) -> str:
        if is_plain_atom(node) and not self.library.is_function(node.functor, 0):
            return self.constant(shared_atom(node.functor))
        term = constant_term(node)
        return "EMPTY" if term is EMPTY else self.constant(term)

    def _variable(self, node: nodes.Variable, scope: Scope) -> str:
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
        """Write a new variable without a value; return its name."""
        depth = f", {self.depth}" if self.depth else ""
        return self.function.assign(f"Var({self.constant(name)}{depth})")

    def namespace(self, namespace: str | nodes.Variable | None, scope: Scope) -> str:
        """Return an expression for a namespace."""
        if namespace is None:
            return "None"
        return self.constant(namespace) if isinstance(namespace, str) else self.build(namespace, scope)

    def _structure(self, node: nodes.Structure, scope: Scope) -> str:
        if self.library.is_function(node.functor, len(node.args)):
            return self._call(node.functor, node.args, scope)
        built = [self.build(a, scope) for a in node.args]
        args = tuple_of(built)
        annots = "" if node.annotations is None else ", " + self.annots(node.annotations, scope)
        if isinstance(node.namespace, nodes.Variable):
            sig = self.constant(signature(node.functor, len(node.args), node.negated))
            return f"qualify({self.build(node.namespace, scope)}, Literal({sig}, {args}{annots}))"
        if not annots:
            varying = [part for part, arg in zip(built, node.args, strict=True) if not is_constant(arg)]
            if len(varying) <= _MOST_CHECKED and all(map(str.isidentifier, varying)):
                annots = f", (), {' and '.join(f'type({part}) is float' for part in varying)}"
        return f"Literal({self.constant(signature_of(node))}, {args}{annots})"

    def annots(self, node: nodes.ListTerm | None, scope: Scope) -> str:
        """Return an expression for the annotations of a term."""
        if node is None or (not node.items and node.tail is None):
            return "()"
        if is_constant(node):
            return self.constant(constant_annots(node))
        parts = tuple_of([self.build(item, scope) for item in node.items])
        if node.tail is None:
            return f"sorted_annots({parts})"
        return f"annots_with_tail({parts}, {self.build(node.tail, scope)})"

    def event_annots(self, node: nodes.ListTerm | None, scope: Scope) -> str:
        """As `annots`, with source(self) added if no source is named."""
        if node is None or (not node.items and node.tail is None):
            return "SELF"
        if is_constant(node):
            found = constant_annots(node)
            return self.constant(found if any(map(is_source, found)) else sorted_annots(found + SELF))
        return f"with_source({self.annots(node, scope)})"

    def pattern_annots(self, node: nodes.ListTerm, scope: Scope) -> str:
        """Annotations to look for: a tail takes the rest."""
        parts = [self.build(item, scope) for item in node.items]
        if node.tail is not None:
            parts.append(f"Rest({self.build(node.tail, scope)})")
        return tuple_of(parts)

    def _code(self, inner: Any, scope: Scope) -> str:
        if self.linking:
            for name in variables(inner):
                self._variable(nodes.Variable(name), scope)
        known = [name for name in variables(inner) if name in scope]
        values = ", ".join(f"{self.constant(name)}: {scope[name]}" for name in known)
        return f"capture({self.constant(inner)}, {{{values}}})"

    def _call(self, name: str, args: tuple[nodes.Term, ...], scope: Scope) -> str:
        """Return a function of the program; what is no function stays a term."""
        if name == ".count" and len(args) == 1:
            return self.count(args[0], scope)
        built = [self.function.assign(self.build(a, scope)) for a in args]
        sig = self.constant(signature(name, len(args)))
        term = f"Literal({sig}, {tuple_of(built)})"
        if not self.library.is_function(name, len(args)):
            return term
        called = self.library.function(name, len(args))
        return self.function.assign(f"call({self.constant(called)}, m, trail, {sig}, {tuple_of(built)})")

    def count(self, query: nodes.Term, scope: Scope) -> str:
        """``.count(Query)`` as a function."""
        raise NotImplementedError

    def _arithmetic(self, node: nodes.Arithmetic, scope: Scope) -> str:
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
            f"type({name}) is float" for name, part in zip(operands, node.operands, strict=True) if not is_number(part)
        ]
        if node.operator == "/":
            checks.append(b)
        quick = f"{a} {node.operator} {b}"
        if checks:
            quick += f" if {' and '.join(checks)} else arithmetic(m, {operator}, {a}, {b})"
        return self.function.assign(quick)
