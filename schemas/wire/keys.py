"""All key expressions of Argosy in one table, functions that return them, and names.

A key is `argosy/{fleet}/` followed by a key of the table. The sender is in the key because access control can enforce
only keys. A name of a fleet, agent, robot or board is one chunk of a key.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Literal, TypeAlias

from schemas.liveness import STATUS_EVERY
from schemas.wire.mind_records import MindActivity, MindDecisions, MindInputs, MindOrder, MindView
from schemas.wire.records import (
    Action,
    ActionStatus,
    BoardReport,
    BoardServices,
    Cancel,
    Checkup,
    Health,
    LiveManifest,
    Mail,
    Mailboxes,
    ManifestChange,
    Outcome,
    Perception,
    Perceptions,
    Receipt,
    Record,
    RunningMission,
    RunState,
    ServiceRequest,
    StopOrder,
)
from schemas.wire.vehicle_records import ParameterRequest, StoredPlan, VehicleParameters

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,63}")


def is_name(text: str) -> bool:
    """Whether a text is a valid name."""
    return _NAME.fullmatch(text) is not None


def check_name(name: str) -> str:
    """Return `name`. Raises ValueError for an invalid one (no `* $ ? # /`, not empty)."""
    if not is_name(name):
        expected = "a name of letters, digits, `_`, `-` or `.` that starts with a letter (a-z, A-Z)"
        raise ValueError(f"Expected {expected}, got `{name}`")
    return name


ROOT = "argosy"
Sight: TypeAlias = Literal["telemetry", "minds", "mail"]
"""Access levels of observers; each value includes those before it."""
SIGHTS: tuple[Sight, ...] = ("telemetry", "minds", "mail")


@dataclass(frozen=True)
class Channel:
    """One row of the table: a record, its key, direction and rate."""

    key: str
    """Below `argosy/{fleet}/`; `{...}` stands for one chunk."""
    kind: Literal["put", "query", "token"]
    carries: type[Record] | None
    """The record that is put, or the payload of a query."""
    answers: type[Record] | None
    """The record of replies."""
    source: str
    """The publisher or server."""
    sink: str
    """The subscriber or querier."""
    rate: float | None
    """Hz at most in normal operation; none = by events."""
    sight: Sight | None
    """The sight that an observer needs; none = it is private to source and sink."""


CHANNELS = (
    Channel("{agent}/percepts", "put", Perceptions, None, "bridged", "agentd, observers", 50, "telemetry"),
    Channel("{agent}/percept/{name}", "put", Perception, None, "bridged", "observers", 50, "telemetry"),
    Channel("{agent}/percept_by_hand/{name}", "put", Perception, None, "operator", "agentd", None, "telemetry"),
    Channel("{agent}/percept/**", "query", None, Perception, "bridged", "agentd", None, "telemetry"),
    Channel("{agent}/action/{name}", "query", Action, ActionStatus, "bridged", "agentd", 1 / STATUS_EVERY, None),
    Channel("{agent}/cancel", "query", Cancel, ActionStatus, "bridged", "agentd", None, None),
    Channel("{agent}/status/{name}", "put", ActionStatus, None, "bridged", "observers", 2, "telemetry"),
    Channel("{agent}/outbox", "query", Mail, Receipt, "commd", "agentd", None, None),
    Channel("{agent}/inbox", "query", Mail, Receipt, "agentd", "commd", None, None),
    Channel("{receiver}/mail/{sender}", "query", Mail, Receipt, "commd", "commd", None, None),
    Channel("{board}/services", "query", None, BoardServices, "commd", "agentd, commd", None, "telemetry"),
    Channel("{board}/services/{agent}", "query", ServiceRequest, BoardServices, "commd", "agentd", None, None),
    Channel("{board}/services", "put", BoardServices, None, "commd", "agentd, commd", 10, "telemetry"),
    Channel("{board}/mailboxes", "query", None, Mailboxes, "commd", "operator", None, None),
    Channel("{agent}/neighbour_mail", "query", None, Mailboxes, "agentd", "operator", None, None),
    Channel("{board}/mission", "query", None, RunningMission, "commd", "observers", None, "telemetry"),
    Channel("{board}/checkup", "query", Checkup, BoardReport, "commd", "operator, commd", None, None),
    Channel("{agent}/mind", "query", None, MindView, "agentd", "observers", 4, "minds"),
    Channel("{agent}/trace/inputs", "put", MindInputs, None, "agentd", "observers", 4, "mail"),
    Channel("{agent}/trace/inputs", "query", None, MindInputs, "agentd", "observers", None, "mail"),
    Channel("{agent}/trace/decisions", "put", MindDecisions, None, "agentd", "observers", 4, "minds"),
    Channel("{agent}/trace/activity", "put", MindActivity, None, "agentd", "observers", 4, "mail"),
    Channel("{agent}/control", "query", MindOrder, Outcome, "agentd", "operator", None, None),
    Channel("{robot}/manifest", "query", ManifestChange, LiveManifest, "bridged", "operator", None, None),
    Channel("{robot}/manifest", "put", LiveManifest, None, "bridged", "observers", None, "telemetry"),
    Channel("{robot}/parameters", "query", ParameterRequest, VehicleParameters, "bridged", "operator", None, None),
    Channel("{robot}/stored_plan", "query", None, StoredPlan, "bridged", "operator", None, None),
    Channel("{robot}/stop", "query", StopOrder, Outcome, "bridged", "operator", None, None),
    Channel("{operator}/run", "put", RunState, None, "operator", "observers", 1, "telemetry"),
    Channel("{name}/alive/{daemon}/{boot}", "token", None, None, "every daemon", "every daemon", None, "telemetry"),
    Channel(
        "{name}/health/{daemon}", "put", Health, None, "every daemon", "bridged, agentd, observers", 1, "telemetry"
    ),
)


RECORDS: dict[str, type[Record]] = {
    record.__name__: record
    for record in (one for channel in CHANNELS for one in (channel.carries, channel.answers))
    if record is not None
}
"""All records on the bus, by name."""


def channels_of(key: str) -> Iterator[Channel]:
    """Yield the channels that a key belongs to; a query's parameters may follow it."""
    if (parsed := parse(key.partition("?")[0])) is not None:
        rest = "/".join(parsed[2])
        yield from (channel for pattern, channel in _patterns() if pattern.fullmatch(rest))


@cache
def _patterns() -> tuple[tuple[re.Pattern[str], Channel], ...]:
    """Return what follows the name in the keys of each channel, as a pattern."""
    rests = (channel.key.partition("/")[2].removesuffix("**") for channel in CHANNELS)
    patterns = (re.sub(r"{\w+}", "[^/]+", rest) + (".*" if rest.endswith("/") else "") for rest in rests)
    return tuple(zip(map(re.compile, patterns), CHANNELS, strict=True))


def _with_name(rest: str) -> Callable[[str, str], str]:
    return lambda fleet, name: f"{ROOT}/{fleet}/{name}/{rest}"


def _with_two(rest: str) -> Callable[[str, str, str], str]:
    return lambda fleet, name, last: f"{ROOT}/{fleet}/{name}/{rest}/{last}"


# Functions that return a key from the fleet and the names in it, in the order of the key; each may be `*`.
percepts = _with_name("percepts")
"""Changes of an agent's percepts."""
percept_by_hand = _with_two("percept_by_hand")
"""A percept that is given to an agent by hand: agent and percept."""
percept = _with_two("percept")
"""A percept of an agent, published only while there are subscribers: agent and percept; `**` for all percepts."""
action = _with_two("action")
"""An action of an agent: agent and action; `*` for the bridge's queryable."""
cancel = _with_name("cancel")
"""Where an agent cancels its actions."""
status = _with_two("status")
"""Action statuses for observers: agent and action."""
outbox = _with_name("outbox")
"""Where an agent hands mail to its board's commd."""
inbox = _with_name("inbox")
"""Where commd hands an agent its mail."""
mail = _with_two("mail")
"""Mail between boards, served by the receiver's commd: receiver and sender."""
services = _with_name("services")
"""A board's agents and services."""
service_requests = _with_two("services")
"""An agent's requests to its board's directory: board and agent."""
mailboxes = _with_name("mailboxes")
"""The list of a board's mail."""
neighbour_mail = _with_name("neighbour_mail")
"""The list of mail within an agentd, by its first agent."""
mission = _with_name("mission")
"""The mission file that a board runs."""
checkup = _with_name("checkup")
"""A board's self-check."""
mind = _with_name("mind")
"""An agent's beliefs and intentions."""
trace = _with_two("trace")
"""A mind's trace, published only while there are subscribers: agent, and `inputs`, `decisions` or `activity`."""
control = _with_name("control")
"""An operator's orders to a mind, if the mission allows them."""
manifest = _with_name("manifest")
"""Where a robot's manifest is read and changed, and published after each change."""
parameters = _with_name("parameters")
"""Where a vehicle's parameters are read, and one of them is set."""
stored_plan = _with_name("stored_plan")
"""Where the mission that a vehicle stores is read."""
stop = _with_name("stop")
"""Operators' orders to a robot."""
run = _with_name("run")
"""The state of an operator's run."""
health = _with_two("health")
"""A daemon's health: name and daemon."""


def alive(fleet: str, name: str, daemon: str, boot: str) -> str:
    """Return the key of the liveliness token of one process of a daemon for one name."""
    return f"{ROOT}/{fleet}/{name}/alive/{daemon}/{boot}"


def parse_alive(key: str) -> tuple[str, str, str, str] | None:
    """Split the key of a liveliness token into fleet, name, daemon and boot; None for another key."""
    match parse(key):
        case (fleet, name, ["alive", daemon, boot]):
            return fleet, name, daemon, boot
    return None


def parse(key: str) -> tuple[str, str, list[str]] | None:
    """Split `argosy/{fleet}/{name}/...` into fleet, name and the rest; None for another key."""
    chunks = key.split("/")
    if len(chunks) < 4 or chunks[0] != ROOT:
        return None
    return chunks[1], chunks[2], chunks[3:]
