"""The minds of a recording that is played: rebuilt from their recorded inputs as far as these are published.

They answer queries for views of minds, `{agent}/mind`, as the agents did. A mind lives on when it is asked for.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

from msgspec.structs import replace

from agentd.conversion.introspection import BadParameter, Look
from agentd.conversion.mind_view import MindViews
from agentd.extensions.plugins import discover
from agentd.replay.replayed_mind import CannotReplay, ReplayedMind
from commd.bus.bus import Bus, Query
from schemas.wire.mind_records import ActivityEvent, MindActivity, MindInputs, MindView

MOST_ACTIONS: Final = 60
"""Last actions and outcomes that a view has."""


class PlayedMind:
    """Serves views of one agent's mind, of one life after the other."""

    def __init__(self, bus: Bus, key: str) -> None:
        self.withdraw: Callable[[], None] = bus.serve(key, MindView, self._show, observers=True)
        self._bus, self._key, self._boot = bus, key, ""
        self._waiting: dict[int, MindInputs] = {}
        """The inputs that the mind has not lived, by number."""
        self._actions: deque[ActivityEvent] = deque(maxlen=MOST_ACTIONS)
        self._lived: tuple[ReplayedMind, MindViews] | None = None

    def take(self, record: MindInputs | MindActivity) -> None:
        """Take what was published of the mind."""
        if record.header.boot != self._boot:
            self._boot, self._lived = record.header.boot, None
            self._waiting.clear()
            self._actions.clear()
        if isinstance(record, MindInputs):
            self._waiting[record.number] = record
        else:
            self._actions += [event for event in record.events if event.kind in ("action", "outcome")]

    async def _show(self, query: Query[MindView]) -> None:
        try:
            view = self._view(Look.of(query.parameters))
        except (BadParameter, CannotReplay) as bad:
            query.reply_error(str(bad))
        else:
            await query.answer(replace(view, header=self._bus.header("mind", view.agent)), self._key)

    def _view(self, look: Look) -> MindView:
        """Return the mind after all inputs so far. Raises CannotReplay."""
        if self._lived is None:
            if 0 not in self._waiting:
                raise CannotReplay("the beginning of its life is not in the recording")
            discover()
            lived = ReplayedMind(self._waiting[0])
            self._lived = lived, MindViews(lived.mind)
        lived, views = self._lived
        while (batch := self._waiting.pop(lived.number + 1, None)) is not None:
            lived.feed(batch)
        return replace(views.view(look, lived.now), actions=tuple(self._actions))
