"""The walk through a program that finds what it mentions. One walk, no recursion."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import TypeAlias

from agentd.analysis.mentions import ANY_ARITY, Call, Mention, PlacedPlan, Survey
from agentd.language.syntax import (
    And,
    Arithmetic,
    Belief,
    Body,
    BodyFormula,
    BodyTerm,
    Directive,
    For,
    Fork,
    Goal,
    If,
    InternalAction,
    Item,
    ListTerm,
    Not,
    Number,
    Operator,
    Or,
    Plan,
    PlanTerm,
    Relation,
    Rule,
    RuleTerm,
    Step,
    String,
    Structure,
    Term,
    TriggerTerm,
    Variable,
    While,
)

DEFAULT = "default"

QUERIES = {
    ".findall": 1,
    ".setof": 1,
    ".count": 0,
    ".eval": 1,
    ".wait": 0,
    ".belief": 0,
    ".foreach": 0,
    ".loop": 0,
    ".if_then_else": 0,
}
"""The internal actions with a logical formula among their arguments, and which argument it is."""

ASSERTIONS = frozenset((".asserta", ".assertz"))
PLAN_MAKERS = frozenset((".add_plan", ".include", ".create_agent"))

_ADDITIONS = frozenset((Operator.ADD, Operator.ADD_NEW_FOCUS, Operator.ADD_FIRST, Operator.ADD_LAST, Operator.UPDATE))
_ELSEWHERE = frozenset(("self", "percept"))


Includes: TypeAlias = Callable[[Directive, str], Iterable[Item]]


def survey(items: Iterable[Item], includes: Includes | None = None) -> Survey:
    """Survey the items of a program; ``includes`` gives the items of a file included into a namespace."""
    return _Walk(includes or (lambda directive, namespace: ())).over(items)


class _Walk:
    def __init__(self, includes: Includes) -> None:
        self._includes = includes
        self.found = Survey()
        # What is still to be looked at: (node, namespace, whether a formula, inverted).
        self._pending: list[tuple[Term | Body | Plan, str, bool, bool]] = []

    def over(self, items: Iterable[Item]) -> Survey:
        blocks: list[tuple[Iterator[Item], str]] = [(iter(items), DEFAULT)]
        top: dict[str, list[PlacedPlan]] = {}
        while blocks:
            block, namespace = blocks[-1]
            item = next(block, None)
            if item is None:
                blocks.pop()
            elif isinstance(item, Directive):
                inside, namespace = self._directive(item, namespace)
                blocks.append((iter(inside), namespace))
            elif isinstance(item, Plan):
                top.setdefault(namespace, []).append(self._place(item, namespace))
                self._pending.append((item, namespace, False, False))
            else:
                self._fact(item, namespace)
        self.found.families += top.values()
        while self._pending:
            self._visit(*self._pending.pop())
        return self.found

    def _directive(self, item: Directive, namespace: str) -> tuple[Iterable[Item], str]:
        """The items that a directive encloses or includes, and their namespace."""
        match item.name.functor, item.name.args:
            case "namespace", (Structure(functor), *_):
                return item.items or (), functor
            case "include", (_, Structure(functor), *_):
                return self._includes(item, functor), functor
            case "include", _:
                return self._includes(item, namespace), namespace
            case "register_function", (String(function), Number(arity), *_):
                self.found.functions.add((function, int(arity)))
            case "register_function", (String(function), *_):
                self.found.functions.add((function, ANY_ARITY))
            case _, args:
                for term in args:
                    self._term(term, namespace)
        return item.items or (), namespace

    def _fact(self, item: Belief | Rule | Goal, namespace: str) -> None:
        match item:
            case Goal(literal, "!"):
                self._mention(self.found.achieved, literal, namespace)
                self._inside(literal, namespace)
            case Goal(literal):
                self._mention(self.found.asked, literal, namespace)
                self._inside(literal, namespace)
            case Belief(literal):
                self.found.beliefs.append(item)
                self._mention(self.found.added, literal, namespace)
                self._inside(literal, namespace)
            case Rule():
                self._rule(item, namespace)

    def _rule(self, rule: Rule, namespace: str) -> None:
        self.found.rules.append(rule)
        self._mention(self.found.added, rule.head, namespace)
        self._inside(rule.head, namespace)
        self._formula(rule.body, namespace)

    def _place(self, plan: Plan, namespace: str) -> PlacedPlan:
        literal = plan.trigger.literal
        name = _qualified(literal, namespace) if isinstance(literal, Structure) else None
        placed = PlacedPlan(plan, name)
        self.found.plans.append(placed)
        return placed

    def _plan(self, plan: Plan, namespace: str) -> None:
        self._inside(plan.trigger.literal, namespace)
        for formula in (plan.context, plan.goal_condition):
            if formula is not None:
                self._formula(formula, namespace)
        self._pending.append((plan.body, namespace, False, False))
        if plan.subplans:
            self.found.families.append([self._place(sub, namespace) for sub in plan.subplans])
            self._pending += ((sub, namespace, False, False) for sub in plan.subplans)

    # --- terms and formulas ------------------------------------------------------------------------------------------

    def _term(self, term: Term, namespace: str) -> None:
        self._pending.append((term, namespace, False, False))

    def _formula(self, term: Term, namespace: str, inverted: bool = False) -> None:
        self._pending.append((term, namespace, True, inverted))

    def _visit(self, node: Term | Body | Plan, namespace: str, formula: bool, inverted: bool) -> None:
        match node:
            case Structure() | Variable():
                if formula and isinstance(node, Structure) and node.functor not in ("true", "false"):
                    self._mention(self.found.tested, node, namespace, inverted)
                self._inside(node, namespace)
            case InternalAction():
                self._call(node, namespace, not formula, inverted)
            case And(left, right) | Or(left, right):
                self._pending += ((left, namespace, formula, inverted), (right, namespace, formula, inverted))
            case Not(operand):
                self._pending.append((operand, namespace, formula, not inverted))
            case Relation(left=left, right=right):
                self._term(left, namespace)
                self._term(right, namespace)
            case Arithmetic(operands=terms):
                for term in terms:
                    self._term(term, namespace)
            case ListTerm(items, tail):
                for term in (*items, *([tail] if tail is not None else ())):
                    self._term(term, namespace)
            case PlanTerm(plan):
                self._place(plan, namespace)
                self._plan(plan, namespace)
            case RuleTerm(rule):
                self._rule(rule, namespace)
            case TriggerTerm(trigger):
                self._term(trigger.literal, namespace)
            case BodyTerm(body):
                self._pending.append((body, namespace, False, False))
            case Body(formulas):
                self.found.bodies.append(node)
                for step in formulas:
                    self._body_formula(step, namespace)
            case Plan():
                self._plan(node, namespace)

    def _inside(self, literal: Structure | Variable, namespace: str) -> None:
        """The arguments and annotations of a literal."""
        if isinstance(literal, Structure):
            for term in literal.args:
                self._term(term, namespace)
        if literal.annotations is not None:
            self._term(literal.annotations, namespace)

    def _call(self, action: InternalAction, namespace: str, as_term: bool, inverted: bool = False) -> None:
        self.found.calls.append(Call(action, as_term))
        query = QUERIES.get(action.name)
        if action.name in (".min", ".max") and len(action.args) == 3:
            query = 1
        if action.name in ASSERTIONS and action.args:
            self._addition(action.args[0], namespace)
        if action.name in PLAN_MAKERS:
            self.found.open_plans = self.found.open_beliefs = True
        for index, term in enumerate(action.args):
            # A query inside `not` is not what is inverted: `not .count(b(_), 0)` says nothing of b.
            self._pending.append((term, namespace, index == query, False))

    # --- bodies ------------------------------------------------------------------------------------------------------

    def _body_formula(self, formula: BodyFormula, namespace: str) -> None:
        match formula:
            case Step():
                self._step(formula, namespace)
            case If(branches, otherwise):
                for condition, body in branches:
                    self._formula(condition, namespace)
                    self._pending.append((body, namespace, False, False))
                if otherwise is not None:
                    self._pending.append((otherwise, namespace, False, False))
            case While(condition, body) | For(condition, body):
                self._formula(condition, namespace)
                self._pending.append((body, namespace, False, False))
            case Fork(branches=bodies):
                self._pending += ((body, namespace, False, False) for body in bodies)

    def _step(self, step: Step, namespace: str) -> None:
        term = step.term
        if step.operator is Operator.TEST:
            if isinstance(term, Structure):
                self._mention(self.found.asked, term, namespace)
                self._inside(term, namespace)
            else:
                self._formula(term, namespace)
        elif step.operator in _ADDITIONS:
            self._addition(term, namespace)
            self._term(term, namespace)
        elif step.operator in (Operator.ACHIEVE, Operator.ACHIEVE_NEW_FOCUS) and isinstance(term, Structure):
            self._mention(self.found.achieved, term, namespace)
            self._inside(term, namespace)
        elif step.operator is Operator.ACTION and isinstance(term, InternalAction):
            self._call(term, namespace, False)
        elif step.operator is Operator.ACTION and isinstance(term, Structure):
            if term.functor not in ("true", "false"):
                self._mention(self.found.actions, term, DEFAULT)  # what a robot does is in no namespace
            self._inside(term, namespace)
        elif step.operator is Operator.ACTION and isinstance(term, Relation | And | Or):
            self._formula(term, namespace)
        else:
            self._term(term, namespace)

    def _addition(self, term: Term, namespace: str) -> None:
        if isinstance(term, Structure):
            self._mention(self.found.added, term, namespace)
        elif isinstance(term, Variable):
            self.found.open_beliefs = True
            self.found.open_plans = True

    def _mention(self, kind: list[Mention], literal: Structure, namespace: str, inverted: bool = False) -> None:
        if not isinstance(literal.namespace, Variable):
            name = _qualified(literal, namespace)
            others = literal.annotations is not None and _from_others(literal.annotations)
            kind.append(Mention(name, len(literal.args), literal.position, inverted, others))


def _qualified(literal: Structure, namespace: str) -> str:
    written = literal.namespace
    if isinstance(written, str):
        namespace = written or DEFAULT
    name = f"~{literal.functor}" if literal.negated else literal.functor
    return name if namespace == DEFAULT else f"{namespace}::{name}"


def _from_others(annotations: ListTerm) -> bool:
    for term in annotations.items:
        match term:
            case Structure("source", (Structure(functor),)):
                return functor not in _ELSEWHERE
            case Structure("source", _):
                return True
    return False
