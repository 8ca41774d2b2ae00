"""Functions in a formula that is waited for: their values are taken before the wait begins, and stay.

``.wait(.count(b(_)) >= 3)`` waits for ever unless there are three already; ``.wait(.count(b(_), 3))`` counts each time.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from agentd.language import syntax
from agentd.language.compile_terms import Scope
from agentd.language.step_writer import StepWriter
from agentd.language.variables import HIDDEN, variables


class ComputedOnce:
    """Puts variables of the frame in place of the functions in a formula, and writes what computes these.

    ``scope`` has the variables that are known before; what else a function needs keeps it from being computed.
    """

    def __init__(self, writer: StepWriter, scope: Scope) -> None:
        self._writer, self._scope = writer, scope
        self._known = {name for name in scope if writer.bound.get(name)}
        self._count = 0

    def formula(self, node: Any) -> Any:
        """The formula with variables for functions."""
        match node:
            case syntax.And(left=left, right=right) | syntax.Or(left=left, right=right):
                return replace(node, left=self.formula(left), right=self.formula(right))
            case syntax.Not(operand=operand):
                return replace(node, operand=self.formula(operand))
            case syntax.Relation(left=left, right=right):
                return replace(node, left=self._term(left), right=self._term(right))
            case syntax.Structure(args=args):
                return replace(node, args=tuple(map(self._term, args)))
        return node

    def _term(self, node: Any) -> Any:
        match node:
            case syntax.InternalAction(name=name, args=args):
                return self._value(node, name, args)
            case syntax.Structure(functor=name, args=args):
                found = self._value(node, name, args)
                return found if found is not node else replace(node, args=tuple(map(self._term, args)))
            case syntax.Arithmetic(operands=operands):
                return replace(node, operands=tuple(map(self._term, operands)))
            case syntax.ListTerm(items=items):
                return replace(node, items=tuple(map(self._term, items)))
        return node

    def _value(self, node: Any, name: str, args: tuple[Any, ...]) -> Any:
        counts = name == ".count" and len(args) == 1
        if not counts and not self._writer.body.library.is_function(name, len(args)):
            return node
        if not counts and not all(variable in self._known for variable in variables(node)):
            return node
        variable = f"{HIDDEN}{self._count}"
        self._count += 1
        built = self._writer.compiler.build(node, dict(self._scope) if counts else self._scope)
        self._scope[variable] = self._writer.function.assign(built)
        # Frames are made with the places of the variables that the program names; this one may be beyond.
        self._writer.function.emit(f"f.extend([None] * ({self._writer.code.slot(variable)} + 1 - len(f)))")
        return syntax.Variable(variable, position=node.position)
