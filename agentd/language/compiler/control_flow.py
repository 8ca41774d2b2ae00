"""Generates the Python of ``if``, ``while``, ``for`` and forks: they choose the step to come, ``f[0]``."""

from __future__ import annotations

from typing import Any

from agentd.language.compiler.code_writer import tuple_of
from agentd.language.compiler.compile_terms import Scope
from agentd.language.compiler.plan_code import StepCode
from agentd.language.compiler.steps import Bound, StepWriter
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.traversal import variables


def write_brackets(writer: StepWriter, body: nodes.Body) -> None:
    """Write ``(a; b)``: a step that goes on with those inside, which share the bindings of the plan."""
    first = writer.body.body(body, writer.bound, writer.code.steps[writer.number].next)
    writer.function.emit(f"f[0] = {writer.step(first)}")
    writer.finish()


def write_if(writer: StepWriter, formula: nodes.If) -> None:
    """Write the conditions as one function, and each block as steps that follow it."""
    following = writer.code.steps[writer.number].next
    before = dict(writer.bound)
    ends: list[Bound] = []
    targets: list[tuple[Any, list[int]]] = []
    for condition, block in formula.branches:
        scope = writer.use(condition)
        place: list[int] = []

        def chosen(found: Scope, place: list[int] = place) -> None:
            writer.store(found)
            place.append(writer.function.reserve())
            place.append(writer.function.indent)
            writer.function.emit("return None")

        writer.compiler.formula(condition, scope, chosen)
        targets.append((block, place))
    otherwise = writer.function.reserve()
    function, trail = writer.function, writer.trail_line
    function.emit("return None")
    for (block, place), (condition, _) in zip(targets, formula.branches, strict=True):
        bound = {**before, **{name: before.get(name, True) for name in variables(condition)}}
        bound.update((name, False) for name in variables(condition) if before.get(name) is not True)
        first = writer.body.body(block, bound, following)
        if place:
            function.fill(place[0], f"f[0] = {writer.step(first)}", place[1])
        ends.append(bound)
    bound = dict(before)
    first = following
    if formula.otherwise is not None:
        first = writer.body.body(formula.otherwise, bound, following)
    ends.append(bound)
    function.fill(otherwise, f"f[0] = {writer.step(first)}", 1)
    function.fill(trail, "trail = i.trail", 1)
    writer.unit.add(function)
    for name in {name: None for end in ends for name in end}:
        writer.bound[name] = all(end.get(name, False) for end in ends)


def write_while(writer: StepWriter, formula: nodes.While) -> None:
    """Write the condition as one function; the last step of the body comes back to it."""
    following = writer.code.steps[writer.number].next
    before = dict(writer.bound)
    kept = _begin_rounds(writer, formula, before)
    if kept:
        with writer.function.block("else:"):
            _free_again(writer, kept)
    _forget(writer, formula, before)
    scope = writer.use(formula.condition)
    place: list[int] = []

    def again(found: Scope) -> None:
        writer.store(found)
        place.append(writer.function.reserve())
        place.append(writer.function.indent)
        writer.function.emit("return None")

    writer.compiler.formula(formula.condition, scope, again)
    if kept:
        writer.function.emit(f"f[{kept}] = None")
    writer.function.emit(f"f[0] = {writer.step(following)}")
    function, trail = writer.function, writer.trail_line
    bound = {**before, **dict.fromkeys(variables(formula.condition), False)}
    bound.update({name: value for name, value in before.items() if value})
    first = writer.body.body(formula.body, bound, writer.number)
    if place:
        function.fill(place[0], f"f[0] = {writer.step(first)}", place[1])
    function.fill(trail, "trail = i.trail", 1)
    writer.unit.add(function)
    writer.bound.clear()
    writer.bound.update(before)


def write_for(writer: StepWriter, formula: nodes.For) -> None:
    """Write one function that finds all solutions and one that begins each round with the next of them."""
    following = writer.code.steps[writer.number].next
    before = dict(writer.bound)
    found_at = writer.code.hidden_slot()
    new = list(variables(formula.condition))
    kept = _begin_rounds(writer, formula, before, first=True)
    scope = writer.use(formula.condition)
    found = writer.function.assign("[]", "l")
    mark = writer.function.assign("len(trail)", "t")

    rows: list[str] = []
    writer.compiler.rows = rows
    opened = {name: _opened(writer, scope[name]) for name in new if name in before}

    def take(inner: Scope) -> None:
        parts = [_part(inner.get(name), opened.get(name)) for name in new]
        facts = f"present({tuple_of(rows)})" if rows else "()"
        writer.function.emit(f"{found}.append(({', '.join([*parts, facts])},))")

    writer.compiler.formula(formula.condition, scope, take)
    writer.compiler.rows = None
    writer.function.emit(f"undo(trail, {mark})")
    writer.function.emit(f"{found}.reverse()")
    next_round = writer.unit.name("n")
    writer.function.emit(f"while len(f) <= {found_at}: f.append(None)")
    writer.function.emit(f"f[{found_at}] = {found}")
    writer.function.emit(f"return {next_round}(m, i, f)")
    writer.finish()
    number = len(writer.code.steps)
    writer.code.steps.append(StepCode(next_round, formula, following))
    writer.start(next_round, writer.bound)
    function, trail = writer.function, writer.trail_line
    if kept:
        _free_again(writer, kept)
    _forget(writer, formula, before)
    function.emit(f"r = next_round(f[{found_at}])")
    with function.block("if r is None:"):
        function.emit(f"f[{found_at}] = None")
        function.emit(f"f[0] = {writer.step(following)}")
        function.emit("return None")
    fresh = [(k, name) for k, name in enumerate(new) if name not in before]
    known = [(k, name) for k, name in enumerate(new) if name in before]
    for k, name in fresh:
        function.emit(f"f[{writer.code.slot(name)}] = r[{k}]")
    for k, name in known:
        place = writer.code.slot(name)
        with function.block(f"if f[{place}] is not r[{k}] and not unify(f[{place}], r[{k}], trail):"):
            function.emit(f"f[{place}] = r[{k}]")
    bound = {**dict.fromkeys(new, False), **before}
    first = writer.body.body(formula.body, bound, number)
    function.emit(f"f[0] = {writer.step(first)}")
    function.fill(trail, "trail = i.trail", 1)
    writer.unit.add(function)
    writer.bound.clear()
    writer.bound.update(before)


def _opened(writer: StepWriter, local: str) -> str:
    """A local that says whether a variable from before the loop has no value, or one with free variables inside."""
    return writer.function.assign(f"type({local}) is not float and type({local}) is not str and not is_ground({local})")


def _part(local: str | None, opened: str | None) -> str:
    """The value of a variable in a solution; one that was known in full before the loop has its value already."""
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


def write_fork(writer: StepWriter, formula: nodes.Fork) -> None:
    """Write the function that starts the branches, each of which ends in the step ``join``."""
    before = dict(writer.bound)
    join = len(writer.code.steps)
    writer.code.steps.append(StepCode("join", formula, None))
    firsts = []
    for block in formula.branches:
        bound = dict(before)
        firsts.append(writer.body.body(block, bound, join))
        for name in bound:
            writer.bound.setdefault(name, False)
    steps = tuple_of([writer.step(first) for first in firsts])
    writer.function.emit(f"return fork(m, i, f, {writer.constant(formula.operator)}, {steps})")
    writer.finish()
