"""What a mind learns besides its inputs, from where it lives: it must learn the same when it is lived again."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from agentd.language.terms.terms import Literal
from agentd.mind.data.inputs import Input


@dataclass(slots=True)
class NamesRead:
    """These can be sent to, in this order, when the program asked; they had changed since it asked last."""

    names: tuple[str, ...]


@dataclass(slots=True)
class MailRefused:
    """The agent's outbox did not take a message: the plan that sent it has failed."""

    msg_id: str
    error: str
    message: str


@dataclass(slots=True)
class CameBack:
    """A restored mind was told that it is back, before its first cycle (`agentd.persistence.restart.come_back`)."""

    life: int
    interrupted: tuple[Literal, ...]


@dataclass(slots=True)
class Interrupted:
    """An action of a former life has ended, and no plan has waited for it."""

    literal: Literal


Reading: TypeAlias = NamesRead | MailRefused | CameBack | Interrupted
Given: TypeAlias = Input | Reading
"""All that goes into a mind."""
