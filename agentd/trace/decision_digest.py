"""Decisions and effects of a mind as lines of text and as a digest: equal digests prove equal decisions."""

from __future__ import annotations

import sys
from array import array
from collections.abc import Iterable
from hashlib import blake2b
from typing import Any, Final

from agentd.language.terms.terms import Literal
from agentd.mind.data.effects import AskPercepts, CancelAction, Effect, Log, PerformAction, Print, StopTeam, TeamRequest
from agentd.mind.data.inputs import Mail
from agentd.mind.data.intention import PLAN
from agentd.mind.introspection.decision_log import Failure
from agentd.mind.introspection.snapshots import short_text
from agentd.mind.plans.plan_library import Plan


class Names(dict[Any, str]):
    """Texts of events (by their `Relevant`) and of the positions of plans, each made once; for None "-"."""

    def __missing__(self, what: Any) -> str:
        if len(self) > MOST_KNOWN:  # a program may add plans for ever
            self.clear()
        if what is None:
            text = "-"
        else:
            text = str(what.syntax.position) if type(what) is Plan else f"{what.text}{what.sig.indicator}"
        self[what] = text
        return text


class DecisionDigest:
    """The digest of the decisions and effects of a mind in one batch.

    A busy mind decides many thousand times a second: the distinguishing texts and numbers are collected in two lists,
    and encoded only at the end.
    """

    def __init__(self) -> None:
        self.count = 0
        """Decisions, failures and effects so far."""
        self._names = Names()
        self._texts: list[str] = []
        self._numbers = array("d")
        self._effects: list[str] = []

    def decided(self, entries: Iterable[Any]) -> None:
        """Add records of `agentd.mind.introspection.decision_log.Decisions`."""
        names, text, number = self._names, self._texts.append, self._numbers.append
        for entry in entries:
            self.count += 1
            number(entry[0])
            if type(entry) is Failure:
                number(entry.intention)
                text(f"failure {entry.failed.error}")
                continue
            relevant, args, _, _ = entry[2]
            rejected, frame = entry[5], entry[6]
            text(names[relevant])
            text(names[None if frame is None else frame[PLAN]])
            if rejected is not None:
                number(len(rejected))
            for term in args:
                if type(term) is float:
                    number(term)
                else:
                    text(brief(term))

    def did(self, effect: str) -> None:
        """Add an effect: `effect_line`."""
        self.count += 1
        self._effects.append(effect)

    def take(self) -> tuple[int, str]:
        """Return the count and the digest since the last call."""
        if sys.byteorder == "big":
            self._numbers.byteswap()
        found = blake2b(self._numbers.tobytes(), digest_size=12)
        found.update("\n".join((*self._texts, "", *self._effects)).encode(errors="replace"))
        count, self.count = self.count, 0
        self._texts, self._numbers, self._effects = [], array("d"), []
        return count, found.hexdigest()


def brief(term: Any) -> str:
    """Return what mostly distinguishes a term, in the same time for large ones."""
    kind = type(term)
    if kind is float:
        return repr(term)
    if kind is str:
        return str(term[:100])
    if kind is Literal:
        return str(term.sig.indicator) if term.args else str(term.sig.functor)
    return kind.__name__


MOST_KNOWN: Final = 10_000


def effect_line(cycle: int, effect: Effect) -> str:
    """Return an effect as a line."""
    return f"{cycle} {effect_text(effect)}"


def effect_text(effect: Effect) -> str:
    """Return an effect as text."""
    match effect:
        case Print(text=text):
            return f"print {text}"
        case Log(level=level, text=text):
            return f"log {level} {text}"
        case PerformAction(id=number, name=name, parameters=parameters):
            return f"action {called(name, parameters)} #{number}"
        case CancelAction(id=number):
            return f"cancel #{number}"
        case Mail():
            answers = f" in reply to {effect.in_reply_to}" if effect.in_reply_to else ""
            to = "all" if effect.receiver is None else effect.receiver
            return f"send {effect.performative} {short_text(effect.content)} to {to}{answers} ({effect.msg_id})"
        case TeamRequest(id=number, what=what, arguments=arguments):
            return f"ask the team {called(what, arguments)} #{number}"
        case StopTeam(exit_code=code, delay=delay):
            return f"stop the team with {code} in {delay:g} s"
        case AskPercepts():
            return "ask for percepts"


def called(name: str, parameters: Iterable[Any]) -> str:
    """Return a name with its arguments, as a program writes it."""
    found = ",".join(map(short_text, parameters))
    return f"{name}({found})" if found else name
