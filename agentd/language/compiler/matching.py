"""Generates Python that matches values against patterns: unification with one side known when it is written."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias, TypeGuard

from agentd.language.compiler.code_writer import targets_of
from agentd.language.compiler.compile_terms import Scope, TermCompiler
from agentd.language.compiler.constants import is_constant, is_plain_atom, signature_of
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.traversal import is_plain_variable, variables

Next: TypeAlias = Callable[[Scope], None]
"""Writes the code after a success, with the variables known there."""


_CODE = nodes.TriggerTerm | nodes.PlanTerm | nodes.BodyTerm | nodes.RuleTerm

_COMPARISONS = {"<": "<", "<=": "<=", ">": ">", ">=": ">=", "==": "==", "\\==": "!="}

MAX_INDENT = 40
"""Python nests blocks no deeper than 100: patterns below this are built and unified, formulas become functions."""


class MatchCompiler(TermCompiler):
    """Writes matches into one function, which has the local ``trail``."""

    asked = False
    """Whether the values are what a rule is asked with: then they are the left side, the head of the rule the right."""

    def match(self, node: nodes.Term, value: str, scope: Scope, then: Next) -> None:
        """Write the unification of a pattern with a value (a local), the pattern being the left side."""
        if is_plain_variable(node):
            assert isinstance(node, nodes.Variable)
            if node.anonymous:
                then(scope)
            elif node.name not in scope:
                self._match_new(node.name, value, scope, then)
            else:
                self._match_known(scope[node.name], value, scope, then)
            return
        if is_constant(node):
            self._match_constant(node, value, scope, then)
        elif self.function.indent > MAX_INDENT:
            self.match_built(node, value, scope, then)
        elif type(node) is nodes.Structure and self._is_plain_structure(node):
            self._match_structure(node, value, scope, then)
        elif type(node) is nodes.ListTerm:
            self._match_list(node, value, scope, then)
        else:
            self.match_built(node, value, scope, then)

    def _match_new(self, name: str, value: str, scope: Scope, then: Next) -> None:
        """Give a variable without a value any term but, where there are such, a literal of another namespace."""
        if not self.library.namespaced:
            then({**scope, name: value})
            return
        with self.function.block(f"if in_default({value}):"):
            then({**scope, name: value})

    def match_built(self, node: nodes.Term, value: str, scope: Scope, then: Next) -> None:
        """Build the pattern as a term and unify."""
        inner = dict(scope)
        linking, self.linking = self.linking, True
        built = self.build(node, inner)
        self.linking = linking
        with self.function.block(f"if {self._unified(node, built, value)}:"):
            then(self.settled(scope, inner))

    def _unified(self, node: nodes.Term, pattern: str, value: str) -> str:
        """Return the call that unifies a pattern with a value; code in braces is one in the head of a rule too."""
        if self.asked and not isinstance(node, _CODE):
            return f"unify({value}, {pattern}, trail)"
        return f"unify({pattern}, {value}, trail)"

    def settled(self, before: Scope, after: Scope) -> Scope:
        """Return the scope after a unification: cells made for it are read, so that what follows sees plain values."""
        settled = dict(after)
        for name, local in after.items():
            if name not in before:
                settled[name] = self.function.assign(f"deref({local})")
        return settled

    def _is_plain_structure(self, node: nodes.Structure) -> bool:
        return (
            node.annotations is None
            and not isinstance(node.namespace, nodes.Variable)
            and not self.library.is_function(node.functor, len(node.args))
        )

    def _match_known(self, known: str, value: str, scope: Scope, then: Next) -> None:
        if known == value:
            then(scope)
            return
        both = f"type({known}) is float and type({value}) is float"
        with self.function.block(f"if ({known} == {value} if {both} else unify({known}, {value}, trail)):"):
            then(scope)

    def _match_constant(self, node: nodes.Term, value: str, scope: Scope, then: Next) -> None:
        inner = dict(scope)
        constant = self.function.assign(self.build(node, inner))
        if isinstance(node, nodes.Structure | nodes.ListTerm):
            test = f"{value} is {constant} or (type({value}) is not float and {self._unified(node, constant, value)})"
        else:
            kind = "str" if isinstance(node, nodes.String) else "float"
            test = f"{value} == {constant} or (type({value}) is not {kind} and {self._unified(node, constant, value)})"
        with self.function.block(f"if {test}:"):
            then(scope)

    def _match_structure(self, node: nodes.Structure, value: str, scope: Scope, then: Next) -> None:
        sig = self.constant(signature_of(node))
        bare, opened = (f" and not {value}.annots", "open_bare") if self.asked else ("", "open_structure")
        args = self.function.assign(
            f"{value}.args if type({value}) is Literal and {value}.sig is {sig}{bare}"
            f" else {opened}({value}, {sig}, trail)"
        )
        with self.function.block(f"if {args} is not None:"):
            locals_ = [self.function.local() for _ in node.args]
            self.function.emit(f"{targets_of(locals_)} = {args}")
            self.match_all(list(zip(node.args, locals_, strict=True)), scope, then)

    def _match_list(self, node: nodes.ListTerm, value: str, scope: Scope, then: Next) -> None:
        if not node.items:
            self.match_built(node, value, scope, then)
            return
        pair = self.function.assign(f"open_list({value}, trail)")
        with self.function.block(f"if {pair} is not None:"):
            head, rest = self.function.local(), self.function.local()
            self.function.emit(f"{head}, {rest} = {pair}")
            if len(node.items) > 1:
                others: nodes.Term = nodes.ListTerm(node.items[1:], node.tail)
            else:
                others = nodes.ListTerm() if node.tail is None else node.tail
            self.match_all([(node.items[0], head), (others, rest)], scope, then)

    def match_all(self, pairs: list[tuple[nodes.Term, str]], scope: Scope, then: Next) -> None:
        """Match several patterns one after the other."""
        if not pairs:
            then(scope)
            return
        (node, value), others = pairs[0], pairs[1:]
        self.match(node, value, scope, lambda inner: self.match_all(others, inner, then))

    def relation(self, node: nodes.Relation, scope: Scope, then: Next) -> None:
        """Write a relation; ``then`` is written where it holds."""
        if node.operator == "=":
            self.linking = True
            self._unification(node.left, node.right, scope, then)
            self.linking = False
        elif node.operator == "=..":
            inner = dict(scope)
            left, right = self.build(node.left, inner), self.build(node.right, inner)
            with self.function.block(f"if univ({left}, {right}, trail):"):
                then(self.settled(scope, inner))
        else:
            inner = dict(scope)
            test = self._comparison(node, inner)
            with self.function.block(f"if {test}:"):
                then(inner)

    def _comparison(self, node: nodes.Relation, scope: Scope) -> str:
        left = self.function.assign(self.build(node.left, scope))
        right = self.function.assign(self.build(node.right, scope))
        operator = _COMPARISONS[node.operator]
        if node.operator in ("==", "\\==") and (is_plain_atom(node.left) or is_plain_atom(node.right)):
            # The same atom is nearly always the same object.
            test = f"({left} is {right} or same({left}, {right}))"
            return test if operator == "==" else f"(not {test})"
        if node.operator in ("==", "\\=="):
            slow = f"{'' if operator == '==' else 'not '}same({left}, {right})"
        else:
            slow = f"order({left}, {right}) {operator} 0"
        checks = [
            f"type({name}) is float"
            for name, part in ((left, node.left), (right, node.right))
            if not isinstance(part, nodes.Number)
        ]
        return f"({left} {operator} {right} if {' and '.join(checks) or 'True'} else {slow})"

    def _unification(self, left: nodes.Term, right: nodes.Term, scope: Scope, then: Next) -> None:
        if self._is_new(left, scope) and self._is_new(right, scope) and not (left.anonymous or right.anonymous):
            # Linked free variables are not == (rule 25): each has a cell of its own.
            inner = dict(scope)
            linked, other = self.build(left, inner), self.build(right, inner)
            if linked != other:
                self.function.emit(f"{linked}.ref = {other}")
            then(inner)
            return
        for new, node in ((left, right), (right, left)):
            if self._is_new(new, scope):
                inner = dict(scope)
                self.match(new, self.function.assign(self.build(node, inner)), inner, then)
                return
        if all(name in scope for name in variables(right)):
            value = self.function.assign(self.build(right, dict(scope)))
            self.match(left, value, scope, then)
            return
        inner = dict(scope)
        built = self.build(left, inner), self.build(right, inner)
        with self.function.block(f"if unify({built[0]}, {built[1]}, trail):"):
            then(self.settled(scope, inner))

    @staticmethod
    def _is_new(node: nodes.Term, scope: Scope) -> TypeGuard[nodes.Variable]:
        return is_plain_variable(node) and (node.anonymous or node.name not in scope)
