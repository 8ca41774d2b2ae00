"""Every key expression of Argosy, in one table (design section 4), and the functions that build them.

A key is `argosy/{fleet}/` and then what stands in the table. The sender stands in the key because only a key can be
enforced by access control.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Literal, TypeAlias

from schemas.liveness import STATUS_EVERY
from schemas.wire.mind_records import MindDecisions, MindDeeds, MindInputs, MindOrder, MindView
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
    Receipt,
    Record,
    RunningMission,
    RunState,
    ServiceRequest,
    StopOrder,
)

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]{0,63}")


def is_name(text: str) -> bool:
    """Whether a text may be a name, and so be a part of a key."""
    return _NAME.fullmatch(text) is not None


def check_name(name: str) -> str:
    """Return `name`, or raise ValueError that says what a name may be (no `* $ ? # /`, not empty)."""
    if not is_name(name):
        raise ValueError(f"Expected a name of letters, digits, `_`, `-` or `.` that starts with a letter, got `{name}`")
    return name


ROOT = "argosy"
Sight: TypeAlias = Literal["telemetry", "minds", "mail"]
"""How much of what is said an observer sees; each includes those before it."""
SIGHTS: tuple[Sight, ...] = ("telemetry", "minds", "mail")


@dataclass(frozen=True)
class Channel:
    """One row of the table: what travels where, in which direction, how often."""

    key: str
    """Below `argosy/{fleet}/`; `{...}` stands for one chunk."""
    kind: Literal["put", "query", "token"]
    carries: type[Record] | None
    """What is put, or asked with."""
    answers: type[Record] | None
    """What a query is answered with."""
    source: str
    """Who puts, or serves."""
    sink: str
    """Who subscribes, or asks."""
    rate: float | None
    """Hz at most in normal operation; none = as things happen."""
    sight: Sight | None
    """What an observer has to be allowed to see it; none = it is between source and sink."""


CHANNELS = (
    Channel("{agent}/percept/{name}", "put", Perception, None, "bridged", "agentd", 50, "telemetry"),
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
    Channel("{board}/mission", "query", None, RunningMission, "commd", "observers", None, "telemetry"),
    Channel("{board}/checkup", "query", Checkup, BoardReport, "commd", "operator, commd", None, None),
    Channel("{agent}/mind", "query", None, MindView, "agentd", "observers", 4, "minds"),
    Channel("{agent}/trace/inputs", "put", MindInputs, None, "agentd", "observers", 4, "mail"),
    Channel("{agent}/trace/inputs", "query", None, MindInputs, "agentd", "observers", None, "mail"),
    Channel("{agent}/trace/decisions", "put", MindDecisions, None, "agentd", "observers", 4, "minds"),
    Channel("{agent}/trace/deeds", "put", MindDeeds, None, "agentd", "observers", 4, "mail"),
    Channel("{agent}/control", "query", MindOrder, Outcome, "agentd", "operator", None, None),
    Channel("{robot}/manifest", "query", ManifestChange, LiveManifest, "bridged", "operator", None, None),
    Channel("{robot}/manifest", "put", LiveManifest, None, "bridged", "observers", None, "telemetry"),
    Channel("{robot}/stop", "query", StopOrder, Outcome, "bridged", "operator", None, None),
    Channel("{operator}/run", "put", RunState, None, "operator", "observers", 1, "telemetry"),
    Channel("{name}/alive/{daemon}/{boot}", "token", None, None, "every daemon", "every daemon", None, "telemetry"),
    Channel(
        "{name}/health/{daemon}", "put", Health, None, "every daemon", "bridged, agentd, observers", 1, "telemetry"
    ),
)


def percept(fleet: str, agent: str, name: str) -> str:
    """One percept of an agent; `**` for all of them."""
    return f"{ROOT}/{fleet}/{agent}/percept/{name}"


def action(fleet: str, agent: str, name: str) -> str:
    """An action of an agent; `*` for the bridge's queryable."""
    return f"{ROOT}/{fleet}/{agent}/action/{name}"


def cancel(fleet: str, agent: str) -> str:
    """Where an agent cancels its running actions."""
    return f"{ROOT}/{fleet}/{agent}/cancel"


def status(fleet: str, agent: str, name: str) -> str:
    """Action statuses for observers."""
    return f"{ROOT}/{fleet}/{agent}/status/{name}"


def outbox(fleet: str, agent: str) -> str:
    """Where an agent hands its mail to its board's commd."""
    return f"{ROOT}/{fleet}/{agent}/outbox"


def inbox(fleet: str, agent: str) -> str:
    """Where commd hands an agent its mail."""
    return f"{ROOT}/{fleet}/{agent}/inbox"


def mail(fleet: str, receiver: str, sender: str) -> str:
    """Mail between boards, served by the receiver's commd."""
    return f"{ROOT}/{fleet}/{receiver}/mail/{sender}"


def services(fleet: str, board: str) -> str:
    """The agents of a board and what they offer; `*` for all boards."""
    return f"{ROOT}/{fleet}/{board}/services"


def service_requests(fleet: str, board: str, agent: str) -> str:
    """Where an agent joins and leaves its board, offers services and looks for them."""
    return f"{ROOT}/{fleet}/{board}/services/{agent}"


def mailboxes(fleet: str, board: str) -> str:
    """What waits at the commd of a board; `*` for all boards."""
    return f"{ROOT}/{fleet}/{board}/mailboxes"


def mission(fleet: str, board: str) -> str:
    """The mission file that a board runs; `*` for all boards."""
    return f"{ROOT}/{fleet}/{board}/mission"


def checkup(fleet: str, board: str) -> str:
    """How a board is, and its links to the others."""
    return f"{ROOT}/{fleet}/{board}/checkup"


def mind(fleet: str, agent: str) -> str:
    """What an agent believes and intends."""
    return f"{ROOT}/{fleet}/{agent}/mind"


def trace(fleet: str, agent: str, part: str) -> str:
    """The course of a mind: `inputs`, `decisions` or `deeds`; put only while somebody listens."""
    return f"{ROOT}/{fleet}/{agent}/trace/{part}"


def control(fleet: str, agent: str) -> str:
    """Where an operator pauses, steps and resumes a mind and gives it goals and beliefs, if the mission allows."""
    return f"{ROOT}/{fleet}/{agent}/control"


def manifest(fleet: str, robot: str) -> str:
    """Where the manifest of a robot is read and changed, and told after each change."""
    return f"{ROOT}/{fleet}/{robot}/manifest"


def stop(fleet: str, robot: str) -> str:
    """Where the operator stops a robot."""
    return f"{ROOT}/{fleet}/{robot}/stop"


def run(fleet: str, operator: str) -> str:
    """How far the run of a mission has come, told by whoever runs it; `*` for anybody."""
    return f"{ROOT}/{fleet}/{operator}/run"


def alive(fleet: str, name: str, daemon: str, boot: str) -> str:
    """The liveliness token of one life of a daemon for one name."""
    return f"{ROOT}/{fleet}/{name}/alive/{daemon}/{boot}"


def health(fleet: str, name: str, daemon: str) -> str:
    """The health of a daemon."""
    return f"{ROOT}/{fleet}/{name}/health/{daemon}"


def parse(key: str) -> tuple[str, str, list[str]] | None:
    """Split `argosy/{fleet}/{name}/...` into fleet, name and the rest; None for a key that is not ours."""
    chunks = key.split("/")
    if len(chunks) < 4 or chunks[0] != ROOT:
        return None
    return chunks[1], chunks[2], chunks[3:]
