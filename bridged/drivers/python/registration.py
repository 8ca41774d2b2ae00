"""The Python driver as `bridged.drivers` finds it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from bridged.drivers.api import Driver, Order, Setup
from bridged.drivers.argument_check import foreign_fields
from bridged.drivers.python.plugins import TWINS, Function, Plugins, has_plugin, misfits, names
from schemas.files.findings import Finding
from schemas.manifest.loader import Manifest
from schemas.mission.model import Robot

ORDERS: frozenset[Order] = frozenset()
"""Orders of a robot of this driver without an action of its manifest."""
MAX_FUNCTIONS = 32
"""Functions that a manifest may name: each has a thread of its own."""
_FOREIGN = ("command", "message", "topic", "service", "frame", "confirm", "latch", "tolerance")
"""Fields of an action that other drivers have."""


def check_manifest(manifest: Manifest) -> Iterator[Finding]:
    """Yield a finding for each missing function and unknown field.

    A plug-in that has a twin is judged by it, so that no hardware is needed; the bridge of the real robot checks again
    when it starts.
    """
    real, twins = Plugins(simulated=False), Plugins(simulated=True)

    def function(name: str) -> Function:
        plugin = name.partition(".")[0]
        return (twins if has_plugin(plugin, TWINS) else real).function(name)

    yield from misfits(manifest, function)
    for name, action in manifest.actions.items():
        yield from foreign_fields(manifest, name, "python", _FOREIGN)
        if action.cancel == "hold" and manifest.robot.driver == "python" and "hold" not in manifest.orders:
            text = "the driver `python` cannot hold by itself: expected `hold` in `[orders]`"
            yield manifest.finding(f"actions.{name}.cancel: {text}", "actions", name, "cancel")
    if len(called := names(manifest)) > MAX_FUNCTIONS:
        text = f"{len(called)} functions are named, more than the {MAX_FUNCTIONS} that can have a thread each"
        yield Finding(manifest.file, 0, 0, text)


def check_robot(robot: Robot) -> Iterable[tuple[str, str]]:
    """Return nothing: the driver needs nothing of the mission's entry."""
    return ()


def make_driver(setup: Setup) -> Driver:
    """Make the driver of one robot. Raises Findings for functions that this run lacks."""
    from bridged.drivers.python.driver import PythonDriver

    return PythonDriver(setup)
