"""Commands to a vehicle: sent, repeated, acknowledged. Pure: messages and time go in and out.

MAVLink devguide, command.md: the same command is sent again with `confirmation` counted up; IN_PROGRESS lengthens the
wait; one instance of a command at a time. An acknowledgement proves little (facts/arducopter.md), so nothing here says
that a command has worked.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from pymavlink.dialects.v20 import ardupilotmega as dialect

from schemas.manifest.loader import Retry

IN_PROGRESS_WAIT = 3.0
"""Wall seconds of patience after an acknowledgement that says IN_PROGRESS."""
MAX_WAITING = 64
"""Commands that may wait for their turn."""

Parameters = tuple[float, float, float, float, float, float, float]


@dataclass(frozen=True, slots=True)
class Identity:
    """Our MAVLink ids, and the vehicle's."""

    system: int
    component: int
    vehicle: int
    autopilot: int = dialect.MAV_COMP_ID_AUTOPILOT1

    @property
    def addressee(self) -> tuple[int, int]:
        """System and component of the vehicle's autopilot, the target of our messages."""
        return self.vehicle, self.autopilot

    def is_addressed(self, message: dialect.MAVLink_message) -> bool:
        """Whether a message is for us: for our ids, for our system, or for anybody (0/0)."""
        to = (message.target_system, message.target_component)
        return to in ((self.system, self.component), (self.system, 0), (0, 0))


@dataclass(eq=False)
class MavlinkCommand:
    """One command and its result."""

    number: int
    parameters: Parameters
    retry: Retry
    may_repeat: Callable[[], bool] = lambda: True
    """Asked before each repetition: a takeoff that has begun must not be sent again."""
    seen_at: Callable[[], float] = lambda: math.inf
    """When the vehicle was last seen to be in nobody else's hands, in mission seconds: a repetition waits for that."""
    frame: int | None = None
    """The frame of its place if it goes as COMMAND_INT; none = COMMAND_LONG."""
    component: int = 0
    """The component of the vehicle's system that it is for; 0 = the autopilot."""
    sent: int = 0
    next_at: float = 0.0
    result: int | None = None
    """MAV_RESULT of the acknowledgement."""
    silent: bool = False
    """Sent as often as allowed, and nothing answered."""
    abandoned: bool = False

    @property
    def name(self) -> str:
        """Such as `MAV_CMD_NAV_TAKEOFF`."""
        entry = dialect.enums["MAV_CMD"].get(self.number)
        return entry.name if entry else f"command {self.number}"

    @property
    def accepted(self) -> bool:
        """Whether the vehicle acknowledged with ACCEPTED."""
        return bool(self.result == dialect.MAV_RESULT_ACCEPTED)

    @property
    def refused(self) -> bool:
        """Whether the vehicle refused."""
        return self.result is not None and not self.accepted

    @property
    def result_name(self) -> str:
        """Such as `FAILED`."""
        entry = dialect.enums["MAV_RESULT"].get(self.result)
        return entry.name.removeprefix("MAV_RESULT_") if entry else f"result {self.result}"

    @property
    def over(self) -> bool:
        """Whether no answer of the vehicle is expected."""
        return self.result is not None or self.silent or self.abandoned


class Commands:
    """The commands that are under way to one vehicle; to each component of each kind one at a time, the others wait.

    `speed` is mission seconds per wall second; `now` is in mission seconds.
    """

    def __init__(self, identity: Identity, speed: float, send: Callable[[dialect.MAVLink_message], None]) -> None:
        self.identity = identity
        self.repeated = 0
        """Commands sent again so far."""
        self.unmatched = 0
        """Acknowledgements so far that were for somebody else, or for nothing that is under way."""
        self._patience = max(1.0, speed)
        self._send = send
        self._queues: dict[tuple[int, int], deque[MavlinkCommand]] = {}
        """By component and number."""

    def submit(self, command: MavlinkCommand, now: float) -> MavlinkCommand:
        """Send a command, now or after those of the same kind."""
        queue = self._queues.setdefault((command.component, command.number), deque())
        if len(queue) >= MAX_WAITING:
            command.silent = True
            return command
        queue.append(command)
        self.tick(now)
        return command

    def abandon(self, command: MavlinkCommand) -> None:
        """Send it no more; a late acknowledgement does not count."""
        command.abandoned = True

    def clear(self) -> None:
        """Give up all commands, as when the link is lost."""
        for queue in self._queues.values():
            for command in queue:
                command.silent = True
        self._queues.clear()

    def acknowledge(self, ack: dialect.MAVLink_message, now: float, component: int = 0) -> None:
        """Take in a COMMAND_ACK of the autopilot, or of another `component` of the vehicle.

        Target 0/0 means anybody (autopilots before MAVLink 2).
        """
        queue = self._queues.get((component, ack.command))
        if not self.identity.is_addressed(ack) or not queue or not queue[0].sent:
            self.unmatched += 1
            return
        if ack.result == dialect.MAV_RESULT_IN_PROGRESS:
            queue[0].next_at = now + IN_PROGRESS_WAIT * self._patience
            return
        queue[0].result = ack.result
        self.tick(now)

    def tick(self, now: float) -> None:
        """Send the commands that are due at this time, in mission seconds."""
        for key, queue in list(self._queues.items()):
            while queue and self._advance(queue[0], now):
                queue.popleft()
            if not queue:
                self._queues.pop(key, None)

    def _advance(self, command: MavlinkCommand, now: float) -> bool:
        """Move one command on; True if it is over."""
        if command.over or now < command.next_at:
            return command.over
        if command.sent > command.retry.times or (command.sent and not command.may_repeat()):
            command.silent = True
            return True
        if command.sent and command.seen_at() < command.next_at:
            return False
        to = (self.identity.vehicle, command.component or self.identity.autopilot)
        number, again = command.number, min(command.sent, 255)
        if command.frame is None:
            self._send(dialect.MAVLink_command_long_message(*to, number, again, *command.parameters))
        else:
            *first, latitude, longitude, altitude = command.parameters
            place = (_degrees_e7(latitude), _degrees_e7(longitude), altitude)
            self._send(dialect.MAVLink_command_int_message(*to, command.frame, number, 0, 0, *first, *place))
        self.repeated += command.sent > 0
        command.sent += 1
        command.next_at = now + float(command.retry.every) * self._patience
        return False


NO_PLACE = 2**31 - 1
"""Latitude or longitude of a COMMAND_INT that names no place."""


def _degrees_e7(degrees: float) -> int:
    return NO_PLACE if math.isnan(degrees) else round(degrees * 1e7)
