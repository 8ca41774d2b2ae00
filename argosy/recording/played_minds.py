"""The minds of a recording that is played: rebuilt from their recorded inputs as far as these are published.

They answer queries for views of minds, `{agent}/mind`, as the agents did. A query replays a
mind up to the present.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final

from msgspec.structs import replace

from agentd.conversion.mind_view import BadParameter, Look, MindViews
from agentd.extensions.plugins import discover
from agentd.replay.replayed_mind import CannotReplay, ReplayedMind
from argosy.recording.reader import Recorded
from commd.bus.bus import Bus, Query
from schemas.wire.codec import BadRecord, codec
from schemas.wire.mind_records import ActivityEvent, MindActivity, MindInputs, MindView
from schemas.wire.records import Header, Record

MOST_ACTIONS: Final = 60
"""Last actions and outcomes that a view has."""


class _Which(Record, frozen=True, kw_only=True):
    """The header of a record of a mind, decoded without the rest, which may not be needed."""

    header: Header = Header()
    number: int = 0


class PlayedMind:
    """Serves views of one agent's mind, of one start after the other."""

    def __init__(self, bus: Bus, key: str) -> None:
        self.withdraw: Callable[[], None] = bus.serve(key, MindView, self._show, observers=True)
        self._bus, self._key, self._boot = bus, key, ""
        self._waiting: dict[int, bytes] = {}
        """The inputs that were not fed yet, by number, as the recording has them."""
        self._broken = ""
        """Why this mind cannot be replayed further; empty = it can."""
        self._actions: deque[ActivityEvent] = deque(maxlen=MOST_ACTIONS)
        self._rebuilt: tuple[ReplayedMind, MindViews] | None = None

    def take(self, message: Recorded) -> None:
        """Take what was published of the mind."""
        try:
            which = codec(_Which).decode(message.data)
        except BadRecord:
            return  # a later batch shows that one is missing
        if which.header.boot != self._boot:
            self._boot, self._rebuilt, self._broken = which.header.boot, None, ""
            self._waiting.clear()
            self._actions.clear()
        if message.name == MindInputs.__name__:
            if self._rebuilt is None or which.number > self._rebuilt[0].number:
                self._waiting[which.number] = message.data
        elif isinstance(record := message.record, MindActivity):
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
        if self._rebuilt is None:
            if 0 not in self._waiting:
                raise CannotReplay("its start is not in the recording")
            discover()
            rebuilt = ReplayedMind(_inputs(self._waiting[0]))
            self._rebuilt = rebuilt, MindViews(rebuilt.mind)
        rebuilt, views = self._rebuilt
        if self._broken:
            raise CannotReplay(self._broken)
        try:
            while (batch := self._waiting.pop(rebuilt.number + 1, None)) is not None:
                rebuilt.feed(_inputs(batch))
        except CannotReplay as bad:
            self._broken = str(bad)
            raise
        if self._waiting:
            rebuilt.take(_inputs(self._waiting[min(self._waiting)]))  # raises: the batches before it are missing
        return replace(views.view(look, rebuilt.now), actions=tuple(self._actions))


def _inputs(batch: bytes) -> MindInputs:
    """Decode a batch. Raises CannotReplay."""
    try:
        return codec(MindInputs).decode(batch)
    except BadRecord as bad:
        raise CannotReplay(f"a batch of its inputs cannot be read: {bad}") from None
