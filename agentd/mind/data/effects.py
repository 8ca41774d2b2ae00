"""Effects: the outputs of a mind.

Effects are immutable by convention. The classes are not frozen because making a frozen one takes seven times as long,
and one is made for each message and action.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeAlias

from agentd.language.syntax_tree.nodes import Position


@dataclass(slots=True)
class PerformAction:
    """An external action to start. ``parameters`` are resolved terms; the answer is an `ActionDone` with this id."""

    id: int
    name: str
    parameters: tuple[Any, ...]


@dataclass(slots=True)
class CancelAction:
    """The intention that waited for this action has ended."""

    id: int


@dataclass(slots=True)
class SendMail:
    """A message to send. ``receiver`` is a name, or None for all others; ``msg_id`` is new for each message."""

    receiver: str | None
    performative: str
    content: Any
    msg_id: str
    in_reply_to: str = ""


@dataclass(slots=True)
class Print:
    """A line of output of the program; ``plain``: without the agent's name before it (``.verbose(0)``)."""

    text: str
    plain: bool = False


@dataclass(slots=True)
class Log:
    """A note for people: ``level`` is ``error``, ``warning``, ``info`` or ``debug``."""

    level: str
    text: str
    details: tuple[str, ...] = ()
    """Further lines."""
    at: Position | None = None
    """The place in the program that it is about."""
    ends: bool = False
    """Whether it reports that an unhandled failure has ended an intention."""


@dataclass(slots=True)
class StopTeam:
    """``.stopMAS``: the whole team ends after ``delay`` seconds with this exit code."""

    exit_code: int = 0
    delay: float = 0.0


@dataclass(slots=True)
class TeamRequest:
    """A request to the runtime of the team; the answer is a `TeamReply` with this id.

    ``what`` is ``create``, ``kill``, ``clone``, ``df_register``, ``df_deregister``, ``df_search``, ``df_subscribe``,
    ``save``, ``list_files`` or ``include``; ``arguments`` are strings and numbers as each needs.
    """

    id: int
    what: str
    arguments: tuple[Any, ...]


class TeamRequestRefused(Exception):
    """A request that is not fulfilled; `error` is the name that the plan's failure handler gets."""

    def __init__(self, error: str, message: str) -> None:
        super().__init__(message)
        self.error = error


@dataclass(slots=True)
class AskPercepts:
    """``.perceive``: bring the percepts up to date before the program continues."""


Effect: TypeAlias = PerformAction | CancelAction | SendMail | Print | Log | StopTeam | TeamRequest | AskPercepts
