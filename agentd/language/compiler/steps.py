"""Generates the Python of single formulas: actions, goals, tests, belief changes and ``.wait`` for a formula.

The function of a formula has the variables of its plan in the frame, and as locals while it runs.
"""

from __future__ import annotations

from contextlib import nullcontext
from typing import Any

from msgspec.structs import replace

from agentd.language.compiler.code_writer import Function, Line, PlanCode, Ref, tuple_of
from agentd.language.compiler.compile_terms import Library, Scope
from agentd.language.compiler.constants import is_plain_atom, signature_of
from agentd.language.compiler.formulas import QUERIES, FormulaCompiler, is_query
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.nodes import Operator
from agentd.language.syntax_tree.signatures import signature
from agentd.language.syntax_tree.traversal import HIDDEN, parts, variables, with_parts
from agentd.language.terms.terms import Term

Bound = dict[str, bool]
"""Which variables have a place filled in the frame: True for certain, False perhaps; not in it: certainly not."""


class StepWriter:
    """The function of one formula, ``number`` among the steps of ``code``; ``bound`` is changed as it is written."""

    def __init__(self, code: PlanCode, library: Library, values: dict[str, Term], number: int, bound: Bound) -> None:
        self.code, self.library, self._values, self.number = code, library, values, number
        self.unit = code.unit
        code.steps[number].function = f"s{number}"
        self.start(f"s{number}", bound)

    @property
    def following(self) -> int | None:
        """The step after this one."""
        return self.code.steps[self.number].next

    def start(self, name: str, bound: Bound) -> None:
        """Begin a function of this step."""
        self.function = Function(self.unit, name, "m, i, f")
        self._trail_line = self.function.reserve()
        """The line for the local ``trail``, see `load_trail`."""
        self._certain: set[str] = set()
        self.compiler = FormulaCompiler(self.unit, self.function, self.library, "len(i.stack)")
        self.scope: Scope = {}
        self.bound = bound

    def use(self, node: nodes.Term) -> Scope:
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
                        known = self._values.get(name)
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

    def settle(self, term: nodes.Term) -> None:
        """After a formula that was written with `succeed`: what it surely binds is known to be bound."""
        for name in variables(term):
            self.bound[name] = name in self._certain or self.bound.get(name, False)

    def load_trail(self) -> None:
        """Give the function its local ``trail``."""
        self.function.fill(self._trail_line, "trail = i.trail")

    def fill_jumps(self, places: list[Line], number: int | None) -> None:
        """Fill reserved lines: the next step is the one with this number."""
        for place in places:
            self.function.fill(place, f"f[0] = {self.step(number)}")

    def finish(self) -> None:
        """End the function and add it to the unit."""
        if self.function.uses("trail"):
            self.load_trail()
        self.unit.add(self.function)

    def step(self, number: int | None) -> str:
        """Return an expression for a step by its number; None ends the body."""
        return "None" if number is None else self.unit.constant(Ref("step", number))

    def constant(self, value: Any) -> str:
        """Return the name of a constant."""
        return self.unit.constant(value)

    def succeed(self, found: Scope) -> None:
        """Write that the formula holds, with the variables of ``found``."""
        self._certain.update(found)
        self.store(found)
        self.function.emit("return None")

    def built(self, term: nodes.Term) -> tuple[str, Scope]:
        """Return an expression for a term, and the scope with its new variables."""
        scope = self.use(term)
        return self.compiler.build(term, scope), scope

    def literal(self, term: nodes.Structure) -> tuple[str, str, Scope]:
        """Expressions for arguments and event annotations of a literal, and the scope with its new variables."""
        scope = self.use(term)
        args = tuple_of([self.compiler.build(arg, scope) for arg in term.args])
        return args, self.compiler.event_annots(term.annotations, scope), scope

    def dynamic(self, call: str, term: nodes.Term) -> None:
        """Leave a formula to the mind: ``call`` gets the built term."""
        built, scope = self.built(term)
        local = self.function.assign(built)
        self.store(scope)
        self.function.emit(f"return {call.format(local)}")
        self.became(scope)
        for name in self.bound:
            self.bound[name] = self.bound[name] and name not in scope

    def relevant(self, operator: str, goal: str, term: nodes.Structure) -> str:
        """Return an expression for the plans that a trigger makes relevant."""
        return self.constant(Ref("relevant", (operator, goal, signature_of(term))))


def write_step(writer: StepWriter, formula: nodes.Step) -> None:
    """Write an operator and its term; the function is left open."""
    operator, term = formula.operator, formula.term
    match operator:
        case Operator.ACTION:
            _action(writer, term)
        case Operator.ACHIEVE | Operator.ACHIEVE_NEW_FOCUS:
            _achieve(writer, term, operator is Operator.ACHIEVE_NEW_FOCUS)
        case Operator.TEST:
            _test(writer, term)
        case _:
            _change(writer, operator, term)


def _action(writer: StepWriter, term: nodes.Term) -> None:
    match term:
        case nodes.InternalAction():
            _internal(writer, term)
        case nodes.Structure() if not isinstance(term.namespace, nodes.Variable):
            _external(writer, term)
        case nodes.Relation() | nodes.And() | nodes.Or():
            _formula(writer, term, "constraint_failed()")
        case _:
            writer.dynamic(f"run_term(m, i, f, {writer.step(writer.number)}, {{}})", term)


def _formula(writer: StepWriter, term: nodes.Term, otherwise: str) -> None:
    """Write a formula that succeeds with its first solution; without one the step does ``otherwise``."""
    writer.compiler.formula(term, writer.use(term), writer.succeed)
    writer.function.emit(otherwise)
    writer.settle(term)


def _achieve(writer: StepWriter, term: nodes.Term, new_focus: bool) -> None:
    if not isinstance(term, nodes.Structure) or isinstance(term.namespace, nodes.Variable):
        writer.dynamic(f"achieve_term(m, i, {{}}, {new_focus})", term)
        return
    args, annots, scope = writer.literal(term)
    relevant = writer.relevant("+", "!", term)
    if not new_focus:
        writer.store(scope)
    if writer.library.has_meta:
        writer.function.emit(f"pending(m, {relevant}, {args}, {annots})")
    if new_focus:
        writer.function.emit(f"m.post({relevant}, detach({args}), {_resolved_annots(annots)})")
    else:
        writer.function.emit(f"m.events.append(({relevant}, {args}, {annots}, i))")
        writer.function.emit("return True")
        writer.became(scope)


def _test(writer: StepWriter, term: nodes.Term) -> None:
    scope = writer.use(term)
    writer.compiler.formula(term, scope, writer.succeed)
    if isinstance(term, nodes.Structure) and not isinstance(term.namespace, nodes.Variable):
        after = dict(scope)
        args = tuple_of([writer.compiler.build(arg, after) for arg in term.args])
        annots = writer.compiler.event_annots(term.annotations, after)
        relevant = writer.relevant("+", "?", term)
        writer.function.emit(f"r = test_event(m, i, {relevant}, {args}, {annots})")
        writer.store(after)
        writer.function.emit("return r")
    elif isinstance(term, nodes.Variable):
        built = writer.compiler.build(term, dict(scope))
        writer.function.emit(f"return test_term(m, i, {built})")
    else:
        writer.function.emit("test_failed()")
    writer.settle(term)


def _external(writer: StepWriter, term: nodes.Structure) -> None:
    scope = writer.use(term)
    built = writer.function.assign(writer.compiler.build(term, scope))
    writer.store(scope)
    writer.function.emit(f"return perform(m, i, {built})")
    writer.became(scope)


def _internal(writer: StepWriter, term: nodes.InternalAction) -> None:
    name, arity = term.name, len(term.args)
    if name == ".wait" and 1 <= arity <= 3 and isinstance(term.args[0], _CONDITIONS):
        _wait(writer, term)
        return
    scope = writer.use(term)
    query = QUERIES.get((name, arity))
    action = writer.library.action(name, arity)
    if query is not None and is_query(term.args[min(1, arity - 2)], scope):
        _formula(writer, term, "action_said_no()")
        return
    if action is None:
        writer.library.unknown_action(term)
        sig = writer.constant(signature(name, arity))
        args = tuple_of([writer.compiler.build(arg, scope) for arg in term.args])
        writer.store(scope)
        writer.function.emit(f"return perform(m, i, Literal({sig}, {args}))")
        writer.became(scope)
        return
    built = writer.compiler.action_arguments(term, scope)
    for place, arg in enumerate(term.args[: action.names]):
        if isinstance(arg, nodes.Structure) and is_plain_atom(arg) and not writer.library.is_function(arg.functor, 0):
            built[place] = writer.constant(arg.functor)
    args = "".join(f", {writer.function.assign(arg)}" for arg in built)
    function = writer.constant(action.function)
    if action.suspends:
        writer.store(scope)
        writer.function.emit(f"return {function}(m, trail{args})")
    else:
        with writer.function.block(f"{'for _ in' if action.backtracks else 'if'} {function}(m, trail{args}):"):
            writer.succeed(writer.compiler.settled(writer.scope, scope))
        writer.function.emit("action_said_no()")
    writer.became(scope)


def _change(writer: StepWriter, operator: Operator, term: nodes.Term) -> None:
    """Belief changes."""
    if not isinstance(term, nodes.Structure) or isinstance(term.namespace, nodes.Variable):
        writer.dynamic(f"change_term(m, i, {writer.constant(operator.value)}, {{}})", term)
        return
    args, annots, scope = writer.literal(term)
    predicate = writer.constant(Ref("predicate", signature_of(term)))
    focus = "None" if operator in (Operator.ADD_NEW_FOCUS, Operator.DELETE_NEW_FOCUS) else "i"
    if operator in (Operator.DELETE, Operator.DELETE_NEW_FOCUS):
        plans = writer.relevant("-", "", term)
        writer.store(scope)
        writer.function.emit(f"return disbelieve(m, {focus}, {predicate}, {plans}, {args}, {annots}, trail)")
    else:
        _add(writer, operator, term, f"m, {focus}", predicate, _resolved_annots(annots), scope)
    writer.became(scope)


def _add(
    writer: StepWriter, operator: Operator, term: nodes.Structure, focus: str, predicate: str, annots: str, scope: Scope
) -> None:
    """Write the addition of a belief, without bound variables; where it is a fact of numbers, without a search."""
    built = [writer.function.assign(writer.compiler.build(arg, scope)) for arg in term.args]
    unknown = [name for name, arg in zip(built, term.args, strict=True) if not _is_constant(arg)]
    plans = writer.relevant("+", "", term)
    writer.store(scope)
    args = tuple_of([f"resolve({name})" if name in unknown else name for name in built])
    if operator is Operator.UPDATE:
        gone = writer.relevant("-", "", term)
        writer.function.emit(f"return replace({focus}, {predicate}, {plans}, {gone}, {args}, {annots})")
        return
    last = ", True" if operator is Operator.ADD_LAST else ""
    if not any(isinstance(arg, nodes.Structure | nodes.ListTerm) and not _is_constant(arg) for arg in term.args):
        numbers = " and ".join(f"type({name}) is float" for name in unknown)
        with writer.function.block(f"if {numbers}:") if unknown else nullcontext():
            fact = writer.function.assign(tuple_of(built))
            added = f"{predicate}.add_ground({fact}, {annots}{last})"
            writer.function.emit(f"return believed({focus}, {plans}, {fact}, {added})")
        if not unknown:
            return
    writer.function.emit(f"return believe({focus}, {predicate}, {plans}, {args}, {annots}{last})")


def _is_constant(arg: nodes.Term) -> bool:
    """Return whether an argument is written as a number, a string or an atom."""
    if isinstance(arg, nodes.Structure):
        return not arg.args and arg.annotations is None
    return isinstance(arg, nodes.Number | nodes.String)


def _resolved_annots(annots: str) -> str:
    """Return an expression for annotations without bound variables; constants have none."""
    return annots if annots.isidentifier() else f"resolve_annots({annots})"


def _wait(writer: StepWriter, term: nodes.InternalAction) -> None:
    """``.wait(Formula[, Ms[, Elapsed]])``: the formula becomes a function that the mind asks after each change.

    Functions in it are computed before, once, as Jason does.
    """
    scope = writer.use(term)
    others = "".join(f", {writer.function.assign(writer.compiler.build(arg, scope))}" for arg in term.args[1:])
    formula = ComputedOnce(writer, scope).formula(term.args[0])
    writer.store(scope)
    check = writer.unit.name("w")
    writer.function.emit(f"return wait_until(m, i, f, {check}{others})")
    writer.became(scope)
    writer.finish()
    writer.start(check, writer.bound)
    inner = writer.use(formula)

    def holds(found: Scope) -> None:
        writer.store(found)
        writer.function.emit("return True")

    writer.compiler.formula(formula, inner, holds)
    writer.function.emit("return False")
    writer.became(dict.fromkeys(variables(formula), ""), certain=False)


_CONDITIONS = (nodes.Structure, nodes.Relation, nodes.And, nodes.Or, nodes.Not, nodes.InternalAction)
"""The formulas that the first argument of ``.wait`` may be; a time, an event or a variable is none."""


class ComputedOnce:
    """Replaces the functions in a formula of ``.wait`` by variables of the frame, computed before the wait begins.

    ``.wait(.count(b(_)) >= 3)`` waits for ever unless there are three already; ``.wait(.count(b(_), 3))`` counts each
    time. ``scope`` has the variables that are known before; what else a function needs keeps it from being computed.
    """

    def __init__(self, writer: StepWriter, scope: Scope) -> None:
        self._writer, self._scope = writer, scope
        self._known = {name for name in scope if writer.bound.get(name)}
        self._count = 0

    def formula(self, node: nodes.Term) -> nodes.Term:
        """Return the formula with variables for functions."""
        match node:
            case nodes.And() | nodes.Or() | nodes.Not():
                return with_parts(node, tuple(map(self.formula, parts(node) or ())))
            case nodes.Relation():
                return with_parts(node, tuple(map(self._term, parts(node) or ())))
            case nodes.Structure(args=args):
                return replace(node, args=tuple(map(self._term, args)))
        return node

    def _term(self, node: nodes.Term) -> nodes.Term:
        match node:
            case nodes.InternalAction(name=name, args=args):
                return self._value(node, name, args)
            case nodes.Structure(functor=name, args=args):
                found = self._value(node, name, args)
                return found if found is not node else replace(node, args=tuple(map(self._term, args)))
            case nodes.Arithmetic() | nodes.ListTerm():
                return with_parts(node, tuple(map(self._term, parts(node) or ())))
        return node

    def _value(self, node: nodes.Term, name: str, args: tuple[nodes.Term, ...]) -> nodes.Term:
        counts = name == ".count" and len(args) == 1
        if not counts and not self._writer.library.is_function(name, len(args)):
            return node
        if not counts and not all(variable in self._known for variable in variables(node)):
            return node
        variable = f"{HIDDEN}{self._count}"
        self._count += 1
        built = self._writer.compiler.build(node, dict(self._scope) if counts else self._scope)
        self._scope[variable] = self._writer.function.assign(built)
        # Frames are made with the places of the variables that the program names; this one may be beyond.
        self._writer.function.emit(f"f.extend([None] * ({self._writer.code.slot(variable)} + 1 - len(f)))")
        return nodes.Variable(variable, position=node.position)
