"""The actions of an agent that dies and comes back: written down before, joined or reported truthfully after."""

import asyncio
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import pytest

from agentd.conversion.term_conversion import BadTerm, to_wire
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.terms import Literal, atom, make_list
from agentd.mind.data.effects import PerformAction
from agentd.mind.data.inputs import ActionDone, Mail
from agentd.persistence.checkpointer import Checkpointer
from agentd.runtime.action_client import ActionClient
from agentd.runtime.mind_runner import MindRunner
from agentd.trace import Tracing
from commd.bus.bus import Bus, Query
from commd.client.actions import ActionRequests
from commd.common.tasks import Tasks
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.records import FINAL_STATES, Action, ActionStatus, Cancel, State
from tests.agentd.hosts import Board, Hosted, Hosts
from tests.agentd.minds import run
from tests.support.buses import FLEET, served, until


class Bridge:
    """Takes actions as a bridge does: an id begins once, whoever asks again hears what has become of it."""

    def __init__(self, bus: Bus) -> None:
        self.begun: list[tuple[str, tuple[object, ...]]] = []
        self.asked: list[tuple[str, int]] = []
        self.cancelled: list[str] = []
        self._states: dict[str, tuple[State, str]] = {}
        self._changed = asyncio.Condition()
        bus.serve(keys.action(FLEET, "a", "*"), Action, self._serve)
        bus.serve(keys.cancel(FLEET, "a"), Cancel, self._cancel)

    async def _serve(self, query: Query[Action]) -> None:
        action = query.record
        self.asked.append((action.id, action.attempt))
        if action.id not in self._states:
            if action.attempt > 1:
                self._states[action.id] = ("refused", "bridge restarted")
            else:
                self._states[action.id] = ("running", "")
                self.begun.append((action.name, action.parameters))
        if self._states[action.id][0] == "running":
            query.reply(ActionStatus(id=action.id, state="accepted", name=action.name))
        async with self._changed:
            await self._changed.wait_for(lambda: self._states[action.id][0] in FINAL_STATES)
        state, reason = self._states[action.id]
        query.reply(
            ActionStatus(id=action.id, state=state, result=state == "succeeded", reason=reason, name=action.name)
        )

    async def _cancel(self, query: Query[Cancel]) -> None:
        self.cancelled.append(query.record.id)
        await self.end("cancelled", "cancelled by a", query.record.id)
        query.reply(ActionStatus(id=query.record.id, state="cancelled"))

    async def end(self, state: State, reason: str = "", only: str = "") -> None:
        """Let what runs come to an end."""
        async with self._changed:
            for identity, (present, _) in self._states.items():
                if present == "running" and only in ("", identity):
                    self._states[identity] = (state, reason)
            self._changed.notify_all()


async def a_bridge(board: Board) -> Bridge:
    bus = await board.connect("uav1", "bridged")
    bridge = Bridge(bus)
    await bus.claim("uav1")
    return bridge


async def a_life(board: Board, source: str) -> Hosted:
    bus = await board.connect("a")
    await served(bus, keys.action(FLEET, "a", "x"))
    return await board.host("a", source, bus=bus, robot="uav1")


async def died_acting(board: Board, source: str) -> Bridge:
    """A bridge that performs the action of an agent which has died since."""
    bridge = await a_bridge(board)
    agent = await a_life(board, source)
    await until(lambda: len(bridge.begun) == 1, "the action begins")
    await agent.die()
    return bridge


@pytest.fixture(autouse=True)
def short_ends(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.persistence.checkpointer.LAST_PATIENCE", 0.1)


FLIES = """\
!begin.
+!begin <- !!fly.
+!fly <- goto(1,2,3); .print(there).
-!fly[error(E), reason(R)] <- .print(E, " ", R).
+interrupted(A, S, R) <- .print(A, " ", S, " ", R).
"""


async def test_an_action_is_on_disk_before_the_bridge_hears_of_it(board: Board) -> None:
    bridge = await a_bridge(board)
    agent = await a_life(board, FLIES)
    await until(lambda: bridge.begun == [("goto", (1, 2, 3))], "the action begins")
    assert [list(saving.actions) for saving in agent.disk.savings if saving.actions] == [[bridge.asked[0][0]]]
    await bridge.end("succeeded")
    await until(lambda: agent.prints == ["there"], "the plan goes on")
    await until(lambda: any(saving.ended for saving in agent.disk.savings), "it is forgotten in the end")
    await agent.end()
    again = await a_life(board, FLIES)
    await until(lambda: any(saving.mind for saving in again.disk.savings), "it goes on")
    assert (again.prints, len(bridge.asked)) == ([], 1)


async def test_a_disk_that_is_slow_or_full_does_not_keep_a_robot_from_acting(board: Board) -> None:
    program = FLIES.replace("+!begin <- !!fly.", "+!begin. +!kqml_received(_, achieve, fly, _) <- !!fly.")
    bridge = await a_bridge(board)
    agent = await a_life(board, program)
    await until(lambda: bool(agent.disk.savings), "it is kept once")
    for problem in ("slow", "full"):
        agent.disk.full = "no space left" if problem == "full" else ""
        if problem == "slow":
            agent.disk.open.clear()
        agent.tell(Mail("b", "achieve", atom("fly")))
        await until(lambda: len(bridge.begun) == 1, f"it acts with a disk that is {problem}")
        await bridge.end("succeeded")
        await until(lambda: agent.prints == ["there"], "the plan goes on")
        agent.disk.open.set()
        agent.disk.full = ""
        bridge.begun.clear()
        agent.host._prints.clear()


@pytest.mark.parametrize("keeping", ["works", "fails", "nothing"])
async def test_what_is_dropped_is_cancelled_before_the_action_that_follows_is_requested(
    board: Board, keeping: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = "!fly. +!fly <: danger <- goto(1,2,3). +danger <- drop(1). +!see <- +danger.\n"
    asked = list[str]()
    bridge = await a_bridge(board)
    bus = await board.connect("a")
    await served(bus, keys.action(FLEET, "a", "x"))
    daemon = await Hosts.open(board.folder, "b" if keeping == "nothing" else "a")
    agent = await board.host("a", program, bus=bus, robot="uav1", daemon=daemon)
    await until(lambda: len(bridge.begun) == 1, "the first one begins")
    if keeping == "fails":
        daemon.disk.full = "no space left"
        await until(lambda: agent.host.notes() or agent.tell(Mail("b", "tell", atom("more"))), "it cannot be kept")
    ask = bus.ask
    monkeypatch.setattr(bus, "ask", lambda key, *rest: asked.append(key) or ask(key, *rest))
    agent.tell(Mail("b", "achieve", atom("see")))
    await until(lambda: len(bridge.begun) == 2, "the second one begins")
    assert asked == [keys.cancel(FLEET, "a"), keys.action(FLEET, "a", "drop")]
    daemon.disk.full = ""


async def test_an_action_that_still_runs_is_joined_by_the_plan_that_performs_it_again(board: Board) -> None:
    bridge = await died_acting(board, FLIES)
    second = await a_life(board, FLIES)
    await until(lambda: any(attempt == 2 for _, attempt in bridge.asked), "it is asked for again by its id")
    await until(lambda: "goto" in str(second.host.viewer.view().intentions), "the plan performs it again")
    await bridge.end("succeeded")
    await until(lambda: second.prints == ["there"], "the plan goes on from there")
    assert len(bridge.begun) == 1
    assert len({identity for identity, _ in bridge.asked}) == 1


async def test_a_joined_action_is_cancelled_with_the_intention_that_waits_for_it(board: Board) -> None:
    program = FLIES + "+!drop <- .wait(100); .drop_intention(fly); .print(dropped).\n+restarted(_) <- !!fly; !!drop.\n"
    bridge = await died_acting(board, program)
    second = await a_life(board, program)
    await until(lambda: second.prints == ["dropped"], "the intention is dropped")
    await until(lambda: bridge.cancelled == [bridge.asked[0][0]], "the action is cancelled")


@pytest.mark.parametrize(
    ("state", "reason"), [("succeeded", ""), ("failed", "agent a is lost: no liveliness token"), ("timed_out", "late")]
)
async def test_what_an_action_came_to_meanwhile_is_reported_before_anything_else_goes_on(
    board: Board, state: State, reason: str
) -> None:
    program = FLIES + '+restarted(N) <- .print("back ", N).\n'
    bridge = await died_acting(board, program)
    await bridge.end(state, reason)
    second = await a_life(board, program)
    await until(lambda: len(second.prints) == 2, "it is reported")
    assert second.prints == ["back 1", f"goto(1,2,3) {state} {reason}"]
    await second.end()
    third = await a_life(board, program)
    await until(lambda: third.prints == ["back 2"], "it is reported once")
    assert len(bridge.asked) == 2


async def test_what_ends_later_and_nobody_has_joined_is_reported_when_it_ends(board: Board) -> None:
    program = FLIES + '+restarted(N) <- .print("back ", N).\n'
    bridge = await died_acting(board, program)
    second = await a_life(board, program)
    await until(lambda: second.prints == ["back 1"], "it is back")
    await bridge.end("failed", "the wind")
    await until(lambda: second.prints == ["back 1", "goto(1,2,3) failed the wind"], "the end is reported")


async def test_a_bridge_that_knows_nothing_of_an_action_begins_nothing_and_the_agent_hears_so(board: Board) -> None:
    program = FLIES + "+restarted(_).\n"

    bridge_bus = await board.connect("uav1", "bridged")
    bridge = Bridge(bridge_bus)
    await bridge_bus.claim("uav1")
    first = await a_life(board, program)
    await until(lambda: len(bridge.begun) == 1, "the action begins")
    await first.die()
    await bridge_bus.close()
    another = await a_bridge(board)
    second = await a_life(board, program)
    await until(lambda: second.prints == ["goto(1,2,3) refused bridge restarted"], "it is reported")
    assert another.begun == []


async def test_the_end_of_an_action_is_reported_again_until_a_plan_has_answered_it(board: Board) -> None:
    program = """\
!begin.
+!begin <- !!deliver.
+!deliver <- drop(1).
+restarted(N) <- .print("back ", N).
+interrupted(A, S, R) <- .print(A, " ", S); .wait(300000).
"""

    async def hears(told: list[str], agent: Hosted) -> None:
        await until(lambda: agent.prints == told, "its end is reported")
        await until(lambda: any(saving.ended for saving in agent.disk.savings) or "back 2" in told, "that is kept")
        await agent.die()

    bridge = await died_acting(board, program)
    await bridge.end("succeeded")
    for life in (1, 2):
        await hears([f"back {life}", "drop(1) succeeded"], await a_life(board, program))


async def test_an_agent_that_has_lost_its_robot_hears_once_what_was_interrupted(board: Board) -> None:
    await died_acting(board, FLIES)
    agent = await board.host("a", FLIES)
    lost = "goto(1,2,3) failed the agent has no robot any more"
    await until(lambda: lost in agent.prints, "the agent hears of it")
    await until(lambda: any(saving.ended for saving in agent.disk.savings), "that is kept")
    await agent.end()
    agent = await board.host("a", FLIES)
    await until(lambda: any(saving.mind for saving in agent.disk.savings), "it goes on")
    assert lost not in agent.prints


class Hands:
    """Does one action, which succeeds when the test says so, and notes what it was asked for."""

    def __init__(self) -> None:
        self.over = asyncio.Event()
        self.asked: list[str] = []

    async def perform(self, action: Action, **asked: Any) -> ActionStatus:
        self.asked.append(action.id)
        if "on_status" in asked:
            asked["on_status"](ActionStatus(id=action.id, state="running", name=action.name))
        await self.over.wait()
        return ActionStatus(id=action.id, state="succeeded", name=action.name)


class Alone:
    """The actions of an agent without mind or bus; `told` is what the mind hears."""

    def __init__(self, hands: Hands) -> None:
        self.told: list[object] = []
        self.tasks: list[asyncio.Task[None]] = []
        action_requests, tell = cast(ActionRequests, hands), self.told.append
        self.on_disk: list[Callable[[], None]] = []
        """What waits until an action is written down."""
        kept = cast(Checkpointer, SimpleNamespace(begun=self.begun, ended=lambda identity: None))
        mind, activity = SimpleNamespace(name="a", cycle=1), SimpleNamespace(ended=lambda cycle, done: None)
        bus = cast(Bus, SimpleNamespace(boot="2", afterwards=asyncio.get_running_loop().call_soon))
        runner, tracing = cast(MindRunner, SimpleNamespace(mind=mind, feed=tell)), SimpleNamespace(activity=activity)
        tasks = cast(Tasks, self)
        self.action_client = ActionClient(bus, runner, cast(Tracing, tracing), action_requests, kept, tell, tasks)

    def begun(self, action: Action, then: Callable[[], None]) -> None:
        codec(Action).encode(action, "json")
        self.on_disk.append(then)

    def spawn(self, work: Any) -> None:
        self.tasks.append(asyncio.get_running_loop().create_task(work))

    async def ended(self) -> list[object]:
        """Everything that is under way has ended; returns what the mind heard, of a literal its name."""
        await asyncio.gather(*self.tasks, return_exceptions=True)
        return [one.sig.functor if isinstance(one, Literal) else one for one in self.told]


LEFT = Action(id="a:1:1", agent="a", name="goto", parameters=(1,))
DONE = ActionDone(7, True, "", "succeeded")
DROPPED = ActionDone(7, False, "the agent has dropped it", "cancelled", "cancelled")


async def test_an_action_that_is_dropped_before_it_is_on_disk_is_not_requested() -> None:
    hands = Hands()
    alone = Alone(hands)
    alone.action_client.begin(PerformAction(7, "goto", (1.0,)))
    assert alone.told == []
    alone.action_client.cancel(7)
    for then in alone.on_disk:
        then()
    assert await alone.ended() == [DROPPED]
    assert hands.asked == []


async def test_a_plan_that_is_dropped_immediately_does_not_join_what_still_runs() -> None:
    hands = Hands()
    alone = Alone(hands)
    assert await alone.action_client.take_up([LEFT]) == []
    alone.action_client.begin(PerformAction(7, "goto", (1.0,)))
    alone.action_client.cancel(7)
    await asyncio.sleep(0)
    hands.over.set()
    assert await alone.ended() == [DROPPED, "interrupted"]


@pytest.mark.parametrize("dropped", [False, True])
async def test_an_action_that_ends_as_a_plan_is_about_to_join_it_is_told_once_and_not_done_again(dropped: bool) -> None:
    hands = Hands()
    alone = Alone(hands)
    assert await alone.action_client.take_up([LEFT]) == []
    hands.over.set()
    waits: list[Any] = []
    alone.spawn = waits.append  # type: ignore[method-assign]
    alone.action_client.begin(PerformAction(7, "goto", (1.0,)))
    if dropped:
        alone.action_client.cancel(7)
    await asyncio.gather(*alone.tasks)  # it has ended, before the plan's own task has begun
    await waits[0]
    assert await alone.ended() == (["interrupted", DROPPED] if dropped else [DONE])
    assert hands.asked == ["a:1:1"]


def nested(times: int) -> object:
    """Code that holds code that holds code: `{ !q({ !q(...) }) }`."""
    program = f"!b(x, {times}). +!b(X, 0) <- act(X). +!b(X, N) <- !b({{ !q(X) }}, N-1)."
    (performed,) = run(program).of(PerformAction)
    return performed.parameters[0]


@pytest.mark.usefixtures("usual_recursion")
def test_a_term_that_is_nested_too_deeply_is_refused_whatever_it_is_made_of() -> None:
    assert to_wire(nested(5))
    with pytest.raises(BadTerm, match="nested too deeply"):
        to_wire(nested(150))


def test_a_term_whose_parts_are_in_it_many_times_is_refused_when_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.language.terms.to_ast.MOST_NODES", 1000)
    part = atom("x")
    for _ in range(60):
        part = Literal(signature("f", 2), (part, part))
    for large in (part, make_list(["x" * 4000] * 10)):
        with pytest.raises(BadTerm, match="more than 1000 parts"):
            to_wire(large)


@pytest.mark.usefixtures("usual_recursion")
@pytest.mark.parametrize("what", ["deep", "half a character", "defect"])
async def test_an_action_that_cannot_be_asked_for_fails_its_plan(what: str, monkeypatch: pytest.MonkeyPatch) -> None:
    parameter = nested(150) if what == "deep" else "\ud800"

    def broken(_: object) -> None:
        raise LookupError("no such thing")

    if what == "defect":
        monkeypatch.setattr("agentd.runtime.action_client.to_wire", broken)
    alone = Alone(Hands())
    alone.action_client.begin(PerformAction(7, "goto", (parameter,)))
    reason, *outcome = {
        "deep": ("goto: nested too deeply", "refused", "request"),
        "half a character": (
            "goto: Action: expected Unicode text, got half a character: '\\ud800'",
            "refused",
            "request",
        ),
        "defect": ("defect in agentd: LookupError: no such thing", "failed"),
    }[what]
    assert await alone.ended() == [ActionDone(7, False, reason, *outcome)]
