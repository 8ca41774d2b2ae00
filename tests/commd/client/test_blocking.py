"""Programs without an event loop as members of the team."""

import asyncio
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from commd.client import NotJoined, UnknownReceiver, blocking
from schemas.mission.model import load_mission, read_mission
from schemas.wire import keys
from schemas.wire.records import Receipt, Refusal
from tests.bridged.studio import in_the_studio
from tests.commd.client.test_client import mail
from tests.commd.client.test_client_robot import MISSION
from tests.commd.scripted_commd import ScriptedCommd
from tests.support.buses import FLEET, Connect, on_a_bus, served


def beside(endpoint: str, program: Callable[[ScriptedCommd, asyncio.AbstractEventLoop], None]) -> None:
    """Run a program in a thread beside a `commd`."""

    async def everything(connect: Connect) -> None:
        commd = ScriptedCommd(await connect("local", "commd"), "planner")
        await asyncio.wait_for(asyncio.to_thread(program, commd, asyncio.get_running_loop()), 120)

    on_a_bus(endpoint, everything)


def test_a_program_without_a_loop_sends_and_receives(endpoint: str) -> None:
    def program(commd: ScriptedCommd, loop: asyncio.AbstractEventLoop) -> None:
        async def offer() -> Receipt | None:
            await served(commd._bus, keys.inbox(FLEET, "planner"))
            return await commd.offer(mail(1), mail(2))

        with blocking.join("planner", fleet=FLEET, router=endpoint) as me:
            me.send("scout", "tell", [1, "x"])
            commd.answers = [Receipt(refused={0: Refusal(code="receiver_not_found")})]
            with pytest.raises(UnknownReceiver):
                me.send("nobody", "tell", 1)
            me.register("plan")
            assert me.search("plan") == ()
            assert list(me.messages(within=0.05)) == []
            offered = asyncio.run_coroutine_threadsafe(offer(), loop)
            for message in me.messages(within=20):
                me.done(message)
                if message.content == 2:
                    break
            assert offered.result(90) == Receipt(taken=2)
        assert [one.content for one in commd.taken] == [[1, "x"]]
        assert [one.do for one in commd.asked] == ["join", "register", "search", "leave"]

    beside(endpoint, program)
    assert not [one for one in threading.enumerate() if one.name.startswith("planner")]


def test_what_fails_in_the_block_or_on_the_way_in_is_raised(endpoint: str) -> None:
    def program(commd: ScriptedCommd, loop: asyncio.AbstractEventLoop) -> None:
        with pytest.raises(ZeroDivisionError), blocking.join("planner", fleet=FLEET, router=endpoint):
            raise ZeroDivisionError
        assert [one.do for one in commd.asked] == ["join"]  # its mail waits for its return
        with (
            pytest.raises(NotJoined, match="commd of board `pi7`"),
            blocking.join("planner", fleet=FLEET, router=endpoint, board="pi7", patience=0.3),
        ):
            pass

    beside(endpoint, program)


async def test_a_program_without_a_loop_has_a_robot(endpoint: str, tmp_path: Path) -> None:
    mission = read_mission(MISSION, Path(load_mission("missions/turtle.yaml").path))

    def program() -> None:
        with blocking.join("driver", mission=mission, router=endpoint) as me:
            assert {one.name for one in me.present(within=20)} <= {"pose", "velocity"}
            assert me.present()
            assert me.perform("teleport", 1, 2, 0).state == "succeeded"

    async with in_the_studio(endpoint, tmp_path, mission=mission) as studio:
        await asyncio.to_thread(program)
        assert (studio.turtle.x, studio.turtle.y) == (1.0, 2.0)
