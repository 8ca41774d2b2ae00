"""Writes the function of one formula of a body: its variables live in the frame, and are locals while it runs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agentd.language import syntax
from agentd.language.compile_formula import FormulaCompiler
from agentd.language.compile_terms import Scope
from agentd.language.constants import signature_of
from agentd.language.emit import Function, Ref, tuple_of
from agentd.language.variables import variables

if TYPE_CHECKING:
    from agentd.language.compile_body import BodyCompiler

Bound = dict[str, bool]
"""Which variables have a place filled in the frame: True for certain, False perhaps; not in it: certainly not."""


class StepWriter:
    """The function of one formula, ``number`` among the steps of ``body``; ``bound`` is changed as it is written."""

    def __init__(self, body: BodyCompiler, number: int, bound: Bound) -> None:
        self.body, self.code, self.bound, self.number = body, body.code, bound, number
        self.unit = body.unit
        self.name = f"s{number}"
        self.code.steps[number].function = self.name
        self.start(self.name, bound)

    def start(self, name: str, bound: Bound) -> None:
        """Begin a function of this step."""
        self.function = Function(self.unit, name, "m, i, f")
        self.trail_line = self.function.reserve()
        """The line for the local ``trail``, filled in when the function is finished."""
        self._certain: set[str] = set()
        self.compiler = FormulaCompiler(self.unit, self.function, self.body.library, "len(i.stack)")
        self.scope: Scope = {}
        self.bound = bound

    def use(self, node: Any) -> Scope:
        """Load the variables of a node into locals."""
        for name in variables(node):
            if name in self.scope:
                continue
            if name in self.bound:
                place = self.code.slot(name)
                local = self.function.assign(f"f[{place}]")
                self.scope[name] = local
                if not self.bound[name]:
                    with self.function.block(f"if {local} is None:"):
                        known = self.body.values.get(name)
                        if known is not None:
                            self.function.emit(f"{local} = f[{place}] = {self.unit.constant(known)}")
                        else:
                            fresh = f"Var({self.unit.constant(name)}, len(i.stack))"
                            self.function.emit(f"{local} = f[{place}] = {fresh}")
        return dict(self.scope)

    def store(self, scope: Scope) -> None:
        """Put variables that are new in ``scope`` into the frame."""
        for name, local in scope.items():
            if self.scope.get(name) != local:
                self.function.emit(f"f[{self.code.slot(name)}] = {local}")

    def became(self, scope: Scope, certain: bool = True) -> None:
        """Note the variables of ``scope`` as bound after this step."""
        for name in scope:
            self.bound[name] = certain or self.bound.get(name, False)

    def settle(self, term: Any) -> None:
        """After a formula that was written with `succeed`: what it surely binds is known to be bound."""
        for name in variables(term):
            self.bound[name] = name in self._certain or self.bound.get(name, False)

    def finish(self) -> None:
        """End the function and add it to the unit."""
        if self.function.uses("trail"):
            self.function.fill(self.trail_line, "trail = i.trail", 1)
        self.unit.add(self.function)

    def step(self, number: int | None) -> str:
        """An expression for a step by its number; None ends the body."""
        return "None" if number is None else self.unit.constant(Ref("step", number))

    def constant(self, value: Any) -> str:
        return self.unit.constant(value)

    def here(self) -> str:
        """An expression for the step that is being written."""
        return self.step(self.number)

    def succeed(self, found: Scope) -> None:
        """The formula holds, with the variables of ``found``."""
        self._certain.update(found)
        self.store(found)
        self.function.emit("return None")

    def succeed_settled(self, scope: Scope) -> None:
        """As `succeed`, after a call that may have bound variables."""
        self.succeed(self.compiler.settled(self.scope, scope))

    def built(self, term: Any) -> tuple[str, Scope]:
        """An expression for a term, and the scope with its new variables."""
        scope = self.use(term)
        return self.compiler.build(term, scope), scope

    def literal(self, term: syntax.Structure) -> tuple[str, str, Scope]:
        """Expressions for arguments and event annotations of a literal, and the scope with its new variables."""
        scope = self.use(term)
        args = tuple_of([self.compiler.build(arg, scope) for arg in term.args])
        return args, self.compiler.event_annots(term.annotations, scope), scope

    def dynamic(self, call: str, term: Any) -> None:
        """Leave a formula to the mind: ``call`` gets the built term."""
        built, scope = self.built(term)
        local = self.function.assign(built)
        self.store(scope)
        self.function.emit(f"return {call.format(local)}")
        self.became(scope)
        for name in self.bound:
            self.bound[name] = self.bound[name] and name not in scope

    def relevant(self, operator: str, goal: str, term: syntax.Structure) -> str:
        """An expression for the plans that a trigger makes relevant."""
        return self.constant(Ref("relevant", (operator, goal, signature_of(term))))
