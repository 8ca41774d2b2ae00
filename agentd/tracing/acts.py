"""What a mind decides and does, each as a line of text: two lives agree if these do, in order."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b
from typing import Any, Final

from agentd.language.terms import Literal
from agentd.mind.decisions import Failure
from agentd.mind.effects import (
    AskPercepts,
    CancelAction,
    Effect,
    Log,
    PerformAction,
    Print,
    SendMail,
    StopTeam,
    TeamRequest,
)
from agentd.mind.frames import PLAN
from agentd.mind.holding import short_text


class DecisionLines:
    """Writes records of `agentd.mind.decisions.Decisions` as lines; it is quick rather than that they are readable."""

    def __init__(self) -> None:
        self._known: dict[Any, str] = {None: "-"}
        """The texts of events and of the places of plans."""

    def of(self, entry: Any) -> str:
        """A record as a line."""
        if type(entry) is Failure:
            return f"{entry.cycle} failure {entry.intention} {entry.failed.error}"
        relevant, args, _, _ = entry[2]
        frame, rejected, known = entry[6], entry[5], self._known
        plan = None if frame is None else frame[PLAN]
        try:
            event, place = known[relevant], known[plan]
        except KeyError:
            event, place = self._learn(relevant, plan)
        terms = " ".join(map(_brief, args)) if args else ""
        return f"{entry[0]} {event} {terms} {0 if rejected is None else len(rejected)} {place}"

    def _learn(self, relevant: Any, plan: Any) -> tuple[str, str]:
        if len(self._known) > MOST_KNOWN:  # a program may add plans for ever
            self._known = {None: "-"}
        event = self._known[relevant] = f"{relevant.text}{relevant.sig.indicator}"
        place = "-" if plan is None else str(plan.syntax.position)
        self._known[plan] = place
        return event, place


def _brief(term: Any) -> str:
    """What distinguishes a term, mostly: it takes the same time for large ones."""
    kind = type(term)
    if kind is float:
        return repr(term)
    if kind is str:
        return str(term[:100])
    if kind is Literal:
        return str(term.sig.indicator) if term.args else str(term.sig.functor)
    return kind.__name__


MOST_KNOWN: Final = 10_000


def effect_text(effect: Effect) -> str:
    """What a mind wants done, in words."""
    match effect:
        case Print(text=text):
            return f"print {text}"
        case Log(level=level, text=text):
            return f"log {level} {text}"
        case PerformAction(id=number, name=name, parameters=parameters):
            return f"action {called(name, parameters)} #{number}"
        case CancelAction(id=number):
            return f"cancel #{number}"
        case SendMail():
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
    """A name with its arguments, as a program writes it."""
    found = ",".join(map(short_text, parameters))
    return f"{name}({found})" if found else name


def digest(lines: Iterable[str]) -> str:
    """Return what stands for lines: others have another digest."""
    text = "\n".join(lines).encode(errors="replace")
    return blake2b(text, digest_size=12).hexdigest()
