"""What a mind decides and does, each as a line of text: two lives agree if these do, in order."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import blake2b
from typing import Any

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


def decision_line(entry: Any) -> str:
    """A record of `agentd.mind.decisions.Decisions` as a line; it is quick rather than readable."""
    if type(entry) is Failure:
        return f"{entry.cycle} failure {entry.intention} {entry.failed.error}"
    relevant, args = entry[2][0], entry[2][1]
    frame, rejected = entry[6], entry[5]
    place = "-" if frame is None else frame[PLAN].syntax.position
    tried = 0 if rejected is None else len(rejected)
    return f"{entry[0]} {relevant.text}{relevant.sig.indicator} {' '.join(map(_brief, args))} {tried} {place}"


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
