"""Intentions, their stacks of frames (one per running plan), timers, and records of what intentions wait for.

A frame is a flat list, so that generated code makes one in one step. Its first places are named below; the variables of
the plan follow from `VARIABLES` on. The first place is the *step to come*; None means that the body has ended.
"""

from __future__ import annotations

from collections.abc import Callable
from heapq import heapify, heappop, heappush
from typing import TYPE_CHECKING, Any, Final, TypeAlias

from msgspec import Struct, field

from agentd.language.syntax_tree.traversal import HIDDEN
from agentd.language.terms.terms import Literal, Var, deref
from schemas.wire.mind_records import WaitView

if TYPE_CHECKING:
    from agentd.mind.plans.plan_library import Relevant
    from agentd.mind.state import MindState


_FEW: Final = 16
"""Cancelled timers that may stay in a queue in any case."""


class Timer:
    """Something to do at mission time ``due``, in seconds; of equal times the lower ``number`` comes first."""

    __slots__ = ("action", "due", "number", "over")

    def __init__(self, due: float, number: int, action: Callable[[], None]) -> None:
        self.due, self.number, self.action = due, number, action
        self.over = False
        """Whether it has acted or was cancelled."""

    def end(self) -> Callable[[], None]:
        """Return the action, and hold it no more: what it is about mostly holds the timer."""
        action, self.action, self.over = self.action, _nothing, True
        return action

    def __lt__(self, other: Timer) -> bool:
        return (self.due, self.number) < (other.due, other.number)


def _nothing() -> None:
    """Do nothing: what a timer does that is over."""


class Timers:
    """A queue of timers. Equal times keep the order in which they were set."""

    def __init__(self) -> None:
        self.heap: list[Timer] = []
        """The timers, the next one first; some may be cancelled. The list is never replaced."""
        self._count = self._cancelled = 0
        self.looks = 0
        """Counts reads of the time: `agentd.trace` records the time only when it mattered."""

    def at(self, due: float, action: Callable[[], None]) -> Timer:
        """Have an action called at mission time ``due``, in seconds."""
        self._count += 1
        self.looks += 1
        timer = Timer(due, self._count, action)
        heappush(self.heap, timer)
        return timer

    def cancel(self, timer: Timer) -> None:
        """Have a timer not act. It leaves the queue when most in there are cancelled: an agent that asks others would
        keep a timer of each question until that would have been given up."""
        if timer.over:
            return
        timer.end()
        self._cancelled += 1
        if self._cancelled > _FEW and 2 * self._cancelled > len(self.heap):
            self.heap[:] = [each for each in self.heap if not each.over]
            heapify(self.heap)
            self._cancelled = 0

    def next_due(self) -> float | None:
        """Return when the earliest timer is due; None without any."""
        while self.heap and self.heap[0].over:
            heappop(self.heap)
            self._cancelled -= 1
        return self.heap[0].due if self.heap else None

    def run(self, now: float) -> None:
        """Run the actions that are due at mission time ``now``."""
        while self.heap and (self.heap[0].over or self.heap[0].due <= now):
            timer = heappop(self.heap)
            if timer.over:
                self._cancelled -= 1
            else:
                self.looks += 1
                timer.end()()


Frame: TypeAlias = list[Any]

STEP: Final = 0
PLAN: Final = 1
RELEVANT: Final = 2
"""The `agentd.mind.plans.plan_library.Relevant` of the event that the plan answers."""
ARGS: Final = 3
ANNOTS: Final = 4
MARK: Final = 5
"""How long the intention's trail was before the plan was selected: a failure undoes to here."""
VARIABLES: Final = 6


class Step:
    """A formula of a loaded plan: the generated function, the next step, and the syntax."""

    __slots__ = ("next", "plan", "run", "syntax")

    run: Callable[[MindState, Intention, Frame], Any]
    next: Step | None

    def __init__(self, syntax: Any, plan: Any) -> None:
        self.syntax, self.plan = syntax, plan
        self.next = None
        self.run = _not_loaded


def _not_loaded(mind: MindState, intention: Intention, frame: Frame) -> bool:
    raise RuntimeError("a step was run before its code was loaded")


Event: TypeAlias = "tuple[Relevant, tuple[Any, ...], tuple[Any, ...], Intention | None]"
"""The plans, arguments and annotations of an event, and the intention that waits for it
(or None)."""


def wait_text(awaited: WaitView) -> str:
    """Return what an intention waits for as text: ``action takeoff``, ``answer of bob``, ``wait(5s)``."""
    match awaited.kind:
        case "answer":
            return f"answer of {', '.join(awaited.agents)}"
        case "time":
            return f"wait({awaited.seconds:g}s)"
        case "formula" | "event":
            return f"wait({awaited.kind})"
        case "action" | "team":
            return f"{awaited.kind} {awaited.name}"
    return awaited.name or awaited.kind.replace("_", " ")


class Intention:
    """One focus of the mind: the plans it is in the middle of, the innermost last."""

    __slots__ = (
        "action",
        "branch",
        "held",
        "id",
        "last",
        "since",
        "stack",
        "suspended",
        "trail",
        "waiting",
    )

    waiting: WaitView | None
    """None while it runs or waits for its own event."""
    since: float
    """Mission seconds since when it is `waiting`; not set before it is for the first time."""
    suspended: str | None
    """Why it must not run although it could (``.suspend``)."""
    action: int | None
    """The id of the external action it waits for."""
    branch: Any
    """The `agentd.mind.execution.control_flow.Fork` that it is a branch of."""
    held: Event | None
    """The event of its next goal, which ``.suspend`` has taken out of the queue; with an empty stack its first one."""

    def __init__(self, number: int, stack: list[Frame], trail: list[Var]) -> None:
        self.id, self.stack = number, stack
        self.trail = trail
        """The variables bound so far that a failure may have to free again."""
        self.last: Step | None = None
        """The formula that was run last: the one that it waits in, while it waits."""
        self.waiting = self.suspended = self.action = self.branch = self.held = None

    def trim(self, mark: int) -> None:
        """Forget the bindings since ``mark`` that no failure below needs to undo, after a frame has ended well."""
        trail, depth = self.trail, len(self.stack)
        trail[mark:] = [v for v in trail[mark:] if v.depth < depth]


def values_of(frame: Frame) -> dict[str, Any]:
    """Return the variables of a frame that have a value, by name."""
    return {
        name: frame[place]
        for name, place in frame[PLAN].slots.items()
        if place < len(frame)
        and frame[place] is not None
        and type(deref(frame[place])) is not Var
        and not name.startswith(HIDDEN)
    }


class Wait(Struct, eq=False):
    """An intention that waits for a formula or an event (`agentd.mind.execution.waiting`), maybe only for some time."""

    intention: Intention
    frame: Frame | None
    since: float
    """Mission seconds."""
    check: Callable[[MindState, Intention, Frame | None], bool] | None = None
    pattern: tuple[str, str, Literal] | None = None
    timer: Timer | None = None
    elapsed: Any = None


class Question(Struct, eq=False):
    """A synchronous ask (`agentd.mind.execution.waiting`): the intention that waits, and whose answers for."""

    intention: Intention
    answer: Any
    many: bool
    receivers: list[str]
    performative: str
    content: Any
    """A term."""
    asked: float
    """Since when it waits, in mission seconds."""
    ids: list[str] = field(default_factory=list)
    """Of the messages, in the order of the receivers."""
    found: list[Any] = field(default_factory=list)
    """The answers so far."""
    timer: Timer | None = None


class Request(Struct, eq=False):
    """A request to the team (`agentd.mind.execution.waiting`) and the use of its answer."""

    intention: Intention
    result: Any
    use: Callable[[Any], None] | None
