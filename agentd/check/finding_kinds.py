"""The kinds of findings that `agentd check` knows: the names by which its JSON output tells them apart."""

from __future__ import annotations

import enum
from typing import Literal

from agentd.language.syntax_tree.nodes import Position
from schemas.files.findings import Finding


class Kind(enum.Enum):
    """A kind of finding: its name, which stays as it is, and what it means."""

    SYNTAX = "syntax", "the text is no program; nothing else is checked until it is one"
    MISSING_SEMICOLON = "missing-semicolon", "a formula on a new line without ; before it, read as if one stood there"
    FILE = "file", "a file that is checked or included cannot be read"
    PROJECT = "project", "what a project file names and nobody here has, such as Java classes"
    UNKNOWN_DIRECTIVE = "unknown-directive", "a directive that does not exist, or with other arguments than it takes"
    DIRECTIVE_AS_BELIEF = "directive-as-belief", "include(...) and the like without braces: a belief and no directive"
    UNKNOWN_INTERNAL_ACTION = "unknown-internal-action", "an internal action that does not exist"
    UNKNOWN_FUNCTION = "unknown-function", "a function, or action of a library, that does not exist"
    INTERNAL_ACTION_ARITY = "internal-action-arity", "an internal action or function with so many arguments"
    UNDOTTED_INTERNAL_ACTION = "undotted-internal-action", "print(...) for .print(...): an action of the environment"
    UNKNOWN_ACTION = "unknown-action", "an action that the manifest does not have"
    ACTION_ARITY = "action-arity", "an action with another number of arguments than the manifest says"
    ACTION_TYPE = "action-type", "an argument of an action that is of no type, or out of the range, in the manifest"
    UNKNOWN_PERCEPT = "unknown-percept", "a plan for a belief that is no percept of the manifest and that nothing adds"
    PERCEPT_ARITY = "percept-arity", "a percept with another number of arguments than the manifest says"
    BELIEF_NEVER_ADDED = "belief-never-added", "a test of a belief that nothing adds"
    GOAL_WITHOUT_PLAN = "goal-without-plan", "a goal that is set and has no plan"
    PLAN_SHADOWED = "plan-shadowed", "a plan behind one that takes every event before it"
    PLAN_NEVER_USED = "plan-never-used", "a plan for an event that nothing raises"
    DUPLICATE_LABEL = "duplicate-label", "two plans with one label"
    SINGLETON_VARIABLE = "singleton-variable", "a variable that stands only once: most often a misspelt one"
    UNBOUND_VARIABLE = (
        "unbound-variable",
        "a variable that is compared or computed with before anything can give it a value",
    )
    KNOWN_WHEN_RUN = "known-when-run", "a file that only the run knows or makes: what it could hold is not checked"
    ENDLESS_ASK = "endless-ask", "a synchronous ask without a time limit by which an atomic plan asks its own agent"
    UNKNOWN_PERFORMATIVE = "unknown-performative", "a performative that is nearly one of those that exist"
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
    """A finding at a place in a program."""
    return Finding(position.file, position.line, position.column, message, severity, kind.label)


def warning(kind: Kind, position: Position, message: str) -> Finding:
    """A finding that may be as its author wants it."""
    return finding(kind, position, message, "warning")
