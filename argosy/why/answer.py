"""An explanation as data: short paragraphs of lines, each with the place in the program that it speaks of."""

from __future__ import annotations

from textwrap import wrap
from typing import Literal

import msgspec

from schemas.humanize import printable

Kind = Literal["now", "decision", "failure", "action", "dropped", "question", "belief", "plan", "hint"]


class Line(msgspec.Struct, frozen=True, omit_defaults=True):
    """A sentence."""

    text: str
    indent: int = 0
    position: str = ""
    """`file:line` of the formula or plan that it is about; the text names it too."""


class Paragraph(msgspec.Struct, frozen=True, omit_defaults=True):
    """The explanation of one event, or of the present state."""

    kind: Kind
    lines: tuple[Line, ...]
    time: float | None = None
    """Mission seconds; None: it is about the present state or the program."""
    times: int = 1
    """How often it happened for the same reasons; the newest is explained."""


class Explanation(msgspec.Struct, frozen=True, omit_defaults=True):
    """Why an agent did, or did not do, something: events in order, the newest last."""

    agent: str
    about: str = ""
    """The goal, belief or action that was asked for; empty: what the agent is doing."""
    time: float = 0.0
    """Mission seconds of the view of the mind that this is made of."""
    paragraphs: tuple[Paragraph, ...] = ()
    known: bool = True
    """False if nothing of the agent's is called as it was asked about."""


def plain(explanation: Explanation, columns: int | None = None) -> str:
    """Return the text for a terminal, paragraphs divided by blank lines; lines are broken at `columns`, None = not."""
    return "\n\n".join(
        "\n".join(part for line in paragraph.lines for part in _parts(line, columns))
        for paragraph in explanation.paragraphs
    )


def _parts(line: Line, columns: int | None) -> list[str]:
    begin, text = "  " * line.indent, printable(line.text)
    if columns is None:
        return [f"{begin}{text}"]
    return wrap(
        text,
        max(columns, 40),
        initial_indent=begin,
        subsequent_indent=f"{begin}    ",
        break_long_words=False,
        break_on_hyphens=False,
    )
