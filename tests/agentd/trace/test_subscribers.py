"""Which agents of a daemon learn that somebody listens to their traces, on real Zenoh."""

from __future__ import annotations

from functools import partial

from agentd.trace.subscribers import Channel, TraceSubscribers
from schemas.wire import keys
from tests.support.buses import FLEET, Connect, bus_test, until

Told = tuple[str, Channel, bool]


def followed(subscribers: TraceSubscribers, told: list[Told], *agents: str) -> None:
    """Add agents that note what they are told."""
    for agent in agents:
        subscribers.add(agent, partial(lambda who, channel, there: told.append((who, channel, there)), agent))


@bus_test
async def test_only_the_agent_whose_trace_has_a_subscriber_learns_of_it_and_of_its_end(connect: Connect) -> None:
    daemon, observer = await connect("a", "agentd"), await connect("observer", "argosy")
    told: list[Told] = []
    subscribers = TraceSubscribers(daemon)
    followed(subscribers, told, "a", "b")
    ear = observer.raw.subscribe(keys.trace(FLEET, "a", "inputs"), lambda _: None)
    await until(lambda: told, "the agent learns of it")
    assert told == [("a", "inputs", True)]
    ear.close()
    await until(lambda: len(told) > 1, "it learns of the end")
    assert told == [("a", "inputs", True), ("a", "inputs", False)]


@bus_test
async def test_a_subscriber_to_the_traces_of_all_is_seen_by_each_agent_also_by_one_that_comes_later(
    connect: Connect,
) -> None:
    daemon, observer = await connect("a", "agentd"), await connect("observer", "argosy")
    told: list[Told] = []
    subscribers = TraceSubscribers(daemon)
    many = [f"a{number}" for number in range(50)]
    followed(subscribers, told, *many)
    observer.raw.subscribe(keys.trace(FLEET, "*", "activity"), lambda _: None)
    await until(lambda: len(told) == len(many), "each agent learns of it")
    assert sorted(told) == sorted((agent, "activity", True) for agent in many)
    followed(subscribers, told, "late")
    await until(lambda: ("late", "activity", True) in told, "the late one learns of it, too")
    subscribers.remove("late")


@bus_test
async def test_agents_whose_traces_nobody_listens_to_have_no_listeners_of_their_own(connect: Connect) -> None:
    daemon, observer = await connect("a", "agentd"), await connect("observer", "argosy")
    subscribers = TraceSubscribers(daemon)
    before = len(daemon._listened)
    told: list[Told] = []
    followed(subscribers, told, "a", "b")
    assert len(daemon._listened) == before
    ear = observer.raw.subscribe(keys.trace(FLEET, "b", "decisions"), lambda _: None)
    await until(lambda: told, "the agent learns of it")
    ear.close()
    await until(lambda: len(told) > 1, "it learns of the end")
    assert len(daemon._listened) == before
