"""Generates the units that a mind loads: plans, bodies run by a variable, rules and queries.

Of a plan this is one function per formula of its body (`agentd.language.compiler.body`) and the function that selects
it for an event, its trigger and its context in one. There are three forms of that, each compiled only for minds that
need it:

- ``select`` returns a new frame, or None if the plan is not applicable: the plain form;
- ``trace`` returns a new frame, or why there is none: None if the trigger does not unify, else the number of the
  literal of the context that failed and the values that its variables had then (for decision records);
- ``options`` yields a frame for each way in which the plan is applicable, and at the end why there is no further one
  (for selection functions).

All three evaluate trigger and context once and in the same order, so that they decide the same.

Nothing here belongs to a mind: predicates, plans and steps are `Ref` constants, provided when a mind loads the unit.
"""

from __future__ import annotations

from typing import Final, Literal

from agentd.language.compiler.body import BodyCompiler
from agentd.language.compiler.code_writer import (
    FRAME_HEADER,
    Function,
    PlanCode,
    Ref,
    StepCode,
    Unit,
    targets_of,
    tuple_of,
)
from agentd.language.compiler.compile_terms import Library, Scope
from agentd.language.compiler.formulas import FormulaCompiler, conjuncts
from agentd.language.compiler.matching import Next
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.traversal import variables
from agentd.language.terms.terms import Term

Form = Literal["select", "trace", "options"]

_MOST_TRACED: Final = 8
"""Literals of a context that are nested in one function; those that follow go into a generator of their own."""

_EVENT: Final = "m, trail, relevant, args, annots"

STEPS = 2
"""Steps of work for which a rule that is asked counts (`agentd.mind.beliefs.work_limit`)."""


def compile_plan(
    plan: nodes.Plan,
    library: Library,
    values: dict[str, Term],
    outer: dict[str, int] | None = None,
    form: Form = "select",
) -> PlanCode:
    """Return the code of a plan. ``values`` are the variables that were bound when the plan was made as a term.

    ``form`` is that of the function that selects it.

    For a nested plan ``outer`` gives the places, in the frame of the plan around it, of the variables that it sees.
    """
    unit = Unit(f"plan at {plan.position}")
    code = PlanCode(unit, {})
    for name in variables((plan.trigger.literal, plan.context, plan.goal_condition, plan.body)):
        code.slot(name)
    for name in values:
        code.slot(name)
    for name in outer or {}:
        code.slot(name)
    bound = _Selector(form, plan, code, library).write(values, outer or {})
    code.bound = dict.fromkeys(bound, True)
    code.first = BodyCompiler(code, library).body(plan.body, dict(code.bound), None)
    if plan.goal_condition is not None:  # condition(m, trail, f): whether it holds in a frame of the plan
        function = Function(unit, "condition", "m, trail, f")
        places = {name: code.slot(name) for name in variables(plan.goal_condition) if code.bound.get(name)}
        scope = {name: function.assign(f"f[{place}]") for name, place in places.items()}
        _write_test(function, plan.goal_condition, scope, library)
    return code


def _write_test(function: Function, formula: nodes.Term, scope: Scope, library: Library) -> None:
    """Write a function that returns whether a formula has a solution."""
    compiler = FormulaCompiler(function.unit, function, library, "")
    compiler.formula(formula, scope, lambda _: function.emit("return True"))
    function.emit("return False")
    function.unit.add(function)


def compile_fragment(
    body: nodes.Body, library: Library, values: dict[str, Term], slots: dict[str, int], size: int
) -> PlanCode:
    """Return the code of a body held by a variable, to run in a frame of ``size`` places with these for variables."""
    code = PlanCode(Unit(f"body at {body.position}"), dict(slots), size=max(size, FRAME_HEADER))
    for name in variables(body):
        code.slot(name)
    code.steps.append(StepCode("", None))  # a placeholder for the step that follows in the frame
    code.first = BodyCompiler(code, library, values).body(body, dict.fromkeys(code.slots, False), 0)
    return code


def compile_rule(rule: nodes.Rule, mode: tuple[bool, ...], library: Library, values: dict[str, Term]) -> Unit:
    """Return a unit with the generator ``answers(m, trail, *args)``.

    Each answer is the tuple of the head's arguments; a mode one longer than the head asks for its annotations as well.
    ``values`` holds what variables of the rule were bound to when it was made at run time.
    """
    head = rule.head
    unit = Unit(f"rule {head.functor}/{len(head.args)} at {rule.position}")
    parameters = [f"a{i}" for i in range(len(head.args))]
    function = Function(unit, "answers", ", ".join(["m", "trail", *parameters]))
    compiler = FormulaCompiler(unit, function, library, "")
    compiler.nested = True
    scope: Scope = {name: unit.constant(value) for name, value in values.items()}
    annotated = len(mode) > len(head.args)
    function.emit(f"m.steps_left -= {STEPS}")
    function.emit("if m.steps_left < 0: too_much_work(m)")
    function.emit("mark = len(trail)")

    def answer(found: Scope) -> None:
        inner = dict(found)
        out = [
            parameter if given else compiler.build(arg, inner)
            for parameter, given, arg in zip(parameters, mode, head.args, strict=False)
        ]
        if annotated:
            out.append(compiler.annots(head.annotations, inner))
        answered = tuple_of(out) if out else "()"
        # Who asked frees what has been bound before asking for the next answer, also what this rule still needs.
        with function.block("if len(trail) > mark:"):
            function.emit(f"yield from bound_again(trail, mark, {answered})")
        with function.block("else:"):
            function.emit(f"yield {answered}")

    given = [(arg, name) for arg, name, known in zip(head.args, parameters, mode, strict=False) if known]
    compiler.asked = True

    def body(inner: Scope) -> None:
        compiler.asked = False
        compiler.formula(rule.body, inner, answer)

    compiler.match_all(given, scope, body)
    function.emit("undo(trail, mark)")
    function.emit("yield from ()")
    unit.add(function)
    return unit


def compile_formula(formula: nodes.Term, library: Library) -> Unit:
    """Return a unit with ``holds(m, trail)``: whether a formula over the beliefs has a solution."""
    unit = Unit("formula")
    _write_test(Function(unit, "holds", "m, trail"), formula, {}, library)
    return unit


class _Selector:
    """Writes the function that selects a plan, in one of its forms."""

    def __init__(self, form: Form, plan: nodes.Plan, code: PlanCode, library: Library) -> None:
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

    def write(self, values: dict[str, Term], outer: dict[str, int]) -> list[str]:
        """Write the function; returns the variables that its frames have values for."""
        function = self.function
        scope: Scope = {name: self.unit.constant(value) for name, value in values.items()}
        for name, place in outer.items():
            local = function.assign(f"around[{place}]")
            with function.block(f"if {local} is None:"):
                function.emit(f"{local} = Var({self.unit.constant(name)})")
            scope[name] = local
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
            pairs: list[tuple[nodes.Term, str]] = list(zip(literal.args, names, strict=True))
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
    """Return whether a literal that fails may have bound variables that its caller is to free."""
    match part:
        case nodes.Relation(operator=operator):
            return operator in ("=", "=..", "\\==")
        case nodes.Structure() | nodes.Not():
            return False
    return True
