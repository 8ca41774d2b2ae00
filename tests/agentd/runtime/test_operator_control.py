"""What an operator does to a mind: pause, step, resume, a goal, a belief; on a real bus, and in real daemons."""

import asyncio
import time
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest

from agentd.mind.data.inputs import Mail, PerceptReplaced
from agentd.runtime import operator_control
from commd.bus.bus import Bus, open_bus
from schemas.wire import keys
from schemas.wire.mind_records import MindOrder, MindView
from schemas.wire.records import Outcome
from tests.agentd.daemons import daemons
from tests.agentd.hosts import Board, Hosted
from tests.agentd.minds import term
from tests.support.buses import served, until
from tests.support.promises import in_time

PROGRAM = """\
n(0).
!count.
+!count : n(N) <- -+n(N+1); .wait(20); !!count.
+!say(X)[source(W)] <- .print("say ", X, " for ", W).
+!far(X, Y) <- fly(X, Y).
+told(X)[source(W)] <- .print("told ", X, " by ", W).
"""


async def order(bus: Bus, agent: str, do: Any, text: str = "", fleet: str = "test") -> Outcome:
    return await bus.ask_one(keys.control(fleet, agent), MindOrder(do=do, text=text), Outcome, 20.0)


def count(agent: Hosted) -> str:
    return next(belief for belief in agent.beliefs if belief.startswith("n("))


class Desk:
    """An operator and an agent on one bus."""

    def __init__(self, bus: Bus, agent: Hosted) -> None:
        self.bus, self.agent = bus, agent

    async def order(self, do: str, text: str = "") -> Outcome:
        return await order(self.bus, "bob", do, text)


async def desk(board: Board, **part: Any) -> Desk:
    operator = await board.connect("op", "argosy")
    agent = await board.host("bob", PROGRAM, **{"inject": True, **part})
    await served(operator, keys.control("test", "bob"))
    return Desk(operator, agent)


@pytest.fixture
@asynccontextmanager
async def bob(board: AbstractAsyncContextManager[Board]) -> AsyncIterator[Desk]:
    async with board as opened:
        yield await desk(opened)


async def test_a_paused_mind_stands_still_until_it_goes_on(bob: Desk) -> None:
    assert (await bob.order("pause")).ok
    view = bob.agent.host.viewer.view()
    assert view.state == "paused"
    assert view.paused_for is not None
    assert 590 < view.paused_for <= 600
    (note,) = bob.agent.host.health().notes
    assert (note.code, note.value) == ("mind_paused", 0)
    cycle, before = view.cycle, count(bob.agent)
    host = bob.agent.host
    await until(lambda: host._clock.now() > (host._mind.wake_at or 0), "its timer is due")
    await bob.order("pause")
    assert (bob.agent.host.viewer.view().cycle, count(bob.agent)) == (cycle, before)
    assert (await bob.order("resume")) == Outcome(ok=True)
    await until(lambda: count(bob.agent) != before, "its timer fires when it goes on")
    assert bob.agent.host.viewer.view().state != "paused"
    assert bob.agent.host.health().notes == ()


async def test_a_step_is_one_cycle(bob: Desk) -> None:
    assert (await bob.order("step")) == Outcome(ok=False, reason="it is not paused: only then it can be stepped")
    await bob.order("pause")
    cycle = bob.agent.host.viewer.view().cycle
    for step in range(1, 4):
        outcome = await bob.order("step")
        assert outcome.ok
        assert outcome.reason.startswith(f"cycle {cycle + step}")
    assert bob.agent.host.viewer.view().cycle == cycle + 3
    host = bob.agent.host
    await until(lambda: host._clock.now() > (host._mind.wake_at or 0), "its timer is due")
    assert (await bob.order("step")).reason == f"cycle {cycle + 4}"
    cycle += 1
    together = await asyncio.gather(*(bob.order("step") for _ in range(10)))
    assert all(outcome.ok for outcome in together)
    assert bob.agent.host.viewer.view().cycle == cycle + 13


async def test_a_goal_and_a_belief_come_from_the_operator(bob: Desk) -> None:
    assert await bob.order("goal", "say(1)") == Outcome(ok=True)
    assert await bob.order("goal", " !say([a,2]) ") == Outcome(ok=True)
    assert await bob.order("belief", "told(3)") == Outcome(ok=True)
    await until(lambda: len(bob.agent.prints) == 3, "it has done what it was given")
    assert bob.agent.prints == ["say 1 for operator", "say [a,2] for operator", "told 3 by operator"]
    assert "told(3)[source(operator)]" in bob.agent.beliefs
    await bob.order("pause")
    given = await bob.order("goal", "say(4)[source(self)]")
    assert given == Outcome(ok=True, reason="it is paused: it takes this when it continues")
    await bob.order("pause")
    assert len(bob.agent.prints) == 3
    await bob.order("resume")
    await until(lambda: len(bob.agent.prints) == 4, "it takes what it was given meanwhile")
    assert "operator" in bob.agent.prints[-1], "nobody speaks as somebody else"


@pytest.mark.parametrize(
    ("do", "text", "why"),
    [
        ("goal", "say(", "the goal cannot be read: the '(' of line 1, column 4 is not closed"),
        ("goal", "", "the goal cannot be read: "),
        ("goal", "say(1); .stopMAS", "the goal cannot be read: ';' is not allowed here"),
        ("goal", ".stopMAS", "the goal cannot be read: "),
        ("goal", "3", "the goal cannot be read: "),
        ("goal", "land(1)", "its program has no plan for +!land/1"),
        ("goal", "say(1,2)", "its program has no plan for +!say/2; it has plans for +!say/1"),
        ("belief", "told(X)", "a belief without variables was expected, got told(X)"),
        ("belief", "told(X) :- true", "the belief cannot be read: "),
        ("belief", "told(" + "[" * 101 + "]" * 101 + ")", "the belief cannot be taken: nested deeper than 100"),
        (
            "belief",
            "told(" + "f(" * 1300 + "1" + ")" * 1300 + ")",
            "the belief cannot be taken: nested deeper than 100",
        ),
        ("goal", "say(" + "[" * 2000, "the goal cannot be taken: nested deeper than 100"),
        ("resume", "", "it is not paused"),
    ],
)
async def test_what_cannot_be_done_is_refused_in_words(bob: Desk, do: str, text: str, why: str) -> None:
    outcome = await bob.order(do, text)
    assert not outcome.ok
    assert outcome.reason.startswith(why)
    assert "\n" not in outcome.reason


async def test_an_order_keeps_nobody_waiting(bob: Desk, caplog: pytest.LogCaptureFixture) -> None:
    """All agents of a process wait while one order is read: a large one is refused unread, and no line is long."""
    caplog.set_level("INFO", "control")
    query = bob.bus.query(keys.control("test", "bob"), MindOrder(do="belief", text="x" * 5000), Outcome, 5.0)
    [why] = [reply.error async for reply in query]
    assert why.endswith(" bytes, expected at most 4096")
    long = "told([" + ",".join(f'"({number}"' for number in range(400)) + "])"
    assert await bob.order("belief", long) == Outcome(ok=True), "brackets in texts are none"
    assert max(len(one.getMessage()) for one in caplog.records) < 300


async def test_a_pause_of_an_agent_with_a_robot_is_short_and_says_what_it_means(board: Board) -> None:
    bob = await desk(board, robot="uav1")
    means = "; until then nobody reacts to percepts of uav1"
    assert await bob.order("pause") == Outcome(ok=True, reason=f"it continues by itself in 60 s{means}")
    [note] = bob.agent.host.health().notes
    assert note.code == "mind_paused"
    assert note.text.endswith(means)


async def test_pausing_again_does_not_move_the_end(bob: Desk) -> None:
    await bob.order("pause")
    held, cycle = bob.agent.host._control, bob.agent.host.viewer.view().cycle
    end = held._until
    outcome = await bob.order("pause")
    assert outcome.reason.startswith("it was paused already, and it continues by itself in ")
    assert held._until == end
    await bob.order("resume")
    await until(lambda: bob.agent.host.viewer.view().cycle > cycle, "it went on")


async def test_a_step_that_is_not_made_is_not_reported_as_made(bob: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_control, "STEP_PATIENCE", 0.05)
    held = bob.agent.host._control
    await held.carry_out(MindOrder(do="pause"))
    asked = [asyncio.create_task(held.carry_out(MindOrder(do="step"))) for _ in range(3)]
    await asyncio.sleep(0)
    assert (await held.carry_out(MindOrder(do="resume"))).ok
    told = await asyncio.gather(*asked)
    assert told == [Outcome(ok=False, reason="the mind went on before this step was made")] * 3
    monkeypatch.setattr(bob.agent.host, "_step", lambda: None)
    await held.carry_out(MindOrder(do="pause"))
    late = await held.carry_out(MindOrder(do="step"))
    assert late == Outcome(ok=False, reason="it has not been made within 0.05 s")
    assert held.take_step() is None, "it is not made later"


async def test_without_leave_of_the_mission_nothing_is_done(board: Board) -> None:
    bob = await desk(board, inject=False)
    for do in ("pause", "step", "resume", "goal", "belief"):
        assert await bob.order(do, "say(1)") == Outcome(ok=False, reason=operator_control.NOT_ALLOWED)
    assert bob.agent.host.viewer.view().state != "paused"
    assert bob.agent.prints == []


async def test_an_order_to_everybody_is_no_order(bob: Desk) -> None:
    said = [
        reply.error async for reply in bob.bus.query(keys.control("test", "*"), MindOrder(do="pause"), Outcome, 5.0)
    ]
    assert said == ["an order is for one mind: its key must not have a wildcard"]
    said = [reply.error async for reply in bob.bus.query(keys.control("test", "bob"), None, Outcome, 5.0)]
    assert said == ["an order was expected: do=pause, step, resume, goal or belief"]
    assert bob.agent.host.viewer.view().state != "paused"


async def test_nobody_forgets_a_paused_mind(board: Board, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_control, "LONGEST_PAUSE", 0.5)
    bob = await desk(board)
    outcome = await bob.order("pause")
    assert outcome == Outcome(ok=True, reason="it continues by itself in 0.5 s")
    before = count(bob.agent)
    await until(lambda: count(bob.agent) != before, "it goes on by itself")
    (note,) = bob.agent.host.health().notes
    assert note.code == "mind_went_on"
    assert note.text.endswith("a pause lasts at most 0.5 s")


async def test_a_pause_ends_when_too_much_waits(bob: Desk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(operator_control, "MOST_WAITING", 10)
    await bob.order("pause")
    for number in range(11):
        bob.agent.host.feed(PerceptReplaced(term(f"at({number})")))
    await until(lambda: "at(10)[source(percept)]" in bob.agent.beliefs, "it goes on by itself")
    (note,) = bob.agent.host.health().notes
    assert note.code == "mind_went_on"
    assert note.text.endswith("more than 10 inputs waited for it")


async def test_a_paused_mind_is_kept_and_takes_its_mail_when_it_goes_on(bob: Desk) -> None:
    await bob.order("pause")
    await bob.order("belief", "told(1)")
    await bob.order("step")
    await until(
        lambda: any(saving.mind is not None and saving.mind.beliefs for saving in bob.agent.disk.savings),
        "what it has become is kept while it is paused",
    )
    bob.agent.tell(Mail("ana", "tell", term("told(2)")))
    await until(lambda: bob.agent.host.viewer.view().mailbox == 1, "its mail waits")
    assert bob.agent.host.health().lag == 0.0
    await bob.order("resume")
    await until(lambda: "told 2 by ana" in bob.agent.prints, "it takes its mail")


async def test_a_paused_agent_leaves_immediately_when_asked_to(bob: Desk) -> None:
    await bob.order("pause")
    before = time.monotonic()
    await bob.agent.end()
    assert in_time(time.monotonic() - before, 5.0)


MISSION = """\
mission: two
{inject}
agents:
  ana: {{program: uav.asl}}
  bob: {{program: uav.asl}}
done: "ana: never"
"""


def test_a_daemon_with_several_agents_pauses_the_one_that_is_meant(tmp_path: Path, endpoint: str) -> None:
    (tmp_path / "uav.asl").write_text(PROGRAM)
    path = tmp_path / "m.yaml"
    path.write_text(MISSION.format(inject="inject: true"))

    async def mind(bus: Bus, agent: str) -> MindView:
        async for reply in bus.query(keys.mind("two", agent), None, MindView, 10.0):
            assert reply.record is not None, reply.error
            return reply.record
        raise AssertionError("nobody shows its mind")

    async def talk() -> None:
        async with open_bus(endpoint, fleet="two", name="op", daemon="test") as bus:
            await served(bus, keys.control("two", "ana"))
            await served(bus, keys.control("two", "bob"))
            assert (await order(bus, "ana", "pause", fleet="two")).ok
            assert (await mind(bus, "ana")).state == "paused"
            ana, bob = await mind(bus, "ana"), await mind(bus, "bob")
            async with asyncio.timeout(90):
                while (await mind(bus, "bob")).cycle < bob.cycle + 3:
                    pass
            assert (await mind(bus, "ana")).cycle == ana.cycle
            assert (await order(bus, "bob", "goal", "say(7)", fleet="two")).ok

    with daemons(str(path), endpoint, ("--state", str(tmp_path))) as (agents,):
        asyncio.run(asyncio.wait_for(talk(), 240))
        agents.says("say 7 for operator")
        agents.process.terminate()
        before = time.monotonic()
        agents.ends()
        assert in_time(time.monotonic() - before, 10.0), "a paused agent keeps nobody from ending"
