"""Programs, old Comm nodes and the radio before real `commd` processes, with real mail on disk."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from commd.client import Client, MailboxFull, TooLarge, UnknownReceiver, join, parse, write
from schemas.wire import keys
from schemas.wire.records import Health, Message, Perception
from tests.commd.old_comm import OldCommNode
from tests.support.buses import until
from tests.support.processes import Daemon, running

MIXED = """
mission: mixed
agents: {{uav: {{program: u.asl, accepts: {{old1: [tell, askOne]}}}}}}
clients: {{planner: {{}}, viewer: {{}}}}
gateway: {{listen: "{listen}", nodes: {{old1: "{node}"}}}}
mail: {{mailbox: 5}}
"""

FAR = """
mission: far
boards: {pi1: {}, pi2: {}}
agents: {uav: {program: u.asl, board: pi1}}
clients: {near: {board: pi1}, distant: {board: pi2}}
radio: {loss: 0.3, delay: 5ms, seed: 8}  # the first transmission of either board is lost
"""


@pytest.fixture
def mission(tmp_path: Path, free_port: Callable[[], int]) -> Path:
    """The mixed mission, whose old node nobody runs."""
    path = tmp_path / "mixed.yaml"
    path.write_text(MIXED.format(listen=f"127.0.0.1:{free_port()}", node="127.0.0.1:9"))
    return path


def commd(mission: Path, state: Path, endpoint: str, *arguments: str) -> contextlib.AbstractContextManager[Daemon]:
    return running("commd", "serve", str(mission), "--state", str(state), "--router", endpoint, *arguments)


async def take(me: Client, count: int) -> list[Message]:
    """The next so many messages, each done with."""
    found: list[Message] = []
    async with asyncio.timeout(240):
        async for message in me.messages():
            found.append(message)
            me.done(message)
            if len(found) == count:
                break
    return found


async def test_two_programs_exchange_mail_and_what_one_sends_waits_for_the_other_across_a_killed_commd(
    endpoint: str, tmp_path: Path, mission: Path
) -> None:
    with commd(mission, tmp_path, endpoint) as first:
        await asyncio.to_thread(first.says, "router board=local")
        async with join("planner", mission=mission, router=endpoint) as me:
            for number in range(3):
                await me.send("viewer", "tell", number)
            with pytest.raises(UnknownReceiver):
                await me.send("nobody", "tell", 1)
            with pytest.raises(TooLarge):
                await me.send("viewer", "tell", "x" * 2**20)
        first.kill()
    with commd(mission, tmp_path, endpoint) as second:
        await asyncio.to_thread(second.says, "router board=local")
        async with (
            join("viewer", mission=mission, router=endpoint) as me,
            join("planner", mission=mission, router=endpoint) as other,
        ):
            assert [one.content for one in await take(me, 3)] == [0, 1, 2]
            answer = await me.send("planner", "tell", parse("seen(3)"), in_reply_to="p1")
            assert await take(other, 1) == [answer]


async def test_a_program_stays_a_member_while_commd_is_restarted(endpoint: str, tmp_path: Path, mission: Path) -> None:
    async with contextlib.AsyncExitStack() as stack:
        with commd(mission, tmp_path, endpoint) as first:
            await asyncio.to_thread(first.says, "router board=local")
            planner = await stack.enter_async_context(join("planner", mission=mission, router=endpoint))
            viewer = await stack.enter_async_context(join("viewer", mission=mission, router=endpoint))
            await planner.send("viewer", "tell", 1)
            reading = viewer.messages()
            assert (await asyncio.wait_for(anext(reading), 120)).content == 1  # in hand when commd dies
            first.kill()
        sending = asyncio.create_task(planner.send("viewer", "tell", 2, patience=60))
        with commd(mission, tmp_path, endpoint) as second:
            await asyncio.to_thread(second.says, "router board=local")
            await sending
            assert (await asyncio.wait_for(anext(reading), 120)).content == 2
            await planner.send("viewer", "tell", 3)
            assert (await asyncio.wait_for(anext(reading), 120)).content == 3
            await stack.aclose()


async def test_a_program_that_was_away_gets_each_message_once_and_a_full_mailbox_is_said(
    endpoint: str, tmp_path: Path, mission: Path
) -> None:
    with commd(mission, tmp_path, endpoint) as daemon:
        await asyncio.to_thread(daemon.says, "router board=local")
        async with join("planner", mission=mission, router=endpoint) as me:
            for number in range(5):
                await me.send("viewer", "tell", number)
            with pytest.raises(MailboxFull):
                await me.send("viewer", "tell", 5, patience=0.5)
            async with join("viewer", mission=mission, router=endpoint) as viewer:
                assert [one.content for one in await take(viewer, 2)] == [0, 1]
            await me.send("viewer", "tell", "late")
            async with join("viewer", mission=mission, router=endpoint) as viewer:
                left = [one.content for one in await take(viewer, 4)]
                assert left == [2, 3, 4, "late"]


async def test_an_unnamed_program_joins_is_sent_to_and_leaves(endpoint: str, tmp_path: Path, mission: Path) -> None:
    with commd(mission, tmp_path, endpoint) as daemon:
        await asyncio.to_thread(daemon.says, "router board=local")
        async with join("planner", mission=mission, router=endpoint) as me:
            async with join("guest", fleet="mixed", router=endpoint) as guest:
                await guest.register("guide")
                assert await me.search("guide") == ("guest",)
                await me.send("guest", "tell", "welcome")
                assert [one.content for one in await take(guest, 1)] == ["welcome"]
            assert await me.search("guide") == ()
            with pytest.raises(UnknownReceiver):
                await me.send("guest", "tell", "farewell")


async def test_an_old_node_and_a_program_talk(endpoint: str, tmp_path: Path, free_port: Callable[[], int]) -> None:
    node, listen = OldCommNode(), f"127.0.0.1:{free_port()}"
    mission = tmp_path / "mixed.yaml"
    mission.write_text(MIXED.format(listen=listen, node=node.address))
    try:
        with commd(mission, tmp_path, endpoint) as daemon:
            await asyncio.to_thread(daemon.says, f"listening to {listen} for old1")
            async with join("planner", mission=mission, router=endpoint) as me:
                node.send("<mid1,old1,askOne,planner,victim(X)>", listen)
                asked = (await take(me, 1))[0]
                assert (asked.sender, asked.id, write(asked.content)) == ("old1", "mid1", "victim(X)")
                sent = await me.send("old1", "tell", parse("victim(3)"), in_reply_to=asked.id)
                await until(lambda: len(node.heard) == 1, "the node hears the answer")
                assert node.heard == [f"<{sent.id}->mid1,planner,tell,old1,victim(3)>"]
                await me.send("old1", "tell", "x" * 2000)
                notice = (await take(me, 1))[0]
                assert (notice.sender, notice.performative) == ("mail", "signal")
                assert write(notice.content).startswith('undelivered(old1,tell,"xxx')
                assert "Comm nodes read 1024" in write(notice.content)
                node.send("<mid2,old1,tell,nobody,hello>", listen)
                await until(lambda: len(node.heard) == 2, "the node hears that nobody has it")
                assert "receiver_not_found" in node.heard[1]
    finally:
        await node.close()


@contextlib.asynccontextmanager
async def near_and_distant(
    mission: str, endpoint: str, state: Path, free_port: Callable[[], int], degraded: str
) -> AsyncIterator[tuple[Client, Client]]:
    """A program on each of two boards, whose commd say that mail between them is degraded."""
    path = state / "mission.yaml"
    path.write_text(mission)
    other, between = f"tcp/127.0.0.1:{free_port()}", f"tcp/127.0.0.1:{free_port()}"
    with (
        commd(path, state, endpoint, "--board", "pi1", "--listen", between) as one,
        commd(path, state, other, "--board", "pi2", "--connect", between) as two,
    ):
        for daemon in (one, two):
            await asyncio.to_thread(daemon.says, f"mail between boards is degraded on purpose{degraded}")
        async with (
            join("near", mission=path, router=endpoint) as near,
            join("distant", mission=path, router=other) as distant,
        ):
            yield near, distant


async def test_mail_crosses_bad_radio_in_order(endpoint: str, tmp_path: Path, free_port: Callable[[], int]) -> None:
    async with near_and_distant(FAR, endpoint, tmp_path, free_port, "") as (near, distant):
        healths: dict[str, Health] = {}
        near._bus.subscribe(keys.health("far", "*", "commd"), Health, healths.__setitem__)
        for number in range(40):
            await near.send("distant", "tell", number)
            await distant.send("near", "tell", number)
        there, here = await asyncio.gather(take(distant, 40), take(near, 40))
        assert [message.content for message in there] == list(range(40))
        assert [message.content for message in here] == list(range(40))
        lost = [keys.health("far", board, "commd") for board in ("pi1", "pi2")]
        await until(
            lambda: all(key in healths and healths[key].counters.get("radio_lost", 0) > 0 for key in lost),
            "both boards have lost transmissions",
        )
        degraded = [note for note in healths[lost[0]].notes if note.code == "radio_degraded"]
        assert ["loss 0.3, delay 5ms" in note.text for note in degraded] == [True]


APART = """
mission: apart
boards: {pi1: {}, pi2: {}}
agents: {uav: {program: u.asl, board: pi1}}
clients: {near: {board: pi1, robot: uav1}, distant: {board: pi2, robot: uav2}}
robots:
  uav1: {manifest: copter, link: "udpin:127.0.0.1:1", board: pi1, simulate: {home: [0, 0, 0]}}
  uav2: {manifest: copter, link: "udpin:127.0.0.1:2", board: pi2, simulate: {home: [0, 0, 0]}}
radio: {range: 300m}
"""


async def test_mail_waits_for_robots_out_of_range(endpoint: str, tmp_path: Path, free_port: Callable[[], int]) -> None:
    async with near_and_distant(APART, endpoint, tmp_path, free_port, ", as the mission declares: range 300m") as (
        near,
        distant,
    ):
        where = Perception(name="global_pos", parameters=(0.0, 0.01))  # 1.1 km to the east

        async def fly() -> None:
            """Be the bridge of the distant robot."""
            while True:
                distant._bus.put(keys.percept("apart", "distant", "global_pos"), where)
                await asyncio.sleep(0.05)

        healths: dict[str, Health] = {}
        near._bus.subscribe(keys.health("apart", "pi1", "commd"), Health, healths.__setitem__)
        flying = asyncio.create_task(fly())

        def lost() -> float:
            return sum(one.counters.get("radio_out_of_range", 0) for one in healths.values())

        number = 0
        while not lost():  # the air of pi1 has to hear of the position first
            number += 1
            await near.send("distant", "tell", number)
            await asyncio.sleep(0.1)
        where = Perception(name="global_pos", parameters=(0.0, 0.0025))  # 278 m
        assert [one.content for one in await take(distant, number)] == list(range(1, number + 1))
        flying.cancel()
