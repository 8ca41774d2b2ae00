"""Generates the Python of plan bodies: one function ``run(m, i, f)`` per formula, ``i`` the intention, ``f`` the frame.

A function returns a true value when the intention has to wait, and raises `Failed` when the formula fails. It may set
``f[0]``, the next step, which already points behind the formula when the function is called: that is how ``if``,
loops and forks jump.
"""

from __future__ import annotations

from typing import Any

from agentd.language.compiler.code_writer import Line, PlanCode, StepCode, tuple_of
from agentd.language.compiler.compile_terms import Library, Scope
from agentd.language.compiler.steps import Bound, StepWriter, write_step
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.nodes import Operator
from agentd.language.syntax_tree.traversal import variables
from agentd.language.terms.terms import Term


class BodyCompiler:
    """Compiles the formulas of one plan in order, tracking which variables are bound where.

    ``values`` are those of variables known when the body became a term; they fill free places before the first step.
    """

    def __init__(self, code: PlanCode, library: Library, values: dict[str, Term] | None = None) -> None:
        self._code, self._library, self._values = code, library, values or {}

    def body(self, body: nodes.Body, bound: Bound, after: int | None) -> int | None:
        """Compile a body; ``bound`` is updated to what holds at its end. Returns its first step, ``after`` if empty."""
        steps = self._code.steps
        formulas = _without_leading_true(body.formulas)
        if not formulas:
            return after
        numbers = range(len(steps), len(steps) + len(formulas))
        for formula, following in zip(formulas, [*numbers[1:], after], strict=True):
            steps.append(StepCode("", formula, following))
        for number, formula in zip(numbers, map(_as_statement, formulas), strict=True):
            self._write(StepWriter(self._code, self._library, self._values, number, bound), formula)
        return numbers[0]

    def _write(self, writer: StepWriter, formula: nodes.BodyFormula) -> None:
        match formula:
            case nodes.Step(operator=Operator.ACTION, term=nodes.BodyTerm(body=body)):
                # ``(a; b)``: a step that goes on with those inside, which share the bindings of the plan.
                first = self.body(body, writer.bound, writer.following)
                writer.function.emit(f"f[0] = {writer.step(first)}")
                writer.finish()
            case nodes.Step():
                write_step(writer, formula)
                writer.finish()
            case nodes.If():
                self._if(writer, formula)
            case nodes.While():
                self._while(writer, formula)
            case nodes.For():
                self._for(writer, formula)
            case nodes.Fork():
                self._fork(writer, formula)

    def _if(self, writer: StepWriter, formula: nodes.If) -> None:
        """Write the conditions as one function, and each block as steps that follow it."""
        function, before = writer.function, dict(writer.bound)
        ends: list[Bound] = []
        places = [_jump_where(writer, condition) for condition, _ in formula.branches]
        otherwise = function.reserve()
        function.emit("return None")
        for place, (condition, block) in zip(places, formula.branches, strict=True):
            bound = {**before, **{name: before.get(name, True) for name in variables(condition)}}
            bound.update((name, False) for name in variables(condition) if before.get(name) is not True)
            first = self.body(block, bound, writer.following)
            writer.fill_jumps(place, first)
            ends.append(bound)
        bound = dict(before)
        first = writer.following
        if formula.otherwise is not None:
            first = self.body(formula.otherwise, bound, writer.following)
        ends.append(bound)
        writer.fill_jumps([otherwise], first)
        writer.load_trail()
        writer.finish()
        for name in {name: None for end in ends for name in end}:
            writer.bound[name] = all(end.get(name, False) for end in ends)

    def _while(self, writer: StepWriter, formula: nodes.While) -> None:
        """Write the condition as one function; the last step of the body leads back to it."""
        function, before = writer.function, dict(writer.bound)
        kept = _begin_rounds(writer, formula, before)
        if kept:
            with function.block("else:"):
                _free_again(writer, kept)
        _forget(writer, formula, before)
        place = _jump_where(writer, formula.condition)
        if kept:
            function.emit(f"f[{kept}] = None")
        function.emit(f"f[0] = {writer.step(writer.following)}")
        bound = {**before, **dict.fromkeys(variables(formula.condition), False)}
        bound.update({name: value for name, value in before.items() if value})
        first = self.body(formula.body, bound, writer.number)
        writer.fill_jumps(place, first)
        writer.load_trail()
        writer.finish()
        writer.bound.clear()
        writer.bound.update(before)

    def _for(self, writer: StepWriter, formula: nodes.For) -> None:
        """Write one function that finds all solutions and one that begins each round with the next of them."""
        code, following = writer.code, writer.following
        before = dict(writer.bound)
        found_at = code.hidden_slot()
        new = list(variables(formula.condition))
        kept = _begin_rounds(writer, formula, before, first=True)
        scope = writer.use(formula.condition)
        function = writer.function
        found = function.assign("[]", "l")
        mark = function.assign("len(trail)", "t")

        rows: list[str] = []
        writer.compiler.rows = rows
        opened = {name: _opened(writer, scope[name]) for name in new if name in before}

        def take(inner: Scope) -> None:
            parts = [_part(inner.get(name), opened.get(name)) for name in new]
            facts = f"present({tuple_of(rows)})" if rows else "()"
            function.emit(f"{found}.append(({', '.join([*parts, facts])},))")

        writer.compiler.formula(formula.condition, scope, take)
        writer.compiler.rows = None
        function.emit(f"undo(trail, {mark})")
        function.emit(f"{found}.reverse()")
        next_round = writer.unit.name("n")
        function.emit(f"while len(f) <= {found_at}: f.append(None)")
        function.emit(f"f[{found_at}] = {found}")
        function.emit(f"return {next_round}(m, i, f)")
        writer.finish()
        number = len(code.steps)
        code.steps.append(StepCode(next_round, formula, following))
        writer.start(next_round, writer.bound)
        function = writer.function
        if kept:
            _free_again(writer, kept)
        _forget(writer, formula, before)
        function.emit(f"r = next_round(f[{found_at}])")
        with function.block("if r is None:"):
            function.emit(f"f[{found_at}] = None")
            function.emit(f"f[0] = {writer.step(following)}")
            function.emit("return None")
        for k, name in enumerate(new):
            if name not in before:
                function.emit(f"f[{code.slot(name)}] = r[{k}]")
        for k, name in enumerate(new):
            if name in before:
                place = code.slot(name)
                with function.block(f"if f[{place}] is not r[{k}] and not unify(f[{place}], r[{k}], trail):"):
                    function.emit(f"f[{place}] = r[{k}]")
        first = self.body(formula.body, {**dict.fromkeys(new, False), **before}, number)
        function.emit(f"f[0] = {writer.step(first)}")
        writer.load_trail()
        writer.finish()
        writer.bound.clear()
        writer.bound.update(before)

    def _fork(self, writer: StepWriter, formula: nodes.Fork) -> None:
        """Write the function that starts the branches, each of which ends in the step ``join``."""
        before = dict(writer.bound)
        join = len(writer.code.steps)
        writer.code.steps.append(StepCode("join", formula))
        firsts = []
        for block in formula.branches:
            bound = dict(before)
            firsts.append(self.body(block, bound, join))
            for name in bound:
                writer.bound.setdefault(name, False)
        steps = tuple_of([writer.step(first) for first in firsts])
        writer.function.emit(f"return fork(m, i, f, {writer.constant(formula.operator)}, {steps})")
        writer.finish()


def _without_leading_true(formulas: tuple[nodes.BodyFormula, ...]) -> tuple[nodes.BodyFormula, ...]:
    """``true`` at the very start of a body or block does nothing (rule 64)."""
    match formulas:
        case (nodes.Step(operator=Operator.ACTION, term=nodes.Structure(functor="true", args=())), *_):
            return formulas[1:]
    return formulas


def _as_statement(formula: nodes.BodyFormula) -> nodes.BodyFormula:
    """Return the statement for ``.foreach``, ``.loop``, ``.if_then_else`` or ``.fork``; any other formula as it is."""
    match formula:
        case nodes.Step(operator=Operator.ACTION, term=nodes.InternalAction() as call):
            position = formula.position
        case _:
            return formula
    args: tuple[Any, ...] = call.args  # a condition that is no formula fails when it is asked
    match call.name, args:
        case (".foreach", (condition, body)):
            return nodes.For(condition, _as_body(body), position)
        case (".loop", (condition, body)):
            return nodes.While(condition, _as_body(body), position)
        case (".if_then_else", (condition, body)):
            return nodes.If(((condition, _as_body(body)),), None, position)
        case (".if_then_else", (condition, body, otherwise)):
            return nodes.If(((condition, _as_body(body)),), _as_body(otherwise), position)
        case (".fork", (nodes.Structure(functor=kind), *branches)) if branches:
            operator = "|&|" if kind == "and" else "|||"
            return nodes.Fork(operator, tuple(map(_as_body, branches)), position)
    return formula


def _as_body(term: nodes.Term) -> nodes.Body:
    """Return the body that an argument in braces is; a variable is run when it has one."""
    match term:
        case nodes.BodyTerm(body=body):
            return body
        case nodes.TriggerTerm(trigger=trigger):
            return nodes.Body((nodes.Step(Operator(trigger.operator), trigger.literal, term.position),))
    return nodes.Body((nodes.Step(Operator.ACTION, term, term.position),))


def _jump_where(writer: StepWriter, condition: nodes.Formula) -> list[Line]:
    """Write a condition. Returns the line, if one is reached, that is to set the next step where it holds."""
    places: list[Line] = []

    def jump(found: Scope) -> None:
        writer.store(found)
        places.append(writer.function.reserve())
        writer.function.emit("return None")

    writer.compiler.formula(condition, writer.use(condition), jump)
    return places


def _opened(writer: StepWriter, local: str) -> str:
    """Return a local that is true if a variable from before the loop has no value or one with free variables."""
    return writer.function.assign(f"type({local}) is not float and type({local}) is not str and not is_ground({local})")


def _part(local: str | None, opened: str | None) -> str:
    """Return the value of a variable in a solution; one known in full before the loop has its value already."""
    if local is None:
        return "None"
    return f"resolve({local})" if opened is None else f"(resolve({local}) if {opened} else {local})"


def _begin_rounds(writer: StepWriter, formula: nodes.While | nodes.For, before: Bound, first: bool = False) -> int:
    """Note what the loop must free again: variables from before it that it may bind (rule 76).

    Returns the hidden place of the note, 0 when the loop uses no variable from before it. ``first`` says that the
    function runs once per loop, not once per round.
    """
    names = [name for name in variables((formula.condition, formula.body)) if name in before]
    if not names:
        return 0
    kept = writer.code.hidden_slot()
    function = writer.function
    function.emit(f"while len(f) <= {kept}: f.append(None)")
    places = tuple_of([str(writer.code.slot(name)) for name in names])
    note = f"f[{kept}] = begin_rounds(trail, f, {places})"
    if first:
        function.emit(note)
    else:
        with function.block(f"if f[{kept}] is None:"):
            function.emit(note)
    return kept


def _free_again(writer: StepWriter, kept: int) -> None:
    """Take back what a round has bound; most often that is nothing."""
    writer.function.emit(f"k = f[{kept}]")
    writer.function.emit("if k[1] or len(trail) > k[0]: free_again(trail, f, k)")


def _forget(writer: StepWriter, formula: nodes.While | nodes.For, before: Bound) -> None:
    """Free the variables that only the loop uses, for each round and after it (rule 76)."""
    for name in variables((formula.condition, formula.body)):
        if name not in before:
            writer.function.emit(f"f[{writer.code.slot(name)}] = None")
