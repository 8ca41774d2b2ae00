"""Messages: asks that may wait for ever, performatives that do not exist."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from agentd.check.finding_kinds import Kind, warning
from agentd.check.symbol_table import Survey, steps_of
from agentd.language.errors.suggestions import near
from agentd.language.syntax_tree.nodes import InternalAction, Structure
from schemas.files.findings import Finding

PERFORMATIVES: Final = frozenset(
    ("tell", "untell", "achieve", "unachieve", "askOne", "askAll", "askHow", "tellHow", "untellHow", "signal")
)


_ASKS: Final = ("askOne", "askAll", "askHow")


def endless_asks(survey: Survey) -> Iterator[Finding]:
    """Synchronous asks of the agent itself in an atomic plan: it answers only when that plan has ended."""
    for plan in (placed.plan for placed in survey.plans if placed.is_labelled("atomic")):
        for step in steps_of(plan.body):
            match step.term:
                case InternalAction(".send", (Structure("self", ()), Structure(functor), _, _), position=position) if (
                    functor in _ASKS
                ):
                    text = "this ask never ends: the agent answers itself only when this atomic plan has ended; "
                    text += "give a time limit in ms as fifth argument of .send"
                    yield warning(Kind.ENDLESS_ASK, position, text)


def unknown_performatives(survey: Survey) -> Iterator[Finding]:
    """Performatives that are nearly one of those that exist; any other may be the agents' own."""
    for call in survey.calls:
        match call.action.name, call.action.args:
            case (".send", (_, Structure(functor) as term, _, *_)) | (".broadcast", (Structure(functor) as term, _)):
                hint = "" if functor in PERFORMATIVES else near(functor, PERFORMATIVES, 0.75)
                if hint:
                    text = f"{functor} is no performative that agents handle by themselves{hint}"
                    yield warning(Kind.UNKNOWN_PERFORMATIVE, term.position, text)
