"""Programs in Python as members of the team: on real Zenoh, before a `commd` that answers as it is told."""

import asyncio
import json
from collections.abc import Callable, Coroutine
from pathlib import Path
from typing import Any

import pytest
from msgspec.structs import replace

from commd.bus.bus import Bus
from commd.bus.errors import AlreadyRunning
from commd.client import (
    Client,
    MailboxFull,
    NotJoined,
    NotSendable,
    NotSent,
    SendTimeout,
    TooLarge,
    UnknownReceiver,
    join,
    parse,
    receive_mail,
    write,
)
from schemas.mission.model import read_mission
from schemas.wire import keys
from schemas.wire.records import BoardServices, Header, Message, Receipt, Refusal
from schemas.wire.terms import Atom, Map, Number, Structure
from tests.commd.scripted_commd import ScriptedCommd
from tests.support.buses import (
    FLEET,
    VIRTUAL_ENDPOINT,
    Connect,
    on_a_bus,
    on_a_virtual_bus,
    run_by,
    served,
    session,
    until,
    virtual_bus_test,
)

NOT_DONE = receive_mail.ProgramInbox.NOT_DONE

Body = Callable[[Client, ScriptedCommd], Coroutine[Any, Any, None]]


def planner(body: Body, router: str, **arguments: Any) -> Callable[[Connect], Coroutine[Any, Any, None]]:
    """Return what runs `body(me, commd)` as the client `planner`, which the mission does not name."""

    async def everything(connect: Connect) -> None:
        bus = await connect("local", "commd")
        commd = ScriptedCommd(bus, "planner")
        async with join("planner", fleet=FLEET, router=router, **arguments) as me:
            await served(bus, keys.inbox(FLEET, "planner"))
            await body(me, commd)

    return everything


def as_planner(endpoint: str, body: Body, **arguments: Any) -> None:
    """Run `body(me, commd)` on a real bus."""
    on_a_bus(endpoint, planner(body, endpoint, **arguments))


def as_virtual_planner(body: Body, **arguments: Any) -> None:
    """Run it on the virtual network, in virtual time."""
    on_a_virtual_bus(planner(body, VIRTUAL_ENDPOINT, **arguments))


planner_test = run_by(lambda body, endpoint: as_planner(endpoint, body), "me", "commd", needs=("endpoint",))
virtual_planner_test = run_by(as_virtual_planner, "me", "commd")


def mail(number: int, sender: str = "scout", boot: str = "life1", **more: Any) -> Message:
    return Message(
        header=Header(seq=number, boot=boot),
        id=f"{sender}{number}",
        sender=sender,
        performative="tell",
        receiver="planner",
        content=number,
        **more,
    )


async def test_a_program_learns_who_is_there(connect: Connect, endpoint: str) -> None:
    ScriptedCommd(await connect("local", "commd"), "planner")
    async with join("planner", fleet=FLEET, router=endpoint) as me:
        assert await me.there("planner")
        assert not await me.there("scout")
        for no_name in ("*", "", "a/b"):
            with pytest.raises(ValueError, match="Expected a name"):
                await me.there(no_name)
        scout = await connect("scout", "agentd")
        token = await scout.claim("scout")
        await until(lambda: me.there("scout"), "the scout is there")
        scout.withdraw(token)

        async def gone() -> bool:
            return not await me.there("scout")

        await until(gone, "the scout is gone")


@pytest.mark.parametrize("speed", [0, -1, 101, float("nan")])
async def test_a_speed_that_no_mission_may_have_is_none_for_a_program(speed: float) -> None:
    with pytest.raises(NotJoined, match=f"speed: expected more than 0 and at most 100, got {speed}"):
        async with join("planner", fleet=FLEET, router="tcp/127.0.0.1:1", speed=speed, patience=0.1):
            pass


@planner_test
async def test_what_is_sent_is_numbered_per_receiver_and_returned_when_taken(me: Client, commd: ScriptedCommd) -> None:
    sent = await me.send("scout", "achieve", parse("survey(north, [1, 2.5])"), ttl=5.0)
    await me.send("rescuer", "tell", "a text")
    await me.send("scout", "tell", Atom("go"), in_reply_to="q1")
    assert commd.taken[0] == sent
    assert [(one.receiver, one.header.seq, one.content, one.ttl, one.in_reply_to) for one in commd.taken] == [
        ("scout", 1, Structure("survey", (Atom("north"), [1, 2.5])), 5.0, ""),
        ("rescuer", 1, "a text", None, ""),
        ("scout", 2, Atom("go"), None, "q1"),
    ]
    assert len({one.header.boot for one in commd.taken}) == 1
    assert {one.sender for one in commd.taken} == {"planner"}
    assert len({one.id for one in commd.taken}) == 3


@planner_test
async def test_python_values_are_terms(me: Client, commd: ScriptedCommd) -> None:
    await me.send("scout", "tell", [1, 2.5, True, "x", ("y",), {"k": float("inf")}, Atom("a")])
    expected = [1, 2.5, True, "x", ["y"], Map((("k", Number("Infinity")),)), Atom("a")]
    assert commd.taken[0].content == expected
    with pytest.raises(TypeError, match="None cannot be a term"):
        await me.send("scout", "tell", None)


@pytest.mark.parametrize(
    ("answer", "error", "text"),
    [
        (Receipt(refused={0: Refusal(code="receiver_not_found")}), UnknownReceiver, "nobody knows an agent `scout`"),
        (Receipt(refused={0: Refusal(code="message_too_large")}), TooLarge, "message_too_large"),
        (Receipt(refused={0: Refusal(code="no such thing")}), NotSent, "no such thing"),
    ],
)
@planner_test
async def test_what_is_refused_for_good_raises_the_reason(
    me: Client, commd: ScriptedCommd, answer: Receipt, error: type[NotSent], text: str
) -> None:
    commd.answers = [answer]
    with pytest.raises(error) as raised:
        await me.send("scout", "tell", 1)
    assert str(raised.value) == f"tell to scout: {text}"
    assert raised.value.message.content == 1
    await me.send("scout", "tell", 2)
    assert [one.content for one in commd.taken] == [2]


@pytest.mark.usefixtures("usual_recursion")
@planner_test
async def test_what_cannot_be_sent_raises_before_it_leaves_and_uses_no_number(me: Client, commd: ScriptedCommd) -> None:
    deep: list[Any] = []
    for _ in range(3000):
        deep = [deep]
    for performative, content, error, text in (
        ("tell", "x" * 2**20, TooLarge, "expected at most 1048576"),
        ("tell", "\ud800", NotSendable, r"expected Unicode text, got half a character: '\\ud800'"),
        ("tell", deep, NotSendable, "nested too deeply"),
        ("tell", Map((("k", deep),)), NotSendable, "nested too deeply"),
        ("tell", float("nan"), NotSendable, "is NaN"),
        ("tel", 1, NotSendable, "no performative `tel`, expected `tell`"),
    ):
        with pytest.raises(error, match=text) as raised:
            await me.send("scout", performative, content)
        assert str(raised.value).startswith(f"{performative} to scout: ")
    await me.send("scout", "of_my_own", 1)
    assert [(one.performative, one.header.seq) for one in commd.taken] == [("of_my_own", 1)]


@planner_test
async def test_a_refused_message_uses_no_number_one_that_may_be_there_does(me: Client, commd: ScriptedCommd) -> None:
    full, refused = (
        Receipt(later={0: Refusal(code="mailbox_full")}),
        Receipt(refused={0: Refusal(code="no such thing")}),
    )
    for answers in ([refused], [full] * 9, [None, refused]):
        commd.answers = list(answers)
        with pytest.raises(NotSent):
            await me.send("scout", "tell", 0, patience=0.1 if answers[0] is full else 60)
        commd.answers = []
        await me.send("scout", "tell", 1)
    assert [(one.content, one.header.seq) for one in commd.taken] == [(1, 1), (1, 2), (0, 3), (1, 4)]


@virtual_planner_test
async def test_a_full_mailbox_is_waited_for_and_then_said(me: Client, commd: ScriptedCommd) -> None:
    full = Receipt(later={0: Refusal(code="mailbox_full")})
    commd.answers = [full, full]
    await me.send("scout", "tell", 1)
    commd.answers = [full] * 100
    with pytest.raises(MailboxFull, match="tell to scout: mailbox_full"):
        await me.send("scout", "tell", 2, patience=0.5)
    assert [one.content for one in commd.taken] == [1]


@virtual_planner_test
async def test_without_an_answer_a_message_goes_again_under_its_own_number(me: Client, commd: ScriptedCommd) -> None:
    commd.answers = [None, "busy", Receipt(taken=5), Receipt(taken=1)]
    await me.send("scout", "tell", 1)
    assert [(one.content, one.header.seq) for one in commd.taken] == [(1, 1), (1, 1), (1, 1)]
    commd.taken.clear()
    commd.answers = [None] * 100
    with pytest.raises(SendTimeout) as raised:
        await me.send("scout", "tell", 2, patience=0.5)
    assert isinstance(raised.value, TimeoutError)
    assert str(raised.value) == "tell to scout: commd: nobody answers (0.5 s)"
    commd.answers = []
    await me.send_again(raised.value)
    assert {(one.content, one.header.seq) for one in commd.taken} == {(2, 2)}
    await me.send("scout", "tell", 3)
    with pytest.raises(ValueError, match="another message to scout has been sent since"):
        await me.send_again(raised.value)


@planner_test
async def test_messages_are_acknowledged_when_the_program_is_done_with_them(me: Client, commd: ScriptedCommd) -> None:
    got: list[Message] = []
    go_on = asyncio.Semaphore(0)

    async def work() -> None:
        async for message in me.messages():
            got.append(message)
            await go_on.acquire()

    working = asyncio.create_task(work())
    asking = asyncio.create_task(commd.offer(mail(1), mail(2), mail(1, "rescuer")))
    await until(lambda: len(got) == 1, "the first is in hand")
    assert not asking.done()
    for _ in range(3):
        go_on.release()
    assert await asking == Receipt(taken=3)
    assert [(one.sender, one.content) for one in got] == [("scout", 1), ("scout", 2), ("rescuer", 1)]
    assert await commd.offer(mail(2), mail(1)) == Receipt(taken=2)  # repeated
    assert len(got) == 3
    working.cancel()


@virtual_planner_test
async def test_commd_hears_how_far_a_slow_program_has_come_and_offers_the_rest_again(
    me: Client, commd: ScriptedCommd, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(receive_mail, "ANSWER_WITHIN", 0.3)
    reading = me.messages()
    later = {1: NOT_DONE, 2: NOT_DONE}
    asking = asyncio.create_task(commd.offer(mail(1), mail(2), mail(3)))
    assert (await anext(reading)).content == 1
    assert (await anext(reading)).content == 2
    assert await asking == Receipt(taken=1, later=later)
    asking = asyncio.create_task(commd.offer(mail(2), mail(3)))
    assert (await anext(reading)).content == 3
    me.done(mail(3))  # not the one in hand: says nothing
    assert await asking == Receipt(taken=1, later={1: later[1]})


@planner_test
async def test_a_message_that_a_loop_was_left_with_comes_again_unless_done(me: Client, commd: ScriptedCommd) -> None:
    asking = asyncio.create_task(commd.offer(mail(1), mail(2)))
    async for message in me.messages():
        assert message.content == 1
        break
    async for message in me.messages():
        assert message.content == 1
        me.done(message)
        break
    async for message in me.messages():
        assert message.content == 2
        me.done(message)
        break
    assert await asking == Receipt(taken=2)


@planner_test
async def test_one_loop_reads_at_a_time(me: Client, commd: ScriptedCommd) -> None:
    first, second = me.messages(), me.messages()
    with pytest.raises(RuntimeError, match="another event loop reads the messages"):
        await anext(first)
    asking = asyncio.create_task(commd.offer(mail(1)))
    me.done(await anext(second))
    assert await asking == Receipt(taken=1)


@virtual_planner_test
async def test_what_expires_while_it_waits_is_not_handed_out(
    me: Client, commd: ScriptedCommd, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(receive_mail, "ANSWER_WITHIN", 0.1)
    late = mail(1, ttl=0.001)
    assert await commd.offer(late, mail(2)) == Receipt(later=dict.fromkeys((0, 1), NOT_DONE))
    messages = me.messages()
    message = await anext(messages)
    assert message.content == 2
    me.done(message)
    for _ in range(2):  # the first answer is lost
        assert await commd.offer(replace(late, ttl=0.0), mail(2)) == Receipt(
            taken=1, refused={0: Refusal(code="expired")}
        )


@planner_test
async def test_a_message_without_number_or_for_somebody_else_is_refused(me: Client, commd: ScriptedCommd) -> None:
    receipt = await commd.offer(Message(id="x", sender="a", performative="tell", receiver="planner", content=1))
    why = "expected a numbered message to planner, as commd hands it over"
    assert receipt == Receipt(refused={0: Refusal(code="wrong_address", text=why)})


async def test_the_end_of_a_program_tells_commd_what_was_done(connect: Connect, endpoint: str) -> None:
    bus = await connect("local", "commd")
    commd = ScriptedCommd(bus, "planner")
    async with join("planner", fleet=FLEET, router=endpoint) as me:
        await served(bus, keys.inbox(FLEET, "planner"))
        asking = asyncio.create_task(commd.offer(mail(1), mail(2)))
        me.done(await anext(me.messages()))
    assert await asking == Receipt(taken=1, later={1: NOT_DONE})


def test_numbers_in_a_file_are_known_to_the_next_life(endpoint: str, tmp_path: Path) -> None:
    file = tmp_path / "planner.numbers"

    async def first(me: Client, commd: ScriptedCommd) -> None:
        asking = asyncio.create_task(commd.offer(mail(1), mail(7, boot="life2"), mail(3, "rescuer")))
        reading = me.messages()
        for _ in range(3):
            me.done(await anext(reading))
        await asking

    async def second(me: Client, commd: ScriptedCommd) -> None:
        assert await commd.offer(mail(1), mail(3, "rescuer")) == Receipt(taken=2)
        asking = asyncio.create_task(commd.offer(mail(2)))
        assert (await anext(me.messages())).content == 2
        await asyncio.wait([asking])

    as_planner(endpoint, first, numbers=file)
    assert json.loads(file.read_text()) == {"scout": {"life1": 1, "life2": 7}, "rescuer": {"life1": 3}}
    as_planner(endpoint, second, numbers=file)


def test_an_unreadable_file_of_numbers_is_set_aside_and_said(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "planner.numbers"
    file.write_text("{nonsense")
    assert receive_mail.read_numbers(file) == {}
    assert (tmp_path / "planner.numbers.corrupt").read_text() == "{nonsense"
    assert "set aside" in caplog.text


async def test_a_program_joins_and_leaves_the_directory_and_asks_it(connect: Connect, endpoint: str) -> None:
    commd = ScriptedCommd(await connect("local", "commd"), "planner")
    commd.answer_directory = lambda request: BoardServices(found=("scout",) if request.do == "search" else ())
    async with join("planner", fleet=FLEET, router=endpoint) as me:
        await me.register("plan")
        assert await me.search("camera") == ("scout",)
    async with join("planner", fleet=FLEET, router=endpoint, stays=True):
        pass
    with pytest.raises(ZeroDivisionError):
        async with join("planner", fleet=FLEET, router=endpoint):
            raise ZeroDivisionError
    assert [(one.agent, one.do, one.service, one.stays) for one in commd.asked] == [
        ("planner", "join", "", False),
        ("planner", "register", "plan", False),
        ("planner", "search", "camera", False),
        ("planner", "leave", "", False),
        ("planner", "join", "", True),
        ("planner", "join", "", False),
    ]


async def test_a_program_that_is_not_let_in_is_told_why(connect: Connect, endpoint: str) -> None:
    commd = ScriptedCommd(await connect("local", "commd"), "planner")
    commd.answer_directory = lambda _: BoardServices(problem="`planner` lives on board pi2")
    with pytest.raises(NotJoined, match="join planner: `planner` lives on board pi2"):
        async with join("planner", fleet=FLEET, router=endpoint):
            pass


async def test_without_commd_or_router_a_program_does_not_wait_for_ever(endpoint: str) -> None:
    async with session(endpoint, "board", "commd", router=True):
        with pytest.raises(NotJoined, match=r"join: commd of board `local`, fleet `test`: nobody answers \(0.5 s\)"):
            async with join("planner", fleet=FLEET, router=endpoint, patience=0.5):
                pass
    with pytest.raises(NotJoined, match="no router at"):
        async with join("planner", fleet=FLEET, router=endpoint, patience=0.5):
            pass


@pytest.mark.parametrize("daemon", ["client", "agentd"])
@virtual_bus_test
async def test_a_name_is_had_by_one_alone(connect: Connect, daemon: str) -> None:
    other: Bus = await connect("planner", daemon)
    ScriptedCommd(await connect("local", "commd"), "planner")
    await other.claim("planner")
    with pytest.raises(AlreadyRunning, match="`planner`"):
        async with join("planner", fleet=FLEET, router=VIRTUAL_ENDPOINT):
            pass


MISSION = """
mission: survey
fleet: test
boards: {pi1: {}, pi2: {}}
agents: {scout: {program: s.asl, board: pi1}}
clients: {planner: {board: pi2}}
"""


async def test_a_mission_says_where_a_client_lives_and_needs_no_joining(connect: Connect, endpoint: str) -> None:
    declared = read_mission(MISSION, Path("survey.yaml"))
    commd = ScriptedCommd(await connect("pi2", "commd"), "planner")
    async with join("planner", mission=declared, router=endpoint) as me:
        assert me.board == "pi2"
        await me.send("scout", "tell", 1)
    assert commd.asked == []
    with pytest.raises(NotJoined, match="`scout` is an agent of the mission: a client needs a name of its own"):
        async with join("scout", mission=declared, router=endpoint):
            pass
    with pytest.raises(NotJoined, match="no board `pi3`"):
        async with join("other", mission=declared, router=endpoint, board="pi3"):
            pass


def test_terms_are_written_as_in_programs() -> None:
    assert parse("victim(3, 4.5)") == Structure("victim", (3, 4.5))
    assert write(parse('at(pi2, "the end", [a|T])')) == 'at(pi2,"the end",[a|T])'
