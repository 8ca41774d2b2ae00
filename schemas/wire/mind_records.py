"""Records of a mind for observers: its present state, and its trace while there are subscribers.

Texts are for people, in the syntax of programs; `docs/reference/records.md` shows how the records are related.
"""

from __future__ import annotations

from typing import Literal

from schemas.wire.records import Finite, Header, Int64, Record
from schemas.wire.terms import Term


class BeliefView(Record, frozen=True, kw_only=True):
    """A belief as observers see it."""

    text: str
    """With its annotations."""
    sources: tuple[str, ...] = ()
    """Its sources: agents, `percept`, `self`."""
    since: Finite | None = None
    """Mission seconds at which it was added; none = unknown, such as for a belief of a process before this one. A
    source that was added later does not change it."""


class EventView(Record, frozen=True, kw_only=True):
    """An event that waits for a plan."""

    text: str
    intention: Int64 = 0
    """The intention that it continues; 0 = it will start a new one."""


class QuestionView(Record, frozen=True, kw_only=True):
    """A question to another agent that has no answer yet."""

    id: str
    """Id of the message that asks."""
    receiver: str
    performative: str
    content: str
    asked: Finite
    """Mission seconds."""
    until: Finite | None = None
    """Mission seconds at which the agent gives up; none = never."""
    intention: Int64 = 0
    position: str = ""
    """`file:line` of the formula that asks."""


class WaitView(Record, frozen=True, kw_only=True):
    """The condition that an intention waits for."""

    kind: Literal["action", "answer", "time", "formula", "event", "plan", "goal_condition", "fork", "team", "python"]
    """`time`, `formula`, `event`: in a `.wait`; `plan`: a plan for its event; `goal_condition`: the condition of its
    goal; `fork`: the branches of its fork; `team`: agentd, as for `.create_agent`; `python`: an internal action in
    Python."""
    name: str = ""
    """Name of the action, of the request to the team or of the event, or as the internal action names it."""
    agents: tuple[str, ...] = ()
    """For `answer`: the agents that were asked."""
    seconds: Finite | None = None
    """For `time`: the whole time, in mission seconds."""


class IntentionView(Record, frozen=True, kw_only=True):
    """An intention as observers see it."""

    id: Int64
    state: str
    """running, waiting or suspended."""
    waits_for: WaitView | None = None
    """Set while it is waiting."""
    stack: tuple[str, ...] = ()
    """Triggering events, the top of the stack first."""
    at: str = ""
    """`file:line` of the next formula."""
    since: Finite | None = None
    """Mission seconds at which this wait began."""


class PlanView(Record, frozen=True, kw_only=True):
    """A plan as observers see it."""

    label: str = ""
    """As written, with annotations; empty if it has none."""
    trigger: str
    position: str = ""
    """`file:line`."""
    bindings: dict[str, str] = {}
    """The variables that had a value, with their values as text."""
    context: str = ""
    """As written; empty if it has none. Only in `plans` of a mind."""
    uses: dict[str, str] = {}
    """Formulas of its body, each with the `file:line` of its first use: goals `!go/1`, tests `?where/1`, beliefs
    `+found/3`, actions `takeoff/1`, internal actions `.send/4`. Only in `plans` of a mind."""
    source: str = ""
    """The whole plan, in the syntax of programs. Only in `plans` of a mind."""


class RejectedView(Record, frozen=True, kw_only=True):
    """A plan that was tried and not chosen."""

    plan: PlanView
    why: Literal["trigger", "context", "error", "choice"]
    """Its trigger does not unify with the event, its context does not hold or cannot be computed, or it was applicable
    but the agent's own selection function did not choose it."""
    literal: str = ""
    """The part of the context that failed, as written."""
    filled: str = ""
    """The same with the values that its variables had."""
    message: str = ""
    """The reason, for people."""


class FailureView(Record, frozen=True, kw_only=True):
    """A formula that failed, or a goal for which there was no plan."""

    cycle: Int64
    time: Finite
    """Mission seconds."""
    intention: Int64 = 0
    formula: str
    """With the values of its variables."""
    position: str = ""
    """`file:line`."""
    error: str
    """Its name in the program, as `error(E)`."""
    reason: str = ""
    """The reason, for people."""
    given_up: tuple[str, ...] = ()
    """The goals that ended with it, the innermost first."""
    handled_by: str = ""
    """The event that handles it, such as `-!fly/1`; empty = none does."""


class CauseView(Record, frozen=True, kw_only=True):
    """The origin of an event."""

    kind: Literal["plan", "failure", "intention", "message", "told", "percept", "program", "outside"]
    """`plan`: a plan that waits for it; `failure`: the failure of a goal; `intention`: a plan that does not wait for
    it; `program`: the initial beliefs and goals; `outside`: an operator, the mission, or a restart."""
    intention: Int64 = 0
    """For `plan`, `failure` and `intention`: that of the plan or goal."""
    sender: str = ""
    """For `message` and `told`."""
    performative: str = ""
    message: str = ""
    """Its id."""


class DecisionView(Record, frozen=True, kw_only=True):
    """An event of an agent and the plan that was chosen for it; the other plans, and why they were not chosen."""

    cycle: Int64
    time: Finite
    """Mission seconds."""
    event: str
    """As text with its annotations; the source `self` is left out."""
    kind: str
    """Operator and kind of the event, such as `+!`."""
    name: str
    """Functor and arity."""
    source: str = ""
    """Its source: an agent, `percept`, `self`."""
    intention: Int64 = 0
    """The intention that the chosen plan is part of."""
    goal: str = ""
    """The event of the plan that raised this one and waits for it."""
    cause: CauseView | None = None
    """None = the agent itself."""
    asked_at: str = ""
    """`file:line` of the formula that raised it."""
    rejected: tuple[RejectedView, ...] = ()
    """The plans tried before the chosen one, in order."""
    chosen: PlanView | None = None
    untried: tuple[PlanView, ...] = ()
    """The relevant plans after the chosen one."""
    outcome: Literal["running", "ended", "failed", "dropped", "none"] = "none"
    """Present outcome of the chosen plan; `none`: no plan was applicable."""
    failure: FailureView | None = None
    """The failed part of it."""
    dropped_by: str = ""
    """The formula that dropped the chosen plan."""
    dropped_at: str = ""
    """Its `file:line`."""


class DropView(Record, frozen=True, kw_only=True):
    """Items of one kind that were dropped because their queue was full."""

    what: Literal["events", "messages", "questions"]
    name: str = ""
    """Name of the events, such as `+tick/1`, or the sender of the messages or questions."""
    count: Int64
    first: Finite
    """Mission seconds."""
    last: Finite
    """Mission seconds."""
    reason: str = ""
    """For people."""


class MindView(Record, frozen=True, kw_only=True):
    """An agent's present beliefs and intentions."""

    header: Header = Header()
    format: Int64 = 1
    """Version of this record, increased when a field changes its meaning."""
    agent: str = ""
    program: str = ""
    """The file of its program."""
    cycle: Int64 = 0
    time: Finite = 0.0
    """Mission seconds."""
    state: Literal["reasoning", "waiting", "paused"] = "waiting"
    """`reasoning`: there is something to do; `waiting`: for an input or a time; `paused`: by the operator."""
    paused_for: Finite | None = None
    """Wall seconds until it continues by itself, if it is paused."""
    beliefs: tuple[BeliefView, ...] = ()
    """The newest of each name first."""
    beliefs_left_out: Int64 = 0
    """Number of beliefs that are not shown."""
    intentions: tuple[IntentionView, ...] = ()
    intentions_left_out: Int64 = 0
    events: tuple[EventView, ...] = ()
    """Events that wait for a plan, the next one first."""
    events_left_out: Int64 = 0
    mailbox: Int64 = 0
    """Messages that wait for the mind."""
    questions: tuple[QuestionView, ...] = ()
    """Its questions to others that have no answer yet."""
    plans: tuple[PlanView, ...] = ()
    """Its plans in order; only on request (`?plans=true`)."""
    plan_count: Int64 = 0
    prints: tuple[str, ...] = ()
    """The last lines that the agent printed, oldest first."""
    decisions: tuple[DecisionView, ...] = ()
    """The last decisions, oldest first."""
    failures: tuple[FailureView, ...] = ()
    """The failures of formulas and goals since the first of these decisions, oldest first."""
    dropped: dict[str, Int64] = {}
    """Numbers of `events`, `messages` and `questions` that were dropped because their queues were full."""
    drops: tuple[DropView, ...] = ()
    """Dropped items by kind and name; at most 50 entries."""
    actions: tuple[ActivityEvent, ...] = ()
    """The last actions that it requested and their outcomes, oldest first."""
    done: dict[str, bool] = {}
    """The mission's `done` formulas of this agent and whether they hold."""
    failed: dict[str, bool] = {}
    """The mission's `failed` formulas of this agent and whether they hold."""


class MindOrder(Record, frozen=True, kw_only=True):
    """An operator's order to a mind; refused unless the mission has `inject: true`."""

    do: Literal["pause", "step", "resume", "goal", "belief"]
    """`step`: run one cycle of a mind that is paused; `goal`: achieve it; `belief`: add it, from source `operator`."""
    text: str = ""
    """The goal or belief, in the syntax of programs: `go(3,4)`."""


class InitialMind(Record, frozen=True, kw_only=True):
    """The initial data of a mind: with these and its inputs it can be replayed (docs/reference/records.md)."""

    program: str
    """The main file, a name in `files`; empty = an empty program."""
    files: dict[str, str] = {}
    """All source files of the program, as text by path."""
    mission: str = ""
    """The path of the mission file, as positions name it."""
    beliefs: tuple[str, ...] = ()
    """Those that the mission file adds, as written there."""
    goals: tuple[str, ...] = ()
    on_restart: str = ""
    """The goal with which it continues after a restart, as written in the mission file; empty = none."""
    formulas: tuple[str, ...] = ()
    """The `done` and `failed` formulas of the mission about this mind."""
    decisions: Int64 = 0
    """Number of decisions that it keeps."""
    kept: bool = False
    """Whether its state is kept across restarts."""
    seed: Int64 = 0
    start: Finite = 0.0
    """Mission seconds."""
    epoch: Finite = 0.0
    """Unix time of mission second 0."""
    zone: str = "UTC"
    names_variables: bool = False
    has_team: bool = True
    ask_timeout: Finite | None = None
    memory: str = ""
    """Restored state: MessagePack, compressed by zlib, as base64; empty = a fresh start."""
    unknown: str = ""
    """Why this mind cannot be replayed, for people; empty = it can."""


class MindStep(Record, frozen=True, kw_only=True):
    """The time at a cycle. Cycles between two steps had times in between, which made no difference to the mind."""

    first: Int64
    now: Finite
    """Mission seconds."""


class MindInput(Record, frozen=True, kw_only=True):
    """An input of a mind, at the beginning of a cycle or when the program requested it."""

    cycle: Int64
    kind: str
    """The class of `agentd.mind.data.inputs`, or the kind of data that was read; docs/reference/records.md
    lists them with their fields."""
    fields: dict[str, Term] = {}


class MindInputs(Record, frozen=True, kw_only=True):
    """A section of a mind's history: all its inputs, and a digest of all its decisions and effects so far."""

    header: Header = Header()
    agent: str = ""
    number: Int64 = 0
    """Number of the section, from 0; a replay needs all sections."""
    initial: InitialMind | None = None
    """In section 0."""
    last: Int64 = 0
    """The last cycle of this section."""
    steps: tuple[MindStep, ...] = ()
    inputs: tuple[MindInput, ...] = ()
    decided: Int64 = 0
    """Number of decisions, failures and effects in this section."""
    digest: str = ""
    """Digest of all of them, in order; empty = not computed, as there was no subscriber."""
    final: bool = False
    """Whether the mind has ended in order, with no input after this; never true for an agent that was killed."""


class MindDecisions(Record, frozen=True, kw_only=True):
    """Decisions of a mind since the last record, as many as fit; `left_out` counts the rest."""

    header: Header = Header()
    agent: str = ""
    decisions: tuple[DecisionView, ...] = ()
    failures: tuple[FailureView, ...] = ()
    left_out: Int64 = 0
    now: Finite = 0.0
    """Mission seconds at the stamp of the header."""
    speed: Finite = 1.0
    """Mission seconds per wall second."""


class ActivityEvent(Record, frozen=True, kw_only=True):
    """An activity of an agent, or something that was done to it, for observers."""

    cycle: Int64 = 0
    time: Finite = 0.0
    """Mission seconds."""
    kind: Literal["print", "log", "action", "outcome", "sent", "received", "undelivered", "operator", "stopped"]
    text: str = ""
    """The printed or logged text, the action with its arguments, the content of the message, or the order."""
    id: str = ""
    """Id of the action or message: an `outcome` has that of its `action`, a `received` that of its `sent`."""
    other: str = ""
    """The agent to which or from which a message goes."""
    performative: str = ""
    in_reply_to: str = ""
    state: str = ""
    """For an `outcome`, the final state of the action; for a `log`, its level."""
    reason: str = ""
    """Why an action failed or a message was not delivered."""


class MindActivity(Record, frozen=True, kw_only=True):
    """Activities of an agent since the last record, as many as fit; `left_out` counts the rest."""

    header: Header = Header()
    agent: str = ""
    now: Finite = 0.0
    """Mission seconds at the stamp of the header."""
    speed: Finite = 1.0
    """Mission seconds per wall second."""
    events: tuple[ActivityEvent, ...] = ()
    left_out: Int64 = 0
