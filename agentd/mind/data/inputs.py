"""Inputs of a mind, taken at the beginning of a cycle; a recording of them replays to the same decisions.

Inputs are immutable by convention. The classes are not frozen because making a frozen one takes seven times as long,
and one is made for each message and percept.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from agentd.language.syntax_tree.signatures import Signature, signature
from agentd.language.terms.terms import Literal, Term


@dataclass(slots=True)
class PerceptReplaced:
    """A percept now has these values.

    It replaces the percepts of the same functor and arity whose arguments at the positions ``key`` agree (``()``: all
    of them). An unchanged percept raises no event.
    """

    literal: Literal
    key: tuple[int, ...] = ()


@dataclass(slots=True)
class PerceptAdded:
    """A percept holds besides those there."""

    literal: Literal


@dataclass(slots=True)
class PerceptRemoved:
    """The percepts with the functor and arity of ``literal`` whose arguments at ``key`` agree hold no longer."""

    literal: Literal
    key: tuple[int, ...] = ()


PerceptKey: TypeAlias = tuple[Signature, tuple[Any, ...]]
"""The identity of a percept, without its annotations."""


@dataclass(slots=True)
class PerceptsChanged:
    """Changes of percepts: the literal for one that holds now, None for one that holds no longer.

    Entries that change nothing are skipped. All terms are ground, without bound variables inside. The dict must not be
    changed after it is fed.
    """

    percepts: dict[PerceptKey, Literal | None]


@dataclass(slots=True)
class Mail:
    """A message from another agent. ``in_reply_to`` is the id of the question that it answers, or ``""``."""

    sender: str
    performative: str
    content: Any
    msg_id: str = ""
    in_reply_to: str = ""


@dataclass(slots=True)
class ActionDone:
    """An external action has ended; ``state`` is its final status, ``cause`` why it failed, ``reason`` that as text."""

    id: int
    ok: bool
    reason: str = ""
    state: str = ""
    cause: str = ""


@dataclass(slots=True)
class TeamReply:
    """The answer to a `TeamRequest`: a term or another result, or the error that its intention gets."""

    id: int
    value: Any = None
    error: str = ""
    message: str = ""


@dataclass(slots=True)
class GoalAdded:
    """A goal to achieve, as ``!g`` in the program would have it; source(self) if it names none."""

    literal: Literal


@dataclass(slots=True)
class BeliefAdded:
    """A belief to add, with its event; source(self) if it names none."""

    literal: Literal


@dataclass(slots=True)
class SignalRaised:
    """An event without a belief, with source(self) if it names none."""

    literal: Literal

    @staticmethod
    def named(functor: str, *args: Term) -> SignalRaised:
        return SignalRaised(Literal(signature(functor, len(args)), args))


@dataclass(slots=True)
class TimeRead:
    """The clock showed ``seconds`` when the program asked for the time within a cycle (see `Mind` about clocks)."""

    seconds: float


@dataclass(slots=True)
class TooDeep:
    """An intention had grown too deep when that was looked at, after some cycle, and failed."""


Input: TypeAlias = (
    PerceptReplaced
    | PerceptAdded
    | PerceptRemoved
    | PerceptsChanged
    | Mail
    | ActionDone
    | TeamReply
    | GoalAdded
    | BeliefAdded
    | SignalRaised
    | TimeRead
    | TooDeep
)
