"""What one agent tells of its course, on three channels of the bus, each only while somebody listens to it."""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Collection, Coroutine, Iterable
from time import perf_counter
from typing import Any, Final, Literal, TypeAlias

import msgspec

from agentd.conversion.introspection import Look
from agentd.conversion.mind_view import decisions_of
from agentd.mind import Mind
from agentd.mind.data.effects import Effect, SendMail
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.trace.activity_events import ActivityEvents
from agentd.trace.environment_reads import CameBack, Given, Interrupted, MailRefused
from agentd.trace.initial_state import InitialState
from agentd.trace.input_log import MOST_BYTES, InputBatch, InputLog
from agentd.trace.input_records import Included
from commd.bus.bus import Bus, Query
from commd.common.clock import Clock
from schemas.wire import keys
from schemas.wire.codec import BadRecord
from schemas.wire.mind_records import Deed, MindDecisions, MindDeeds, MindInputs
from schemas.wire.records import Header

log = logging.getLogger("trace")

PERIOD: Final = 0.25
"""Wall seconds between two batches."""
SHARE: Final = 0.007
"""Of the time since the last batch the decisions of this one may take so much to be put into words, of all agents of
the process together; the rest is left out and counted."""
LEAST: Final = 2
MOST: Final = 100
"""So many decisions are in a batch at least and at most, if there were so many."""
MOST_TOGETHER: Final = 4 * MOST_BYTES
"""Bytes that all agents of the process together may keep of what has gone into them since their births, roughly."""
TOO_LATE: Final = (
    "the beginning of this life is not kept any more: more has gone into it since than is kept; "
    "begin to record before the agent begins"
)

Channel: TypeAlias = Literal["inputs", "decisions", "deeds"]
Office: TypeAlias = Callable[[SendMail], None]
Ran: TypeAlias = Callable[[int, float, list[Effect]], None]
"""Hears that the mind has run from a cycle on, at a mission time, and what it wants done."""
_all: set[Tracing] = set()
"""Those of this process: what each may keep and take depends on how many there are."""


class Tracing:
    """What one agent tells of itself."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        mind: Mind,
        birth: InitialState,
        early: Iterable[tuple[int, Given]],
        names: Callable[[], Collection[str]],
        life: str,
        spawn: Callable[[Coroutine[Any, Any, None]], object],
    ) -> None:
        """`early` has gone into the mind while it was made; `names` are all that can be sent to; `life` is what the ids
        of this life's messages end with.
        """
        agent = mind.name
        self.birth = birth
        self.course = InputLog(
            mind,
            birth.record,
            early,
            room=lambda: min(MOST_BYTES, MOST_TOGETHER // max(1, len(_all))),
            forgotten=self._hook,
        )
        self.deeds = ActivityEvents(
            agent, lambda number: f"{agent}:{bus.boot}:{number}", lambda one: f"{one}.{life}", clock.now
        )
        self.ran: Ran | None = None
        """To be called after each run of the mind; None: that is not needed."""
        self._bus, self._clock, self._mind, self._spawn = bus, clock, mind, spawn
        self._life = life
        self._heard: set[Channel] = set()
        self._flushing = False
        self._decided_at, self._per_view = perf_counter(), 0.0002
        """When decisions were put into words last, and the wall seconds that it takes for one, about."""
        self._office: Office | None = None
        self._receivers: Callable[[SendMail], list[str]] = lambda mail: []
        self._keys: dict[Channel, str] = {
            channel: keys.trace(bus.fleet, agent, channel) for channel in ("inputs", "decisions", "deeds")
        }
        mind.agents = self.course.reading(names)
        mind.on_input = self.course.given
        self._withdraw = [bus.serve(self._keys["inputs"], MindInputs, self._tell_since_birth, observers=True)]
        for channel, key in self._keys.items():
            self._withdraw.append(bus.listened(key, lambda somebody, c=channel: self._listened(c, somebody)))  # type: ignore[misc]
        _all.add(self)
        self._hook()

    # --- what happens ---

    def _ran(self, first: int, now: float, effects: Iterable[Effect]) -> None:
        """The mind has run from cycle `first` on, at mission time `now`, and wants this done; somebody listens."""
        course, recorder = self.course, self._mind.recorder
        if recorder is not None:
            recorder.settle()
        if course.listened:
            for effect in effects:
                course.did(self._mind.cycle, effect)
        if course.on:
            course.ran(first, now)

    def did(self, effect: Effect) -> None:
        """What the mind wants done is being done."""
        self.deeds.did(self._mind.cycle, effect)

    def done(self, item: Given) -> None:
        """An action has ended."""
        self.deeds.given(self._mind.cycle, item)

    def ordered(self, order: str) -> None:
        """An operator has done something to the mind."""
        self.deeds.add(Deed(cycle=self._mind.cycle, time=self._clock.now(), kind="operator", text=order))

    def send_by(self, office: Office, receivers: Callable[[SendMail], list[str]]) -> None:
        """Let `office` be the post office of the mind, with what is sent or refused noted while that is needed."""
        self._office, self._receivers = office, receivers
        self._hook()

    def _send(self, mail: SendMail) -> None:
        course, mind = self.course, self._mind
        assert self._office is not None
        try:
            self._office(mail)
        except Failed as failed:
            if course.on:
                course.given(mind.cycle, MailRefused(mail.msg_id, failed.error, failed.message))
            raise
        if course.listened:
            course.did(mind.cycle, mail)
        if self.deeds.listened:
            self.deeds.sent(mind.cycle, mail, self._receivers(mail))

    def came_back(self, reading: CameBack | Interrupted) -> None:
        """A restored mind is about to be told something, between two runs."""
        if self.course.on:
            self.course.given(self._mind.cycle + 1, reading)

    def included(self, request: int, program: Included) -> None:
        """The team has read a program that the mind asked for."""
        if self.course.on:
            self.course.included[request] = program

    def cloned(self, other: str) -> None:
        """The mind is made of what another one has become."""
        self.birth.unknown = f"it is a clone of {other}, and what that had become is not recorded"

    def _given(self, cycle: int, item: Given) -> None:
        """Something has gone into the mind, and somebody follows its deeds."""
        if self.course.on:
            self.course.given(cycle, item)
        if type(item) is Mail:
            self.deeds.given(cycle, item)

    # --- who listens ---

    def _listened(self, channel: Channel, somebody: bool) -> None:
        """Somebody has begun to listen to a channel, or nobody does any more."""
        log.debug("agent=%s trace=%s listened=%s", self._mind.name, channel, somebody)
        if somebody:
            self._heard.add(channel)
        else:
            self._heard.discard(channel)
        match channel:
            case "inputs":
                self.course.listen(self._put if somebody else None)
                self._count()
                if somebody:
                    self._spawn(self._put_kept())
            case "decisions":
                self._count()
            case "deeds":
                self.deeds.listened = somebody
                self.deeds.take()
        self._hook()
        if self._heard and not self._flushing:
            self._flushing = True
            self._spawn(self._flush_now_and_then())

    def _hook(self) -> None:
        """Have what happens told to those only who want it: what nobody wants costs nothing."""
        mind, course, deeds = self._mind, self.course, self.deeds.listened
        mind.on_input = self._given if deeds else course.given if course.on else None
        if course.listened or "decisions" in self._heard:
            self.ran = self._ran
        else:
            self.ran = course.ran if course.on else None
        if self._office is not None:
            mind.post_office = self._send if course.on or deeds else self._office

    def _count(self) -> None:
        recorder = self._mind.recorder
        if recorder is None:
            return
        if self.course.listened:
            recorder.count_all(self.course.decided)
        elif "decisions" in self._heard:
            recorder.count_all()
        else:
            recorder.count_none()

    async def _flush_now_and_then(self) -> None:
        while self._heard:
            await asyncio.sleep(PERIOD)
            self.flush()
        self._flushing = False

    # --- what is told ---

    def flush(self) -> None:
        """Tell what has happened since this was called last."""
        if "deeds" in self._heard:
            self._put_deeds()
        if "decisions" in self._heard:
            self._put_decisions()
        if self.course.listened:
            self.course.flush()

    def close(self, *, in_order: bool) -> None:
        """Tell what is left, then no more; `in_order`: the life has ended, it was not broken off by a defect."""
        self.flush()
        if in_order and self.course.listened:
            self.course.end()
        self._heard.clear()
        _all.discard(self)
        for withdraw in self._withdraw:
            withdraw()
        self._withdraw.clear()

    def _put(self, stretch: InputBatch) -> None:
        record = self.course.record(stretch)
        self._bus.put(self._keys["inputs"], msgspec.structs.replace(record, header=self._header("inputs")))

    async def _put_kept(self) -> None:
        """Tell what was kept while nobody listened, without a long turn."""
        for stretch in self.course.untold():
            self._put(stretch)
            await asyncio.sleep(0)

    def _header(self, channel: Channel) -> Header:
        """The next header on a channel; its `boot` is this life of the agent, of which a process may have several."""
        header = self._bus.header(f"trace/{channel}", self._mind.name)
        return msgspec.structs.replace(header, boot=self._life)

    def _put_deeds(self) -> None:
        deeds, left_out = self.deeds.take()
        if deeds or left_out:
            agent, now, speed = self._mind.name, self._clock.now(), self._clock.speed
            header = self._header("deeds")
            record = MindDeeds(header=header, agent=agent, deeds=deeds, left_out=left_out, now=now, speed=speed)
            self._bus.put(self._keys["deeds"], record)

    def _put_decisions(self) -> None:
        mind, recorder = self._mind, self._mind.recorder
        if recorder is None:
            return
        begin = perf_counter()
        budget = SHARE * (begin - self._decided_at) / sum("decisions" in one._heard for one in _all)
        self._decided_at = begin
        shown, left_out = recorder.take_new(min(MOST, max(LEAST, int(budget / self._per_view))))
        if not shown:
            return
        decisions, failures = decisions_of(mind, Look(last=shown))
        header = self._header("decisions")
        record = MindDecisions(
            header=header,
            agent=mind.name,
            decisions=decisions,
            failures=failures,
            left_out=left_out,
            now=self._clock.now(),
            speed=self._clock.speed,
        )
        self._bus.put(self._keys["decisions"], record)
        self._per_view += 0.2 * ((perf_counter() - begin) / shown - self._per_view)

    async def _tell_since_birth(self, query: Query[MindInputs]) -> None:
        """Answer who wants all that went in since birth; not who asks for everything there is."""
        if not query.key.endswith("/trace/inputs"):
            return
        batches = self.course.since_birth()
        self._hook()
        if batches is None:
            query.reply_error(TOO_LATE)
            return
        for batch in batches:
            try:
                await query.answer(msgspec.structs.replace(batch, header=self._header("inputs")), self._keys["inputs"])
            except BadRecord as bad:
                query.reply_error(str(bad))
                return
