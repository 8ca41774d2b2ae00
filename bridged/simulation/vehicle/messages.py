"""What is the same in the MAVLink side of all simulated autopilots: channels, streams, lists of parameters."""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Container, Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.autopilot import Autopilot
from bridged.simulation.vehicle.notifications import Event, ItemReached, ParameterChanged
from bridged.simulation.vehicle.parameters import Parameter

SHORTEST_INTERVAL_S = 0.02
"""Faster requests are slowed to this, in vehicle seconds."""

PARAMETERS_PER_STEP = 5
"""Parameters of a requested list sent per step."""

Messages = list[dialect.MAVLink_message]
A = TypeVar("A", bound=Autopilot)


@dataclass(slots=True)
class Streams:
    """Intervals in vehicle seconds by message id; `now` is in vehicle seconds."""

    known: Container[int]
    """The messages that the vehicle can send at all."""
    defaults: Mapping[int, float]
    intervals: dict[int, float] = field(default_factory=dict)
    _due: dict[int, float] = field(default_factory=dict)
    _next_due: float | None = None
    """The least of them; None: not known."""

    def __post_init__(self) -> None:
        self.intervals = dict(self.defaults)

    def interval_us(self, message: int) -> int:
        """Return the interval in µs as in MESSAGE_INTERVAL, by message id: 0 unknown, -1 not sent."""
        if message not in self.known:
            return 0
        interval = self.intervals.get(message)
        return -1 if interval is None else round(interval * 1e6)

    def set(self, message: int, interval_us: float, now: float) -> bool:
        """Set the `interval_us` (µs; -1 stops, 0: default) of a `message` id from `now` (s).

        Returns False for an unknown one.
        """
        if message not in self.known:
            return False
        self._next_due = None
        seconds = self.defaults.get(message) if interval_us == 0 else interval_us / 1e6
        if seconds is None or seconds < 0:
            self.intervals.pop(message, None)
            self._due.pop(message, None)
        else:
            self.intervals[message] = max(SHORTEST_INTERVAL_S, seconds)
            self._due[message] = now + self.intervals[message]
        return True

    def send_now(self, message: int, now: float) -> None:
        """Let a message that is streamed be due `now`."""
        if message in self.intervals:
            self._due[message], self._next_due = now, None

    def due(self, now: float) -> list[int]:
        """Return the ids of the messages to send now."""
        if self.next_due() > now + 1e-9:
            return []
        self._next_due = None
        ready = [message for message in self.intervals if self._due.get(message, 0.0) <= now + 1e-9]
        for message in ready:
            interval = self.intervals[message]
            last = self._due.get(message, now)
            # The rhythm is kept unless the vehicle was asked nothing for long.
            self._due[message] = last + interval if last + interval > now else now + interval
        return ready

    def next_due(self) -> float:
        """Return the vehicle time in seconds at which the next message is due."""
        if self._next_due is None:
            self._next_due = min((self._due.get(message, 0.0) for message in self.intervals), default=math.inf)
        return self._next_due


@dataclass(slots=True)
class Channel:
    """One link of the vehicle: its requested streams and its outbox."""

    streams: Streams
    heard: bool = False
    list_at: int | None = None  # the parameter that comes next in a list that was asked for
    outbox: Messages = field(default_factory=list)
    station_at: float | None = None  # when the HEARTBEAT of a ground station was heard last, in vehicle seconds
    station_since: float = 0.0  # since when one is heard
    held: list[tuple[float, str, int]] = field(default_factory=list)  # texts that wait for one: since when, severity

    def take(self) -> Messages:
        """Return and clear the outbox."""
        waiting, self.outbox = self.outbox, []
        return waiting


class MessageHandler(ABC, Generic[A]):
    """The MAVLink side of one autopilot: answers messages, sends streams and news."""

    def __init__(self, autopilot: A, builders: Mapping[int, Callable[[A], dialect.MAVLink_message | None]]) -> None:
        """`builders` make the messages that can be asked for, by id; None while one has no content."""
        self.autopilot = autopilot
        self.builders = builders
        self.reboots = False
        """Whether a restart of the autopilot has been commanded."""

    @abstractmethod
    def streams(self) -> Streams:
        """Return the streams of a new link."""

    @abstractmethod
    def answer(self, message: dialect.MAVLink_message, channel: Channel) -> Messages:
        """Answer a message of another system on the channel on which it came."""

    @abstractmethod
    def notify(self, event: Event, channels: list[Channel]) -> None:
        """Send a notification on the channels that get it."""

    @abstractmethod
    def continued(self) -> Messages:
        """Return what goes on by itself, for all channels: the requests of an upload."""

    @property
    def waits(self) -> bool:
        """Whether something is to be sent soon that is no stream."""
        return False

    def regular(self) -> Messages:
        """Return what is sent regularly and is no stream, for all channels."""
        return []

    @abstractmethod
    def value_of(self, parameter: Parameter, *, named: bool = False) -> dialect.MAVLink_message:
        """Return the PARAM_VALUE of a parameter, which was asked for by its name or is reported unasked (`named`)."""

    def news(self, event: Event) -> Messages:
        """Return the messages of a notification that all autopilots send alike."""
        match event:
            case ParameterChanged(name):
                found = self.autopilot.parameters.find(name)
                return [self.value_of(found, named=True)] if found is not None else []
            case ItemReached(seq):
                return [dialect.MAVLink_mission_item_reached_message(seq)]
        return []

    def time_sync(self, message: dialect.MAVLink_message) -> Messages:
        """Answer a TIMESYNC that asks for the time."""
        return [dialect.MAVLink_timesync_message(round(self.autopilot.now * 1e9), message.ts1)]

    def sends(self, message: int) -> bool:
        """Return whether a stream is sent at all now, by message id."""
        return True

    def streamed(self, channel: Channel, now: float) -> Messages:
        """Return the streams of a channel that are due at `now` vehicle seconds."""
        built = (self.builders[message](self.autopilot) for message in channel.streams.due(now) if self.sends(message))
        return [message for message in built if message is not None]

    def listed(self, channel: Channel) -> Messages:
        """Return the next parameters of a list that was asked for on a channel."""
        if channel.list_at is None:
            return []
        found: Messages = []
        for index in range(channel.list_at, channel.list_at + PARAMETERS_PER_STEP):
            parameter = self.autopilot.parameters.at(index)
            if parameter is None:
                channel.list_at = None
                return found
            found.append(self.value_of(parameter))
        channel.list_at += PARAMETERS_PER_STEP
        return found


def parameter_name(message: dialect.MAVLink_message) -> str:
    """Return the name in a message of the parameter protocol."""
    name = message.param_id
    return name.decode(errors="replace") if isinstance(name, bytes) else str(name)
