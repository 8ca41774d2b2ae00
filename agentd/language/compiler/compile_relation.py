"""Generates Python for relations: comparisons, ``=`` and ``=..``."""

from __future__ import annotations

from typing import Any

from agentd.language.compiler.compile_terms import Scope
from agentd.language.compiler.constants import is_plain_atom
from agentd.language.compiler.matching import MatchCompiler, Next
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.traversal import is_plain_variable, variables

_COMPARISONS = {"<": "<", "<=": "<=", ">": ">", ">=": ">=", "==": "==", "\\==": "!="}


class RelationCompiler(MatchCompiler):
    """Writes relations into one function, which has the local ``trail``."""

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

    def _unification(self, left: Any, right: Any, scope: Scope, then: Next) -> None:
        if self._is_new(left, scope) and self._is_new(right, scope) and not (left.anonymous or right.anonymous):
            # Linked free variables are not == (rule 25): each has a cell of its own.
            inner = dict(scope)
            linked, other = self.build(left, inner), self.build(right, inner)
            if linked != other:
                self.function.emit(f"{linked}.ref = {other}")
            then(inner)
            return
        if self._is_new(left, scope):
            inner = dict(scope)
            value = self.function.assign(self.build(right, inner))
            if left.anonymous:
                then(inner)
                return
            self.match(left, value, inner, then)
            return
        if self._is_new(right, scope):
            inner = dict(scope)
            value = self.function.assign(self.build(left, inner))
            self.match(right, value, inner, then)
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
    def _is_new(node: Any, scope: Scope) -> bool:
        return is_plain_variable(node) and (node.anonymous or node.name not in scope)
