"""Publish the trace of one agent on three channels of the bus, each only while it has subscribers.

The daemon has one listener for each channel, on the key expression of all agents. Only while that has a subscriber each
agent has listeners of its own, which tell whose trace it is: a listener costs half a millisecond of processor time, and
most daemons are watched by nobody.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Iterable
from functools import partial
from time import perf_counter
from typing import Final, Literal, TypeAlias

import msgspec

from agentd.conversion.mind_view import Look, decisions_of
from agentd.mind import Mind
from agentd.mind.data.effects import Effect
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.inputs import Mail
from agentd.runtime.agent_directory import AgentDirectory
from agentd.trace.activity_events import ActivityEvents
from agentd.trace.initial_state import InitialState
from agentd.trace.input_log import MOST_BYTES, InputBatch, InputLog
from agentd.trace.input_records import CameBack, Given, Included, Interrupted, MailRefused
from commd.bus.bus import Bus, Query
from commd.common.clock import Clock
from commd.common.tasks import Tasks
from schemas.wire import keys
from schemas.wire.codec import BadRecord
from schemas.wire.mind_records import ActivityEvent, MindActivity, MindDecisions, MindInputs
from schemas.wire.records import Header

log = logging.getLogger("trace")

Channel: TypeAlias = Literal["inputs", "decisions", "activity"]
CHANNELS: Final[tuple[Channel, ...]] = ("inputs", "decisions", "activity")
Follow: TypeAlias = Callable[[Channel, bool], None]
"""Gets a channel, and whether it has subscribers now."""
AT_ONCE: Final = 20
"""Agents that get listeners of their own in one pass of the event loop."""
PERIOD: Final = 0.25
"""Wall seconds between two batches."""
SHARE: Final = 0.007
"""Share of the time since the last batch that converting decisions may take, of all agents of the process together;
the rest is left out and counted."""
LEAST: Final = 2
MOST: Final = 100
"""Decisions in a batch at least and at most, if there were that many."""
MOST_TOGETHER: Final = 4 * MOST_BYTES
"""Bytes (estimated) of inputs that all agents of the process keep together."""
TOO_LATE: Final = (
    "the inputs since the agent's start exceed the limit, and its first ones were dropped; "
    "begin to record before the agent begins"
)

Ran: TypeAlias = Callable[[int, float, list[Effect]], None]
"""Gets a run of the mind: first cycle, mission time, effects."""
_all: set[Tracing] = set()
"""The tracings of this process: their number limits what each may keep and spend."""


class Tracing:
    """The trace of one agent. Made before its mind, for the mind's first inputs; `follow` completes it."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        agent: str,
        initial: InitialState,
        directory: AgentDirectory,
        agent_boot: str,
        tasks: Tasks,
        subscribers: TraceSubscribers,
    ) -> None:
        """`agent_boot` identifies this start of the agent; the ids of its messages end with it."""
        self.initial = initial
        self.inputs = InputLog(agent, initial.record, lambda: directory.names, self._room, self._hook)
        self.activity = ActivityEvents(agent, bus.boot, agent_boot, clock)
        self.ran: Ran | None = None
        """To be called after each run of the mind; None while nobody needs it."""
        self._mind: Mind
        self.agent_boot = agent_boot
        self._bus, self._clock, self._agent, self._tasks = bus, clock, agent, tasks
        self._subscribers = subscribers
        self._heard: set[Channel] = set()
        """The channels that have subscribers."""
        self._flushing = False
        self._decided_at, self._per_view = perf_counter(), 0.0002
        """When decisions were converted last, and the wall seconds that one takes, estimated."""
        self._keys: dict[Channel, str] = {channel: keys.trace(bus.fleet, agent, channel) for channel in CHANNELS}
        self._withdraw: list[Callable[[], None]] = []

    def follow(self, mind: Mind) -> None:
        """Trace this mind, which was made with `inputs.given` and `inputs.names`, and serve its trace."""
        self._mind = mind
        self.inputs.follow(mind)
        self._withdraw.append(
            self._bus.serve(self._keys["inputs"], MindInputs, self._answer_since_start, observers=True)
        )
        self._subscribers.add(self._agent, self._listened)
        self._withdraw.append(partial(self._subscribers.remove, self._agent))
        _all.add(self)
        self._hook()

    def _room(self) -> int:
        return min(MOST_BYTES, MOST_TOGETHER // max(1, len(_all)))

    # --- events ---

    def _ran(self, first: int, now: float, effects: Iterable[Effect]) -> None:
        """Take a run of the mind from cycle `first` on, at mission time `now`, while there are subscribers."""
        inputs, recorder = self.inputs, self._mind.recorder
        if recorder is not None:
            recorder.settle()
        if inputs.listened:
            for effect in effects:
                inputs.did(self._mind.cycle, effect)
        if inputs.on:
            inputs.ran(first, now)

    def ordered(self, order: str) -> None:
        """Take an operator's order, as text."""
        self.activity.add(ActivityEvent(cycle=self._mind.cycle, time=self._clock.now(), kind="operator", text=order))

    def sent(self, mail: Mail, receivers: list[str]) -> None:
        """Take a message that the outbox has accepted."""
        if self.inputs.listened:
            self.inputs.did(self._mind.cycle, mail)
        if self.activity.listened:
            self.activity.sent(self._mind.cycle, mail, receivers)

    def refused(self, mail: Mail, failed: Failed) -> None:
        """Take a message that the outbox has refused; its plan fails."""
        if self.inputs.on:
            self.inputs.given(self._mind.cycle, MailRefused(mail.msg_id, failed.error, failed.message))

    def came_back(self, reading: CameBack | Interrupted) -> None:
        """Take the notification of a restored mind, between two runs."""
        if self.inputs.on:
            self.inputs.given(self._mind.cycle + 1, reading)

    def included(self, request: int, program: Included) -> None:
        """Take a program that the mind has included."""
        if self.inputs.on:
            self.inputs.included[request] = program

    def cloned(self, other: str) -> None:
        """Note that the mind is a copy of another one, so that it cannot be rebuilt."""
        self.initial.unknown = f"it is a clone of {other}, and what that had become is not recorded"

    def _given(self, cycle: int, item: Given) -> None:
        """Take an input while the channel `activity` has subscribers."""
        if self.inputs.on:
            self.inputs.given(cycle, item)
        if type(item) is Mail:
            self.activity.given(cycle, item)

    # --- subscribers ---

    def _listened(self, channel: Channel, somebody: bool) -> None:
        """Follow whether a channel has subscribers."""
        log.debug("agent=%s trace=%s listened=%s", self._mind.name, channel, somebody)
        if somebody:
            self._heard.add(channel)
        else:
            self._heard.discard(channel)
        match channel:
            case "inputs":
                self.inputs.listen(self._put if somebody else None)
                self._count()
                if somebody:
                    self._tasks.spawn(self._put_kept())
            case "decisions":
                self._count()
            case "activity":
                self.activity.listened = somebody
                self.activity.take()
        self._hook()
        if self._heard and not self._flushing:
            self._flushing = True
            self._tasks.spawn(self._flush_periodically())

    def _hook(self) -> None:
        """Set the hooks of the mind that somebody needs; the others cost nothing."""
        inputs = self.inputs
        self._mind.on_input = self._given if self.activity.listened else inputs.given if inputs.on else None
        if inputs.listened or "decisions" in self._heard:
            self.ran = self._ran
        else:
            self.ran = inputs.ran if inputs.on else None

    def _count(self) -> None:
        recorder = self._mind.recorder
        if recorder is None:
            return
        if self.inputs.listened:
            recorder.count_all(self.inputs.decided)
        elif "decisions" in self._heard:
            recorder.count_all()
        else:
            recorder.count_none()

    async def _flush_periodically(self) -> None:
        while self._heard:
            await asyncio.sleep(PERIOD)
            self.flush()
        self._flushing = False

    # --- batches ---

    def flush(self) -> None:
        """Publish the events since the last call."""
        if "activity" in self._heard:
            events, left_out = self.activity.take()
            if events or left_out:
                self._put_record("activity", MindActivity(agent=self._agent, events=events, left_out=left_out))
        if "decisions" in self._heard:
            self._put_decisions()
        if self.inputs.listened:
            self.inputs.flush()

    def close(self, *, in_order: bool) -> None:
        """Publish the last events; `in_order`: the agent has ended without a defect."""
        self.flush()
        if in_order and self.inputs.listened:
            self.inputs.end()
        self._heard.clear()
        _all.discard(self)
        for withdraw in self._withdraw:
            withdraw()
        self._withdraw.clear()

    def _put(self, batch: InputBatch) -> None:
        record = self.inputs.record(batch)
        self._bus.put(self._keys["inputs"], msgspec.structs.replace(record, header=self._header("inputs")))

    async def _put_kept(self) -> None:
        """Publish the batches that were kept without subscribers, one in each pass of the event loop."""
        for batch in self.inputs.unpublished():
            self._put(batch)
            await asyncio.sleep(0)

    def _header(self, channel: Channel) -> Header:
        """Return the next header on a channel. Its `boot` is that of the agent: a process may have several."""
        header = self._bus.header(f"trace/{channel}", self._agent)
        return msgspec.structs.replace(header, boot=self.agent_boot)

    def _put_record(self, channel: Channel, record: MindActivity | MindDecisions) -> None:
        now, speed = self._clock.now(), self._clock.speed
        made = msgspec.structs.replace(record, header=self._header(channel), now=now, speed=speed)
        self._bus.put(self._keys[channel], made)

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
        record = MindDecisions(agent=self._agent, decisions=decisions, failures=failures, left_out=left_out)
        self._put_record("decisions", record)
        self._per_view += 0.2 * ((perf_counter() - begin) / shown - self._per_view)

    async def _answer_since_start(self, query: Query[MindInputs]) -> None:
        """Answer a query for all inputs since the agent's start, unless its key covers every agent."""
        self._subscribers.settle(self._agent)
        if not query.key.endswith("/trace/inputs"):
            return
        batches = self.inputs.since_start()
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


class TraceSubscribers:
    """Notifies the agents of one daemon which of their channels have subscribers."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        self._agents: dict[str, Follow] = {}
        self._somebody: set[Channel] = set()
        """Channels of which some agent of the fleet has subscribers."""
        self._own: dict[tuple[str, Channel], Callable[[], None]] = {}
        """What ends the listener of one agent."""
        self._listened: set[tuple[str, Channel]] = set()
        self._declaring: dict[Channel, asyncio.Task[None]] = {}
        for channel in CHANNELS:
            bus.listened(keys.trace(bus.fleet, "*", channel), partial(self._changed, channel))

    def add(self, agent: str, follow: Follow) -> None:
        """Call `follow` whenever the first subscriber to a channel of an agent appears or the last one ends."""
        self._agents[agent] = follow
        self.settle(agent)

    def settle(self, agent: str) -> None:
        """Call what is due for an agent before it answers a subscriber, who expects to hear all that follows.

        Zenoh reports the subscriber before the query that it sends next; a listener of the agent's own comes later."""
        for channel in self._somebody:
            self._listen(agent, channel)

    def remove(self, agent: str) -> None:
        """End the calls for an agent."""
        del self._agents[agent]
        for channel in CHANNELS:
            self._end(agent, channel)

    def _changed(self, channel: Channel, somebody: bool) -> None:
        if (task := self._declaring.pop(channel, None)) is not None:
            task.cancel()
        if somebody:
            self._somebody.add(channel)
            self._declaring[channel] = asyncio.get_running_loop().create_task(self._listen_to_all(channel))
            return
        self._somebody.discard(channel)
        for agent, follow in list(self._agents.items()):
            if self._end(agent, channel):
                follow(channel, False)

    def _changed_of(self, agent: str, channel: Channel, somebody: bool) -> None:
        (self._listened.add if somebody else self._listened.discard)((agent, channel))
        self._agents[agent](channel, somebody)

    async def _listen_to_all(self, channel: Channel) -> None:
        for number, agent in enumerate(list(self._agents)):
            if agent in self._agents:
                self._listen(agent, channel)
            if number % AT_ONCE == AT_ONCE - 1:
                await asyncio.sleep(0)

    def _listen(self, agent: str, channel: Channel) -> None:
        if (agent, channel) not in self._own:
            key = keys.trace(self._bus.fleet, agent, channel)
            self._own[agent, channel] = self._bus.listened(key, partial(self._changed_of, agent, channel))

    def _end(self, agent: str, channel: Channel) -> bool:
        """End the listener of one agent. Returns whether its last word was that there are subscribers."""
        if (withdraw := self._own.pop((agent, channel), None)) is not None:
            withdraw()
        there = (agent, channel) in self._listened
        self._listened.discard((agent, channel))
        return there
