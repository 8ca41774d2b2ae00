"""What each rule of the grammar becomes in the syntax tree, and what a grammar cannot refuse.

The methods are named as the rules and aliases of `grammar.lark`; ``at`` is the offset where the rule begins.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, TypeAlias, TypeVar

from msgspec import Struct
from msgspec.structs import replace

from agentd.language.parser.build_terms import FORMULAS, KINDS, TermBuilder
from agentd.language.parser.fact_runs import FactRun
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import shown
from agentd.language.syntax_tree.source import Source

MOST_BLOCKS: Final = 100
"""The most blocks in { } or ( ) that are nested in one another."""


class _Context(Struct, frozen=True):
    formula: nodes.Formula
    operator: str


class _Subplans(Struct, frozen=True):
    plans: tuple[nodes.Plan, ...]
    at: int


class _Begin(Struct, frozen=True):
    directive: nodes.Structure
    at: int


class _End(Struct, frozen=True):
    at: int


_Detail: TypeAlias = _Context | nodes.Body
_Part = TypeVar("_Part")
_ItemPart: TypeAlias = nodes.Item | FactRun | _Subplans | _Begin | _End


class Builder(TermBuilder):
    """Builds the syntax tree of one text.

    ``end_of_text`` is the offset where its last token ends; ``runs`` are the runs of facts, each represented by one
    belief.
    """

    def __init__(self, source: Source, end_of_text: int, runs: Mapping[int, FactRun]) -> None:
        super().__init__(source)
        self._runs = runs
        self._end_of_text = end_of_text
        self._depths = _BlockDepths(self.refuse)
        self._trigger_bodies: dict[int, tuple[nodes.TriggerTerm, nodes.Body]] = {}

    def program(self, at: int, *parts: _ItemPart) -> nodes.Program:
        """Return the program, with blocks that are closed and subplans in their plans; what is neither is refused."""
        open_blocks: list[tuple[_Begin, list[nodes.Item]]] = []
        items: list[nodes.Item] = []
        for part in parts:
            match part:
                case _Begin():
                    if len(open_blocks) == MOST_BLOCKS:
                        self._depths.refuse(part.at)
                    open_blocks.append((part, items))
                    items = []
                case _End():
                    if not open_blocks:
                        self.refuse(part.at, "{ end } without a { begin ... } before it")
                        continue
                    begin, outer = open_blocks.pop()
                    outer.append(nodes.Directive(begin.directive, tuple(items), self.position(begin.at)))
                    items = outer
                case _Subplans():
                    self._attach(items, part)
                case FactRun():
                    items.extend(part.facts)
                case _:
                    items.append(part)
        for begin, _ in open_blocks:
            line, _column = self.source.place(begin.at)
            name = begin.directive.functor
            message = (
                f"{{ begin {shown(name)} }} of line {line} is not closed; put {{ end }} after the last of its items"
            )
            self.refuse(self._end_of_text, message)
        return nodes.Program(self.source.file, tuple(items))

    def _attach(self, items: list[nodes.Item], block: _Subplans) -> None:
        owner = items[-1] if items else None
        if isinstance(owner, nodes.Plan):
            items[-1] = whole = replace(owner, subplans=owner.subplans + block.plans)
            self._depths.note(block.at, whole, block.plans)
        else:
            self.refuse(block.at, "plans in { } belong to the plan before them, and there is none here")

    def belief(self, at: int, literal: nodes.Structure) -> nodes.Belief | FactRun:
        """Return an initial belief, or the run of facts that it represents."""
        run = self._runs.get(at)
        return nodes.Belief(literal, self.position(at)) if run is None else run

    def rule(self, at: int, head: nodes.Structure, body: nodes.Term) -> nodes.Rule:
        """Return a rule of beliefs."""
        return nodes.Rule(head, self.condition_of(at, body, "the body of a rule"), self.position(at))

    def goal(self, at: int, operator: str, literal: nodes.Structure) -> nodes.Goal:
        """Return an initial goal."""
        return nodes.Goal(literal, operator, self.position(at))

    def plan(
        self, at: int, label: nodes.Structure | nodes.Variable | None, trigger: nodes.Trigger, *details: _Detail
    ) -> nodes.Plan:
        """Return a plan without its subplans; a context ``true`` counts as none, as in Jason."""
        context: nodes.Formula | None = None
        condition: nodes.Formula | None = None
        body = nodes.Body()
        for detail in details:
            if isinstance(detail, nodes.Body):
                body = detail
            elif detail.operator == ":":
                context = (
                    None if detail.formula == nodes.Structure("true") else detail.formula
                )  # as in Jason, also in terms
            else:
                condition = detail.formula
        return nodes.Plan(trigger, context, body, label, condition, (), self.position(at))

    def context(self, at: int, term: nodes.Term) -> _Context:
        """Return the context of a plan, for `plan`."""
        return _Context(self.condition_of(at, term, "the context of a plan"), ":")

    def condition(self, at: int, term: nodes.Term) -> _Context:
        """Return the goal condition of a plan, for `plan`."""
        return _Context(self.condition_of(at, term, "the goal condition of a plan"), "<:")

    def only(self, at: int, part: _Part) -> _Part:
        """Replace a rule by its only part."""
        return part

    arrow = any_label = lone_expression = lone_literal = lone_plan = lone_trigger = only

    def label(self, at: int, label: nodes.Structure | nodes.ListTerm) -> nodes.Structure:
        """Return a label; annotations alone are one without a name."""
        if isinstance(label, nodes.ListTerm):
            return nodes.Structure("", (), label, position=self.position(at))
        return label

    def goal_trigger(
        self, at: int, operator: str, goal: str, literal: nodes.Structure | nodes.Variable
    ) -> nodes.Trigger:
        """Return the trigger of an event of a goal."""
        return nodes.Trigger(operator, goal, literal, self.position(at))

    def belief_trigger(self, at: int, operator: str, literal: nodes.Structure | nodes.Variable) -> nodes.Trigger:
        """Return the trigger of an event of a belief; ``^`` is refused."""
        if operator == "^":
            self.refuse(at, "^ is for events of goals: ^!g or ^?g, often with [state(S)]")
        return nodes.Trigger(operator, "", literal, self.position(at))

    def subplans(self, at: int, *parts: nodes.Plan | _Subplans) -> _Subplans:
        """Return plans in braces, for `program`."""
        plans: list[nodes.Item] = []
        for part in parts:
            if isinstance(part, _Subplans):
                self._attach(plans, part)
            else:
                plans.append(part)
        return _Subplans(tuple(plan for plan in plans if isinstance(plan, nodes.Plan)), at)

    def directive(self, at: int, call: nodes.Structure) -> nodes.Directive | _End:
        """Return a directive, or the end of a block."""
        if call.functor == "end" and not call.args:
            return _End(at)
        if call.functor == "register_function" and call.args and isinstance(call.args[0], nodes.String):
            self.functions.add(call.args[0].value)
        elif call.functor == "include":
            self.includes = True
        return nodes.Directive(call, None, self.position(at))

    def begin(self, at: int, word: str, call: nodes.Structure) -> _Begin:
        """Return the beginning of a block; any other word than ``begin`` is refused."""
        if word != "begin":
            if word == "end":
                self.refuse(at, "the end of a block is written { end }")
            else:
                self.refuse(
                    at, f"a directive is written {{ {shown(word)}(...) }} or {{ begin {shown(call.functor)}(...) }}"
                )
        return _Begin(call, at)

    def call(self, at: int, name: str, arguments: tuple[nodes.Term, ...] | None) -> nodes.Structure:
        """Return the name and arguments of a directive."""
        return nodes.Structure(name, arguments or (), position=self.position(at))

    def body(self, at: int, *formulas: nodes.BodyFormula) -> nodes.Body:
        """Return a plan body; one that is nested too deep is refused."""
        body = nodes.Body(formulas, self.position(at))
        self._depths.body(at, body)
        return body

    def braced(self, at: int, body: nodes.Body | None) -> nodes.Body:
        """Return a body in braces, which may be empty."""
        return body if body is not None else nodes.Body((), self.position(at))

    def if_block(
        self,
        at: int,
        condition: nodes.Term,
        body: nodes.Body,
        *rest: tuple[nodes.Formula, nodes.Body] | nodes.Body | None,
    ) -> nodes.If:
        """Return an ``if`` with its ``elif`` and ``else``."""
        otherwise = rest[-1]
        branches = tuple(branch for branch in rest if isinstance(branch, tuple))
        first = (self.formula_of(at, condition, "the condition of if"), body)
        return nodes.If((first, *branches), otherwise if isinstance(otherwise, nodes.Body) else None, self.position(at))

    def elif_(self, at: int, condition: nodes.Term, body: nodes.Body) -> tuple[nodes.Formula, nodes.Body]:
        """Return the condition and body of an ``elif``."""
        return self.formula_of(at, condition, "the condition of elif"), body

    def while_block(self, at: int, condition: nodes.Term, body: nodes.Body) -> nodes.While:
        """Return a ``while``."""
        return nodes.While(self.formula_of(at, condition, "the condition of while"), body, self.position(at))

    def for_block(self, at: int, condition: nodes.Term, body: nodes.Body) -> nodes.For:
        """Return a ``for``."""
        return nodes.For(self.formula_of(at, condition, "the condition of for"), body, self.position(at))

    def fork_or(self, at: int, *branches: nodes.BodyFormula) -> nodes.Fork:
        """Return a fork of which one branch is needed."""
        return nodes.Fork("|||", tuple(self._branch(at, branch) for branch in branches), self.position(at))

    def fork_and(self, at: int, *branches: nodes.BodyFormula) -> nodes.Fork:
        """Return a fork of which all branches are needed."""
        return nodes.Fork("|&|", tuple(self._branch(at, branch) for branch in branches), self.position(at))

    def _branch(self, at: int, formula: nodes.BodyFormula) -> nodes.Body:
        if (
            isinstance(formula, nodes.Step)
            and formula.operator is nodes.Operator.ACTION
            and isinstance(formula.term, nodes.BodyTerm)
        ):
            return formula.term.body
        body = nodes.Body((formula,), formula.position)
        self._depths.body(at, body)
        return body

    def group(self, at: int, *formulas: nodes.BodyFormula) -> nodes.Step:
        """Return formulas in round brackets as one step."""
        position = self.position(at)
        return nodes.Step(nodes.Operator.ACTION, nodes.BodyTerm(self.body(at, *formulas), position), position)

    def expression_step(self, at: int, term: nodes.Term) -> nodes.Step:
        """Return an expression as a formula of a body: an action, a condition, or with a sign a change of beliefs."""
        position = self.position(at)
        signed = self.signed.get(id(term))
        if signed is not None:
            self.bad_signs.pop(id(term), None)
            return nodes.Step(nodes.Operator(signed.sign), self._changed(at, signed.operand), position)
        if isinstance(term, nodes.TriggerTerm) and id(term) in self._trigger_bodies:
            term = nodes.BodyTerm(self._trigger_bodies[id(term)][1], term.position)
        if not isinstance(term, (*FORMULAS, nodes.BodyTerm)):
            if isinstance(term, nodes.Arithmetic) and self._refuse_changes_in_a_row(term):
                return nodes.Step(nodes.Operator.ACTION, term, position)
            self.refuse(at, f"{KINDS[type(term)]} is not a formula of a plan body; a value is computed by X = ...")
        return nodes.Step(nodes.Operator.ACTION, term, position)

    def _refuse_changes_in_a_row(self, term: nodes.Arithmetic) -> bool:
        """Refuse ``+a +b``, read as a sum: changes of beliefs are separated by semicolons."""
        while len(term.operands) == 2:
            left, right = term.operands
            if not isinstance(left, nodes.Arithmetic):
                break
            if id(left) in self.bad_signs:
                self.bad_signs.pop(id(left))
                self.refuse(right.position, f"a ; is missing before {term.operator}; {KINDS[type(right)]} follows it")
                return True
            term = left
        return False

    def operator_step(self, at: int, operator: str, term: nodes.Term) -> nodes.Step:
        """Return a goal, a test, or an addition at one end of the belief base."""
        kind = nodes.Operator(operator)
        if kind in (nodes.Operator.ADD_FIRST, nodes.Operator.ADD_LAST):
            term = self._changed(at, term)
        elif kind is nodes.Operator.TEST:
            if isinstance(term, nodes.InternalAction):
                written = f"write {shown(term.name)} without {operator}"
                self.refuse(at, f"{operator} cannot be applied to an internal action; {written}")
            else:
                term = self.formula_of(at, term, "what follows ?")
        return nodes.Step(kind, term, self.position(at))

    def _changed(self, at: int, term: nodes.Term) -> nodes.Term:
        """Return what + and - add and delete: a belief, or a plan or rule in braces."""
        if isinstance(term, nodes.TriggerTerm):
            return nodes.PlanTerm(nodes.Plan(term.trigger, position=term.position), term.position)
        if isinstance(term, nodes.InternalAction):
            message = (
                f"an internal action is not a belief: {shown(term.name)} takes no + or -; is a ';' missing before it?"
            )
            self.refuse(at, message)
        elif not isinstance(term, nodes.Structure | nodes.Variable | nodes.PlanTerm | nodes.RuleTerm):
            self.refuse(at, f"{KINDS[type(term)]} is not a belief; + and - change beliefs, or plans and rules in {{ }}")
        return term

    def body_term(self, at: int, body: nodes.Body | None) -> nodes.BodyTerm | nodes.TriggerTerm:
        """Return a body as a term; one change of a belief alone is a trigger."""
        position = self.position(at)
        if body is not None and len(body.formulas) == 1:
            step = body.formulas[0]
            if (
                isinstance(step, nodes.Step)
                and step.operator in (nodes.Operator.ADD, nodes.Operator.DELETE)
                and isinstance(step.term, nodes.Structure | nodes.Variable)
            ):
                trigger = nodes.TriggerTerm(nodes.Trigger(step.operator.value, "", step.term, step.position), position)
                self._trigger_bodies[id(trigger)] = (trigger, body)
                return trigger
        return nodes.BodyTerm(body if body is not None else nodes.Body((), position), position)

    def trigger_term(self, at: int, trigger: nodes.Trigger) -> nodes.TriggerTerm:
        """Return a trigger as a term."""
        return nodes.TriggerTerm(trigger, self.position(at))

    def plan_term(self, at: int, *parts: nodes.Structure | nodes.Variable | nodes.Trigger | _Detail) -> nodes.PlanTerm:
        """Return a plan as a term."""
        first = parts[0]
        label = None
        if isinstance(first, nodes.Structure | nodes.Variable):
            label, parts = first, parts[1:]
        trigger = parts[0]
        assert isinstance(trigger, nodes.Trigger)
        details = [part for part in parts if isinstance(part, _Context | nodes.Body)]
        return nodes.PlanTerm(self.plan(at, label, trigger, *details), self.position(at))

    def rule_term(self, at: int, head: nodes.Structure, body: nodes.Term) -> nodes.RuleTerm:
        """Return a rule as a term."""
        return nodes.RuleTerm(self.rule(at, head, body), self.position(at))


class _BlockDepths:
    """The depths of the bodies and plans of one text; ``refuse`` gets the offset of one that is nested too deep."""

    def __init__(self, refuse: Callable[[int, str], None]) -> None:
        self._refuse = refuse
        self._depths: dict[int, int] = {}
        """By identity, of those with blocks in them."""

    def body(self, at: int, body: nodes.Body) -> None:
        """Take a body that has been read."""
        self.note(at, body, [block for formula in body.formulas for block in _blocks(formula)])

    def note(self, at: int, owner: nodes.Body | nodes.Plan, blocks: Sequence[nodes.Body | nodes.Plan]) -> None:
        """Note that something with these blocks has been read. It is refused once, where it becomes too deep."""
        depth = 1 + max((self._depths.get(id(block), 0) for block in blocks), default=-1)
        if depth == MOST_BLOCKS + 1:
            self.refuse(at)
        if depth:
            self._depths[id(owner)] = depth
        else:
            self._depths.pop(id(owner), None)

    def refuse(self, at: int) -> None:
        """Report blocks that are nested too deep, at an offset in characters."""
        message = (
            f"blocks are nested more than {MOST_BLOCKS} deep; write the inner ones as goals with plans of their own"
        )
        self._refuse(at, message)


def _blocks(formula: nodes.BodyFormula) -> tuple[nodes.Body, ...]:
    """Return the bodies inside a formula."""
    match formula:
        case nodes.If(branches=branches, otherwise=otherwise):
            return (*(body for _, body in branches), *([] if otherwise is None else [otherwise]))
        case (
            nodes.While(body=body)
            | nodes.For(body=body)
            | nodes.Step(operator=nodes.Operator.ACTION, term=nodes.BodyTerm(body=body))
        ):
            return (body,)
        case nodes.Fork(branches=bodies):
            return bodies
    return ()
