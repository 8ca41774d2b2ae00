"""What each rule of the grammar for terms and formulas becomes, and which operands are no numbers."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any, TypeAlias, TypeGuard

from msgspec import Struct

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import Problem, problem_on, shown
from agentd.language.syntax_tree.source import Source

NOT_IN_CONDITIONS = frozenset((".wait", ".suspend", ".foreach", ".loop", ".if_then_else", ".fork", ".join"))
"""Internal actions that suspend or run a body: refused in contexts and rules, where nothing can wait."""

FORMULAS = (nodes.Structure, nodes.Variable, nodes.InternalAction, nodes.Relation, nodes.Not, nodes.And, nodes.Or)
_NUMERIC = (nodes.Number, nodes.Variable, nodes.Arithmetic, nodes.InternalAction)

KINDS: dict[type, str] = {
    nodes.Number: "a number",
    nodes.String: "a string",
    nodes.ListTerm: "a list",
    nodes.Structure: "an atom or structure",
    nodes.Variable: "a variable",
    nodes.InternalAction: "an internal action",
    nodes.Arithmetic: "an arithmetic expression",
    nodes.Relation: "a comparison",
    nodes.Not: "a logical formula",
    nodes.And: "a logical formula",
    nodes.Or: "a logical formula",
    nodes.PlanTerm: "a plan",
    nodes.TriggerTerm: "a trigger",
    nodes.BodyTerm: "a plan body",
    nodes.RuleTerm: "a rule",
}


class Signed(Struct, frozen=True):
    """An expression with a sign, as written: ``--b`` is a belief change as a formula, else minus minus b."""

    expression: nodes.Arithmetic
    sign: str
    operand: nodes.Term


Scope: TypeAlias = str | nodes.Variable


def is_formula(term: nodes.Term) -> TypeGuard[nodes.Formula]:
    """Return whether a term can be true or false: a literal, a comparison, a connection of such."""
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
        self.bad_signs: dict[int, tuple[int, nodes.Term]] = {}
        self._calls: list[tuple[int, nodes.Structure]] = []

    def position(self, at: int) -> nodes.Position:
        """Return the position of the character at offset ``at``, from 0."""
        return nodes.Position(self.source.file, *self.source.place(at))

    def refuse(self, where: int | nodes.Position, message: str) -> None:
        """Report a problem at a position, or at an offset in characters."""
        line, column = (where.line, where.column) if isinstance(where, nodes.Position) else self.source.place(where)
        self.problems.append(problem_on(self.source, line, column, message))

    def or_(self, at: int, left: nodes.Term, right: nodes.Term) -> nodes.Or:
        """Return a disjunction."""
        return nodes.Or(
            self.formula_of(at, left, "left of |"), self.formula_of(at, right, "right of |"), self.position(at)
        )

    def and_(self, at: int, left: nodes.Term, right: nodes.Term) -> nodes.And:
        """Return a conjunction."""
        return nodes.And(
            self.formula_of(at, left, "left of &"), self.formula_of(at, right, "right of &"), self.position(at)
        )

    def not_(self, at: int, operand: nodes.Term) -> nodes.Not:
        """Return a negation."""
        return nodes.Not(self.formula_of(at, operand, "what follows not"), self.position(at))

    def relate(self, at: int, left: nodes.Term, operator: str, right: nodes.Term) -> nodes.Relation:
        """Return a comparison, unification or construction of a term."""
        return nodes.Relation(operator, left, right, self.position(at))

    def binary(self, at: int, left: nodes.Term, operator: str, right: nodes.Term) -> nodes.Arithmetic:
        """Return an operation on two numbers; ``5--2`` is ``5 - (-2)``."""
        self._operand(at, left, operator)
        if id(left) not in self.bad_signs:  # else `+a +b`, two changes of beliefs, reported once
            self._operand(at, right, operator)
        position = self.position(at)
        if len(operator) == 2 and operator != "**":  # `5--2` is 5 - (-2)
            right = nodes.Arithmetic(operator[1], (right,), position)
            operator = operator[0]
        return nodes.Arithmetic(operator, (left, right), position)

    def unary(self, at: int, sign: str, operand: nodes.Term) -> nodes.Arithmetic:
        """Return a signed expression, which in a body may be a change of beliefs."""
        position = self.position(at)
        expression = nodes.Arithmetic(sign[-1], (operand,), position)
        if len(sign) == 2:
            expression = nodes.Arithmetic(sign[0], (expression,), position)
        self.signed[id(expression)] = Signed(expression, sign, operand)
        if not isinstance(operand, _NUMERIC):
            self.bad_signs[id(expression)] = (at, operand)
        return expression

    def _operand(self, at: int, term: nodes.Term, operator: str) -> None:
        if isinstance(term, nodes.Structure) and not term.negated and term.args:
            self._calls.append((at, term))
        elif not isinstance(term, _NUMERIC):
            self._refuse_operand(at, term, operator)

    def _refuse_operand(self, at: int, term: nodes.Term, operator: str) -> None:
        message = f"{operator} computes with numbers, its operand must not be {KINDS[type(term)]}"
        if isinstance(term, nodes.String):
            message += "; strings are joined with .concat"
        elif isinstance(term, nodes.Structure) and not term.args and not term.negated:
            message = f"{operator} computes with numbers, its operand must not be the atom {shown(term.functor)}"
            message += "; a variable begins with a capital letter"
        self.refuse(at, message)

    def number(self, at: int, text: str) -> nodes.Number:
        """Return a numeral."""
        return nodes.Number(float(text), self.position(at))

    def string(self, at: int, text: str) -> nodes.String:
        """Return a string without its escapes."""
        return nodes.String(string_value(text), self.position(at))

    def truth(self, at: int, text: str) -> nodes.Structure:
        """Return ``true`` or ``false``."""
        return nodes.Structure(text, position=self.position(at))

    def literal(
        self,
        at: int,
        scope: Scope | None,
        tilde: str | None,
        name: str,
        arguments: tuple[nodes.Term, ...] | None,
        annotations: nodes.ListTerm | None,
    ) -> nodes.Structure:
        """Return a literal."""
        return nodes.Structure(name, arguments or (), annotations, tilde is not None, scope, self.position(at))

    def negated_literal(self, at: int, tilde: str, scope: Scope, *rest: Any) -> nodes.Structure:
        """Return a literal whose ``~`` precedes its namespace."""
        return self.literal(at, scope, tilde, *rest)

    def variable(
        self, at: int, scope: Scope | None, tilde: str | None, name: str, annotations: nodes.ListTerm | None
    ) -> nodes.Variable:
        """Return a variable, maybe with annotations, a namespace or ``~``."""
        return nodes.Variable(name, annotations, tilde is not None, scope, self.position(at))

    def negated_variable(self, at: int, tilde: str, scope: Scope, *rest: Any) -> nodes.Variable:
        """Return a variable whose ``~`` precedes its namespace."""
        return self.variable(at, scope, tilde, *rest)

    def internal(self, at: int, name: str, arguments: tuple[nodes.Term, ...] | None) -> nodes.InternalAction:
        """Return an internal action, or a call of a function with a dot in its name."""
        return nodes.InternalAction(name, arguments or (), self.position(at))

    def scope(self, at: int, name: str | None) -> Scope:
        """Return a namespace; empty for ``::`` alone."""
        if name is None:
            return ""
        return nodes.Variable(name, position=self.position(at)) if name[0].isupper() or name[0] == "_" else name

    def arguments(self, at: int, *terms: nodes.Term) -> tuple[nodes.Term, ...]:
        """Return several terms."""
        return terms

    elements = arguments

    def list_(
        self, at: int, items: tuple[nodes.Term, ...] = (), tail: nodes.Variable | nodes.ListTerm | None = None
    ) -> nodes.ListTerm:
        """Return a list, or annotations."""
        return nodes.ListTerm(items, tail, self.position(at))

    annotations = list_

    def annotations_rest(self, at: int, tail: nodes.Variable | nodes.ListTerm) -> nodes.ListTerm:
        """Return annotations that are a tail alone."""
        return nodes.ListTerm((), tail, self.position(at))

    def formula_of(self, at: int, term: nodes.Term, where: str) -> nodes.Formula:
        """Return a term that may be true or false; another one is refused; `where` it is, for the message."""
        if is_formula(term):
            return term
        if self.bad_signs.pop(id(term), None):
            sign = self.signed[id(term)].sign
            self.refuse(term.position, f"{where} is only tested: there is no {sign}, a belief is changed in a body")
            return nodes.Structure("false", position=self.position(at))
        self.refuse(term.position, f"{where}: expected a formula that can be true or false, got {KINDS[type(term)]}")
        return nodes.Structure("false", position=self.position(at))

    def condition_of(self, at: int, term: nodes.Term, where: str) -> nodes.Formula:
        """Return a formula in which nothing may have to wait; `where` it is, for the message."""
        formula = self.formula_of(at, term, where)
        pending: list[nodes.Term] = [formula]
        while pending:
            match pending.pop():
                case nodes.InternalAction(name, position=place) if name in NOT_IN_CONDITIONS:
                    self.refuse(place, f"{name} cannot be used in {where}: it may have to wait; use it in the body")
                case nodes.And(left, right) | nodes.Or(left, right):
                    pending += (right, left)
                case nodes.Not(operand):
                    pending.append(operand)
        return formula

    def unfinished(self, values: Sequence[object]) -> None:
        """Drop the signs of expressions that contain an error: they may belong to belief changes."""
        for value in values:
            self.bad_signs.pop(id(value), None)

    def finish(self) -> None:
        """Report what could be judged only with the whole text read."""
        for at, operand in self.bad_signs.values():
            if isinstance(operand, nodes.Structure) and operand.args and not operand.negated:
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
    """Return the value of a string token, its escapes translated."""
    value = text[1:-1]
    return _ESCAPE.sub(_translated, value) if "\\" in value else value


_ESCAPE = re.compile(r"\\(.)")


def _translated(escape: re.Match[str]) -> str:
    character = escape[1]
    return "\n" if character == "n" else '"' if character == '"' else escape[0]
