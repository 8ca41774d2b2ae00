"""Places of a program as people know them: without the folder that the mission has its programs in."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import PurePath
from typing import Any, TypeVar

import msgspec
from msgspec.structs import replace

from argosy.why.answer import Line, Paragraph
from schemas.wire.mind_records import MindView

S = TypeVar("S", bound=msgspec.Struct)
_PLACES = ("position", "at", "asked_at", "dropped_at", "program")
"""Fields that hold `file:line`, or a file, and nothing else; `uses` holds several."""


class Places:
    """Cuts the folder of a program out of the places in a view, and puts it back into those of the lines about it.

    Nothing else is touched: what programs and vehicles say may hold the same letters.
    """

    def __init__(self, view: MindView) -> None:
        self._folder = f"{PurePath(view.program).parent}/" if "/" in view.program else ""
        self._whole: dict[str, str] = {}

    def near(self, struct: S) -> S:
        """Return a view, or a part of one, with short places."""
        return self._near(struct) if self._folder else struct

    def far(self, paragraphs: Iterable[Paragraph]) -> tuple[Paragraph, ...]:
        """Return paragraphs whose lines have their whole position, beside the texts with the short one."""
        return tuple(replace(one, lines=tuple(map(self._far, one.lines))) for one in paragraphs)

    def _far(self, line: Line) -> Line:
        return replace(line, position=self._whole.get(line.position, line.position))

    def _near(self, struct: S) -> S:
        changes: dict[str, Any] = {}
        for name in struct.__struct_fields__:
            match name, getattr(struct, name):
                case _, str(text) if name in _PLACES and text.startswith(self._folder):
                    changes[name] = self._cut(text)
                case "uses", dict(uses):
                    changes[name] = {use: self._cut(place) for use, place in uses.items()}
                case _, msgspec.Struct() as inner:
                    changes[name] = self._near(inner)
                case _, tuple(several) if several and isinstance(several[0], msgspec.Struct):
                    changes[name] = tuple(map(self._near, several))
        return replace(struct, **changes) if changes else struct

    def _cut(self, place: str) -> str:
        short = place.removeprefix(self._folder)
        self._whole[short] = place
        return short
