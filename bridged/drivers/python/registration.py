"""The Python driver as `bridged.drivers` finds it."""

from __future__ import annotations

from collections.abc import Iterable

from bridged.drivers.api import Driver, Order, Setup
from schemas.files.findings import Finding
from schemas.manifest.loader import Manifest
from schemas.mission.model import Robot

ORDERS: frozenset[Order] = frozenset()
"""Orders of a robot of this driver without an action of its manifest."""


def check_manifest(manifest: Manifest) -> Iterable[Finding]:
    """Yield a finding for each missing function and unknown field.

    A plug-in that has a twin is judged by it, so that no hardware is needed; the bridge of the real robot looks again
    when it starts.
    """
    from bridged.drivers.python.plugins import check_manifest as check

    return check(manifest)


def check_robot(robot: Robot) -> Iterable[tuple[str, str]]:
    """Return nothing: the driver needs nothing of the mission's entry."""
    return ()


def make_driver(setup: Setup) -> Driver:
    """Make the driver of one robot. Raises Findings for functions that this run lacks."""
    from bridged.drivers.python.driver import PythonDriver

    return PythonDriver(setup)
