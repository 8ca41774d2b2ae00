"""Drivers by their name: finding them, checking manifests by them, and reading the manifest of a robot."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable, Iterable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from bridged.drivers.api import DriverKind, Order
from bridged.drivers.argument_check import order_problems
from commd.process.user_code import describe_error
from schemas.files.findings import Finding, Findings
from schemas.manifest.loader import Manifest, load_manifest
from schemas.mission.model import Robot

OURS = {
    "mavlink": "bridged.drivers.mavlink.registration",
    "zenoh": "bridged.drivers.zenoh.registration",
    "python": "bridged.drivers.python.registration",
}
GROUP = "argosy.drivers"


class NoDriver(ValueError):
    """There is no driver of a name, or it cannot be loaded."""


class DriverError(ValueError):
    """Code of a driver has raised an exception, takes too long, or has returned something else than it must."""

    def __init__(self, driver: str, what: str) -> None:
        super().__init__(f"driver `{driver}`: {what}")
        self.what = what
        """Without the driver's name."""


@cache
def find_driver(name: str) -> DriverKind:
    """Import a driver. Raises NoDriver."""
    if name in OURS:
        return cast(DriverKind, import_module(OURS[name]))
    from importlib.metadata import entry_points  # takes longer than most missions need to be read

    found = entry_points(group=GROUP)
    for entry in found.select(name=name):
        origin = "" if entry.dist is None else f" of {entry.dist.name} {entry.dist.version}"
        try:
            kind = load(entry)
        except (Exception, SystemExit) as error:  # whatever a package does when it is imported
            raise NoDriver(f"driver `{name}`{origin} cannot be loaded: {describe_error(error)}") from None
        lacking = [
            one for one in ("check_manifest", "check_robot", "make_driver") if not callable(getattr(kind, one, 0))
        ]
        if lacking:
            raise NoDriver(f"driver `{name}`{origin} has no {', '.join(lacking)}")
        return cast(DriverKind, kind)
    known = ", ".join([*OURS, *sorted({entry.name for entry in found})])
    raise NoDriver(f"no driver `{name}`, there is {known}")


def check_manifest(manifest: Manifest) -> list[Finding]:
    """Return what the drivers do not know in a manifest, and orders without an action, each at its line."""
    findings = list(order_problems(manifest))
    for name in manifest.drivers():
        try:
            findings += _checked_by(name, "check_manifest", manifest.part(name), _is_finding, "findings")
        except (NoDriver, DriverError) as error:
            where = _where_named(manifest, name)
            findings.append(manifest.finding(f"{'.'.join(where)}: {error}", *where))
    return findings


def check_robot(manifest: Manifest, robot: Robot) -> list[tuple[str, str]]:
    """Return what the drivers miss in the mission's entry of a robot: the field and the problem."""
    problems: list[tuple[str, str]] = []
    for name in manifest.drivers():
        try:
            problems += _checked_by(name, "check_robot", robot, _is_problem, "pairs of a field and its problem")
        except NoDriver:
            continue  # a finding of the manifest
        except DriverError as error:
            problems.append(("manifest", str(error)))
    return problems


def _checked_by(name: str, function: str, subject: object, fits: Callable[[object], bool], expected: str) -> list[Any]:
    """Return what a driver's check finds. Raises NoDriver, and DriverError for a check that fails or takes too long."""
    check = getattr(find_driver(name), function)
    if name in OURS:
        return list(check(subject))

    def work() -> list[Any]:
        try:
            found = check(subject)
            problems = list(found) if isinstance(found, Iterable) else [found]  # a generator does its work here
        except BaseException as error:
            raise DriverError(name, f"{function} raised {describe_error(error)}") from None
        if wrong := [one for one in problems if not fits(one)]:
            what = found if isinstance(found, str) else wrong[0]
            raise DriverError(name, f"{function} returned {what!r}, expected {expected}")
        return problems

    try:
        return cast(list[Any], _in_time(work, f"{function} of driver {name}"))
    except TimeoutError as error:
        raise DriverError(name, f"{function} hangs: {error}") from None


def _is_finding(one: object) -> bool:
    return isinstance(one, Finding)


def _is_problem(one: object) -> bool:
    return isinstance(one, tuple) and len(one) == 2 and all(isinstance(text, str) for text in one)


def orders_of(manifest: Manifest) -> frozenset[Order] | None:
    """Return the orders that a robot has, by its driver or its manifest; None if its driver does not declare them."""
    try:
        own: frozenset[Order] | None = getattr(find_driver(manifest.robot.driver), "ORDERS", None)
    except NoDriver:
        return None
    return None if own is None else own | frozenset(manifest.orders)


def _where_named(manifest: Manifest, driver: str) -> tuple[str, ...]:
    if manifest.robot.driver == driver:
        return ("robot", "driver")
    for table, entries in (("percepts", manifest.percepts), ("actions", manifest.actions)):
        for name, entry in entries.items():
            if entry.driver == driver:
                return (table, name, "driver")
    return ()


if TYPE_CHECKING:  # megabytes, for those that have no extension
    from importlib.metadata import EntryPoint

PATIENCE = 20.0
"""Upper bound of an import or a check, in wall seconds; the event loop, and with it every signal, waits for it."""
log = logging.getLogger("drivers")


def load(entry: EntryPoint) -> Any:
    """Import what an entry point names, in a thread. Raises TimeoutError and the errors of the import."""
    if entry.module not in sys.modules:
        log.info("importing %s, which `%s` names", entry.module, entry.name)
    return _in_time(entry.load, f"import {entry.module}")


def _in_time(work: Callable[[], Any], name: str) -> Any:
    """Return the result of `work`, which a thread of this name does. Raises TimeoutError and what the work raises."""
    result: list[Any] = []
    failure: list[BaseException] = []

    def run() -> None:
        try:
            result.append(work())
        except BaseException as error:
            failure.append(error)

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    thread.join(PATIENCE)
    if failure:
        raise failure[0]
    if not result:
        raise TimeoutError(f"it has not ended within {PATIENCE:g} s")
    return result[0]


def load_robot_manifest(named: str | tuple[str, ...], folder: Path) -> Manifest:
    """Read what a mission names: a shipped manifest, a TOML file, or the paper's pair of INI files, actions first.

    Raises Findings with every problem, each at its line; where there are any, also with those that the drivers see.
    """
    if isinstance(named, str):
        return load_manifest(named, folder, check_manifest)
    if len(named) != 2:
        problem = f"expected one manifest, or two: [actions_manifest, perceptions_manifest]; got {len(named)}"
        raise Findings([Finding(named[0] if named else "", 0, 0, problem)])
    from bridged.paper_format.ini_manifests import (
        load_ini_pair,  # the vocabulary of mavros is memory that others need not have
    )

    return load_ini_pair(folder / named[0], folder / named[1])
