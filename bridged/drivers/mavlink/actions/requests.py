"""Messages that a procedure asks the vehicle for and waits for, and those that it waits for alone."""

from __future__ import annotations

from collections.abc import Callable, Generator

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.context import ProcedureContext, Task
from bridged.drivers.mavlink.vehicle.commands import Command
from bridged.drivers.mavlink.vehicle.streams import message_number
from schemas.manifest.loader import Retry

ASK_EVERY = (0.5, 0.3)
"""Mission and wall seconds between requests for a message that a procedure looks at."""
ONCE = Retry(times=0)

Fits = Callable[[dialect.MAVLink_message], bool]


class Poll:
    """Asks for one message again and again (MAV_CMD_REQUEST_MESSAGE), while its owner looks at it."""

    def __init__(self, flight: ProcedureContext, task: Task, name: str, every: tuple[float, float] = ASK_EVERY) -> None:
        self._flight, self._task, self._every = flight, task, every
        self._number = float(message_number(name))
        self._at = flight.now
        self._last: Command | None = None

    def __call__(self) -> None:
        """Ask if it is time; what is still under way of the last request is given up: its answer may be lost."""
        flight = self._flight
        if flight.now < self._at:
            return
        self._at = flight.now + flight.wait(*self._every)
        parameters = (self._number, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
        if self._last is not None:
            flight.commands.abandon(self._last)
            self._task.commands.remove(self._last)
        self._last = flight.submit(self._task, dialect.MAV_CMD_REQUEST_MESSAGE, parameters, ONCE)


def next_message(
    flight: ProcedureContext, name: str, patience: tuple[float, float], fits: Fits = lambda message: True
) -> Generator[None, None, dialect.MAVLink_message | None]:
    """Wait for a message that fits. Returns None if none comes in time."""
    until = flight.now + flight.wait(*patience)
    while flight.now <= until:
        yield
        message = flight.message
        if message is not None and message.get_type() == name and fits(message):
            return message
    return None


def asked_message(
    flight: ProcedureContext,
    task: Task,
    name: str,
    patience: tuple[float, float],
    fits: Fits = lambda message: True,
) -> Generator[None, None, dialect.MAVLink_message | None]:
    """Ask for a message until one comes that fits. Returns None if none comes in time."""
    poll, until = Poll(flight, task, name), flight.now + flight.wait(*patience)
    while flight.now <= until:
        poll()
        yield
        message = flight.message
        if message is not None and message.get_type() == name and fits(message):
            return message
    return None


def for_us(flight: ProcedureContext, message: dialect.MAVLink_message) -> bool:
    """Whether a message of the mission protocol is for us: other ground stations speak it too."""
    identity = flight.commands.identity
    return (message.target_system, message.target_component) in (
        (identity.system, identity.component),
        (identity.system, 0),
        (0, 0),
    )
