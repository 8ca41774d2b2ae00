"""Serve views of a mind: `{agent}/mind`.

A view must not disturb the mind: repeated queries get the last view again, and each view is bounded
(`agentd.conversion.mind_view`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from msgspec.structs import replace

from agentd.conversion.mind_view import EVERYTHING, BadParameter, Look, MindViews
from agentd.runtime.mind_runner import MindRunner
from agentd.runtime.operator_control import OperatorControl
from agentd.runtime.program_loader import Part
from agentd.trace import Tracing
from commd.bus.bus import Bus, Query
from commd.common.clock import Clock
from schemas.wire import keys
from schemas.wire.mind_records import MindView

SHOWN_AGAIN: Final = 0.2
"""Wall seconds for which equal queries get the same view."""


class Viewer:
    """Serves views of one mind."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        runner: MindRunner,
        part: Part,
        control: OperatorControl,
        tracing: Tracing,
        prints: Iterable[str],
    ) -> None:
        """`part` has the mission's formulas; `prints` holds the last lines that were printed."""
        mind = runner.mind
        self._bus, self._clock, self._runner, self._mind, self._part = bus, clock, runner, mind, part
        self._control, self._tracing, self._prints = control, tracing, prints
        self._views = MindViews(mind, tracing.agent_boot)
        self._made: dict[Look, tuple[float, MindView]] = {}
        """The last views, and their times in wall seconds."""
        self._key = keys.mind(bus.fleet, mind.name)
        self.withdraw: Callable[[], None] = bus.serve(self._key, MindView, self._show, observers=True)

    def forget(self) -> None:
        """Make new views: an operator has changed the mind."""
        self._made.clear()

    async def _show(self, query: Query[MindView]) -> None:
        try:
            look = Look.of(query.parameters)
        except BadParameter as bad:
            query.reply_error(str(bad))
            return
        now = self._clock.wall()
        made = self._made.get(look)
        if made is None or now >= made[0] + SHOWN_AGAIN:
            self._made = {one: other for one, other in self._made.items() if now < other[0] + SHOWN_AGAIN}
            made = self._made[look] = (now, self.view(look))
        await query.answer(made[1], self._key)

    def view(self, look: Look = EVERYTHING) -> MindView:
        """Return the present beliefs and intentions."""
        self._runner.catch_up()
        mind, paused_for = self._mind, self._control.left
        view = self._views.view(look, self._clock.now())
        return replace(
            view,
            header=self._bus.header("mind", mind.name),
            state="paused" if self._control.paused else view.state,
            paused_for=paused_for,
            prints=tuple(self._prints),
            actions=tuple(self._tracing.activity.actions),
            done={text: mind.query(formula) for text, formula in self._part.done.items()},
            failed={text: mind.query(formula) for text, formula in self._part.failed.items()},
        )
