"""What a mind shows of itself: the records of its present state, and of its course while somebody follows it.

Texts are for people and as the program writes them; `docs/reference/mind-records.md` tells how the records hang
together.
"""

from __future__ import annotations

from typing import Literal

from schemas.wire.records import Header, Record
from schemas.wire.terms import Term


class BeliefView(Record, frozen=True, kw_only=True):
    """A belief as observers see it."""

    text: str
    """With its annotations."""
    sources: tuple[str, ...] = ()
    """Who told it: agents, `percept`, `self`."""
    since: float | None = None
    """Mission seconds by when it was believed; none = nobody knows, such as for a belief of a former life. A source
    that joined later does not change it."""


class EventView(Record, frozen=True, kw_only=True):
    """An event that waits to be given a plan."""

    text: str
    intention: int = 0
    """The intention that goes on with it; 0: it will start one of its own."""


class QuestionView(Record, frozen=True, kw_only=True):
    """A question to another agent that has no answer yet."""

    id: str
    """Of the message that asks."""
    receiver: str
    performative: str
    content: str
    asked: float
    """Mission seconds."""
    until: float | None = None
    """Mission seconds at which the agent gives up; none = never."""
    intention: int = 0
    position: str = ""
    """`file:line` of the formula that asks."""


class WaitView(Record, frozen=True, kw_only=True):
    """What an intention waits for."""

    kind: Literal["action", "answer", "time", "formula", "event", "plan", "goal_condition", "fork", "team", "python"]
    """`time`, `formula`, `event`: in a `.wait`; `plan`: its event has not been given one yet; `goal_condition`: the
    condition of its goal does not hold yet; `fork`: the branches of its fork; `team`: agentd, as for `.create_agent`;
    `python`: an internal action in Python."""
    name: str = ""
    """Of the action; of the request to the team; the event; or what the internal action calls it."""
    agents: tuple[str, ...] = ()
    """Of `answer`: who was asked."""
    seconds: float | None = None
    """Of `time`: mission seconds in all."""


class IntentionView(Record, frozen=True, kw_only=True):
    """An intention as observers see it."""

    id: int
    state: str
    """running, waiting or suspended."""
    waits_for: WaitView | None = None
    """Set while it is waiting."""
    stack: tuple[str, ...] = ()
    """Triggering events, the top of the stack first."""
    at: str = ""
    """`file:line` of the next formula."""
    since: float | None = None
    """Mission seconds since when it waits for this."""


class PlanView(Record, frozen=True, kw_only=True):
    """A plan as observers see it."""

    label: str = ""
    """As written, with annotations; empty if it has none."""
    trigger: str
    position: str = ""
    """`file:line`."""
    bindings: dict[str, str] = {}
    """The variables that had a value, as text."""
    context: str = ""
    """As written; empty if it has none. Only among the `plans` of a mind."""
    uses: dict[str, str] = {}
    """What its body does, with the `file:line` where it does so first: goals `!go/1`, tests `?where/1`, beliefs
    `+found/3`, actions `takeoff/1`, internal actions `.send/4`. Only among the `plans` of a mind."""
    source: str = ""
    """All of it, as the program would write it. Only among the `plans` of a mind."""


class RejectedView(Record, frozen=True, kw_only=True):
    """A plan that was tried in vain."""

    plan: PlanView
    why: Literal["trigger", "context", "error", "choice"]
    """Its trigger does not unify with the event, its context does not hold or cannot be computed, or it was applicable
    but the agent's own selection function did not choose it."""
    literal: str = ""
    """The part of the context that failed, as written."""
    filled: str = ""
    """The same with the values that its variables had."""
    message: str = ""
    """Why, in words."""


class FailureView(Record, frozen=True, kw_only=True):
    """A formula that failed, or a goal for which there was no plan."""

    cycle: int
    time: float
    """Mission seconds."""
    intention: int = 0
    formula: str
    """With the values of its variables."""
    position: str = ""
    """`file:line`."""
    error: str
    """The name that the program sees as `error(E)`."""
    reason: str = ""
    """Why, in words."""
    given_up: tuple[str, ...] = ()
    """The goals that ended with it, the innermost first."""
    handled_by: str = ""
    """The event that goes on from here, such as `-!fly/1`; empty if nothing handles it."""


class CauseView(Record, frozen=True, kw_only=True):
    """Where an event comes from."""

    kind: Literal["plan", "failure", "intention", "message", "told", "percept", "program", "outside"]
    """`plan`: a plan that waits for it; `failure`: of a goal; `intention`: a plan that does not wait for it; `program`:
    the initial beliefs and goals; `outside`: an operator, the mission, or a restart."""
    intention: int = 0
    """Of `plan`, `failure` and `intention`: of that plan or goal."""
    sender: str = ""
    """Of `message` and `told`."""
    performative: str = ""
    message: str = ""
    """Its id."""


class DecisionView(Record, frozen=True, kw_only=True):
    """An event of an agent and the plan that was chosen for it, with those that were not and why."""

    cycle: int
    time: float
    """Mission seconds."""
    event: str
    """As text with its annotations; the source `self` goes without saying."""
    kind: str
    """Operator and kind of the event, such as `+!`."""
    name: str
    """Functor and arity."""
    source: str = ""
    """Who told it: an agent, `percept`, `self`."""
    intention: int = 0
    """The intention that the chosen plan is part of."""
    goal: str = ""
    """The event of the plan that raised this one and waits for it."""
    cause: CauseView | None = None
    """None = the agent itself."""
    asked_at: str = ""
    """`file:line` of the formula that raised it."""
    rejected: tuple[RejectedView, ...] = ()
    """The plans tried in vain before the chosen one, in order."""
    chosen: PlanView | None = None
    untried: tuple[PlanView, ...] = ()
    """The relevant plans after the chosen one."""
    outcome: Literal["running", "ended", "failed", "dropped", "none"] = "none"
    """What became of the chosen plan so far; `none`: no plan was applicable."""
    failure: FailureView | None = None
    """What failed in it."""
    dropped_by: str = ""
    """The formula that dropped the chosen plan."""
    dropped_at: str = ""
    """Its `file:line`."""


class DropView(Record, frozen=True, kw_only=True):
    """What was dropped because too much waited, of one kind."""

    what: Literal["events", "messages", "questions"]
    name: str = ""
    """Of the events, such as `+tick/1`; or who sent the messages or questions."""
    count: int
    first: float
    """Mission seconds."""
    last: float
    """Mission seconds."""
    reason: str = ""
    """In words."""


class MindView(Record, frozen=True, kw_only=True):
    """What an agent believes and intends now."""

    header: Header = Header()
    format: int = 1
    """Of this record; counts up when a field changes its meaning."""
    agent: str = ""
    program: str = ""
    """The file of its program."""
    cycle: int = 0
    time: float = 0.0
    """Mission seconds."""
    state: Literal["reasoning", "waiting", "paused"] = "waiting"
    """`reasoning`: there is something to do; `waiting`: for an input or a time; `paused`: by the operator."""
    paused_for: float | None = None
    """Wall seconds until it goes on by itself, if it is paused."""
    beliefs: tuple[str, ...] = ()
    """The texts of what is believed, with annotations."""
    believed: tuple[BeliefView, ...] = ()
    """The same beliefs in the same order, with who told them and since when."""
    beliefs_left_out: int = 0
    """So many more are believed than are shown."""
    intentions: tuple[IntentionView, ...] = ()
    intentions_left_out: int = 0
    events: tuple[EventView, ...] = ()
    """What waits to be given a plan, the next one first."""
    events_left_out: int = 0
    mailbox: int = 0
    """Messages that wait to be taken."""
    questions: tuple[QuestionView, ...] = ()
    """What it has asked others and waits for."""
    plans: tuple[PlanView, ...] = ()
    """Its plans in order; only if asked for (`?plans=true`)."""
    plan_count: int = 0
    prints: tuple[str, ...] = ()
    """The last lines that the agent printed, oldest first."""
    decisions: tuple[DecisionView, ...] = ()
    """The last decisions, oldest first."""
    failures: tuple[FailureView, ...] = ()
    """The failures of formulas and goals since the first of these decisions, oldest first."""
    dropped: dict[str, int] = {}
    """How much was dropped because too much waited: `events`, `messages` and `questions`."""
    drops: tuple[DropView, ...] = ()
    """What was dropped, by its name; at most 50 of them."""
    actions: tuple[ActivityEvent, ...] = ()
    """The last actions that it asked for and their outcomes, oldest first."""
    done: dict[str, bool] = {}
    """The mission's `done` formulas of this agent and whether they hold."""
    failed: dict[str, bool] = {}
    """The mission's `failed` formulas of this agent and whether they hold."""


class MindOrder(Record, frozen=True, kw_only=True):
    """What an operator does to a mind; refused unless the mission says `inject: true`."""

    do: Literal["pause", "step", "resume", "goal", "belief"]
    """`step`: run one cycle of a mind that is paused; `goal`: achieve it; `belief`: add it, from source `operator`."""
    text: str = ""
    """The goal or belief, as the program would write it: `go(3,4)`."""


class MindBirth(Record, frozen=True, kw_only=True):
    """All that a mind was made of: with its inputs it can be lived again (docs/reference/mind-records.md)."""

    program: str
    """The main file, a name among `files`; empty: a program of nothing."""
    files: dict[str, str] = {}
    """Every source file that the program was read from, by its path, as text."""
    mission: str = ""
    """The path of the mission file, as positions name it."""
    beliefs: tuple[str, ...] = ()
    """Those that the mission file adds, as it has them."""
    goals: tuple[str, ...] = ()
    on_restart: str = ""
    """The goal with which it goes on after a restart, as the mission file has it; empty if there is none."""
    formulas: tuple[str, ...] = ()
    """The `done` and `failed` formulas of the mission that look into this mind."""
    decisions: int = 0
    """How many decisions it remembers."""
    kept: bool = False
    """It is kept across restarts."""
    seed: int = 0
    start: float = 0.0
    """Mission seconds."""
    epoch: float = 0.0
    """Unix time of mission second 0."""
    zone: str = "UTC"
    names_variables: bool = False
    has_team: bool = True
    ask_timeout: float | None = None
    memory: str = ""
    """What was restored of a former life: MessagePack, compressed (zlib), as base64; empty = it was born anew."""
    unknown: str = ""
    """Why this mind cannot be lived again, in words; empty = it can."""


class MindStep(Record, frozen=True, kw_only=True):
    """The time from some cycle on. Those between two steps had times between, which made no difference to the mind."""

    first: int
    now: float
    """Mission seconds."""


class MindInput(Record, frozen=True, kw_only=True):
    """Something that went into a mind, at the beginning of a cycle or when the program asked for it."""

    cycle: int
    kind: str
    """The class of `agentd.mind.data.inputs`, or what was read: docs/reference/mind-records.md lists them with their
    fields."""
    fields: dict[str, Term] = {}


class MindInputs(Record, frozen=True, kw_only=True):
    """A stretch of a mind's life: all that went in, and a digest of all that it decided and did so far."""

    header: Header = Header()
    agent: str = ""
    number: int = 0
    """Counts up from 0 with each batch of this life: none may be missing to live it again."""
    birth: MindBirth | None = None
    """In batch 0."""
    last: int = 0
    """The last cycle of this stretch."""
    steps: tuple[MindStep, ...] = ()
    inputs: tuple[MindInput, ...] = ()
    decided: int = 0
    """Decisions, failures and effects of this stretch."""
    digest: str = ""
    """Of all of them, in order; empty: nobody listened then, so it was not made."""
    final: bool = False
    """The life has ended in order: nothing went in after this. No batch of an agent that was killed says so."""


class MindDecisions(Record, frozen=True, kw_only=True):
    """What a mind has decided since the last one, as far as there is room; `left_out` counts the rest."""

    header: Header = Header()
    agent: str = ""
    decisions: tuple[DecisionView, ...] = ()
    failures: tuple[FailureView, ...] = ()
    left_out: int = 0
    now: float = 0.0
    """Mission seconds at the stamp of the header."""
    speed: float = 1.0
    """Mission seconds per wall second."""


class ActivityEvent(Record, frozen=True, kw_only=True):
    """Something that an agent did or that was done to it, for people who look on."""

    cycle: int = 0
    time: float = 0.0
    """Mission seconds."""
    kind: Literal["print", "log", "action", "outcome", "sent", "received", "undelivered", "operator", "stopped"]
    text: str = ""
    """What was printed or logged; the action with its arguments; the content of the message; the order."""
    id: str = ""
    """Of the action or message: an `outcome` has that of its `action`, a `received` that of the `sent`."""
    other: str = ""
    """The agent to which or from which a message goes."""
    performative: str = ""
    in_reply_to: str = ""
    state: str = ""
    """Of an `outcome`: the final state of the action; of a `log`: its level."""
    reason: str = ""
    """Why an action failed or a message was not delivered."""


class MindActivity(Record, frozen=True, kw_only=True):
    """What an agent has done since the last one, as far as there is room; `left_out` counts the rest."""

    header: Header = Header()
    agent: str = ""
    now: float = 0.0
    """Mission seconds at the time of the header."""
    speed: float = 1.0
    """Mission seconds that pass in a wall second."""
    events: tuple[ActivityEvent, ...] = ()
    left_out: int = 0
