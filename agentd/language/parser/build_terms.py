"""What each rule of the grammar for terms and formulas becomes, and which operands are no numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias, TypeGuard

from agentd.language.syntax_tree.errors import Problem, problem_on, shown
from agentd.language.syntax_tree.nodes import (
    And,
    Arithmetic,
    BodyTerm,
    Formula,
    InternalAction,
    ListTerm,
    Not,
    Number,
    Or,
    PlanTerm,
    Position,
    Relation,
    RuleTerm,
    String,
    Structure,
    Term,
    TriggerTerm,
    Variable,
)
from agentd.language.syntax_tree.source import Source

NOT_IN_CONDITIONS = frozenset((".wait", ".suspend", ".foreach", ".loop", ".if_then_else", ".fork", ".join"))
"""Internal actions that suspend or run a body: refused in contexts and rules, where nothing can wait."""

FORMULAS = (Structure, Variable, InternalAction, Relation, Not, And, Or)
_NUMERIC = (Number, Variable, Arithmetic, InternalAction)

KINDS: dict[type, str] = {
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
class Signed:
    """An expression with a sign, as written: ``--b`` is a belief change as a formula, else minus minus b."""

    expression: Arithmetic
    sign: str
    operand: Term


Scope: TypeAlias = str | Variable


def is_formula(term: Term) -> TypeGuard[Formula]:
    """Whether a term can be true or false: a literal, a comparison, a connection of such."""
    return isinstance(term, FORMULAS)


class TermBuilder:
    """Builds terms and formulas, and gathers what is wrong with them in ``problems``.

    Whether a sign changes a belief is known only where the expression ends, and which names are functions only at the
    end of the text: ``signed``, ``bad_signs`` and ``functions`` are kept until then.
    """

    def __init__(self, source: Source) -> None:
        self.source = source
        self.problems: list[Problem] = []
        self.functions: set[str] = set()
        self.includes = False
        self.signed: dict[int, Signed] = {}
        self.bad_signs: dict[int, tuple[int, Term]] = {}
        self._calls: list[tuple[int, Structure]] = []

    def position(self, at: int) -> Position:
        return Position(self.source.file, *self.source.place(at))

    def refuse(self, where: int | Position, message: str) -> None:
        line, column = (where.line, where.column) if isinstance(where, Position) else self.source.place(where)
        self.problems.append(problem_on(self.source, line, column, message))

    def or_(self, at: int, left: Term, right: Term) -> Or:
        return Or(self.formula_of(at, left, "left of |"), self.formula_of(at, right, "right of |"), self.position(at))

    def and_(self, at: int, left: Term, right: Term) -> And:
        return And(self.formula_of(at, left, "left of &"), self.formula_of(at, right, "right of &"), self.position(at))

    def not_(self, at: int, operand: Term) -> Not:
        return Not(self.formula_of(at, operand, "what follows not"), self.position(at))

    def relate(self, at: int, left: Term, operator: str, right: Term) -> Relation:
        return Relation(operator, left, right, self.position(at))

    def binary(self, at: int, left: Term, operator: str, right: Term) -> Arithmetic:
        self._operand(at, left, operator)
        if id(left) not in self.bad_signs:  # else `+a +b`, two changes of beliefs, of which is told once
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
        self.signed[id(expression)] = Signed(expression, sign, operand)
        if not isinstance(operand, _NUMERIC):
            self.bad_signs[id(expression)] = (at, operand)
        return expression

    def _operand(self, at: int, term: Term, operator: str) -> None:
        if isinstance(term, Structure) and not term.negated and term.args:
            self._calls.append((at, term))
        elif not isinstance(term, _NUMERIC):
            self._refuse_operand(at, term, operator)

    def _refuse_operand(self, at: int, term: Term, operator: str) -> None:
        message = f"{operator} computes with numbers, its operand must not be {KINDS[type(term)]}"
        if isinstance(term, String):
            message += "; strings are joined with .concat"
        elif isinstance(term, Structure) and not term.args and not term.negated:
            message = f"{operator} computes with numbers, its operand must not be the atom {shown(term.functor)}"
            message += "; a variable begins with a capital letter"
        self.refuse(at, message)

    def number(self, at: int, text: str) -> Number:
        return Number(float(text), self.position(at))

    def string(self, at: int, text: str) -> String:
        return String(string_value(text), self.position(at))

    def truth(self, at: int, text: str) -> Structure:
        return Structure(text, position=self.position(at))

    def literal(
        self,
        at: int,
        scope: Scope | None,
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
        scope: Scope,
        name: str,
        arguments: tuple[Term, ...] | None,
        annotations: ListTerm | None,
    ) -> Structure:
        return Structure(name, arguments or (), annotations, True, scope, self.position(at))

    def variable(
        self, at: int, scope: Scope | None, tilde: str | None, name: str, annotations: ListTerm | None
    ) -> Variable:
        return Variable(name, annotations, tilde is not None, scope, self.position(at))

    def negated_variable(self, at: int, tilde: str, scope: Scope, name: str, annotations: ListTerm | None) -> Variable:
        return Variable(name, annotations, True, scope, self.position(at))

    def internal(self, at: int, name: str, arguments: tuple[Term, ...] | None) -> InternalAction:
        return InternalAction(name, arguments or (), self.position(at))

    def scope(self, at: int, name: str | None) -> Scope:
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

    def formula_of(self, at: int, term: Term, where: str) -> Formula:
        if is_formula(term):
            return term
        if self.bad_signs.pop(id(term), None):
            sign = self.signed[id(term)].sign
            self.refuse(term.position, f"{where} is only tested: there is no {sign}, a belief is changed in a body")
            return Structure("false", position=self.position(at))
        self.refuse(term.position, f"{where}: expected a formula that can be true or false, got {KINDS[type(term)]}")
        return Structure("false", position=self.position(at))

    def condition_of(self, at: int, term: Term, where: str) -> Formula:
        formula = self.formula_of(at, term, where)
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

    def unfinished(self, values: Sequence[object]) -> None:
        """Drop the signs of expressions that contain an error: they may belong to belief changes."""
        for value in values:
            self.bad_signs.pop(id(value), None)

    def finish(self) -> None:
        """Report what could be judged only with the whole text read."""
        for at, operand in self.bad_signs.values():
            if isinstance(operand, Structure) and operand.args and not operand.negated:
                self._calls.append((at, operand))
            else:
                self._refuse_operand(at, operand, self.source.text[at])
        if self.includes:
            return  # an included file may register functions
        for at, call in self._calls:
            if call.functor not in self.functions:
                message = (
                    f"{shown(call.functor)}/{len(call.args)} is not a function; arithmetic is done with numbers, "
                    "variables and functions such as math.abs(X), or one that { register_function(...) } names"
                )
                self.refuse(at, message)


def string_value(text: str) -> str:
    """The value of a string token, its escapes translated."""
    value = text[1:-1]
    return _ESCAPE.sub(_translated, value) if "\\" in value else value


_ESCAPE = re.compile(r"\\(.)")


def _translated(escape: re.Match[str]) -> str:
    character = escape[1]
    return "\n" if character == "n" else '"' if character == '"' else escape[0]
