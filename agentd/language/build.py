"""What each rule of the grammar becomes in the syntax tree, and what a grammar cannot refuse.

The methods are named as the rules and aliases of `grammar.lark`; ``at`` is the offset where the rule begins.
"""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from typing import TypeAlias, TypeGuard

from agentd.language.errors import Problem, problem_on
from agentd.language.source import Source
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
    Formula,
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
    Position,
    Program,
    Relation,
    Rule,
    RuleTerm,
    Step,
    String,
    Structure,
    Term,
    Trigger,
    TriggerTerm,
    Variable,
    While,
)

NOT_IN_CONDITIONS = frozenset((".wait", ".suspend", ".foreach", ".loop", ".if_then_else", ".fork", ".join"))
"""Internal actions that suspend or run a body: refused in contexts and rules, where nothing can wait."""

_FORMULAS = (Structure, Variable, InternalAction, Relation, Not, And, Or)
_NUMERIC = (Number, Variable, Arithmetic, InternalAction)

_KINDS: dict[type, str] = {
    Number: "a number",
    String: "a string",
    ListTerm: "a list",
    Structure: "an atom or structure",
    Variable: "a variable",
    InternalAction: "an internal action",
    Arithmetic: "an arithmetic expression",
    Relation: "a comparison",
    Not: "a logical formula",
    And: "a logical formula",
    Or: "a logical formula",
    PlanTerm: "a plan",
    TriggerTerm: "a trigger",
    BodyTerm: "a plan body",
    RuleTerm: "a rule",
}


@dataclass(frozen=True, slots=True)
class _Context:
    formula: Formula | None
    operator: str
    at: int


@dataclass(frozen=True, slots=True)
class _Subplans:
    plans: tuple[Plan, ...]
    at: int


@dataclass(frozen=True, slots=True)
class _Begin:
    directive: Structure
    at: int


@dataclass(frozen=True, slots=True)
class _End:
    at: int


@dataclass(frozen=True, slots=True)
class _Signed:
    """An expression with a sign, as written: ``--b`` is a belief change as a formula, else minus minus b."""

    expression: Arithmetic
    sign: str
    operand: Term


_Detail: TypeAlias = _Context | Body
_Scope: TypeAlias = str | Variable
_ItemPart: TypeAlias = Item | _Subplans | _Begin | _End


def is_formula(term: Term) -> TypeGuard[Formula]:
    """Whether a term can be true or false: a literal, a comparison, a connection of such."""
    return isinstance(term, _FORMULAS)


class Builder:
    """Builds the syntax tree of one text, and gathers what is wrong with it in ``problems``."""

    def __init__(self, source: Source, functions: frozenset[str] = frozenset()) -> None:
        self.source = source
        self.problems: list[Problem] = []
        self._functions = set(functions)
        self._includes = False
        # Decided when the text has been read: what is only known then is whether a sign changes a belief, and which
        # names are functions.
        self._signed: dict[int, _Signed] = {}
        self._bad_signs: dict[int, tuple[int, Term]] = {}
        self._calls: list[tuple[int, Structure]] = []
        self._trigger_bodies: dict[int, tuple[TriggerTerm, Body]] = {}
        self.end_of_text = 0

    def position(self, at: int) -> Position:
        return Position(self.source.file, *self.source.place(at))

    def refuse(self, where: int | Position, message: str) -> None:
        line, column = (where.line, where.column) if isinstance(where, Position) else self.source.place(where)
        self.problems.append(problem_on(self.source, line, column, message))

    # --- programs ----------------------------------------------------------------------------------------------------

    def program(self, at: int, *parts: _ItemPart) -> Program:
        open_blocks: list[tuple[_Begin, list[Item]]] = []
        items: list[Item] = []
        for part in parts:
            match part:
                case _Begin():
                    open_blocks.append((part, items))
                    items = []
                case _End():
                    if not open_blocks:
                        self.refuse(part.at, "{ end } without a { begin ... } before it")
                        continue
                    begin, outer = open_blocks.pop()
                    outer.append(Directive(begin.directive, tuple(items), self.position(begin.at)))
                    items = outer
                case _Subplans():
                    self._attach(items, part)
                case _:
                    items.append(part)
        for begin, _ in open_blocks:
            line, _column = self.source.place(begin.at)
            name = begin.directive.functor
            message = f"{{ begin {name} }} of line {line} is not closed; put {{ end }} after the last of its items"
            self.refuse(self.end_of_text, message)
        return Program(self.source.file, tuple(items))

    def _attach(self, items: list[Item], block: _Subplans) -> None:
        owner = items[-1] if items else None
        if isinstance(owner, Plan):
            items[-1] = replace(owner, subplans=owner.subplans + block.plans)
        else:
            self.refuse(block.at, "plans in { } belong to the plan before them, and there is none here")

    def belief(self, at: int, literal: Structure) -> Belief:
        return Belief(literal, self.position(at))

    def rule(self, at: int, head: Structure, body: Term) -> Rule:
        return Rule(head, self._condition(at, body, "the body of a rule"), self.position(at))

    def goal(self, at: int, operator: str, literal: Structure) -> Goal:
        return Goal(literal, operator, self.position(at))

    def plan(self, at: int, label: Structure | Variable | None, trigger: Trigger, *details: _Detail) -> Plan:
        context: Formula | None = None
        condition: Formula | None = None
        body = Body()
        for detail in details:
            if isinstance(detail, Body):
                body = detail
            elif detail.operator == ":":
                context = detail.formula
            else:
                condition = detail.formula
        return Plan(trigger, context, body, label, condition, (), self.position(at))

    def context(self, at: int, term: Term) -> _Context:
        return _Context(self._condition(at, term, "the context of a plan"), ":", at)

    def condition(self, at: int, term: Term) -> _Context:
        return _Context(self._condition(at, term, "the goal condition of a plan"), "<:", at)

    def arrow(self, at: int, body: Body) -> Body:
        return body

    def label(self, at: int, label: Structure | ListTerm) -> Structure:
        if isinstance(label, ListTerm):
            return Structure("", (), label, position=self.position(at))
        return label

    def any_label(self, at: int, label: Variable) -> Variable:
        return label

    def goal_trigger(self, at: int, operator: str, goal: str, literal: Structure | Variable) -> Trigger:
        return Trigger(operator, goal, literal, self.position(at))

    def belief_trigger(self, at: int, operator: str, literal: Structure | Variable) -> Trigger:
        if operator == "^":
            self.refuse(at, "^ is for events of goals: ^!g or ^?g, often with [state(S)]")
        return Trigger(operator, "", literal, self.position(at))

    def subplans(self, at: int, *parts: Plan | _Subplans) -> _Subplans:
        plans: list[Item] = []
        for part in parts:
            if isinstance(part, _Subplans):
                self._attach(plans, part)
            else:
                plans.append(part)
        return _Subplans(tuple(plan for plan in plans if isinstance(plan, Plan)), at)

    def directive(self, at: int, call: Structure) -> Directive | _End:
        if call.functor == "end" and not call.args:
            return _End(at)
        if call.functor == "register_function" and call.args and isinstance(call.args[0], String):
            self._functions.add(call.args[0].value)
        elif call.functor == "include":
            self._includes = True
        return Directive(call, None, self.position(at))

    def begin(self, at: int, word: str, call: Structure) -> _Begin:
        if word != "begin":
            self.refuse(at, f"a directive is written {{ {word}(...) }} or {{ begin {call.functor}(...) }}")
        return _Begin(call, at)

    def call(self, at: int, name: str, arguments: tuple[Term, ...] | None) -> Structure:
        return Structure(name, arguments or (), position=self.position(at))

    # --- plan bodies -------------------------------------------------------------------------------------------------

    def body(self, at: int, *formulas: BodyFormula) -> Body:
        return Body(formulas, self.position(at))

    def braced(self, at: int, body: Body | None) -> Body:
        return body if body is not None else Body((), self.position(at))

    def if_block(self, at: int, condition: Term, body: Body, *rest: tuple[Formula, Body] | Body | None) -> If:
        otherwise = rest[-1]
        branches = tuple(branch for branch in rest if isinstance(branch, tuple))
        first = (self._formula(at, condition, "the condition of if"), body)
        return If((first, *branches), otherwise if isinstance(otherwise, Body) else None, self.position(at))

    def elif_(self, at: int, condition: Term, body: Body) -> tuple[Formula, Body]:
        return self._formula(at, condition, "the condition of elif"), body

    def while_block(self, at: int, condition: Term, body: Body) -> While:
        return While(self._formula(at, condition, "the condition of while"), body, self.position(at))

    def for_block(self, at: int, condition: Term, body: Body) -> For:
        return For(self._formula(at, condition, "the condition of for"), body, self.position(at))

    def fork_or(self, at: int, *branches: BodyFormula) -> Fork:
        return Fork("|||", tuple(self._branch(branch) for branch in branches), self.position(at))

    def fork_and(self, at: int, *branches: BodyFormula) -> Fork:
        return Fork("|&|", tuple(self._branch(branch) for branch in branches), self.position(at))

    def _branch(self, formula: BodyFormula) -> Body:
        if isinstance(formula, Step) and formula.operator is Operator.ACTION and isinstance(formula.term, BodyTerm):
            return formula.term.body
        return Body((formula,), formula.position)

    def group(self, at: int, *formulas: BodyFormula) -> Step:
        position = self.position(at)
        return Step(Operator.ACTION, BodyTerm(Body(formulas, position), position), position)

    def expression_step(self, at: int, term: Term) -> Step:
        position = self.position(at)
        signed = self._signed.get(id(term))
        if signed is not None:
            self._bad_signs.pop(id(term), None)
            return Step(Operator(signed.sign), self._changed(at, signed.operand), position)
        if isinstance(term, TriggerTerm) and id(term) in self._trigger_bodies:
            term = BodyTerm(self._trigger_bodies[id(term)][1], term.position)
        if not isinstance(term, (*_FORMULAS, BodyTerm)):
            self.refuse(at, f"{_KINDS[type(term)]} is not a formula of a plan body; a value is computed by X = ...")
        return Step(Operator.ACTION, term, position)

    def operator_step(self, at: int, operator: str, term: Term) -> Step:
        kind = Operator(operator)
        if kind in (Operator.ADD_FIRST, Operator.ADD_LAST):
            term = self._changed(at, term)
        elif kind is Operator.TEST:
            if isinstance(term, InternalAction):
                self._refuse_operator(at, operator, term)
            else:
                term = self._formula(at, term, "what follows ?")
        return Step(kind, term, self.position(at))

    def _refuse_operator(self, at: int, operator: str, action: InternalAction) -> None:
        message = f"{operator} cannot be applied to an internal action; write {action.name} without {operator}"
        self.refuse(at, message)

    def _changed(self, at: int, term: Term) -> Term:
        """What + and - add and delete: a belief, or a plan or rule in braces."""
        if isinstance(term, TriggerTerm):
            return PlanTerm(Plan(term.trigger, position=term.position), term.position)
        if isinstance(term, InternalAction):
            message = f"an internal action is no belief: {term.name} takes no + or -; is a ';' missing before it?"
            self.refuse(at, message)
        elif not isinstance(term, Structure | Variable | PlanTerm | RuleTerm):
            self.refuse(at, f"{_KINDS[type(term)]} is no belief; + and - change beliefs, or plans and rules in {{ }}")
        return term

    # --- expressions -------------------------------------------------------------------------------------------------

    def or_(self, at: int, left: Term, right: Term) -> Or:
        return Or(self._formula(at, left, "left of |"), self._formula(at, right, "right of |"), self.position(at))

    def and_(self, at: int, left: Term, right: Term) -> And:
        return And(self._formula(at, left, "left of &"), self._formula(at, right, "right of &"), self.position(at))

    def not_(self, at: int, operand: Term) -> Not:
        return Not(self._formula(at, operand, "what follows not"), self.position(at))

    def relate(self, at: int, left: Term, operator: str, right: Term) -> Relation:
        return Relation(operator, left, right, self.position(at))

    def binary(self, at: int, left: Term, operator: str, right: Term) -> Arithmetic:
        self._operand(at, left, operator)
        self._operand(at, right, operator)
        position = self.position(at)
        if len(operator) == 2 and operator != "**":  # `5--2` is 5 - (-2)
            right = Arithmetic(operator[1], (right,), position)
            operator = operator[0]
        return Arithmetic(operator, (left, right), position)

    def unary(self, at: int, sign: str, operand: Term) -> Arithmetic:
        position = self.position(at)
        expression = Arithmetic(sign[-1], (operand,), position)
        if len(sign) == 2:
            expression = Arithmetic(sign[0], (expression,), position)
        self._signed[id(expression)] = _Signed(expression, sign, operand)
        if not isinstance(operand, _NUMERIC):
            self._bad_signs[id(expression)] = (at, operand)
        return expression

    def _operand(self, at: int, term: Term, operator: str) -> None:
        if isinstance(term, Structure) and not term.negated and term.args:
            self._calls.append((at, term))
        elif not isinstance(term, _NUMERIC):
            self._refuse_operand(at, term, operator)

    def _refuse_operand(self, at: int, term: Term, operator: str) -> None:
        message = f"{operator} computes with numbers, its operand must not be {_KINDS[type(term)]}"
        if isinstance(term, String):
            message += "; strings are joined with .concat"
        elif isinstance(term, Structure) and not term.args and not term.negated:
            message = f"{operator} computes with numbers, its operand must not be the atom {term.functor}"
            message += "; a variable begins with a capital letter"
        self.refuse(at, message)

    def number(self, at: int, text: str) -> Number:
        return Number(float(text), self.position(at))

    def string(self, at: int, text: str) -> String:
        value = text[1:-1]
        if "\\" in value:
            value = _ESCAPE.sub(_translated, value)
        return String(value, self.position(at))

    def truth(self, at: int, text: str) -> Structure:
        return Structure(text, position=self.position(at))

    def literal(
        self,
        at: int,
        scope: _Scope | None,
        tilde: str | None,
        name: str,
        arguments: tuple[Term, ...] | None,
        annotations: ListTerm | None,
    ) -> Structure:
        return Structure(name, arguments or (), annotations, tilde is not None, scope, self.position(at))

    def negated_literal(
        self,
        at: int,
        tilde: str,
        scope: _Scope,
        name: str,
        arguments: tuple[Term, ...] | None,
        annotations: ListTerm | None,
    ) -> Structure:
        return Structure(name, arguments or (), annotations, True, scope, self.position(at))

    def variable(
        self, at: int, scope: _Scope | None, tilde: str | None, name: str, annotations: ListTerm | None
    ) -> Variable:
        return Variable(name, annotations, tilde is not None, scope, self.position(at))

    def negated_variable(self, at: int, tilde: str, scope: _Scope, name: str, annotations: ListTerm | None) -> Variable:
        return Variable(name, annotations, True, scope, self.position(at))

    def internal(self, at: int, name: str, arguments: tuple[Term, ...] | None) -> InternalAction:
        return InternalAction(name, arguments or (), self.position(at))

    def scope(self, at: int, name: str | None) -> _Scope:
        if name is None:
            return ""
        return Variable(name, position=self.position(at)) if name[0].isupper() or name[0] == "_" else name

    def arguments(self, at: int, *terms: Term) -> tuple[Term, ...]:
        return terms

    def elements(self, at: int, *terms: Term) -> tuple[Term, ...]:
        return terms

    def list_(self, at: int, items: tuple[Term, ...] = (), tail: Variable | ListTerm | None = None) -> ListTerm:
        return ListTerm(items, tail, self.position(at))

    annotations = list_

    def annotations_rest(self, at: int, tail: Variable | ListTerm) -> ListTerm:
        return ListTerm((), tail, self.position(at))

    # --- code as terms -----------------------------------------------------------------------------------------------

    def body_term(self, at: int, body: Body | None) -> BodyTerm | TriggerTerm:
        position = self.position(at)
        if body is not None and len(body.formulas) == 1:
            step = body.formulas[0]
            if (
                isinstance(step, Step)
                and step.operator in (Operator.ADD, Operator.DELETE)
                and isinstance(step.term, Structure | Variable)
            ):
                trigger = TriggerTerm(Trigger(step.operator.value, "", step.term, step.position), position)
                self._trigger_bodies[id(trigger)] = (trigger, body)
                return trigger
        return BodyTerm(body if body is not None else Body((), position), position)

    def trigger_term(self, at: int, trigger: Trigger) -> TriggerTerm:
        return TriggerTerm(trigger, self.position(at))

    def plan_term(self, at: int, *parts: Structure | Variable | Trigger | _Detail) -> PlanTerm:
        first = parts[0]
        label = None
        if isinstance(first, Structure | Variable):
            label, parts = first, parts[1:]
        trigger = parts[0]
        assert isinstance(trigger, Trigger)
        details = [part for part in parts if isinstance(part, _Context | Body)]
        return PlanTerm(self.plan(at, label, trigger, *details), self.position(at))

    def rule_term(self, at: int, head: Structure, body: Term) -> RuleTerm:
        return RuleTerm(self.rule(at, head, body), self.position(at))

    # --- texts that are one thing ------------------------------------------------------------------------------------

    def lone_expression(self, at: int, term: Term) -> Term:
        return term

    def lone_literal(self, at: int, literal: Structure) -> Structure:
        return literal

    def lone_plan(self, at: int, plan: Plan) -> Plan:
        return plan

    def lone_trigger(self, at: int, trigger: Trigger) -> Trigger:
        return trigger

    # --- what a grammar cannot refuse --------------------------------------------------------------------------------

    def _formula(self, at: int, term: Term, where: str) -> Formula:
        if is_formula(term):
            return term
        self.refuse(term.position, f"{where}: expected a formula that can be true or false, got {_KINDS[type(term)]}")
        return Structure("false", position=self.position(at))

    def _condition(self, at: int, term: Term, where: str) -> Formula:
        formula = self._formula(at, term, where)
        pending: list[Term] = [formula]
        while pending:
            match pending.pop():
                case InternalAction(name, position=place) if name in NOT_IN_CONDITIONS:
                    self.refuse(place, f"{name} cannot be used in {where}: it may have to wait; use it in the body")
                case And(left, right) | Or(left, right):
                    pending += (right, left)
                case Not(operand):
                    pending.append(operand)
        return formula

    def finish(self) -> None:
        """Report what could be judged only with the whole text read."""
        for at, operand in self._bad_signs.values():
            if isinstance(operand, Structure) and operand.args and not operand.negated:
                self._calls.append((at, operand))
            else:
                self._refuse_operand(at, operand, self.source.text[at])
        if self._includes:
            return  # an included file may register functions
        for at, call in self._calls:
            if call.functor not in self._functions:
                message = (
                    f"{call.functor}/{len(call.args)} is not a function; arithmetic is done with numbers, variables "
                    "and functions such as math.abs(X), or one that { register_function(...) } names"
                )
                self.refuse(at, message)


_ESCAPE = re.compile(r"\\(.)")


def _translated(escape: re.Match[str]) -> str:
    character = escape[1]
    return "\n" if character == "n" else '"' if character == '"' else escape[0]
