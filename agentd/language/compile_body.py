"""Generates the Python of plan bodies: one function ``run(m, i, f)`` per formula, ``i`` the intention, ``f`` the frame.

A function returns a true value when the intention has to wait, and raises `Failed` when the formula fails. It may set
``f[0]``, the step to come, which is already the next one when it is called: that is how ``if`` and loops jump.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from agentd.language import syntax
from agentd.language.compile_formula import FormulaCompiler
from agentd.language.compile_terms import Scope
from agentd.language.emit import Function, Ref, tuple_of
from agentd.language.signatures import signature
from agentd.language.syntax import Operator
from agentd.language.variables import is_plain_variable, variables

if TYPE_CHECKING:
    from agentd.language.compile_plan import PlanCode

Bound = dict[str, bool]
"""Which variables have a place filled in the frame: True for certain, False perhaps; not in it: certainly not."""


class BodyCompiler:
    """Compiles the formulas of one plan in order, tracking which variables are bound where."""

    def __init__(self, code: PlanCode, library: Any) -> None:
        self.code, self.unit, self.library = code, code.unit, library
        self.values: dict[str, Any] = {}
        """Values of variables known when the body became a term; they fill free places before the first step."""

    def body(self, body: syntax.Body, bound: Bound, after: int | None) -> int | None:
        """Compile a body; ``bound`` is updated to what holds at its end. Returns its first step, ``after`` if empty."""
        from agentd.language.compile_plan import StepCode

        if not body.formulas:
            return after
        numbers = []
        for formula in body.formulas:
            numbers.append(len(self.code.steps))
            self.code.steps.append(StepCode("", formula))
        for number, following in zip(numbers, [*numbers[1:], after], strict=False):  # an empty body has no step
            self.code.steps[number].next = following
        for number, formula in zip(numbers, map(_as_statement, body.formulas), strict=True):
            writer = _StepWriter(self, number, bound)
            writer.write(formula)
        return numbers[0]


class _StepWriter:
    """Writes the function of one formula."""

    def __init__(self, body: BodyCompiler, number: int, bound: Bound) -> None:
        self.body, self.code, self.bound, self.number = body, body.code, bound, number
        self.unit = body.unit
        self.name = f"s{number}"
        self.code.steps[number].function = self.name
        self.start(self.name, bound)

    def start(self, name: str, bound: Bound) -> None:
        """Begin a function of this step."""
        self.function = Function(self.unit, name, "m, i, f")
        self._trail = self.function.reserve()
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
        """After a formula that was written with `_succeed`: what it surely binds is known to be bound."""
        for name in variables(term):
            self.bound[name] = name in self._certain or self.bound.get(name, False)

    def finish(self) -> None:
        self.function.fill(self._trail, "trail = i.trail", 1)
        self.unit.add(self.function)

    def step(self, number: int | None) -> str:
        return "None" if number is None else self.unit.constant(Ref("step", number))

    def constant(self, value: Any) -> str:
        return self.unit.constant(value)

    def here(self) -> str:
        return self.step(self.number)

    # --- formulas ---

    def write(self, formula: syntax.BodyFormula) -> None:
        match formula:
            case syntax.Step():
                self._step(formula)
                self.finish()
            case syntax.If():
                self._if(formula)
            case syntax.While():
                self._while(formula)
            case syntax.For():
                self._for(formula)
            case syntax.Fork():
                self._fork(formula)

    def _step(self, formula: syntax.Step) -> None:
        operator, term = formula.operator, formula.term
        match operator:
            case Operator.ACTION:
                self._action(term)
            case Operator.ACHIEVE | Operator.ACHIEVE_NEW_FOCUS:
                self._achieve(term, operator is Operator.ACHIEVE_NEW_FOCUS)
            case Operator.TEST:
                self._test(term)
            case _:
                self._change(operator, term)

    def _built(self, term: Any) -> tuple[str, Scope]:
        scope = self.use(term)
        return self.compiler.build(term, scope), scope

    def _literal(self, term: syntax.Structure) -> tuple[str, str, Scope]:
        """Expressions for arguments and event annotations of a literal, and the scope with its new variables."""
        scope = self.use(term)
        args = tuple_of([self.compiler.build(arg, scope) for arg in term.args])
        return args, self.compiler.event_annots(term.annotations, scope), scope

    def _dynamic(self, call: str, term: Any) -> None:
        """Leave a formula to the mind: ``call`` gets the built term."""
        built, scope = self._built(term)
        local = self.function.assign(built)
        self.store(scope)
        self.function.emit(f"return {call.format(local)}")
        self.became(scope)
        for name in self.bound:
            self.bound[name] = self.bound[name] and name not in scope

    def _achieve(self, term: Any, new_focus: bool) -> None:
        if not isinstance(term, syntax.Structure) or isinstance(term.namespace, syntax.Variable):
            self._dynamic(f"achieve_term(m, i, {{}}, {new_focus})", term)
            return
        args, annots, scope = self._literal(term)
        relevant = self._relevant("+", "!", term)
        if new_focus:
            if self.body.library.has_meta:
                self.function.emit(f"pending(m, {relevant}, {args}, {annots})")
            self.function.emit(f"m.post({relevant}, detach({args}), {annots})")
        else:
            self.store(scope)
            if self.body.library.has_meta:
                self.function.emit(f"pending(m, {relevant}, {args}, {annots})")
            self.function.emit(f"m.events.append(({relevant}, {args}, {annots}, i))")
            self.function.emit("return True")
            self.became(scope)

    def _relevant(self, operator: str, goal: str, term: syntax.Structure) -> str:
        from agentd.language.constants import signature_of

        return self.constant(Ref("relevant", (operator, goal, signature_of(term))))

    def _test(self, term: Any) -> None:
        scope = self.use(term)
        self.compiler.formula(term, scope, self._succeed)
        if isinstance(term, syntax.Structure) and not isinstance(term.namespace, syntax.Variable):
            after = dict(scope)
            args = tuple_of([self.compiler.build(arg, after) for arg in term.args])
            annots = self.compiler.event_annots(term.annotations, after)
            relevant = self._relevant("+", "?", term)
            self.function.emit(f"r = test_event(m, i, {relevant}, {args}, {annots})")
            self.store(after)
            self.function.emit("return r")
        elif isinstance(term, syntax.Variable):
            built = self.compiler.build(term, dict(scope))
            self.function.emit(f"return test_term(m, i, {built})")
        else:
            self.function.emit("test_failed(m, i)")
        self.settle(term)

    def _succeed(self, found: Scope) -> None:
        self._certain.update(found)
        self.store(found)
        self.function.emit("return None")

    def _action(self, term: Any) -> None:
        match term:
            case syntax.InternalAction():
                self._internal(term)
            case syntax.Structure() if not isinstance(term.namespace, syntax.Variable):
                self._external(term)
            case syntax.Relation():
                scope = self.use(term)
                self.compiler.formula(term, scope, self._succeed)
                self.function.emit("constraint_failed()")
                self.settle(term)
            case syntax.Variable():
                self._dynamic(f"run_term(m, i, f, {self.here()}, {{}})", term)
            case syntax.And() | syntax.Or():
                scope = self.use(term)
                self.compiler.formula(term, scope, self._succeed)
                self.function.emit("constraint_failed()")
                self.settle(term)
            case _:
                self._dynamic(f"run_term(m, i, f, {self.here()}, {{}})", term)

    def _external(self, term: syntax.Structure) -> None:
        scope = self.use(term)
        built = self.function.assign(self.compiler.build(term, scope))
        self.store(scope)
        self.function.emit(f"return perform(m, i, {built})")
        self.became(scope)

    def _internal(self, term: syntax.InternalAction) -> None:
        from agentd.language.compile_queries import QUERIES, is_query

        name, arity = term.name, len(term.args)
        if name == ".wait" and arity <= 3 and arity and _is_condition(term.args[0]):
            self._wait(term)
            return
        scope = self.use(term)
        query = QUERIES.get((name, arity))
        action = self.body.library.action(name, arity)
        if query is not None and is_query(term.args[min(1, arity - 2)], scope):
            self.compiler.formula(term, scope, self._succeed)
            self.function.emit("action_said_no()")
            self.settle(term)
            return
        if action is None:
            self.body.library.unknown_action(term)
            sig = self.constant(signature(name, arity))
            args = tuple_of([self.compiler.build(arg, scope) for arg in term.args])
            self.store(scope)
            self.function.emit(f"return perform(m, i, Literal({sig}, {args}))")
            self.became(scope)
            return
        args = "".join(f", {self.function.assign(self.compiler.build(arg, scope))}" for arg in term.args)
        function = self.constant(action.function)
        if action.suspends:
            self.store(scope)
            self.function.emit(f"return {function}(m, trail{args})")
        elif action.backtracks:
            with self.function.block(f"for _ in {function}(m, trail{args}):"):
                self._settle_and_return(scope)
            self.function.emit("action_said_no()")
        else:
            with self.function.block(f"if {function}(m, trail{args}):"):
                self._settle_and_return(scope)
            self.function.emit("action_said_no()")
        self.became(scope)

    def _settle_and_return(self, scope: Scope) -> None:
        self._succeed(self.compiler.settled(self.scope, scope))

    def _change(self, operator: Operator, term: Any) -> None:
        """Belief changes."""
        if not isinstance(term, syntax.Structure) or isinstance(term.namespace, syntax.Variable):
            self._dynamic(f"change_term(m, i, {self.constant(operator.value)}, {{}})", term)
            return
        from agentd.language.constants import signature_of

        args, annots, scope = self._literal(term)
        predicate = self.constant(Ref("predicate", signature_of(term)))
        focus = "None" if operator in (Operator.ADD_NEW_FOCUS, Operator.DELETE_NEW_FOCUS) else "i"
        match operator:
            case Operator.ADD | Operator.ADD_FIRST | Operator.ADD_NEW_FOCUS:
                plans = self._relevant("+", "", term)
                call = f"believe(m, {focus}, {predicate}, {plans}, {self._resolved(term, scope)}, {annots})"
            case Operator.ADD_LAST:
                plans = self._relevant("+", "", term)
                call = f"believe(m, {focus}, {predicate}, {plans}, {self._resolved(term, scope)}, {annots}, True)"
            case Operator.DELETE | Operator.DELETE_NEW_FOCUS:
                plans = self._relevant("-", "", term)
                call = f"disbelieve(m, {focus}, {predicate}, {plans}, {args}, {annots}, trail)"
            case _:
                plans, gone = self._relevant("+", "", term), self._relevant("-", "", term)
                resolved = self._resolved(term, scope)
                call = f"replace(m, {focus}, {predicate}, {plans}, {gone}, {resolved}, {annots})"
        self.store(scope)
        self.function.emit(f"return {call}")
        self.became(scope)

    def _resolved(self, term: syntax.Structure, scope: Scope) -> str:
        """The arguments of a belief to be added, without bound variables."""
        parts = []
        for arg in term.args:
            built = self.function.assign(self.compiler.build(arg, scope))
            if isinstance(arg, syntax.Number | syntax.String) or (
                isinstance(arg, syntax.Structure) and not arg.args and arg.annotations is None
            ):
                parts.append(built)
            else:
                parts.append(f"{built} if type({built}) is float else resolve({built})")
        return tuple_of(parts)

    # --- waiting and control ---

    def _wait(self, term: syntax.InternalAction) -> None:
        """``.wait(Formula[, Ms[, Elapsed]])``: the formula becomes a function that the mind asks after each change."""
        scope = self.use(term)
        others = "".join(f", {self.function.assign(self.compiler.build(arg, scope))}" for arg in term.args[1:])
        self.store(scope)
        check = self.unit.name("w")
        self.function.emit(f"return wait_until(m, i, f, {check}{others})")
        self.became(scope)
        self.finish()
        self.start(check, self.bound)
        inner = self.use(term.args[0])

        def holds(found: Scope) -> None:
            self.store(found)
            self.function.emit("return True")

        self.compiler.formula(term.args[0], inner, holds)
        self.function.emit("return False")
        self.became(dict.fromkeys(variables(term.args[0]), ""), certain=False)

    def _if(self, formula: syntax.If) -> None:
        following = self.code.steps[self.number].next
        before = dict(self.bound)
        ends: list[Bound] = []
        targets: list[tuple[Any, list[int]]] = []
        for condition, block in formula.branches:
            scope = self.use(condition)
            place: list[int] = []

            def chosen(found: Scope, place: list[int] = place) -> None:
                self.store(found)
                place.append(self.function.reserve())
                place.append(self.function.indent)
                self.function.emit("return None")

            self.compiler.formula(condition, scope, chosen)
            targets.append((block, place))
        otherwise = self.function.reserve()
        function, trail = self.function, self._trail
        function.emit("return None")
        for (block, place), (condition, _) in zip(targets, formula.branches, strict=True):
            bound = {**before, **{name: before.get(name, True) for name in variables(condition)}}
            bound.update((name, False) for name in variables(condition) if before.get(name) is not True)
            first = self.body.body(block, bound, following)
            if place:
                function.fill(place[0], f"f[0] = {self.step(first)}", place[1])
            ends.append(bound)
        bound = dict(before)
        first = following
        if formula.otherwise is not None:
            first = self.body.body(formula.otherwise, bound, following)
        ends.append(bound)
        function.fill(otherwise, f"f[0] = {self.step(first)}", 1)
        function.fill(trail, "trail = i.trail", 1)
        self.unit.add(function)
        for name in {name: None for end in ends for name in end}:
            self.bound[name] = all(end.get(name, False) for end in ends)

    def _while(self, formula: syntax.While) -> None:
        following = self.code.steps[self.number].next
        before = dict(self.bound)
        self._forget(formula, before)
        scope = self.use(formula.condition)
        place: list[int] = []

        def again(found: Scope) -> None:
            self.store(found)
            place.append(self.function.reserve())
            place.append(self.function.indent)
            self.function.emit("return None")

        self.compiler.formula(formula.condition, scope, again)
        self.function.emit(f"f[0] = {self.step(following)}")
        function, trail = self.function, self._trail
        bound = {**before, **dict.fromkeys(variables(formula.condition), False)}
        bound.update({name: value for name, value in before.items() if value})
        first = self.body.body(formula.body, bound, self.number)
        if place:
            function.fill(place[0], f"f[0] = {self.step(first)}", place[1])
        function.fill(trail, "trail = i.trail", 1)
        self.unit.add(function)
        self.bound.clear()
        self.bound.update(before)

    def _forget(self, formula: syntax.While | syntax.For, before: Bound) -> None:
        """Free the variables that only the loop uses, for each round and after it (rule 76)."""
        for name in variables((formula.condition, formula.body)):
            if name not in before:
                self.function.emit(f"f[{self.code.slot(name)}] = None")

    def _for(self, formula: syntax.For) -> None:
        following = self.code.steps[self.number].next
        before = dict(self.bound)
        found_at = self.code.hidden_slot()
        new = [name for name in variables(formula.condition) if not before.get(name, False)]
        scope = self.use(formula.condition)
        found = self.function.assign("[]", "l")
        mark = self.function.assign("len(trail)", "t")

        rows: list[str] = []
        self.compiler.rows = rows

        def take(inner: Scope) -> None:
            parts = [f"resolve({inner[name]})" if name in inner else "None" for name in new]
            facts = f"present({tuple_of(rows)})" if rows else "()"
            self.function.emit(f"{found}.append(({', '.join([*parts, facts])},))")

        self.compiler.formula(formula.condition, scope, take)
        self.compiler.rows = None
        self.function.emit(f"undo(trail, {mark})")
        self.function.emit(f"{found}.reverse()")
        next_round = self.unit.name("n")
        self.function.emit(f"while len(f) <= {found_at}: f.append(None)")
        self.function.emit(f"f[{found_at}] = {found}")
        self.function.emit(f"return {next_round}(m, i, f)")
        self.finish()
        from agentd.language.compile_plan import StepCode

        number = len(self.code.steps)
        self.code.steps.append(StepCode(next_round, formula, following))
        self.start(next_round, self.bound)
        function, trail = self.function, self._trail
        self._forget(formula, before)
        function.emit(f"r = next_round(f[{found_at}])")
        with function.block("if r is None:"):
            function.emit(f"f[{found_at}] = None")
            function.emit(f"f[0] = {self.step(following)}")
            function.emit("return None")
        fresh = [(k, name) for k, name in enumerate(new) if name not in before]
        known = [(k, name) for k, name in enumerate(new) if name in before]
        for k, name in fresh:
            function.emit(f"f[{self.code.slot(name)}] = r[{k}]")
        for k, name in known:
            place = self.code.slot(name)
            with function.block(f"if type(f[{place}]) is not Var or not unify(f[{place}], r[{k}], trail):"):
                function.emit(f"f[{place}] = r[{k}]")
        bound = {**before, **dict.fromkeys(new, False)}
        first = self.body.body(formula.body, bound, number)
        function.emit(f"f[0] = {self.step(first)}")
        function.fill(trail, "trail = i.trail", 1)
        self.unit.add(function)
        self.bound.clear()
        self.bound.update(before)

    def _fork(self, formula: syntax.Fork) -> None:
        before = dict(self.bound)
        from agentd.language.compile_plan import StepCode

        join = len(self.code.steps)
        self.code.steps.append(StepCode("join", formula, None))
        firsts = []
        for block in formula.branches:
            bound = dict(before)
            firsts.append(self.body.body(block, bound, join))
            for name in bound:
                self.bound.setdefault(name, False)
        steps = tuple_of([self.step(first) for first in firsts])
        self.function.emit(f"return fork(m, i, f, {self.constant(formula.operator)}, {steps})")
        self.finish()


def _as_statement(formula: syntax.BodyFormula) -> syntax.BodyFormula:
    """``.foreach``, ``.loop``, ``.if_then_else`` and ``.fork`` are the statements that they stand for."""
    match formula:
        case syntax.Step(operator=Operator.ACTION, term=syntax.InternalAction(name=name, args=args)):
            return _statement(name, args, formula)
    return formula


def _statement(name: str, args: Any, formula: syntax.BodyFormula) -> syntax.BodyFormula:
    place = formula.position
    match name, args:
        case (".foreach", (condition, body)):
            return syntax.For(condition, _as_body(body), place)
        case (".loop", (condition, body)):
            return syntax.While(condition, _as_body(body), place)
        case (".if_then_else", (condition, body)):
            return syntax.If(((condition, _as_body(body)),), None, place)
        case (".if_then_else", (condition, body, otherwise)):
            return syntax.If(((condition, _as_body(body)),), _as_body(otherwise), place)
        case (".fork", (syntax.Structure(functor=kind), *branches)) if branches:
            operator = "|&|" if kind == "and" else "|||"
            return syntax.Fork(operator, tuple(map(_as_body, branches)), place)
    return formula


def _as_body(term: Any) -> syntax.Body:
    """The body that an argument in braces is; a variable is run when it has one."""
    match term:
        case syntax.BodyTerm(body=body):
            return body
        case syntax.TriggerTerm(trigger=trigger):
            return syntax.Body((syntax.Step(Operator(trigger.operator), trigger.literal, term.position),))
    return syntax.Body((syntax.Step(Operator.ACTION, term, term.position),))


def _is_condition(node: Any) -> bool:
    """Whether the first argument of ``.wait`` is a formula (not a time, an event or a variable)."""
    return isinstance(
        node, syntax.Structure | syntax.Relation | syntax.And | syntax.Or | syntax.Not | syntax.InternalAction
    ) and not is_plain_variable(node)
