"""The records that daemons exchange. Decoding validates them, once, where they arrive."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec

from schemas.wire.terms import Term

Finite = Annotated[float, msgspec.Meta(ge=-1e300, le=1e300)]
"""A number. MessagePack knows infinity and NaN: a daemon that passes on such a number in JSON would be refused."""
Int64 = Annotated[int, msgspec.Meta(ge=-(2**63), le=2**63 - 1)]
"""An integer: JSON writes larger ones, which cannot be stored, passed on or shown as a time."""
Boot = Annotated[str, msgspec.Meta(max_length=64)]
"""Id of a process; other boards keep it and pass it on."""
VERSION = 1
"""Major version of all records; it is part of the Encoding, and another major version is refused."""

State = Literal["accepted", "running", "succeeded", "failed", "refused", "cancelled", "timed_out"]
FINAL_STATES: frozenset[State] = frozenset({"succeeded", "failed", "refused", "cancelled", "timed_out"})

Cause = Literal[
    "operator",
    "agent_lost",
    "shutdown",
    "pilot",
    "limits",
    "lease",
    "deadline",
    "cancelled",
    "superseded",
    "busy",
    "request",
    "rights",
    "restart",
    "storage",
    "unreachable",
    "link",
    "driver",
]
"""Cause of an action that did not succeed.

- `operator`, `agent_lost`, `shutdown`: the operator, the loss of its agent, or the end of the bridge overrides it.
- `pilot`: a pilot, ground station or failsafe set the mode.
- `limits`: the mission's `limits` forbid it.
- `lease`: another agent has the robot.
- `deadline`: not done in time.
- `cancelled`: by its agent, or by hand.
- `superseded`: another action took over; `busy`: another action runs.
- `request`: the robot has no such action, or not with these arguments; `rights`: the asker may not ask.
- `restart`: the bridge was restarted; `storage`: its id cannot be stored.
- `unreachable`: its bridge gives no outcome; `link`: the bridge does not hear the robot.
- `driver`: the robot or its driver.
"""
Order = Literal["hold", "land", "rtl"]
"""An order that brings a robot to safety without its agents."""


class Record(msgspec.Struct, frozen=True, omit_defaults=True, kw_only=True):
    """A record on the wire: unknown fields are ignored and counted, new fields are optional."""


class Header(Record, frozen=True, kw_only=True):
    """Publisher, time and sequence number of a record."""

    seq: Int64 = 0
    """Sequence number, counted from 1 for each publisher and kind of record."""
    stamp: Int64 = 0
    """Unix time in nanoseconds."""
    source: str = ""
    """Name of the publisher."""
    boot: Boot = ""
    """Id of the publisher's process, up to 64 characters; a restart changes it."""


class Perception(Record, frozen=True, kw_only=True):
    """A change of an agent's percepts (the paper's listing 1)."""

    header: Header = Header()
    name: str = ""
    """May be empty in a percept put by hand: then the key has it."""
    parameters: tuple[Term, ...] = ()
    update: Literal["replace", "add", "remove"] = "replace"
    key: tuple[Int64, ...] = ()
    """Positions of the parameters that identify the belief to replace or remove; none = all of that name and arity."""


class Perceptions(Record, frozen=True, kw_only=True):
    """Changes of an agent's percepts that its bridge publishes together, in their order."""

    changes: tuple[Perception, ...] = ()


class Action(Record, frozen=True, kw_only=True):
    """A request to act (the paper's listing 2). By hand `{"parameters": [5]}` is enough."""

    header: Header = Header()
    id: str = ""
    """`agent:boot:counter`; an id is executed once."""
    agent: str = ""
    name: str = ""
    parameters: tuple[Term, ...] = ()
    deadline: Finite | None = None
    """Mission seconds from arrival to the end, at most the manifest's; none = the manifest's."""
    attempt: Int64 = 1
    """Number of requests with this id; above 1 the action is not started, only answered."""
    robot: str | None = None
    """The robot that its agent commands; the bridge of another one ignores it. None = not known."""


class ActionStatus(Record, frozen=True, kw_only=True):
    """The status of an action (the paper's listing 3): exactly one final one, with a reason if it did not succeed."""

    header: Header = Header()
    id: str
    state: State
    result: bool | None = None
    """The paper's boolean, whether it succeeded; none while it runs."""
    cause: Cause | None = None
    """Why it did not succeed; none if it did, or while it runs."""
    order: Order | None = None
    """The order that overrides it (`operator`, `agent_lost`, `shutdown`)."""
    reason: str = ""
    """For people, with the vehicle's own text."""
    feedback: dict[str, Finite] = {}
    """Progress of a long action, such as `{"distance": 12.5}`, in the units of the manifest."""
    after: Int64 | None = None
    """Seq of the last percept that was published before this status."""
    deadline: Finite | None = None
    """Mission seconds from this status to the deadline; none = the action has ended."""
    paused: bool = False
    """The operator has paused the robot: the action waits for `continue`, and its deadline does not run."""
    name: str = ""
    parameters: tuple[Term, ...] = ()

    @property
    def final(self) -> bool:
        """Whether it is the last status."""
        return self.state in FINAL_STATES


class Cancel(Record, frozen=True, kw_only=True):
    """A request of its agent, or by hand, to end a running action."""

    header: Header = Header()
    id: str


class Message(Record, frozen=True, kw_only=True):
    """Mail between agents (the paper's listing 4: `<id,sender,itlforce,receiver,data>`).

    `header.boot` (the numbering) and `header.seq` number the messages of a sender to a receiver: after number N of a
    numbering, none up to N is taken again. The first `commd` gives a number to a message without one (by hand).
    """

    header: Header = Header()
    id: str
    sender: str
    performative: str
    receiver: str
    content: Term
    in_reply_to: str = ""
    ttl: Finite | None = None
    """Time to live in wall seconds, 0 or more; none = no limit."""


class Mail(Record, frozen=True, kw_only=True):
    """A batch of messages in outbox, inbox and mail queries; those of a pair are in the order of their numbers."""

    messages: tuple[Message, ...] = ()
    numberings: tuple[str, ...] = ()
    """In an outbox query without messages: the numbering from which on the board counts the messages that it has taken,
    and the present one, which it leaves out."""


class Refusal(Record, frozen=True, kw_only=True):
    """Why a message was not taken or not delivered."""

    code: str
    """For programs. For good: `receiver_not_found`, `receiver_left`, `message_too_large` (above 1 MB),
    `not_sendable` (it cannot be kept, or not be written as a datagram), `unreadable` (by its receiver), `wrong_address`
    (not its key's sender or receiver), `too_many_senders` (of names made at run time on a board), `not_accepted`
    (`accepts` of the receiver), `set_aside` (the receiver crashed on it), `expired`, `unknown` (expired, and perhaps
    delivered), `defect`. To be sent again: `mailbox_full`, `not_absorbed`, `out_of_order` (it follows one that is
    expired)."""
    text: str = ""
    """For people, if there is more than the code."""

    def __str__(self) -> str:
        return self.text or self.code


class Receipt(Record, frozen=True, kw_only=True):
    """The reply to a batch, sent when the taken messages are on disk. The three counts add up to the batch's length."""

    taken: Int64 = 0
    """Number of messages taken, now or before."""
    refused: dict[int, Refusal] = {}
    """Messages refused for good: place in the batch, and reason."""
    later: dict[int, Refusal] = {}
    """Messages to be sent again: place in the batch, and reason. They include all later messages of the same pair, to
    keep the order."""
    numbers: dict[str, Int64] = {}
    """Messages taken, by receiver, of the numberings asked about."""


class ServiceRequest(Record, frozen=True, kw_only=True):
    """An agent's request to the directory at its board's `commd`."""

    agent: str
    do: Literal["join", "leave", "register", "deregister", "search", "subscribe"]
    """`join`: for an agent that is not in the mission. `leave`: for one that has ended for good, or starts over."""
    others: tuple[str, ...] = ()
    """In `leave`: further agents of the board that leave with it."""
    service: str = ""
    stays: bool = False
    """In `join`: it keeps its mailbox while it is away; otherwise it has left after a minute of absence."""


class MailSeen(Record, frozen=True, kw_only=True):
    """The mail clock of a board, as seen by another board."""

    boot: str = ""
    """Of the board's `commd`."""
    time: Finite = 0.0
    """The latest `mail_time` of that boot."""
    former: Finite = 0.0
    """The latest of earlier boots."""


class BoardServices(Record, frozen=True, kw_only=True):
    """The agents of a board and their services: published at each change, and queried by newcomers."""

    header: Header = Header()
    board: str = ""
    version: Int64 = 0
    """Number of changes; it is stored on disk."""
    agents: dict[str, tuple[str, ...]] = {}
    """Services of each agent of this board, of the mission or joined, present or away."""
    found: tuple[str, ...] = ()
    """In the reply to `search` and `subscribe`: the agents of the fleet that offer the service."""
    problem: str = ""
    """In a reply: why the request is refused; empty if it is fulfilled."""
    prefix: str = ""
    """Prefix of the names of agents that join this board at run time; empty = none."""
    mail_time: Finite = 0.0
    """Its mail clock on disk, in seconds; 0 = not known."""
    mail_seen: dict[str, MailSeen] = {}
    """The mail clocks of other boards, as it has seen them."""


class Queue(Record, frozen=True, kw_only=True):
    """Messages of one sender to one receiver that wait."""

    box: Literal["outbox", "inbox", "mind"]
    """`outbox`: at a `commd`, for the receiver's board; `inbox`: there, for the receiver itself; `mind`: within an
    `agentd`, for the receiver's mind."""
    sender: str
    receiver: str
    messages: Int64
    bytes: Int64 = 0
    oldest: Finite = 0.0
    """Age of the oldest message, in wall seconds."""
    state: str = ""
    """What it waits for, for people: `pi2 is away`, `next attempt in 3 s`."""


class DeadLetter(Record, frozen=True, kw_only=True):
    """A message that was given up, and why."""

    message: Message
    reason: Refusal
    stamp: Int64
    """Unix time in nanoseconds at which it was given up."""


class Mailboxes(Record, frozen=True, kw_only=True):
    """The waiting and the given up mail of a board's `commd`, or what waits within an `agentd`."""

    header: Header = Header()
    board: str = ""
    store: str = ""
    """Path of the database."""
    synchronous: str = ""
    queues: tuple[Queue, ...] = ()
    dead: tuple[DeadLetter, ...] = ()
    """The newest of them, the newest last."""
    dead_count: Int64 = 0
    """Number of all that are stored."""


RunPhase = Literal["starting", "running", "bringing_home", "done", "failed"]
"""`done` and `failed` are final: no vehicle flies, or none can be brought home from here."""


class RunState(Record, frozen=True, kw_only=True):
    """The state of a mission's run: published by `argosy run` at each change and once a second."""

    header: Header = Header()
    phase: RunPhase = "starting"
    why: str = ""
    """Why the run has failed, or why it brings its vehicles home."""
    mission_time: Finite = 0.0
    """Mission seconds from the start of the run to now, or to its end."""
    speed: Finite = 1.0
    """Mission seconds per wall second."""
    report: str = ""
    """Folder of the report; empty = none is written."""
    recording: str = ""
    """File of the recording; empty = none is made."""
    dead: tuple[str, ...] = ()
    """Daemons that ended unexpectedly and were not restarted: daemon and name, separated by a blank."""


class RunningMission(Record, frozen=True, kw_only=True):
    """The mission file as a board read it at its start."""

    header: Header = Header()
    file: str = ""
    """Name of the file, without its folder."""
    text: str = ""


OperatorOrder = Literal["hold", "land", "rtl", "release", "pause", "continue"]


class StopOrder(Record, frozen=True, kw_only=True):
    """An operator's order to a robot, which overrides every agent."""

    order: OperatorOrder


class Outcome(Record, frozen=True, kw_only=True):
    """The reply to an order: done or not, and why."""

    ok: bool
    reason: str = ""


class ManifestChange(Record, frozen=True, kw_only=True):
    """A change of a running manifest, which is applied as a whole or not at all."""

    set: dict[str, Any] = {}
    """New values by their path, such as `{"percepts.altitude.rate": 5}`; a whole entry is a mapping."""
    remove: tuple[str, ...] = ()
    """Paths of entries or single fields, such as `percepts.gps` or `percepts.altitude.ttl`; removed first."""
    version: Int64 | None = None
    """The version of the manifest that the change is for; another one refuses it; none = any version."""


class LiveManifest(Record, frozen=True, kw_only=True):
    """The present manifest of a robot."""

    header: Header = Header()
    robot: str = ""
    version: Int64 = 1
    """1 when the bridge starts, plus 1 for each change."""
    file: str = ""
    """Its file. Changes are not written there: a restarted bridge reads the file again."""
    manifest: dict[str, Any] = {}
    """The same data as in a manifest's TOML file."""
    problems: tuple[str, ...] = ()
    """Why a change was refused as a whole; none = it is in effect."""


class Note(Record, frozen=True, kw_only=False):
    """A present warning: a code for programs, a text for people."""

    code: str
    """The kind of warning; docs/guides/monitoring.md lists the codes."""
    text: str
    """For people; it may change with releases, and during the warning."""
    about: str = ""
    """The board, file, link, system, function or key concerned; empty = the daemon's own agent, robot or board."""
    value: Finite | None = None
    """A figure that may change during the warning, such as seconds or a count."""

    @property
    def identity(self) -> tuple[str, str]:
        """Identifies a warning in successive records, whatever its text and value."""
        return self.code, self.about


class AgentHealth(Record, frozen=True, kw_only=True):
    """The health of one agent in that of its daemon; `schemas.wire.health` makes one record of both."""

    drops: Int64 = 0
    """Items that its queues have dropped."""
    bad_input: Int64 = 0
    """Records that could not be decoded for it."""
    counters: dict[str, Finite] = {}
    """Those that are not 0."""
    notes: tuple[Note, ...] = ()
    lag: Finite = 0.0
    """Age of the oldest input that waits for it, in wall seconds."""
    last_error: str = ""
    """The newest error logged about it."""
    last_error_age: Finite | None = None
    """Seconds since then."""
    idle: bool | None = None
    """It has no intention, no input and nothing is due; none = not known."""
    robot: str | None = None
    """The robot that it commands by the mission that its daemon has read; empty: no robot; none = not known."""


class Health(Record, frozen=True, kw_only=True):
    """The health of a daemon, once a second; that of an `agentd` includes its agents of one board."""

    header: Header = Header()
    daemon: str = ""
    pid: Int64 = 0
    uptime: Finite = 0.0
    """Seconds."""
    cpu: Finite = 0.0
    """CPU seconds of the process."""
    drops: Int64 = 0
    """Items that queues have dropped."""
    bad_input: Int64 = 0
    """Records or packets that could not be decoded."""
    counters: dict[str, Finite] = {}
    percepts: dict[str, str] = {}
    """Digest of the present percept set per agent (bridges only)."""
    paused: bool = False
    """The operator has paused the robot (bridges only)."""
    ordered: Order | None = None
    """The operator's order that is in force until `release` (bridges only)."""
    notes: tuple[Note, ...] = ()
    """Present warnings."""
    version: str = ""
    """Of Argosy; empty = not known."""
    restarts: Int64 | None = None
    """Restarts after a failure since the machine's boot; none = not known."""
    lag: Finite = 0.0
    """Delay of the daemon in wall seconds: the worst of its event loop in the last second, or the age of the oldest
    input that waits for the agent."""
    errors: Int64 = 0
    """Errors logged."""
    last_error: str = ""
    """The newest of them; or how the process before this one failed."""
    last_error_age: Finite | None = None
    """Seconds since then; none = not known, as it was before this process."""
    idle: bool | None = None
    """Of an agent: it has no intention, no input and nothing is due; none = not known."""
    agents: dict[str, AgentHealth] = {}
    """The agents of the board that this process runs (`agentd` only)."""
    left_out: Int64 = 0
    """Counters and notes of agents for which the record has no room."""


class Checkup(Record, frozen=True, kw_only=True):
    """A query of a board by `argosy doctor`, or by other boards on its behalf."""

    links: bool = False
    """Whether it must measure its links to the other boards first, which takes some seconds."""
    filler: str = ""
    """Ignored: the time of its transmission shows the rate of the link."""


class LinkReport(Record, frozen=True, kw_only=True):
    """The link from one board to another."""

    board: str
    asked: Int64 = 0
    """Round trips tried."""
    answered: Int64 = 0
    round_trip: Finite | None = None
    """Wall seconds of the fastest."""
    slowest: Finite | None = None
    """Wall seconds of the slowest."""
    ahead: Finite | None = None
    """Seconds by which the other clock is ahead, within half the fastest round trip."""
    rate: Finite | None = None
    """Bytes per second to it; none = not measured, or too fast to measure."""
    problem: str = ""
    """Why something was not measured, for people."""


class BoardReport(Record, frozen=True, kw_only=True):
    """The reply of a board's `commd`; `header.stamp` is its clock."""

    header: Header = Header()
    board: str = ""
    state: str = ""
    """Folder of its mail."""
    disk_free: Int64 | None = None
    """Free bytes there."""
    disk_size: Int64 | None = None
    """Bytes of that file system."""
    links: tuple[LinkReport, ...] = ()
    """To the other boards of the mission, if asked for."""
