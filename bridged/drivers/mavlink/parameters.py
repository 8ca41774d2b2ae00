"""Parameters by name: read, set, and confirmed by the value that the vehicle took (facts/arducopter.md, Params).

An unknown name is answered by silence, so it is asked for again and again for three seconds. Names differ between
versions of ArduPilot: both spellings are asked for, and the vehicle's answer tells which it has.
"""

from __future__ import annotations

import struct
from collections.abc import Generator

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.flight import SUCCEEDED, Call, Flight, Steps, Task
from bridged.drivers.robot import Outcome, Reading

READ_TRIES, SET_TRIES, PULL_TRIES = 6, 3, 3
AT_ONCE = 50
"""Parameters of a list that are asked for one by one at once, if they did not come with it."""
READ_EVERY, PULL_EVERY = (0.5, 0.5), (1.0, 1.0)
"""Mission and wall seconds. With every fifth packet lost each way, six tries call one known name in 500 unknown."""
_NEW_NAMES = {"SYSID_THISMAV": "MAV_SYSID", "SYSID_MYGCS": "MAV_GCS_SYSID"}
_OLD_NAMES = {new: old for old, new in _NEW_NAMES.items()}
_RENAMED = (_NEW_NAMES, _OLD_NAMES)


def spellings(name: str) -> tuple[str, ...]:
    """The names that a parameter may have: ArduPilot 4.7 renamed SYSID_* and SRn_* to MAV_* and MAVn_*."""
    for names in _RENAMED:
        if name in names:
            return (name, names[name])
    head, _, rest = name.partition("_")
    for old, new, shift in (("SR", "MAV", 1), ("MAV", "SR", -1)):
        number = head.removeprefix(old)
        if head.startswith(old) and number.isdigit() and rest and int(number) + shift >= 0:
            return (name, f"{new}{int(number) + shift}_{rest}")
    return (name,)


def read_parameter(flight: Flight, task: Task, name: str) -> Generator[None, None, tuple[str, float] | None]:
    """Ask for a parameter. Returns its name on the vehicle and its value, None if the vehicle knows none."""
    names = spellings(name)
    for _ in range(READ_TRIES):
        for one in names:
            _request(flight, one)
        task.waits_for = f"the value of {name}"
        until = flight.now + flight.wait(*READ_EVERY)
        while flight.now <= until:
            yield
            message = flight.message
            if message is not None and message.get_type() == "PARAM_VALUE" and message.param_id in names:
                return message.param_id, message.param_value
    return None


def get_parameter(flight: Flight, task: Task, call: Call) -> Steps:
    """`param_get`: the vehicle tells the value, which becomes a reading of PARAM."""
    name = str(call.arguments["name"])
    found = yield from read_parameter(flight, task, name)
    if found is None:
        return Outcome("failed", f"the vehicle knows no parameter {name}")
    flight.learn(name, found[1])
    return SUCCEEDED


def pull_parameters(flight: Flight, task: Task, call: Call) -> Steps:
    """`param_pull`: the vehicle tells every parameter, each a reading of PARAM; what was lost is asked for again."""
    told, count, tries = set[int](), 0, 0
    identity = flight.commands.identity
    while tries < PULL_TRIES:
        tries += 1
        if not count:
            flight.send(dialect.MAVLink_param_request_list_message(identity.vehicle, identity.autopilot))
        for index in sorted(set(range(count)) - told)[:AT_ONCE]:
            flight.send(dialect.MAVLink_param_request_read_message(identity.vehicle, identity.autopilot, b"", index))
        until = flight.now + flight.wait(*PULL_EVERY)
        while flight.now <= until:
            yield
            message = flight.message
            if message is None or message.get_type() != "PARAM_VALUE" or message.param_index >= message.param_count:
                continue
            count = message.param_count
            if message.param_index not in told:
                told.add(message.param_index)
                tries = 0
                flight.tell(Reading("PARAM", {"name": message.param_id, "value": message.param_value}))
                until = flight.now + flight.wait(*PULL_EVERY)
            task.feedback = {"params": float(len(told)), "of": float(count)}
            task.waits_for = f"the rest of {count} parameters; {len(told)} came"
            if len(told) == count:
                return SUCCEEDED
    came = f"{len(told)} of {count} parameters came" if count else "the vehicle does not tell its parameters"
    return Outcome("failed", came)


def set_parameter(flight: Flight, task: Task, call: Call) -> Steps:
    """`param_set`: the vehicle tells that it has the value that was asked for."""
    name, wanted = str(call.arguments["name"]), _as_float32(call.arguments["value"])
    failure = yield from write_parameter(flight, task, name, wanted)
    return failure or SUCCEEDED


def write_parameter(flight: Flight, task: Task, name: str, wanted: float) -> Generator[None, None, Outcome | None]:
    """Set a parameter. Returns the failure, None if the vehicle has taken the value."""
    found = yield from read_parameter(flight, task, name)
    if found is None:
        return Outcome("failed", f"the vehicle knows no parameter {name}")
    theirs, told = found[0], None
    identity = flight.commands.identity
    for _ in range(SET_TRIES):
        flight.send(
            dialect.MAVLink_param_set_message(
                identity.vehicle, identity.autopilot, theirs.encode(), wanted, dialect.MAV_PARAM_TYPE_REAL32
            )
        )
        task.waits_for = f"the vehicle to take {name} = {wanted:g}"
        again = yield from read_parameter(flight, task, theirs)  # a late answer to the first question is older
        told = told if again is None else again[1]
        if told == wanted:
            break
    if told is None:
        return Outcome("failed", f"{name}: {wanted:g} was asked for, and the vehicle does not tell what it has")
    flight.learn(name, told)
    return None if told == wanted else Outcome("failed", f"{name}: {wanted:g} was asked for, the vehicle has {told:g}")


def _request(flight: Flight, name: str) -> None:
    identity = flight.commands.identity
    flight.send(dialect.MAVLink_param_request_read_message(identity.vehicle, identity.autopilot, name.encode(), -1))


def _as_float32(value: object) -> float:
    if not isinstance(value, int | float):
        raise TypeError(f"a parameter's value is a number, got {value!r}")
    return float(struct.unpack("<f", struct.pack("<f", float(value)))[0])
