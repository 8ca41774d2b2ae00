"""Ports for tests that nobody else takes between their choice and their use.

They lie below the range from which the kernel gives out ports of its own accord: an outgoing connection elsewhere
cannot take one meanwhile, and a client that knocks before its server listens cannot be connected to itself. Each is
given out once in a run of the tests, so that nothing of an earlier test answers for a later one. Processes that share a
run (pytest-xdist) have ports of their own.
"""

import os
import random
import socket
from pathlib import Path

LOWEST = 12_000
_RANGE = Path("/proc/sys/net/ipv4/ip_local_port_range")
_HIGHEST = min(int(_RANGE.read_text().split()[0]) if _RANGE.exists() else 32_768, 60_000)
_given: set[int] = set()
_PROCESSES = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
_PROCESS = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
_chance = random.Random()  # unlike in two test runs on one machine


def free_port() -> int:
    """Return a loopback port that nobody uses now, neither by TCP nor by UDP."""
    for _ in range(10_000):
        port = _chance.randrange(LOWEST + _PROCESS, _HIGHEST, _PROCESSES)
        if port not in _given and _is_free(port):
            _given.add(port)
            return port
    raise AssertionError(f"no free port between {LOWEST} and {_HIGHEST}")


def neighbouring_ports(count: int) -> list[int]:
    """Return loopback ports that follow one another and that nobody uses now."""
    for _ in range(10_000):
        first = _chance.randrange(LOWEST, _HIGHEST - count)
        found = [first + index for index in range(count)]
        if not _given.intersection(found) and all(map(_is_free, found)):
            _given.update(found)
            return found
    raise AssertionError(f"no {count} free ports side by side between {LOWEST} and {_HIGHEST}")


def _is_free(port: int) -> bool:
    for kind in (socket.SOCK_STREAM, socket.SOCK_DGRAM):
        with socket.socket(socket.AF_INET, kind) as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                return False
    return True
