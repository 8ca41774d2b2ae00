"""The Python driver as `bridged.drivers` finds it."""

from __future__ import annotations

from collections.abc import Iterable

from bridged.drivers.api import Driver, Order, Setup
from schemas.files.findings import Finding
from schemas.manifest.loader import Manifest
from schemas.mission.model import Robot

ORDERS: frozenset[Order] = frozenset()
"""What a robot of this driver can be ordered without an action of its manifest."""


def check_manifest(manifest: Manifest) -> Iterable[Finding]:
    """Say which functions there are not, and what the driver does not know.

    A plug-in that has a twin is judged by it, so that no hardware is needed; the bridge of the real robot looks again
    when it starts.
    """
    from bridged.drivers.python.manifest_validation import check_manifest as check

    return check(manifest)


def check_robot(robot: Robot) -> Iterable[tuple[str, str]]:
    """Nothing of what the mission says of a robot is needed."""
    return ()


def make_driver(setup: Setup) -> Driver:
    """Make the driver of one robot. Raises Findings for functions that it lacks in this run."""
    from bridged.drivers.python.driver import PythonDriver

    return PythonDriver(setup)
