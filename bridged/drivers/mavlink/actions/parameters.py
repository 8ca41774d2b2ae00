"""Parameters by name: read, set, and confirmed by the value that the vehicle took (facts/arducopter.md, Params).

ArduPilot answers an unknown name by silence, so it is asked for again and again for three seconds. Names differ between
versions and autopilots: both spellings are requested, and the vehicle's answer shows which it has.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Generator, Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome, Reading
from bridged.drivers.mavlink.actions.context import (
    SUCCEEDED,
    BoundAction,
    Ended,
    Part,
    ProcedureContext,
    ProcedureRun,
    Steps,
)

READ_TRIES, SET_TRIES, PULL_TRIES = 6, 3, 3
REQUESTED_TOGETHER = 50
"""Missing parameters of a list that are requested together, one by one."""
READ_EVERY, PULL_EVERY = (0.5, 0.5), (1.0, 1.0)
"""Mission and wall seconds. With a loss of 20 % each way, six tries take one known name in 500 for unknown."""
_NEW_NAMES = {"SYSID_THISMAV": "MAV_SYSID", "SYSID_MYGCS": "MAV_GCS_SYSID"}
_OLD_NAMES = {new: old for old, new in _NEW_NAMES.items()}
_RENAMED = (_NEW_NAMES, _OLD_NAMES)
_ON_PX4 = {"FENCE_RADIUS": "GF_MAX_HOR_DIST", "FENCE_ALT_MAX": "GF_MAX_VER_DIST"}
"""PX4's parameters of the same meaning and unit."""
UNKNOWN = dialect.MAV_PARAM_ERROR_DOES_NOT_EXIST
"""PARAM_ERROR.error of a name that the vehicle does not have."""
_FAILSAFE_SWITCHES = frozenset({"FS_GCS_ENABLE", "FS_GCS_ENABL", "FS_ACTION", "NAV_DLL_ACT"})
_FAILSAFE_SETTINGS = frozenset({"MAV_GCS_SYSID", "SYSID_MYGCS", "FS_GCS_TIMEOUT", "COM_DL_LOSS_T"})
_FENCE_SWITCHES = frozenset({
    "FENCE_ENABLE", "FENCE_ACTION", "FENCE_TYPE", "GF_ACTION", "GF_MAX_HOR_DIST", "GF_MAX_VER_DIST",
})  # fmt: skip
"""Switches are off at 0; another value of a setting may make the failsafe watch another station, or react late."""


def spellings(name: str) -> tuple[str, ...]:
    """Return the names that a parameter may have: ArduPilot 4.7 renamed SYSID_* and SRn_* to MAV_* and MAVn_*."""
    for names in _RENAMED:
        if name in names:
            return (name, names[name])
    if name in _ON_PX4:
        return (name, _ON_PX4[name])
    head, _, rest = name.partition("_")
    for old, new, shift in (("SR", "MAV", 1), ("MAV", "SR", -1)):
        number = head.removeprefix(old)
        if head.startswith(old) and number.isdigit() and rest and int(number) + shift >= 0:
            return (name, f"{new}{int(number) + shift}_{rest}")
    return (name,)


class Parameter(NamedTuple):
    """A parameter as the vehicle reports it."""

    name: str
    value: float
    type: int
    """MAV_PARAM_TYPE."""


def read_parameter(flight: ProcedureContext, run: ProcedureRun, name: str) -> Generator[None, None, Parameter | None]:
    """Request a parameter, under each spelling of its name. Returns it, None if the vehicle has none."""
    found = yield from _read(flight, run, sorted(spellings(name)), f"the value of {name}", enough=1)
    return next(iter(found.values()), None)


def read_parameters(
    flight: ProcedureContext, run: ProcedureRun, names: Sequence[str]
) -> Generator[None, None, dict[str, float]]:
    """Request several parameters together. Returns those that arrived."""
    what = f"the values of {names[0]} to {names[-1]}"
    found = yield from _read(flight, run, names, what, enough=len(names))
    return {name: one.value for name, one in found.items()}


def _read(
    flight: ProcedureContext, run: ProcedureRun, names: Sequence[str], what: str, enough: int
) -> Generator[None, None, dict[str, Parameter]]:
    """Request parameters until `enough` of them have arrived; `what` is awaited, for people. Returns them by name.

    An error (PARAM_ERROR) shows that there is none of a name; of a vehicle that reports none, silence is the only sign.
    """
    found: dict[str, Parameter] = {}
    awaited = dict.fromkeys(names)
    for _ in range(READ_TRIES):
        for name in awaited:
            flight.send(dialect.MAVLink_param_request_read_message(*flight.addressee, name.encode(), -1))
        until = flight.now + flight.wait(*READ_EVERY)
        while awaited and flight.now <= until:
            run.waits_for = f"{what}; {len(found)} of {enough} came" if enough > 1 else what
            yield
            match flight.message:
                case dialect.MAVLink_param_value_message(param_id=name, param_value=value, param_type=kind) if (
                    name in names
                ):
                    found[name] = Parameter(name, value, kind)
                    awaited.pop(name, None)
                    if len(found) >= enough:
                        return found
                case dialect.MAVLink_param_error_message(param_id=name, error=error) if error == UNKNOWN:
                    awaited.pop(name, None)
        if not awaited:
            break
    return found


def get_parameter(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`param_get`: the vehicle sends the value, which becomes a reading of PARAM."""
    name = str(action.arguments["name"])
    found = yield from read_parameter(flight, run, name)
    if found is None:
        return Outcome("failed", f"the vehicle knows no parameter {name}")
    flight.learn(name, found.value)
    return SUCCEEDED


def pull_parameters(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`param_pull`: the vehicle sends every parameter, each a reading of PARAM."""
    yield from pull(flight, run, lambda name, value: flight.report(Reading("PARAM", {"name": name, "value": value})))
    return SUCCEEDED


def pull(flight: ProcedureContext, run: ProcedureRun, take: Callable[[str, float], None]) -> Part:
    """Request every parameter and `take` each, by its name; lost ones are requested again."""
    indices, count, tries = set[int](), 0, 0
    while tries < PULL_TRIES:
        tries += 1
        if not count:
            flight.send(dialect.MAVLink_param_request_list_message(*flight.addressee))
        for index in sorted(set(range(count)) - indices)[:REQUESTED_TOGETHER]:
            flight.send(dialect.MAVLink_param_request_read_message(*flight.addressee, b"", index))
        until = flight.now + flight.wait(*PULL_EVERY)
        while flight.now <= until:
            yield
            message = flight.message
            if message is None or message.get_type() != "PARAM_VALUE" or message.param_index >= message.param_count:
                continue
            count = message.param_count
            if message.param_index not in indices:
                indices.add(message.param_index)
                tries = 0
                take(message.param_id, message.param_value)
                until = flight.now + flight.wait(*PULL_EVERY)
            run.feedback = {"params": float(len(indices)), "of": float(count)}
            run.waits_for = f"the rest of {count} parameters; {len(indices)} came"
            if len(indices) == count:
                return
    came = f"only {len(indices)} of {count} parameters arrived" if count else "the vehicle does not send its parameters"
    raise Ended("failed", came)


def set_parameter(flight: ProcedureContext, run: ProcedureRun, action: BoundAction) -> Steps:
    """`param_set`: the vehicle reports the requested value."""
    name, wanted = str(action.arguments["name"]), action.arguments["value"]
    if not isinstance(wanted, int | float):
        return Outcome("refused", f"a parameter's value is a number, got {wanted!r}")
    if guarded := guard(flight, name, wanted):
        return Outcome("refused", guarded)
    yield from write_parameter(flight, run, name, wanted)
    return SUCCEEDED


def guard(flight: ProcedureContext, name: str, value: float) -> str:
    """Return that a value would switch off what the mission file relies on, for people; empty = it would not.

    `value`: as ArduPilot's parameter of the name counts.
    """
    name, off = name.upper(), abs(value) < 1
    if flight.failsafe.watches and (name in _FAILSAFE_SETTINGS or (name in _FAILSAFE_SWITCHES and off)):
        return f"{name} is not set to {value:g}: the mission declares `failsafe`, which relies on it"
    if flight.limited and name in _FENCE_SWITCHES and off:
        return f"{name} is not set to {value:g}: the mission declares `limits`, and the fence stays as it is"
    return ""


def write_parameter(flight: ProcedureContext, run: ProcedureRun, name: str, wanted: float) -> Part:
    """Set a parameter to a value that fits into 32 bits, until the vehicle reports it."""
    exact = wanted
    try:
        wanted = struct.unpack("<f", struct.pack("<f", wanted))[0]  # as the vehicle will report it
    except OverflowError:
        wanted = math.inf
    if not math.isfinite(wanted):
        raise Ended("refused", f"{name}: a parameter's value is a number of 32 bits, up to 3.4e38")
    found = yield from read_parameter(flight, run, name)
    if found is None:
        raise Ended("failed", f"the vehicle knows no parameter {name}")
    kind = found.type if flight.autopilot.typed_parameters else dialect.MAV_PARAM_TYPE_REAL32
    if kind != dialect.MAV_PARAM_TYPE_REAL32:
        if not (float(exact).is_integer() and abs(exact) < 2**31):
            raise Ended("refused", f"{name} is a whole number on the vehicle, got {exact:.10g}")
        wanted = float(exact)  # its bytes are sent: all 32 bits count
    reported = None
    for _ in range(SET_TRIES):
        flight.send(dialect.MAVLink_param_set_message(*flight.addressee, found.name.encode(), wanted, kind))
        run.waits_for = f"the vehicle to take {name} = {wanted:g}"
        again = yield from read_parameter(flight, run, found.name)  # a late answer to the first question is older
        reported = reported if again is None else again.value
        if reported == wanted:
            break
    if reported is None:
        raise Ended("failed", f"{name}: {wanted:g} was asked for, and the vehicle does not report its value")
    flight.learn(name, reported)
    if reported != wanted:
        raise Ended("failed", f"{name}: {wanted:g} was asked for, the vehicle has {reported:g}")
