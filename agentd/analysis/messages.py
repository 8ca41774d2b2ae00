"""Messages: asks that may wait for ever, performatives that do not exist."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from agentd.analysis.kinds import Kind, warning
from agentd.analysis.mentions import Survey
from agentd.language.spelling import near
from agentd.language.syntax import Structure
from schemas.findings import Finding

PERFORMATIVES: Final = frozenset(
    ("tell", "untell", "achieve", "unachieve", "askOne", "askAll", "askHow", "tellHow", "untellHow", "signal")
)


def endless_asks(survey: Survey) -> Iterator[Finding]:
    """Synchronous asks that wait for ever when the receiver gives no answer."""
    for call in survey.calls:
        match call.action.name, call.action.args:
            case ".send", (_, Structure(functor), _, _) if functor in ("askOne", "askAll", "askHow"):
                text = "this ask has no time limit and may never end; give one in ms as fifth argument of .send"
                yield warning(Kind.ENDLESS_ASK, call.action.position, text)


def unknown_performatives(survey: Survey) -> Iterator[Finding]:
    """Performatives that are nearly one of those that exist; any other may be the agents' own."""
    for call in survey.calls:
        match call.action.name, call.action.args:
            case (".send", (_, Structure(functor) as term, _, *_)) | (".broadcast", (Structure(functor) as term, _)):
                hint = "" if functor in PERFORMATIVES else near(functor, PERFORMATIVES, 0.75)
                if hint:
                    text = f"{functor} is no performative that agents handle by themselves{hint}"
                    yield warning(Kind.UNKNOWN_PERFORMATIVE, term.position, text)
