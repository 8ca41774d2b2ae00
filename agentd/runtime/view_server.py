"""Serve views of a mind: `{agent}/mind`.

A view must not disturb the mind: repeated queries get the last view again, and each view is bounded
(`agentd.conversion.mind_view`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Final

from agentd.conversion.introspection import EVERYTHING, BadParameter, Look
from agentd.conversion.mind_view import Beliefs, Plans, decisions_of, events_of, intentions_of, questions_of
from agentd.mind import Mind
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
        mind: Mind,
        part: Part,
        control: OperatorControl,
        tracing: Tracing,
        prints: Iterable[str],
    ) -> None:
        """`part` has the mission's formulas; `prints` holds the last lines that were printed."""
        self._bus, self._clock, self._mind, self._part = bus, clock, mind, part
        self._control, self._tracing, self._prints = control, tracing, prints
        self._beliefs, self._plans = Beliefs(mind), Plans(mind)
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
        await query.answer(self._recent(look), self._key)

    def _recent(self, look: Look) -> MindView:
        """Return a view that is at most `SHOWN_AGAIN` old."""
        now = self._clock.wall()
        made = self._made.get(look)
        if made is None or now >= made[0] + SHOWN_AGAIN:
            self._made = {one: other for one, other in self._made.items() if now < other[0] + SHOWN_AGAIN}
            made = self._made[look] = (now, self.view(look))
        return made[1]

    def view(self, look: Look = EVERYTHING) -> MindView:
        """Return the present beliefs and intentions."""
        mind, paused_for, now = self._mind, self._control.left, self._clock.now()
        believed, beliefs_left_out = self._beliefs.shown(look, now)
        intentions, intentions_left_out = intentions_of(mind)
        events, events_left_out = events_of(mind, look.about)
        decisions, failures = decisions_of(mind, look)
        return MindView(
            header=self._bus.header("mind", mind.name),
            agent=mind.name,
            program=mind.program.file,
            cycle=mind.cycle,
            time=now,
            state="paused" if self._control.paused else "reasoning" if mind.ready else "waiting",
            paused_for=paused_for,
            beliefs=tuple(one.text for one in believed),
            believed=believed,
            beliefs_left_out=beliefs_left_out,
            intentions=intentions,
            intentions_left_out=intentions_left_out,
            events=events,
            events_left_out=events_left_out,
            mailbox=len(mind.mailbox),
            questions=questions_of(mind, self._tracing.life),
            plans=self._plans.shown(look),
            plan_count=len(mind.plans.plans),
            prints=tuple(self._prints),
            decisions=decisions,
            failures=failures,
            dropped=dict(mind.drops.counts),
            drops=tuple(mind.drops.by_name.values()),
            actions=tuple(self._tracing.activity.actions),
            done={text: mind.query(formula) for text, formula in self._part.done.items()},
            failed={text: mind.query(formula) for text, formula in self._part.failed.items()},
        )
