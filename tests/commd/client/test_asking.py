"""A program asks: answers come back to who asked, and mail is numbered as before."""

import asyncio
from pathlib import Path
from typing import Any

import pytest

from commd.client import Client, NotSent, SendTimeout, Unanswered, join, parse, receive_mail, write
from commd.client.receive_mail import ProgramInbox, read_numbers
from commd.client.receive_once import Numbered
from schemas.wire.records import Receipt
from schemas.wire.terms import Structure
from tests.commd.client.test_client import as_planner, as_virtual_planner, mail, planner_test, virtual_planner_test
from tests.commd.scripted_commd import ScriptedCommd
from tests.support.buses import until
from tests.support.processes import running

MISSION = Path(__file__).parents[3] / "examples" / "client" / "survey.yaml"
NOT_DONE = ProgramInbox.NOT_DONE
QUESTION = parse("victims(east, N)")


def test_an_agent_answers_what_it_believes_and_what_it_does_not(endpoint: str, tmp_path: Path) -> None:
    async def ask() -> None:
        async with join("planner", mission=MISSION, router=endpoint, patience=30) as me:
            answer = await me.ask("scout", QUESTION)
            assert isinstance(answer, Structure)
            assert write(answer).startswith("victims(east,2)")
            assert await me.ask("scout", parse("victims(atlantis, N)")) is False
            several = [me.ask("scout", parse(f"victims({one}, N)")) for one in ("north", "south", "east")]
            assert [write(one)[:16] for one in await asyncio.gather(*several)] == [
                "victims(north,0)",
                "victims(south,1)",
                "victims(east,2)[",
            ]
            await me.send("scout", "achieve", parse("survey(east)"))
            async with asyncio.timeout(240):
                async for message in me.messages():
                    assert write(message.content) == "surveyed(east,2)", "an answer is no message"
                    break

    where = ("--router", endpoint, "--state", str(tmp_path))
    with running("commd", "serve", str(MISSION), *where) as commd:
        commd.says("router board=")
        with running("agentd", "serve", str(MISSION), "scout", *where):
            asyncio.run(asyncio.wait_for(ask(), 240))


def asked(commd: ScriptedCommd, place: int = -1) -> str:
    assert commd.taken[place].performative == "askOne"
    return commd.taken[place].id


@virtual_planner_test
async def test_nobody_answers(me: Client, commd: ScriptedCommd) -> None:
    with pytest.raises(Unanswered, match=r"victims\(east,N\) to scout: no answer within 0.3 s"):
        await me.ask("scout", QUESTION, patience=0.3)
    receipt = await commd.offer(mail(1, in_reply_to=asked(commd)), mail(2))
    assert receipt == Receipt(taken=1, later={1: NOT_DONE}), "the late answer is dropped"
    commd.answers = ["the disk is full"] * 100
    with pytest.raises(SendTimeout):
        await me.ask("scout", QUESTION, patience=0.3)


@planner_test
async def test_who_asks_with_a_message_in_hand_has_the_answer_that_stands_behind_it(
    me: Client, commd: ScriptedCommd, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(receive_mail, "ANSWER_WITHIN", 1000.0)
    held = asyncio.create_task(commd.offer(mail(1), patience=1000))
    reading = me.messages()
    assert (await anext(reading)).content == 1
    assert not held.done()
    asking = asyncio.create_task(me.ask("scout", QUESTION, patience=240))
    assert await asyncio.wait_for(held, 120) == Receipt(later={0: NOT_DONE}), "its commd may offer what is behind"
    offer = commd.offer(mail(1), mail(2, in_reply_to=asked(commd)))
    assert await asyncio.wait_for(offer, 120) == Receipt(later={0: NOT_DONE, 1: NOT_DONE})
    assert await asking == 2


@planner_test
async def test_an_answer_is_given_also_when_there_is_no_room_for_more_mail(
    me: Client, commd: ScriptedCommd, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(receive_mail, "ROOM", 2)
    asking = asyncio.create_task(me.ask("scout", QUESTION, patience=240))
    await until(lambda: commd.taken, "the question")
    offer = commd.offer(*(mail(number) for number in (1, 2, 3)), mail(4, in_reply_to=asked(commd)), patience=1000)
    offered = asyncio.create_task(offer)
    assert await asyncio.wait_for(asking, 120) == 4
    offered.cancel()


@virtual_planner_test
async def test_who_reads_no_mail_is_told_that_an_answer_may_stand_behind_it(me: Client, commd: ScriptedCommd) -> None:
    offered = asyncio.create_task(commd.offer(mail(1), mail(2), mail(1, sender="rescuer")))
    with pytest.raises(Unanswered, match="no answer within 1 s; it may be behind 3 messages that are not done"):
        await me.ask("scout", QUESTION, patience=1)
    await offered


@virtual_planner_test
async def test_a_commd_that_says_nothing_is_no_agent_that_does_not_answer(me: Client, commd: ScriptedCommd) -> None:
    commd.hangs = True
    begun = asyncio.get_running_loop().time()
    first, second = await asyncio.gather(
        me.ask("scout", QUESTION, patience=1), me.ask("scout", QUESTION, patience=0.5), return_exceptions=True
    )
    assert asyncio.get_running_loop().time() - begun < 2
    assert isinstance(first, SendTimeout)
    assert isinstance(second, NotSent)
    assert str(second) == "askOne to scout: commd has not answered for an earlier message (0.5 s)"
    commd.hangs = False
    await me.send_again(first)
    assert commd.taken[-1] == first.message


@virtual_planner_test
async def test_an_answer_that_overtakes_the_word_of_commd_is_one(me: Client, commd: ScriptedCommd) -> None:
    commd.answers = [None] * 100
    asking = asyncio.create_task(me.ask("scout", QUESTION, patience=1))
    await until(lambda: bool(commd.taken), "it has asked")
    assert await commd.offer(mail(1, in_reply_to=asked(commd))) == Receipt(taken=1)
    assert await asking == 1


def test_an_answer_is_done_with_only_when_what_its_sender_said_before_is(endpoint: str, tmp_path: Path) -> None:
    numbers = tmp_path / "numbers"

    async def body(me: Client, commd: ScriptedCommd) -> None:
        asking = asyncio.create_task(me.ask("scout", QUESTION))
        await until(lambda: bool(commd.taken), "it has asked")
        answer = mail(2, in_reply_to=asked(commd))
        offered = asyncio.create_task(commd.offer(mail(1), answer, mail(1, sender="rescuer")))
        assert await asking == 2, "before the program has come to the message before it"
        assert ("scout", answer.header.boot) not in (read_numbers(numbers) if numbers.exists() else {})
        contents = []
        async for message in me.messages():
            contents.append((message.sender, message.content))
            if len(contents) == 2:
                me.done(message)
                break
        assert contents == [("scout", 1), ("rescuer", 1)]
        assert await offered == Receipt(taken=3)
        assert read_numbers(numbers)[Numbered("scout", answer.header.boot)] == 2

    as_planner(endpoint, body, numbers=numbers)


@virtual_planner_test
async def test_an_answer_to_a_former_life_is_nobodys(me: Client, commd: ScriptedCommd) -> None:
    former = mail(1, in_reply_to="sync:1.planner.before")
    assert await commd.offer(former) == Receipt(taken=1)
    messages = me.messages()
    assert await commd.offer(mail(2), former, patience=10) == Receipt(taken=1, later={0: NOT_DONE})
    assert (await anext(messages)).content == 2


def test_a_span_of_the_mission_is_shorter_where_it_is_flown_fast() -> None:
    async def body(me: Client, _: Any) -> None:
        assert (me.speed, me.wall(10)) == (5, 2)
        begun = asyncio.get_running_loop().time()
        await me.sleep(1)
        assert asyncio.get_running_loop().time() - begun == pytest.approx(0.2)

    as_virtual_planner(body, speed=5)
