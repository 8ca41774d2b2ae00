"""The Zenoh driver as `bridged.drivers` finds it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import zenoh

from bridged.drivers.api import Driver, Order, Setup
from bridged.drivers.argument_check import fields_of, foreign_fields
from bridged.drivers.zenoh.payload_codecs import CODECS, WHOLE
from schemas.files.findings import Finding
from schemas.manifest.loader import ActionEntry, Manifest
from schemas.mission.model import Robot
from schemas.wire import keys

ORDERS: frozenset[Order] = frozenset()
"""Orders of a robot of this driver without an action of its manifest."""


def check_robot(robot: Robot) -> Iterable[tuple[str, str]]:
    """Return what is wrong with the prefix of a robot's keys; there may be none."""
    if robot.prefix and (problem := key_problem(robot.prefix)):
        yield "prefix", problem


def make_driver(setup: Setup) -> Driver:
    """Make the driver of one robot."""
    from bridged.drivers.zenoh.driver import ZenohDriver

    return ZenohDriver(setup)


_FOREIGN = ("command", "message", "call", "frame", "confirm", "tolerance")
"""Fields of an action that other drivers have."""


def check_manifest(manifest: Manifest) -> Iterator[Finding]:
    """Yield the problems of the driver's percepts and actions, each at its line."""
    if manifest.robot.driver == "zenoh" and manifest.robot.vehicle:
        yield manifest.finding("robot.vehicle: the driver `zenoh` has no vehicles", "robot", "vehicle")
    if manifest.robot.payload not in ("", *CODECS):
        expected = f"robot.payload: expected {' or '.join(CODECS)}, got `{manifest.robot.payload}`"
        yield manifest.finding(expected, "robot", "payload")
    for name, percept in manifest.percepts.items():
        if problem := key_problem(percept.source):
            yield manifest.finding(f"percepts.{name}.source: {problem}", "percepts", name, "source")
    for name, action in manifest.actions.items():
        yield from _check_action(manifest, name, action)


def key_problem(key: str) -> str:
    """Return why a text is no key of a robot, empty if it is: no wildcards, no keys of Argosy's or Zenoh's own."""
    if "*" in key or "$" in key:
        return f"`{key}`: expected a key without wildcards, such as `turtle1/pose`"
    try:
        zenoh.KeyExpr(key)
    except zenoh.ZError:
        return f"`{key}` is no Zenoh key, expected one such as `turtle1/pose`: no empty parts, no `?` or `#`"
    if key.split("/")[0] == keys.ROOT:
        return f"`{key}`: keys under `{keys.ROOT}/` are Argosy's own"
    if any(chunk.startswith("@") for chunk in key.split("/")):
        return f"`{key}`: keys with `@` are Zenoh's own"
    return ""


def _check_action(manifest: Manifest, name: str, entry: ActionEntry) -> Iterator[Finding]:
    where = ("actions", name)
    yield from foreign_fields(manifest, name, "zenoh", _FOREIGN)
    for field in ("topic", "service"):
        key = getattr(entry, field)
        if key and (problem := key_problem(key)):
            yield manifest.finding(f"actions.{name}.{field}: {problem}", *where, field)
    if not entry.topic and not entry.service and not entry.ways().keys() & set(_FOREIGN):
        expected = "expected `topic`, a key to put to, or `service`, a key to ask"
        yield manifest.finding(f"actions.{name}: {expected}", *where)
    if entry.latch and not entry.topic:
        yield manifest.finding(f"actions.{name}.latch: only a `topic` has it", *where, "latch")
    for problem in _path_problems(list(fields_of(entry))):
        yield manifest.finding(f"actions.{name}.fields: {problem}", *where, "fields" if entry.fields else "params")


def _path_problems(paths: list[str]) -> Iterator[str]:
    """Yield paths that contradict each other, or are none."""
    if WHOLE in paths and len(paths) > 1:
        yield f"`{WHOLE}` is the whole payload, there can be no other field"
        return
    places = [tuple(path.split(".")) for path in paths if path != WHOLE]
    steps: dict[tuple[str, ...], set[str]] = {}
    for place in places:
        if not all(place):
            yield f"`{'.'.join(place)}` is not a path such as `linear.x`"
            continue
        if any(other != place and other[: len(place)] == place for other in places):
            yield f"`{'.'.join(place)}` is a value, and has fields of its own"
        for depth, step in enumerate(place):
            steps.setdefault(place[:depth], set()).add(step)
    for parent, under in steps.items():
        where = ".".join(parent) or "the payload"
        numbers = {step for step in under if step.isdecimal()}
        if numbers and numbers != {str(index) for index in range(len(under))}:
            yield f"a list has the places 0, 1, ... and nothing else; {where} has {', '.join(sorted(under))}"
