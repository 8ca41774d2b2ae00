"""All key expressions of Argosy in one table, the functions that build them, and names.

A key is `argosy/{fleet}/` followed by a key of the table. The sender is in the key because access control can enforce
only keys. A name of a fleet, agent, robot or board is one chunk of a key.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
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
        raise ValueError(f"Expected a name of letters, digits, `_`, `-` or `.` that starts with a letter, got `{name}`")
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


def percepts(fleet: str, agent: str) -> str:
    """Return the key of the changes of an agent's percepts; `*` for all agents."""
    return f"{ROOT}/{fleet}/{agent}/percepts"


def percept_by_hand(fleet: str, agent: str, name: str) -> str:
    """Return the key on which a percept is given to an agent by hand; `*` for all of them."""
    return f"{ROOT}/{fleet}/{agent}/percept_by_hand/{name}"


def percept(fleet: str, agent: str, name: str) -> str:
    """Return the key of a percept of an agent, published only while there are subscribers; `**` for all of them."""
    return f"{ROOT}/{fleet}/{agent}/percept/{name}"


def action(fleet: str, agent: str, name: str) -> str:
    """Return the key of an action of an agent; `*` for the bridge's queryable."""
    return f"{ROOT}/{fleet}/{agent}/action/{name}"


def cancel(fleet: str, agent: str) -> str:
    """Return the key on which an agent cancels its actions."""
    return f"{ROOT}/{fleet}/{agent}/cancel"


def status(fleet: str, agent: str, name: str) -> str:
    """Return the key of action statuses for observers."""
    return f"{ROOT}/{fleet}/{agent}/status/{name}"


def outbox(fleet: str, agent: str) -> str:
    """Return the key on which an agent hands mail to its board's commd."""
    return f"{ROOT}/{fleet}/{agent}/outbox"


def inbox(fleet: str, agent: str) -> str:
    """Return the key on which commd hands an agent its mail."""
    return f"{ROOT}/{fleet}/{agent}/inbox"


def mail(fleet: str, receiver: str, sender: str) -> str:
    """Return the key of mail between boards, served by the receiver's commd."""
    return f"{ROOT}/{fleet}/{receiver}/mail/{sender}"


def services(fleet: str, board: str) -> str:
    """Return the key of a board's agents and services; `*` for all boards."""
    return f"{ROOT}/{fleet}/{board}/services"


def service_requests(fleet: str, board: str, agent: str) -> str:
    """Return the key of an agent's requests to its board's directory."""
    return f"{ROOT}/{fleet}/{board}/services/{agent}"


def mailboxes(fleet: str, board: str) -> str:
    """Return the key of the list of a board's mail; `*` for all boards."""
    return f"{ROOT}/{fleet}/{board}/mailboxes"


def neighbour_mail(fleet: str, agent: str) -> str:
    """Return the key of the list of mail within an agentd, by its first agent; `*` for all."""
    return f"{ROOT}/{fleet}/{agent}/neighbour_mail"


def mission(fleet: str, board: str) -> str:
    """Return the key of the mission file that a board runs; `*` for all boards."""
    return f"{ROOT}/{fleet}/{board}/mission"


def checkup(fleet: str, board: str) -> str:
    """Return the key of a board's self-check."""
    return f"{ROOT}/{fleet}/{board}/checkup"


def mind(fleet: str, agent: str) -> str:
    """Return the key of an agent's beliefs and intentions."""
    return f"{ROOT}/{fleet}/{agent}/mind"


def trace(fleet: str, agent: str, part: str) -> str:
    """Return the key of a mind's trace: `inputs`, `decisions` or `activity`; published only while there are
    subscribers."""
    return f"{ROOT}/{fleet}/{agent}/trace/{part}"


def control(fleet: str, agent: str) -> str:
    """Return the key of an operator's orders to a mind, if the mission allows them."""
    return f"{ROOT}/{fleet}/{agent}/control"


def manifest(fleet: str, robot: str) -> str:
    """Return the key on which a robot's manifest is read and changed, and published after each change."""
    return f"{ROOT}/{fleet}/{robot}/manifest"


def parameters(fleet: str, robot: str) -> str:
    """Return the key on which a vehicle's parameters are read, and one of them is set."""
    return f"{ROOT}/{fleet}/{robot}/parameters"


def stored_plan(fleet: str, robot: str) -> str:
    """Return the key on which the mission that a vehicle stores is read."""
    return f"{ROOT}/{fleet}/{robot}/stored_plan"


def stop(fleet: str, robot: str) -> str:
    """Return the key of operators' orders to a robot."""
    return f"{ROOT}/{fleet}/{robot}/stop"


def run(fleet: str, operator: str) -> str:
    """Return the key of the state of an operator's run; `*` for all operators."""
    return f"{ROOT}/{fleet}/{operator}/run"


def alive(fleet: str, name: str, daemon: str, boot: str) -> str:
    """Return the key of the liveliness token of one process of a daemon for one name."""
    return f"{ROOT}/{fleet}/{name}/alive/{daemon}/{boot}"


def health(fleet: str, name: str, daemon: str) -> str:
    """Return the key of a daemon's health."""
    return f"{ROOT}/{fleet}/{name}/health/{daemon}"


def parse(key: str) -> tuple[str, str, list[str]] | None:
    """Split `argosy/{fleet}/{name}/...` into fleet, name and the rest; None for another key."""
    chunks = key.split("/")
    if len(chunks) < 4 or chunks[0] != ROOT:
        return None
    return chunks[1], chunks[2], chunks[3:]
