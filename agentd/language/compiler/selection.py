"""Generates the function that selects a plan for an event: its trigger and its context in one.

There are three forms of it, each compiled only for minds that need it:

- ``select`` returns a new frame, or None if the plan is not applicable: the plain form;
- ``trace`` returns a new frame, or why there is none: None if the trigger does not unify, else the number of the
  literal of the context that failed and the values that its variables had then (for decision records);
- ``options`` yields a frame for each way in which the plan is applicable, and at the end why there is no further one
  (for selection functions).

All three evaluate trigger and context once and in the same order, so that they decide the same.
"""

from __future__ import annotations

from typing import Any, Final, Literal

from agentd.language.compiler.code_writer import Function, Ref, targets_of, tuple_of
from agentd.language.compiler.compile_terms import Scope
from agentd.language.compiler.formulas import FormulaCompiler, conjuncts
from agentd.language.compiler.matching import Next
from agentd.language.compiler.plan_code import FRAME_HEADER, PlanCode
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.traversal import variables

Form = Literal["select", "trace", "options"]

_MOST_TRACED: Final = 8
"""So many literals of a context are nested in one function; those that follow go into a generator of their own."""

_EVENT: Final = "m, trail, relevant, args, annots"


def compile_select(
    form: Form, plan: nodes.Plan, code: PlanCode, library: Any, values: dict[str, Any], outer: dict[str, int]
) -> list[str]:
    """Write one form of the function; returns the variables that its frames have values for."""
    writer = _Writer(form, plan, code, library)
    scope: Scope = {name: code.unit.constant(value) for name, value in values.items()}
    for name, place in outer.items():
        local = writer.function.assign(f"around[{place}]")
        with writer.function.block(f"if {local} is None:"):
            writer.function.emit(f"{local} = Var({code.unit.constant(name)})")
        scope[name] = local
    return writer.write(scope)


class _Writer:
    """Writes one function."""

    def __init__(self, form: Form, plan: nodes.Plan, code: PlanCode, library: Any) -> None:
        self.form, self.plan, self.code, self.library = form, plan, code, library
        self.unit = code.unit
        self.function = Function(code.unit, form, f"{_EVENT}, around=None")
        self.compiler = FormulaCompiler(code.unit, self.function, library, "")
        self.bound: list[str] = []
        self.parts = [] if plan.context is None else conjuncts(plan.context)
        self.noted = form != "select" and bool(self.parts)
        """Whether to note how far the context holds."""
        self.shared = len(self.parts) > _MOST_TRACED
        """Whether the note is a list shared by several functions, not two locals."""

    def write(self, scope: Scope) -> list[str]:
        function = self.function
        if self.noted:
            function.emit("w = [-1, ()]" if self.shared else "w = -1")
        if self.form == "options":
            function.emit("mark = len(trail)")
        self._trigger(scope)
        if self.form == "options":
            function.emit("undo(trail, mark)")
        verb = "yield" if self.form == "options" else "return"
        if not self.noted:
            function.emit(f"{verb} None")
        elif self.shared:
            function.emit(f"{verb} None if w[0] < 0 else tuple(w)")
        else:
            function.emit(f"{verb} None if w < 0 else (w, b)")
        self.unit.add(function)
        return self.bound

    def _trigger(self, scope: Scope) -> None:
        literal = self.plan.trigger.literal
        if isinstance(literal, nodes.Structure):
            names = [f"a{i}" for i in range(len(literal.args))]
            if names:
                self.function.emit(f"({', '.join(names)},) = args")
            pairs: list[tuple[Any, str]] = list(zip(literal.args, names, strict=True))
            if isinstance(literal.namespace, nodes.Variable):
                pairs.insert(0, (literal.namespace, self.function.assign("atom(relevant.sig.namespace)")))
            self.compiler.match_all(pairs, scope, self._annots)
            return
        whole = self.function.assign("Literal(relevant.sig, args, annots)")
        self.compiler.match(literal, whole, scope, self._context)

    def _annots(self, found: Scope) -> None:
        pattern = self.plan.trigger.literal.annotations
        if pattern is None or (not pattern.items and pattern.tail is None):
            self._context(found)
        else:
            self.compiler.match_annots(pattern, "annots", found, self._context)

    def _context(self, found: Scope) -> None:
        if self.plan.context is None:
            self._selected(found)
        elif self.noted:
            self.code.tried = [(part, ()) for part in self.parts]
            self._literal(0, found, self.compiler, self._selected)
        else:
            self.compiler.formula(self.plan.context, found, self._selected)

    def _selected(self, found: Scope) -> None:
        self.bound[:] = [name for name in self.code.slots if name in found]
        places = ["None"] * (self.code.size - FRAME_HEADER)
        for name in self.bound:
            places[self.code.slots[name] - FRAME_HEADER] = found[name]
        first = self.unit.constant(Ref("first", None))
        here = self.unit.constant(Ref("plan", None))
        frame = ", ".join([first, here, "relevant", "args", "annots", "0", *places])
        self.function.emit(f"yield [{frame}]" if self.form == "options" else f"return [{frame}]")
        # The size of a frame may still grow by hidden places of the body, which are appended when they are first used.

    def _literal(self, number: int, scope: Scope, compiler: FormulaCompiler, then: Next) -> None:
        """Write a literal of the context and those that follow it, each with its note."""
        if number == len(self.parts):
            then(scope)
        elif number and number % _MOST_TRACED == 0:
            self._apart(number, scope, compiler, then)
        else:
            self._noted_literal(number, scope, compiler, then)

    def _noted_literal(self, number: int, scope: Scope, compiler: FormulaCompiler, then: Next) -> None:
        """Write a literal, and after it what is noted when it has no (further) solution and nothing later failed.

        So a context that holds pays nothing for its notes.
        """
        part, function = self.parts[number], compiler.function
        names = tuple(name for name in variables(part) if name in scope)
        self.code.tried[number] = (part, names)
        mark = function.assign("len(trail)", "t") if names and _may_leave_bindings(part) else ""
        compiler.formula(part, scope, lambda inner: self._literal(number + 1, inner, compiler, then))
        held = tuple_of([f"{scope[n]} if type({scope[n]}) is float else held({scope[n]})" for n in names])
        with function.block(f"if {'w[0]' if self.shared else 'w'} < {number}:"):
            if mark:
                function.emit(f"if len(trail) > {mark}: undo(trail, {mark})")
            function.emit(f"{'w[:]' if self.shared else 'w, b'} = {number}, {held if names else '()'}")

    def _apart(self, number: int, scope: Scope, compiler: FormulaCompiler, then: Next) -> None:
        """Go on in a generator, which yields the values of the variables that the rest of the context binds."""
        rest = tuple(self.parts[number:])
        known = [name for name in variables(rest) if name in scope]
        new = [name for name in variables(rest) if name not in scope]
        parameters = [f"p{i}" for i in range(len(known))]
        name = self.unit.name("h")
        function = Function(self.unit, name, ", ".join(["m", "trail", "w", *parameters]))
        inner = FormulaCompiler(self.unit, function, self.library, "")
        function.emit("mark = len(trail)")

        def succeed(found: Scope) -> None:
            out = [inner.build(nodes.Variable(v), dict(found)) for v in new]
            function.emit(f"yield {tuple_of(out) if out else 'None'}")

        self._noted_literal(number, dict(zip(known, parameters, strict=True)), inner, succeed)
        function.emit("undo(trail, mark)")
        function.emit("yield from ()")
        self.unit.add(function)
        targets = [compiler.function.local() for _ in new]
        call = f"{name}({', '.join(['m', 'trail', 'w', *(scope[name] for name in known)])})"
        with compiler.function.block(f"for {targets_of(targets) if targets else '_'} in {call}:"):
            then({**scope, **dict(zip(new, targets, strict=True))})


def _may_leave_bindings(part: nodes.Term) -> bool:
    """Whether a literal that fails may have bound variables that its caller is to free."""
    match part:
        case nodes.Relation(operator=operator):
            return operator in ("=", "=..", "\\==")
        case nodes.Structure() | nodes.Not():
            return False
    return True
