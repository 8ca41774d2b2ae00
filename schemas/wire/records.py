"""The records that daemons exchange (design section 3). Decoded, which is validated, once at the edge."""

from __future__ import annotations

from typing import Any, Literal

import msgspec

from schemas.wire.terms import Term

VERSION = 1
"""Major version of every record on the wire; it stands in the Encoding and another major version is refused."""

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
    "driver",
]
"""Why an action did not succeed.

- `operator`, `agent_lost`, `shutdown`: the operator, the loss of its agent, or the end of the bridge overrides it.
- `pilot`: others (pilot, ground station or failsafe) set the mode.
- `limits`: the mission's `limits` forbid it.
- `lease`: another agent has the robot.
- `deadline`: not done in time.
- `cancelled`: by its agent, or by hand.
- `superseded`: another action took over; `busy`: another action runs.
- `request`: the robot has no such action, or not with these arguments; `rights`: whoever asked may not ask.
- `restart`: the bridge was restarted; `storage`: its id cannot be kept on disk.
- `unreachable`: its bridge gives no outcome.
- `driver`: the robot or its driver.
"""
Order = Literal["hold", "land", "rtl"]
"""What brings a robot to safety without its agents."""


class Record(msgspec.Struct, frozen=True, omit_defaults=True, kw_only=True):
    """A record on the wire: unknown fields are ignored and counted, new fields are optional."""


class Header(Record, frozen=True, kw_only=True):
    """Who said it, when, and in which order."""

    seq: int = 0
    """Counts up by one for each record of this publisher and kind."""
    stamp: int = 0
    """Unix time in nanoseconds."""
    source: str = ""
    """Name of the publisher."""
    boot: str = ""
    """Which life of the publisher: changes whenever it starts again."""


class Perception(Record, frozen=True, kw_only=True):
    """A change of what an agent perceives (the paper's listing 1)."""

    header: Header = Header()
    name: str = ""
    """By hand it may be missing: then it is the key's."""
    parameters: tuple[Term, ...] = ()
    update: Literal["replace", "add", "remove"] = "replace"
    key: tuple[int, ...] = ()
    """Positions of the parameters that identify the belief to replace or remove; none = all of that name and arity."""


class Action(Record, frozen=True, kw_only=True):
    """A request to act (the paper's listing 2). By hand `{"parameters": [5]}` is enough: the rest is filled in."""

    header: Header = Header()
    id: str = ""
    """`agent:boot:counter`; an id is executed once."""
    agent: str = ""
    name: str = ""
    parameters: tuple[Term, ...] = ()
    deadline: float | None = None
    """Mission seconds from arrival until it must have ended, at most the manifest's; none = the manifest's."""
    attempt: int = 1
    """How often this id was asked for; above 1 it is never started, only answered."""


class ActionStatus(Record, frozen=True, kw_only=True):
    """What became of an action (the paper's listing 3): exactly one final state, and a reason if not succeeded."""

    header: Header = Header()
    id: str
    state: State
    result: bool | None = None
    """The paper's boolean: did it succeed; none while it runs."""
    cause: Cause | None = None
    """Why it did not succeed; none if it did, or still runs."""
    order: Order | None = None
    """The order that overrides it (`operator`, `agent_lost`, `shutdown`)."""
    reason: str = ""
    """For people, with the vehicle's own text."""
    feedback: dict[str, float] = {}
    """Progress of a long action, such as `{"distance": 12.5}`, in the units of the manifest."""
    after: int | None = None
    """Seq of the last percept that was published before this status."""
    deadline: float | None = None
    """Mission seconds from this status until the action will have ended; none = it has."""
    paused: bool = False
    """The operator has paused the robot: the action waits for `continue`, and its deadline does not run."""
    name: str = ""
    parameters: tuple[Term, ...] = ()

    @property
    def final(self) -> bool:
        """Whether nothing more follows."""
        return self.state in FINAL_STATES


class Cancel(Record, frozen=True, kw_only=True):
    """A request to end a running action: of the agent whose it is, or by hand."""

    header: Header = Header()
    id: str


class Message(Record, frozen=True, kw_only=True):
    """Mail between agents (the paper's listing 4: `<id,sender,itlforce,receiver,data>`).

    `header.boot` and `header.seq` number the messages of a pair of sender and receiver: whoever has taken number N of a
    numbering takes no message of it up to N again. A message without number (by hand) gets one from the first `commd`.
    """

    header: Header = Header()
    id: str
    sender: str
    performative: str
    receiver: str
    content: Term
    in_reply_to: str = ""
    ttl: float | None = None
    """Wall seconds from now after which it is not to be delivered any more; none = it waits for ever."""


class Mail(Record, frozen=True, kw_only=True):
    """A batch of messages: outbox, inbox and mail queries carry them, those of a pair in the order of their numbers."""

    messages: tuple[Message, ...] = ()
    numberings: tuple[str, ...] = ()
    """Of an outbox's query without messages: a numbering of the sender's, of which and of all later ones the board is
    to say how much it has taken, and the present one, which is left out."""


class Refusal(Record, frozen=True, kw_only=True):
    """Why a message was not taken or not delivered."""

    code: str
    """What programs act on. For good: `receiver_not_found`, `receiver_left`, `message_too_large` (above 1 MB),
    `not_sendable` (it cannot be kept, or not be written as a datagram), `unreadable` (by its receiver), `wrong_address`
    (not its key's sender or receiver), `not_accepted` (`accepts` of the receiver), `set_aside` (the receiver died at
    it), `expired`, `unknown` (expired, and perhaps delivered), `defect`. To be sent again: `mailbox_full`,
    `not_absorbed`, `out_of_order` (it follows one that is expired)."""
    text: str = ""
    """For people, if there is more to say than the code does."""

    def __str__(self) -> str:
        return self.text or self.code


class Receipt(Record, frozen=True, kw_only=True):
    """The answer to a batch, sent when what was taken is on disk. The three counts together are the batch's length."""

    taken: int = 0
    """Messages that are taken, now or before."""
    refused: dict[int, Refusal] = {}
    """Place in the batch to the reason why that message is refused for good."""
    later: dict[int, Refusal] = {}
    """Place in the batch to the reason why that message is to be sent again. Of a pair, all that follow one of these
    are among them, so that order is kept."""
    numbers: dict[str, int] = {}
    """Receiver to how many messages the board has taken, of the numberings that were asked about."""


class ServiceRequest(Record, frozen=True, kw_only=True):
    """What an agent asks of the directory at its board's `commd`."""

    agent: str
    do: Literal["join", "leave", "register", "deregister", "search", "subscribe"]
    """`join` and `leave`: an agent that the mission does not name begins and ends."""
    service: str = ""
    stays: bool = False
    """Of `join`: it keeps its mailbox while it is away; else it has left when it has been gone for a minute."""


class MailSeen(Record, frozen=True, kw_only=True):
    """How far the mail file of a board had come, as another board has seen it."""

    boot: str = ""
    """The life of the board's `commd`."""
    time: float = 0.0
    """The latest `mail_time` of that life."""
    former: float = 0.0
    """The latest of the lives before it."""


class BoardServices(Record, frozen=True, kw_only=True):
    """The agents of a board and what they offer: put at each change and asked for by whoever joins."""

    header: Header = Header()
    board: str = ""
    version: int = 0
    """Counts up with each change; it is on disk and survives the board's restart."""
    agents: dict[str, tuple[str, ...]] = {}
    """The services of each agent that lives on this board, of the mission or not, there or away."""
    found: tuple[str, ...] = ()
    """In the answer to `search` and `subscribe`: the agents of the whole fleet that offer the service."""
    problem: str = ""
    """In an answer: why the request is not fulfilled; empty if it is."""
    prefix: str = ""
    """What the names of agents made on this board at run time begin with; empty = anything."""
    mail_time: float = 0.0
    """How far its mail file has come: seconds of a clock of its own that are on disk; 0 = it does not say."""
    mail_seen: dict[str, MailSeen] = {}
    """What it has seen of the mail files of other boards."""


class Queue(Record, frozen=True, kw_only=True):
    """Messages of one sender to one receiver that wait at a `commd`."""

    box: Literal["outbox", "inbox"]
    """`outbox`: for the receiver's board; `inbox`: for the receiver itself."""
    sender: str
    receiver: str
    messages: int
    bytes: int = 0
    oldest: float = 0.0
    """Wall seconds for which the first one has waited."""
    state: str = ""
    """What it waits for, in words: `pi2 is away`, `next attempt in 3 s`."""


class DeadLetter(Record, frozen=True, kw_only=True):
    """A message that will not be delivered, and why."""

    message: Message
    reason: Refusal
    stamp: int
    """Unix time in nanoseconds when it was given up."""


class Mailboxes(Record, frozen=True, kw_only=True):
    """What waits at a board's `commd`, and what it has given up."""

    header: Header = Header()
    board: str = ""
    store: str = ""
    """Path of the database."""
    synchronous: str = ""
    queues: tuple[Queue, ...] = ()
    dead: tuple[DeadLetter, ...] = ()
    """The newest of them, the newest last."""
    dead_count: int = 0
    """All that are kept."""


RunPhase = Literal["starting", "flying", "bringing_home", "done", "failed"]
"""`done` and `failed` are final: nothing flies any more, or nobody here can bring it home."""


class RunState(Record, frozen=True, kw_only=True):
    """How far a run of a mission has come: put by `argosy run` at each change and once a second."""

    header: Header = Header()
    phase: RunPhase = "starting"
    why: str = ""
    """Why the run has failed, or why it brings its vehicles home."""
    mission_time: float = 0.0
    """Mission seconds since the run began; from `done` or `failed` on, when it ended."""
    speed: float = 1.0
    """Mission seconds in a wall second."""
    report: str = ""
    """Folder of the report; empty = none is written."""
    recording: str = ""
    """File of the recording; empty = none is made."""
    dead: tuple[str, ...] = ()
    """What ended although nobody told it to, and was not started again: daemon and name with a blank between them."""


class RunningMission(Record, frozen=True, kw_only=True):
    """The mission file as a board has read it at its start."""

    header: Header = Header()
    file: str = ""
    """Name of the file, without its folder."""
    text: str = ""


OperatorOrder = Literal["hold", "land", "rtl", "release", "pause", "continue"]


class StopOrder(Record, frozen=True, kw_only=True):
    """An operator's order to a robot; it stands above every agent."""

    order: OperatorOrder


class Outcome(Record, frozen=True, kw_only=True):
    """The answer to an order: done or not, and why."""

    ok: bool
    reason: str = ""


class ManifestChange(Record, frozen=True, kw_only=True):
    """A change of a running manifest: checked as a whole, and carried out as a whole or not at all."""

    set: dict[str, Any] = {}
    """New values by their path, such as `{"percepts.altitude.rate": 5}`; a whole entry is a mapping."""
    remove: tuple[str, ...] = ()
    """Paths of entries or single fields, such as `percepts.gps` or `percepts.altitude.ttl`; taken out first."""
    version: int | None = None
    """The change is for this version of the manifest and refused by any other; none = whichever there is."""


class LiveManifest(Record, frozen=True, kw_only=True):
    """The manifest that a robot runs by now."""

    header: Header = Header()
    robot: str = ""
    version: int = 1
    """Counts up by one for each change; 1 is what the bridge has read at its start."""
    file: str = ""
    """Where it comes from. Changes are not written there: a restarted bridge reads the file again."""
    manifest: dict[str, Any] = {}
    """The same data as in a manifest's TOML file."""
    problems: tuple[str, ...] = ()
    """Why a change was refused, all of it; none = it is in effect."""


class Note(Record, frozen=True, kw_only=False):
    """A warning that holds now: a code for programs, a text for people."""

    code: str
    """The kind of warning; docs/guides/monitoring.md lists the codes."""
    text: str
    """For people; it changes with releases and while the warning holds."""
    about: str = ""
    """The board, file, link, system, function or key concerned; empty = the daemon's own agent, robot or board."""
    value: float | None = None
    """A figure that may change while the warning holds, such as seconds or a count."""

    @property
    def identity(self) -> tuple[str, str]:
        """What two records of the same warning have in common, whatever text and value have become."""
        return self.code, self.about


class Health(Record, frozen=True, kw_only=True):
    """How a daemon is, at most once a second."""

    header: Header = Header()
    daemon: str = ""
    pid: int = 0
    uptime: float = 0.0
    """Seconds."""
    cpu: float = 0.0
    """CPU seconds used so far by the process."""
    drops: int = 0
    """What queues have dropped so far."""
    bad_input: int = 0
    """Records or packets that did not decode so far."""
    counters: dict[str, float] = {}
    percepts: dict[str, str] = {}
    """Digest of the present percept set per agent (bridges only)."""
    paused: bool = False
    """The operator has paused the robot (bridges only)."""
    ordered: Order | None = None
    """The operator's order that is in force until `release` (bridges only)."""
    notes: tuple[Note, ...] = ()
    """Warnings that hold now."""
    version: str = ""
    """Of Argosy; empty = it does not say."""
    restarts: int | None = None
    """Lives before this one, since its machine started, that nobody had told to end; none = not known."""
    lag: float = 0.0
    """Wall seconds by which the daemon is behind: its event loop at worst in the last second, or the oldest of what
    waits for the agent."""
    errors: int = 0
    """What it has logged as errors so far."""
    last_error: str = ""
    """The newest of them; or how the life before ended, if nobody had told it to."""
    last_error_age: float | None = None
    """Seconds since then; none = not known, as it was before this life."""
    idle: bool | None = None
    """Of an agent: it has no intention, nothing waits for it and nothing is due; none = it does not say."""


class Checkup(Record, frozen=True, kw_only=True):
    """What a board is asked by `argosy doctor`, and by other boards on its behalf."""

    links: bool = False
    """Whether it is to measure its links to the other boards first, which takes some seconds."""
    filler: str = ""
    """Read by nobody: how long it takes to arrive shows how fast a link is."""


class LinkReport(Record, frozen=True, kw_only=True):
    """How one board reaches another."""

    board: str
    asked: int = 0
    """Round trips tried."""
    answered: int = 0
    round_trip: float | None = None
    """Wall seconds of the fastest."""
    slowest: float | None = None
    """Wall seconds of the slowest."""
    ahead: float | None = None
    """Seconds by which the other's clock is ahead, as far as half the fastest round trip."""
    rate: float | None = None
    """Bytes a second that went to it; none = not measured, or too fast for that."""
    problem: str = ""
    """Why nothing is known, in words."""


class BoardReport(Record, frozen=True, kw_only=True):
    """What a board's `commd` answers: `header.stamp` is its clock."""

    header: Header = Header()
    board: str = ""
    state: str = ""
    """The folder where its mail is kept."""
    disk_free: int | None = None
    """Bytes that are left there."""
    disk_size: int | None = None
    """Bytes of that file system."""
    links: tuple[LinkReport, ...] = ()
    """To the other boards of the mission, if they were asked for."""
