"""Inputs of a mind, taken at the beginning of a cycle; a recording of them replays to the same decisions."""

from __future__ import annotations

from typing import Any, TypeAlias

from msgspec import Struct

from agentd.language.syntax_tree.signatures import Signature, signature
from agentd.language.terms.terms import Literal, Term


class PerceptReplaced(Struct, frozen=True):
    """A percept now has these values.

    It replaces the percepts of the same functor and arity whose arguments at the positions ``key`` agree (``()``: all
    of them). An unchanged percept raises no event.
    """

    literal: Literal
    key: tuple[int, ...] = ()


class PerceptAdded(Struct, frozen=True):
    """A percept holds besides those there."""

    literal: Literal


class PerceptRemoved(Struct, frozen=True):
    """The percepts with the functor and arity of ``literal`` whose arguments at ``key`` agree hold no longer."""

    literal: Literal
    key: tuple[int, ...] = ()


PerceptKey: TypeAlias = tuple[Signature, tuple[Any, ...]]
"""The identity of a percept, without its annotations."""


class PerceptsChanged(Struct, frozen=True):
    """Changes of percepts: the literal for one that holds now, None for one that holds no longer.

    Entries that change nothing are skipped. All terms are ground, without bound variables inside. The dict must not be
    changed after it is fed.
    """

    percepts: dict[PerceptKey, Literal | None]


class Mail(Struct, frozen=True, gc=False):
    """A message from one agent to another: an effect of the one, an input of the other.

    ``msg_id`` is new for each message of a sender, ``in_reply_to`` the id of the question that it answers, or ``""``.
    ``receiver`` is a name, or None for all others; ``""`` where the message is one for the agent in hand.
    """

    sender: str
    performative: str
    content: Any
    msg_id: str = ""
    in_reply_to: str = ""
    receiver: str | None = ""


class ActionDone(Struct, frozen=True):
    """An external action has ended; ``state`` is its final status, ``cause`` why it failed, ``reason`` that as text."""

    id: int
    ok: bool
    reason: str = ""
    state: str = ""
    cause: str = ""


class TeamReply(Struct, frozen=True):
    """The answer to a `TeamRequest`: a term or another result, or the error that its intention gets."""

    id: int
    value: Any = None
    error: str = ""
    message: str = ""


class GoalAdded(Struct, frozen=True):
    """A goal to achieve, as ``!g`` in the program would have it; source(self) if it names none."""

    literal: Literal


class BeliefAdded(Struct, frozen=True):
    """A belief to add, with its event; source(self) if it names none."""

    literal: Literal


class SignalRaised(Struct, frozen=True):
    """An event without a belief, with source(self) if it names none."""

    literal: Literal

    @staticmethod
    def named(functor: str, *args: Term) -> SignalRaised:
        """Make a signal `functor(args)`."""
        return SignalRaised(Literal(signature(functor, len(args)), args))


class TimeRead(Struct, frozen=True, gc=False):
    """The clock showed ``seconds`` when the program asked for the time within a cycle (see `Mind` about clocks)."""

    seconds: float


class TooDeep(Struct, frozen=True):
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
