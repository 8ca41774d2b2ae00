"""Printing and logging."""

from __future__ import annotations

import re
from typing import Any

from agentd.language.terms.format import code_text, printed, text
from agentd.language.terms.numbers import java_int
from agentd.language.terms.terms import Code, Literal, Term, Var, deref
from agentd.mind.beliefs.belief_base import RuleClause
from agentd.mind.beliefs.term_copy import resolve
from agentd.mind.beliefs.unification import Trail, unify
from agentd.mind.beliefs.work_limit import joined, limited, substituted
from agentd.mind.data.effects import Log, Print
from agentd.mind.data.formula_failure import argument
from agentd.mind.data.intention import values_of
from agentd.mind.data.registry import internal_action
from agentd.mind.plans.plan_terms import plans_for, read_trigger, shown_term
from agentd.mind.state import MindState


def _line(mind: MindState, shown: str) -> Print:
    return Print(shown) if mind.verbose else Print(shown, plain=True)


@internal_action(".print", (0, None))
@internal_action(".println", (0, None))
def print_terms(mind: MindState, trail: Trail, *args: Term) -> bool:
    """``.print(T, ...)``, ``.println(T, ...)``: the texts of the terms, joined, as one line."""
    mind.effects.append(_line(mind, joined(".print", (printed(resolve(a)) for a in args))))
    return True


DEBUGGING = 2
"""The level of ``.verbose`` from which all logging is shown."""
_LEVELS = {"severe": "error", "warning": "warning", "info": "info"}


@internal_action(".log", (1, None))
def log(mind: MindState, trail: Trail, level: Term, *args: Term) -> bool:
    """``.log(Level, T, ...)``: as ``.print``; below ``info`` it is shown only after ``.verbose(2)``."""
    name = argument(Literal, level, ".log takes a level first", "unknown").functor
    shown = _LEVELS.get(name, "debug" if name in ("fine", "finer", "finest") else "info")
    line = joined(".log", (printed(resolve(a)) for a in args))
    mind.effects.append(Log(shown, line) if shown == "debug" and mind.verbose < DEBUGGING else _line(mind, line))
    return True


@internal_action(".verbose", 1)
def verbose(mind: MindState, trail: Trail, level: Term) -> bool:
    """``.verbose(N)``: 0 prints without the agent's name, 1 is normal, 2 also shows log lines below info."""
    mind.verbose = java_int(argument(float, level, ".verbose takes a number", "unknown"))
    return True


@internal_action(".printf", (1, None))
def printf(mind: MindState, trail: Trail, pattern: Term, *args: Term) -> bool:
    """``.printf(Format, T, ...)``: Java's format; every number is a double."""
    form = argument(str, pattern, ".printf takes a format string first")
    from agentd.stdlib.java_format import java_format  # it needs `decimal`, which costs every other program memory

    with limited("the format of .printf"):
        line = java_format(form, [deref(resolve(a)) for a in args])
    mind.effects.append(_line(mind, line))
    return True


def _values(mind: MindState) -> dict[str, Any]:
    """The variables of the running plan that have a value."""
    return values_of(mind.current.stack[-1]) if mind.current is not None and mind.current.stack else {}


_PLACE = re.compile(r"#\{([A-Za-z_]\w*)\}")


@internal_action(".puts", (1, 2))
def puts(mind: MindState, trail: Trail, pattern: Term, result: Term | None = None) -> bool:
    """``.puts("... #{X} ..."[, S])``: variables of the plan by name; with S the text is returned."""
    form, values = argument(str, pattern, ".puts takes a string"), _values(mind)

    def piece(match: re.Match[str]) -> str:
        value = values.get(match.group(1))
        return match.group(1) if value is None else printed(resolve(value))

    line = substituted(".puts", _PLACE, piece, form)
    if result is None:
        mind.effects.append(_line(mind, line))
        return True
    return type(deref(result)) is Var and unify(result, line, trail)


@internal_action(".print_unifier", 0)
def print_unifier(mind: MindState, trail: Trail) -> bool:
    """``.print_unifier``: a line per variable of the plan that has a value, then ``done``."""
    for name, term in _values(mind).items():
        mind.effects.append(_line(mind, f"{name}={text(resolve(term))}"))
    mind.effects.append(_line(mind, "done"))
    return True


@internal_action(".list_plans", (0, 1))
def list_plans(mind: MindState, trail: Trail, trigger: Term | None = None) -> bool:
    """``.list_plans[(Trigger)]``: the plan library, or the plans for an event, as source text."""
    plans = list(mind.plans) if trigger is None else plans_for(mind, read_trigger(mind, trigger))
    for plan in plans:
        term = shown_term(plan)
        mind.effects.append(_line(mind, f"{code_text(Code(term.syntax, term.values, bare=True))}."))
    return True


@internal_action(".list_rules", 0)
def list_rules(mind: MindState, trail: Trail) -> bool:
    """``.list_rules``: the rules as source text."""
    for predicate in mind.beliefs.predicates():
        for entry in reversed(predicate.entries.values()):
            if type(entry) is RuleClause:
                mind.effects.append(_line(mind, f"{code_text(Code(entry.syntax, entry.values, bare=True))}."))
    return True
