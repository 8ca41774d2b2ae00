"""One driver of a robot while it runs: run again when what it needs is not there, given up when it fails."""

from __future__ import annotations

import asyncio
import errno
import logging
import socket
from collections.abc import Callable

from bridged.drivers.api import Driver
from commd.process.systemd import Loop

PAUSES = (0.5, 5.0)
"""First and longest wall seconds until a driver that could not open its link is run again."""
LASTS = 1.0
"""Wall seconds that a driver must have run until what it failed by before is no warning any more."""
MAY_COME = frozenset({errno.ENOENT, errno.ENODEV, errno.ENXIO})
"""Errors of a device that is not plugged in."""
log = logging.getLogger("drivers")


class DriverSupervisor:
    """Runs a driver for as long as the bridge does."""

    def __init__(
        self, robot: str, name: str, driver: Driver, on_failure: Callable[[str], None], loop: Loop | None = None
    ) -> None:
        """`on_failure` is told why the driver does not run, each time that it has stopped. Its turns are beats of
        `loop`, from the first one after it began to wait: to open a link may take long."""
        self._loop = loop or Loop.unwatched()
        self._robot, self._name, self._driver, self._on_failure = robot, name, driver, on_failure
        self.problem = ""
        """Why the driver does not run, in words; empty while it does."""

    async def keep(self, worth_waiting: Callable[[OSError], bool]) -> None:
        """Run it until cancelled, again after each OSError that is worth waiting. Raises every other failure."""
        loop, (pause, longest) = asyncio.get_running_loop(), PAUSES
        while True:
            running = loop.call_later(LASTS, self._runs)
            loop.call_soon(self._loop.rest)  # after what the driver tells before it first waits: it opens its link then
            try:
                await self._driver.run()
                raise RuntimeError(f"driver `{self._name}` of {self._robot} has ended by itself")
            except OSError as error:
                if not worth_waiting(error):
                    raise
                self._loop.rest()
                self._failed(str(error) or type(error).__name__, "it is tried again")
            finally:
                running.cancel()
            await asyncio.sleep(pause)
            pause = min(2 * pause, longest)

    async def keep_apart(self) -> None:
        """Run it until cancelled; its failure is nobody else's, and is left at a warning."""
        try:
            await self.keep(lambda error: True)
        except Exception as error:
            self._loop.end()
            self._failed(f"{type(error).__name__}: {error}", "it is not run again before the bridge is restarted")
            await asyncio.Event().wait()

    def _runs(self) -> None:
        if self.problem:
            log.info("robot=%s driver `%s` runs again", self._robot, self._name)
        self.problem = ""

    def _failed(self, why: str, then: str) -> None:
        problem = f"driver `{self._name}` does not run: {why}; {then}"
        if problem != self.problem:
            log.error("robot=%s %s", self._robot, problem)
        self.problem = problem
        try:
            self._on_failure(problem)
        except Exception as error:  # of the bridge: the driver is tried again all the same
            asyncio.get_running_loop().call_exception_handler({"message": problem, "exception": error})


def may_come(error: OSError) -> bool:
    """Whether what a driver could not open may be there later: a device, a name; a port that is taken is not."""
    cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
    return isinstance(cause, socket.gaierror) or cause.errno in MAY_COME
