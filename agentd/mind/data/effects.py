"""Effects: the outputs of a mind."""

from __future__ import annotations

from typing import Any, TypeAlias

from msgspec import Struct

from agentd.language.syntax_tree.nodes import Position
from agentd.mind.data.inputs import Mail


class PerformAction(Struct, frozen=True):
    """An external action to start. ``parameters`` are resolved terms; the answer is an `ActionDone` with this id."""

    id: int
    name: str
    parameters: tuple[Any, ...]


class CancelAction(Struct, frozen=True):
    """The intention that waited for this action has ended."""

    id: int


class Print(Struct, frozen=True):
    """A line of output of the program; ``plain``: without the agent's name before it (``.verbose(0)``)."""

    text: str
    plain: bool = False


class Log(Struct, frozen=True):
    """A note for people: ``level`` is ``error``, ``warning``, ``info`` or ``debug``."""

    level: str
    text: str
    details: tuple[str, ...] = ()
    """Further lines."""
    at: Position | None = None
    """The place in the program that it is about."""
    ends: bool = False
    """Whether it reports that an unhandled failure has ended an intention."""


class StopTeam(Struct, frozen=True):
    """``.stopMAS``: the whole team ends after ``delay`` seconds with this exit code."""

    exit_code: int = 0
    delay: float = 0.0


class TeamRequest(Struct, frozen=True):
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


class AskPercepts(Struct, frozen=True):
    """``.perceive``: bring the percepts up to date before the program continues."""


Effect: TypeAlias = PerformAction | CancelAction | Mail | Print | Log | StopTeam | TeamRequest | AskPercepts
