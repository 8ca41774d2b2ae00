"""The kinds of findings of `agentd check`, as its JSON output names them."""

from __future__ import annotations

import enum
from typing import Literal

from agentd.language.syntax_tree.nodes import Position
from schemas.files.findings import Finding


class Kind(enum.Enum):
    """A kind of finding: its name, which stays as it is, and what it means."""

    SYNTAX = "syntax", "the text does not parse; nothing else is checked until it does"
    MISSING_SEMICOLON = "missing-semicolon", "a formula on a new line without ; before it, read as if it were there"
    EMPTY_PROGRAM = "empty-program", "a program without beliefs, goals and plans"
    FILE = "file", "a file that is checked or included cannot be read"
    PROJECT = "project", "a feature that a project file names and agentd does not have, such as a Java class"
    UNKNOWN_DIRECTIVE = "unknown-directive", "a directive that does not exist or has wrong arguments"
    DIRECTIVE_AS_BELIEF = "directive-as-belief", "include(...) or the like without braces: a belief, not a directive"
    UNKNOWN_INTERNAL_ACTION = "unknown-internal-action", "an internal action that does not exist"
    UNKNOWN_FUNCTION = "unknown-function", "a function, or action of a library, that does not exist"
    INTERNAL_ACTION_ARITY = "internal-action-arity", "an internal action or function with a wrong number of arguments"
    UNDOTTED_INTERNAL_ACTION = "undotted-internal-action", "print(...) for .print(...): an action of the environment"
    UNKNOWN_ACTION = "unknown-action", "an action that the manifest does not have"
    ACTION_ARITY = "action-arity", "an action with a number of arguments that the manifest does not allow"
    ACTION_TYPE = "action-type", "an argument of an action whose type or range does not fit the manifest"
    UNAVAILABLE_ACTION = "unavailable-action", "an action that the simulated autopilot of the mission does not have"
    UNKNOWN_PERCEPT = (
        "unknown-percept",
        "a plan for a belief that is not a percept of the manifest and that nothing adds",
    )
    PERCEPT_ARITY = "percept-arity", "a percept with a number of arguments that the manifest does not allow"
    BELIEF_NEVER_ADDED = "belief-never-added", "a test of a belief that nothing adds"
    GOAL_WITHOUT_PLAN = "goal-without-plan", "a goal that is set and has no plan"
    PLAN_SHADOWED = "plan-shadowed", "a plan behind one that takes every event before it"
    PLAN_NEVER_USED = "plan-never-used", "a plan for an event that nothing raises"
    DUPLICATE_LABEL = "duplicate-label", "two plans with one label"
    MISSPELT_ANNOTATION = "misspelt-annotation", "a misspelt test, atomic or all_unifs in the label of a plan"
    SINGLETON_VARIABLE = "singleton-variable", "a variable that occurs only once: most often a misspelling"
    UNBOUND_VARIABLE = (
        "unbound-variable",
        "a variable that is used in a comparison or computation before anything can give it a value",
    )
    KNOWN_WHEN_RUN = (
        "known-when-run",
        "a file whose name or content is known only at run time: its content is not checked",
    )
    ENDLESS_ASK = "endless-ask", "a synchronous ask of an atomic plan to its own agent, without a time limit"
    UNKNOWN_PERFORMATIVE = "unknown-performative", "a performative that looks like a misspelling of an existing one"
    FORMULA_AS_ACTION = "formula-as-action", "a test without its ? in a body: performed as an action, it fails"
    BUSY_LOOP = "busy-loop", "a loop without end that never waits"

    def __init__(self, label: str, meaning: str) -> None:
        self.label, self.meaning = label, meaning


FAILS_WHERE_REACHED = frozenset(
    kind.label
    for kind in (
        Kind.UNKNOWN_INTERNAL_ACTION,
        Kind.UNKNOWN_FUNCTION,
        Kind.INTERNAL_ACTION_ARITY,
        Kind.UNKNOWN_ACTION,
        Kind.ACTION_ARITY,
        Kind.ACTION_TYPE,
        Kind.GOAL_WITHOUT_PLAN,
    )
)
"""Errors that fail the plan that reaches them, as in Jason. The agent starts with them; with others it does not."""


def finding(
    kind: Kind, position: Position, message: str, severity: Literal["error", "warning", "info"] = "error"
) -> Finding:
    """Return a finding at a place in a program."""
    return Finding(position.file, position.line, position.column, message, severity, kind.label)


def warning(kind: Kind, position: Position, message: str) -> Finding:
    """Return a finding that may be as its author wants it."""
    return finding(kind, position, message, "warning")
