"""Attacks by what is said: in somebody else's name, twice, too much, too large, too deep."""

import asyncio
import json
import time
from statistics import median

import zenoh

from agentd.runtime.agent_directory import AgentDirectory
from schemas.wire import keys
from schemas.wire.records import (
    Action,
    ActionStatus,
    BoardServices,
    Cancel,
    Header,
    Outcome,
    Perception,
    Receipt,
    ServiceRequest,
    StopOrder,
)
from tests.attacks.world import (
    NAME,
    Attack,
    Row,
    World,
    ask,
    attack,
    health_of,
    letter,
    put_until,
    raw_session,
    waiting_for,
)
from tests.support.buses import served, until

FLOOD = 3.0
"""Wall seconds."""
MOVE = Action(header=Header(source="a"), id="a:attacked:1", parameters=(1.0, 0.0, 0.0))


@attack(
    "a forged sender in mail",
    "pi3 asks `b/mail/a` at pi2 with a message of `a`; a member of pi3 hands a message of `a` into `c/outbox`, "
    "and asks `a/outbox`",
    "pi2's router: `pi3` may ask `*/mail/c` alone; commd of pi3; pi3's router",
)
async def forged_sender(row: Row, world: World) -> None:
    """A board sends mail in the name of an agent of another board."""
    async with (
        world.machine("pi3", "pi2") as attacker,
        world.member("pi3", "c") as member,
        world.machine("ops", "pi2") as ops,
    ):
        await served(member, keys.mail(NAME, "b", "c"))
        row.expect(await ask(attacker, keys.mail(NAME, "b", "a"), letter("a", "b"), Receipt) == [], "no receipt")
        inside = await ask(attacker, keys.mail(NAME, "b", "c"), letter("a", "b"), Receipt)
        row.expect(_refused(inside, "wrong_address"), "a's message on c's key is refused")
        handed = await ask(member, keys.outbox(NAME, "c"), letter("a", "b"), Receipt)
        row.expect(_refused(handed, "wrong_address"), "the outbox refuses it")
        row.expect(
            await ask(member, keys.outbox(NAME, "a"), letter("a", "b"), Receipt) == [], "a's outbox is not there"
        )
        row.expect(await waiting_for(ops, "b", "a") == 0, "nothing of a waits for b")
        good = await ask(attacker, keys.mail(NAME, "b", "c"), letter("c", "b"), Receipt)
        row.expect(good == [Receipt(taken=1)], "c's own mail is taken")
        row.expect(await waiting_for(ops, "b", "c") == 1, "it waits for b")
        turned = (await health_of(ops, "pi2", "commd")).counters["turned_away"]
    row.seen.append("attacker: no reply (`b/mail/a`, `a/outbox`); `it came as mail from c to b`; `its sender is not c`")
    row.seen.append(f"commd of pi2: `turned_away` {turned:g} in its health; `argosy mail`: nothing of `a`")


@attack(
    "a name made at run time elsewhere",
    "pi3 sends mail as `pi1_x` and asks pi1 to let `pi1_x` join; a member of pi1 joins as `kid`",
    "pi2's and pi1's routers: `pi3_*` alone; commd of pi1",
)
async def run_time_name(row: Row, world: World) -> None:
    """A board takes a name that another board may make at run time, or joins an agent there."""
    async with world.machine("pi3", "pi2") as at2, world.machine("pi3", "pi1") as at1, world.member("pi1") as member:
        row.expect(await ask(at2, keys.mail(NAME, "b", "pi1_x"), letter("pi1_x", "b"), Receipt) == [], "no receipt")
        join = ServiceRequest(agent="pi1_x", do="join")
        row.expect(await ask(at1, keys.service_requests(NAME, "pi1", "pi1_x"), join, BoardServices) == [], "no answer")
        printed = await ask(at1, keys.services(NAME, "pi1"), join, BoardServices)
        row.expect(
            printed and "is accepted on argosy/three/pi1/services/pi1_x" in str(printed[0]), "reading is not asking"
        )
        kid = await ask(
            member, keys.service_requests(NAME, "pi1", "kid"), ServiceRequest(agent="kid", do="join"), BoardServices
        )
        word = kid[0].problem if kid and isinstance(kid[0], BoardServices) else ""
        row.expect(word == "names made on board pi1 begin with `pi1_`, such as `pi1_kid`", "kid is told so")
    row.seen.append(f"attacker: no reply; member of pi1: ``{word}``")


@attack(
    "names of others claimed as one's own",
    "pi3 puts on `pi3/services` that it has `pi1_kid`, `ops` and `r1` besides `pi3_kid`, and that pi1 has 1,000 "
    "agents, and holds the token `pi3_$*/alive/**`; a member of pi1 joins as `pi1_kid`",
    "commd and agentd of pi1: of pi3 they take names that begin with `pi3_`, and the mission's",
)
async def claimed_names(row: Row, world: World) -> None:
    """A board says of itself that it has the agents that another board is to make, and holds tokens of no meaning."""
    async with world.machine("pi3", "pi1") as attacker, world.member("pi1", "pi1_kid") as kid:
        names: dict[str, tuple[str, ...]] = {"pi1_kid": (), "ops": (), "r1": (), "pi3_kid": ()}
        printed = BoardServices(header=attacker.header("services"), board="pi3", version=1000, agents=names)
        crowd = {f"pi1_{number}": () for number in range(1000)}
        of_pi1 = BoardServices(header=attacker.header("services"), board="pi1", version=1000, agents=crowd)
        directory = AgentDirectory(kid, {"a": "pi1", "b": "pi2", "c": "pi3"})
        await directory.watch(["pi1"])
        attacker.token(f"argosy/{NAME}/pi3_$*/alive/**")
        known: set[str] = set()

        async def taken() -> bool:
            attacker.put(keys.services(NAME, "pi3"), of_pi1)
            attacker.put(keys.services(NAME, "pi3"), printed)
            boards = await ask(kid, keys.services(NAME, "pi1"), None, BoardServices)
            known.update(name for one in boards if isinstance(one, BoardServices) for name in one.agents)
            return "pi3_kid" in known and "pi3_kid" in directory.names

        await until(taken, "pi1 takes pi3's own name")
        known |= directory.names.keys()
        row.expect(known <= {"a", "b", "c", "pi3_kid"}, f"pi1 takes nobody else's names: {sorted(known)[:9]}")
        request = keys.service_requests(NAME, "pi1", "pi1_kid")
        joined = [await ask(kid, request, ServiceRequest(agent="pi1_kid", do="join"), BoardServices)]
        joined.append(await ask(kid, request, ServiceRequest(agent="pi1_kid", do="leave"), BoardServices))
        for answers in joined:
            problems = [one.problem for one in answers if isinstance(one, BoardServices)]
            row.expect(problems == [""], f"`pi1_kid` joins pi1 and leaves: {answers}")
    lines = world.commd["pi1"].lines
    row.expect(not any("defect" in line for line in lines), "no defect in commd of pi1")
    reported = [line.partition("directory ")[2] for line in lines if "accepted in part" in line]
    row.expect(reported, "commd says so")
    row.seen.append(f"commd of pi1: `{reported[-1] if reported else ''}`; `pi1_kid` joins pi1, and is nowhere else")


@attack(
    "percept injection",
    "pi3 puts on `a/percept/pose` and on `*/percept/pose` at pi1, and serves `a/percept/**` and `*/percept/**` for "
    "when `a` asks what it missed",
    "pi1's router: `pi3` may put and serve for `c` alone",
)
async def percept_injection(row: Row, world: World) -> None:
    """A board tells an agent of another board what it perceives."""
    async with world.machine("pi3", "pi1") as attacker, world.member("pi1", "a") as agent:
        heard: list[tuple[str, str]] = []
        names: list[str] = []

        def hear(key: str, record: Perception) -> None:
            heard.append((key, record.header.source))
            names.append(key)

        agent.subscribe(keys.percept(NAME, "*", "*"), Perception, hear)

        async def forge(query) -> None:  # type: ignore[no-untyped-def]
            query.reply(Perception(name="pose", header=attacker.header("pose")), keys.percept(NAME, "a", "pose"))

        for name in ("a", "*"):
            attacker.serve(keys.percept(NAME, name, "**"), Perception, forge)
        attacker.serve(keys.percept(NAME, "c", "**"), Perception, forge)
        await served(agent, keys.percept(NAME, "c", "**"))
        for name in ("a", "*"):
            names.clear()
            await put_until(attacker, names, keys.percept(NAME, name, "pose"), keys.percept(NAME, "c", "x"))
        row.expect(all(source != "pi3" for key, source in heard if "/c/" not in key), "nothing of pi3 for a")
        reported = await ask(agent, keys.percept(NAME, "a", "**"), None, Perception)
        sources = {one.header.source for one in reported if isinstance(one, Perception)}
        row.expect("pi3" not in sources and sources, "what a asks for is answered by its bridge alone")
    row.seen.append(f"agent `a`: percepts of {', '.join(sorted(sources))} alone; pi3's own `c/percept/x` arrived")


@attack(
    "action injection",
    "pi3 asks `a/action/cmd_vel`, `a/cancel` and `r1/stop` at pi1",
    "pi1's router: `pi3` may ask actions of `c` alone, orders of nobody",
)
async def action_injection(row: Row, world: World) -> None:
    """A board moves, stops or cancels for a robot of another board."""
    async with world.machine("pi3", "pi1") as attacker, world.member("pi1", "a") as agent:
        key = keys.action(NAME, "a", "cmd_vel")
        await served(agent, key)
        ended: set[str] = set()
        agent.subscribe(
            keys.status(NAME, "a", "*"), ActionStatus, lambda _, one: ended.add(one.id) if one.final else None
        )
        row.expect(await ask(attacker, key, MOVE, ActionStatus, 10) == [], "no status for pi3")
        row.expect(await ask(attacker, keys.cancel(NAME, "a"), Cancel(id="x"), ActionStatus) == [], "no cancel")
        row.expect(await ask(attacker, keys.stop(NAME, "r1"), StopOrder(order="hold"), Outcome) == [], "no stop")
        own = [one for one in await ask(agent, key, MOVE, ActionStatus, 10) if isinstance(one, ActionStatus)]
        row.expect(own and own[-1].state == "succeeded", f"a's own action is carried out: {own}")
        await until(lambda: bool(ended), "its end is told to observers")
        row.expect(ended == {own[-1].id}, f"one action was carried out, a's: {ended}")
    row.seen.append("attacker: no reply; status records of `a`: one `cmd_vel`, asked for by `a`")


@attack(
    "a replayed action",
    "the same `Action` record of `a`, id and all, asked three times more at pi1; once by pi3",
    "the bridge's ledger: an id is carried out once; pi1's router for pi3",
)
async def replayed_action(row: Row, world: World) -> None:
    """What was asked once is asked again, word for word."""
    async with world.machine("pi3", "pi1") as attacker, world.member("pi1", "a") as agent:
        key = keys.action(NAME, "a", "cmd_vel")
        await served(agent, key)
        action = Action(
            header=Header(source="a"), id="a:replayed:1", agent="a", name="cmd_vel", parameters=(1.0, 0.0, 0.0)
        )
        begun: list[str] = []
        agent.subscribe(
            keys.status(NAME, "a", "cmd_vel"), ActionStatus, lambda _, one: begun.append(f"{one.id} {one.state}")
        )
        first = await ask(agent, key, action, ActionStatus, 10)
        again = [await ask(agent, key, action, ActionStatus, 10) for _ in range(3)]
        row.expect(await ask(attacker, key, action, ActionStatus) == [], "no status for pi3")
        row.expect(_states(first)[-1:] == ["succeeded"], "it is carried out")
        row.expect(all(_states(one) == ["succeeded"] for one in again), "again only its end is told")
        await until(lambda: "a:replayed:1 succeeded" in begun, "its end is told to observers")
        await asyncio.sleep(0.3)
        row.expect(begun.count("a:replayed:1 succeeded") == 1, "and told once")
    row.seen.append("asker: the remembered final status each time; observers: one `succeeded` for the id")


@attack(
    "flood",
    f"pi3 puts 1 kB percepts and asks `*/mind` at pi1 for {FLOOD:g} s as fast as it can",
    "nobody: it is pi3's right; bounded queues drop, others go on",
)
async def flood(row: Row, world: World) -> None:
    """A board puts and asks as fast as it can, in its own name."""
    async with world.member("pi1", "a") as agent, world.machine("ops", "pi1") as slow:
        key = keys.mail(NAME, "b", "a")
        await served(agent, key)

        async def trip() -> float:
            began = time.monotonic()
            receipt = await ask(agent, key, letter("a", "b", time.time_ns()), Receipt, 10)
            row.expect(receipt == [Receipt(taken=1)], "a's mail to b is taken")
            return time.monotonic() - began

        calm = median([await trip() for _ in range(20)])
        taken = 0

        def take(_: str, __: Perception) -> None:
            nonlocal taken
            taken += 1

        slow.subscribe(keys.percept(NAME, "*", "*"), Perception, take)
        until_then = time.monotonic() + FLOOD
        sending = asyncio.create_task(asyncio.to_thread(_flood, world, until_then))
        trips = []
        while not sending.done():
            trips.append(await trip())
            await asyncio.sleep(0.02)
        sent, asked = await sending
        busy = median(trips)
        row.expect(len(trips) >= 5 and max(trips) < 5, "mail goes on meanwhile")
        await until(lambda: taken > 0, "something of it arrived")
        health = await health_of(agent, "pi1", "commd")
        row.expect(health.daemon == "commd", "commd tells its health")
        row.expect(world.commd["pi1"].process.poll() is None, "commd lives")
        await asyncio.sleep(0.2)
        dropped = slow.counters["dropped"]
    row.seen.append(
        f"{sent / FLOOD:,.0f} puts and {asked / FLOOD:,.0f} queries a second; mail `a` to `b` p50 {calm * 1e3:.0f} ms "
        f"calm, {busy * 1e3:.0f} ms meanwhile, {max(trips) * 1e3:.0f} ms at most"
    )
    row.seen.append(
        f"a subscriber of them all: {taken:,} taken, `drops` {dropped:,} in health, the rest dropped by routers"
    )


@attack(
    "oversized payloads",
    "pi3 puts 5 MiB and 16 MiB at pi1 on its own key; mail of 2 MiB in one message; an action of 200 kB",
    "pi1's router: 4 MiB a record, and the link is closed at 8 MiB; commd; the bridge",
)
async def oversized(row: Row, world: World) -> None:
    """Payloads larger than any record."""
    async with world.member("pi1", "a") as agent, world.machine("pi3", "pi2") as mailer:
        sizes: list[int] = []
        with (
            await asyncio.to_thread(raw_session, world.fleet.socket("pi1"), None) as listener,
            await asyncio.to_thread(raw_session, world.fleet.link("pi1"), world.fleet.tls("pi3")) as attacker,
            listener.declare_subscriber(f"argosy/{NAME}/c/percept/*", lambda sample: sizes.append(len(sample.payload))),
        ):
            for size in (5 * 2**20, 10):
                await asyncio.to_thread(_put_large, attacker, size, sizes if size == 10 else None)
            row.expect(set(sizes) == {10}, f"the small one arrives alone: {sizes}")
            await asyncio.to_thread(_put_large, attacker, 16 * 2**20, None)
            await until(lambda: len(agent._routers) == 1, "the members' links stay")
            sizes.clear()
            await asyncio.to_thread(_put_large, attacker, 10, sizes)
            row.expect(set(sizes) == {10}, f"and nothing of the largest: {sizes}")
        printed = await ask(mailer, keys.mail(NAME, "b", "c"), letter("c", "b", content="x" * 2**21), Receipt, 10)
        row.expect(_refused(printed, "message_too_large"), f"the message is refused: {str(printed)[:100]}")
        big = Action(parameters=("x" * 200_000,))
        reported = await ask(agent, keys.action(NAME, "a", "cmd_vel"), big, ActionStatus, 10)
        row.expect(reported and "expected at most" in str(reported[0]), f"the bridge says why: {str(reported)[:100]}")
        before = (await health_of(agent, "r1", "bridged")).bad_input
        row.expect(before >= 1, "the bridge has counted it")
    row.seen.append(
        f"commd of pi2: `message_too_large`; bridge: `{str(reported[0])[:60]}`, `bad_input` {before} in its health"
    )


@attack(
    "deeply nested payloads",
    "pi3 sends mail, and a member of pi1 an action, of 100,000 opening brackets; a percept of them too",
    "the codec: refused before anything is made of it",
)
async def nested(row: Row, world: World) -> None:
    """Payloads that are nested more deeply than a decoder can follow."""
    deep = b"[" * 100_000
    async with (
        world.member("pi1", "a") as agent,
        world.machine("pi3", "pi2") as mailer,
        world.machine("pi3", "pi1") as teller,
    ):
        heard: list[Perception] = []
        agent.subscribe(keys.percept(NAME, "c", "*"), Perception, lambda _, one: heard.append(one))
        mail_of_it = b'{"messages":[{"id":"c.1.b.1","sender":"c","performative":"tell","receiver":"b","content":' + deep
        answer = await asyncio.to_thread(_ask_raw, mailer._session, keys.mail(NAME, "b", "c"), mail_of_it)
        row.expect("nested too deeply" in answer or "Mail" in answer, f"commd says why: {answer[:100]}")
        action = await asyncio.to_thread(
            _ask_raw, agent._session, keys.action(NAME, "a", "cmd_vel"), b'{"parameters":' + deep
        )
        row.expect(action, "the bridge answers")

        def counted() -> bool:
            teller._session.put(keys.percept(NAME, "c", "x"), b'{"name":"x","parameters":[' + deep)
            return agent.counters["bad_input"] > 0

        await until(counted, "it is counted as bad input")
        teller.put(keys.percept(NAME, "c", "x"), Perception(name="x"))
        await until(lambda: bool(heard), "the next good percept arrives")
        row.expect(all(daemon.process.poll() is None for daemon in (*world.commd.values(), world.bridged)), "all live")
    row.seen.append(
        f"mail: `{answer[:80]}`; bridge: `{_problem(action)[:80]}`; "
        "subscriber: `bad_input` in health, the next percept is taken"
    )


def _problem(text: str) -> str:
    try:
        return str(json.loads(text).get("problem") or text)
    except ValueError:
        return text


def _refused(answers: list[Receipt | str], code: str) -> bool:
    codes = [{at: one.code for at, one in answer.refused.items()} for answer in answers if isinstance(answer, Receipt)]
    return codes == [{0: code}] and len(answers) == 1


def _states(statuses: list[ActionStatus | str]) -> list[str]:
    return [one.state if isinstance(one, ActionStatus) else one for one in statuses if one != "running"]


def _flood(world: World, until_then: float) -> tuple[int, int]:
    """Put and ask as fast as it goes. Returns how often."""
    sent = asked = 0
    data = json.dumps({"name": "x", "parameters": ["y" * 1000]}).encode()
    with raw_session(world.fleet.link("pi1"), world.fleet.tls("pi3")) as attacker:
        while time.monotonic() < until_then:
            for _ in range(100):
                attacker.put(keys.percept(NAME, "c", "x"), data, congestion_control=zenoh.CongestionControl.DROP)
            sent += 100
            attacker.get(keys.mind(NAME, "*"), zenoh.handlers.FifoChannel(4), timeout=1)
            asked += 1
    return sent, asked


def _put_large(session: zenoh.Session, size: int, arrived: list[int] | None) -> None:
    """Put so many bytes, again and again until something arrived, or once."""
    until_then = time.monotonic() + 15
    while time.monotonic() < until_then:
        session.put(keys.percept(NAME, "c", "x"), b"x" * size, congestion_control=zenoh.CongestionControl.BLOCK)
        time.sleep(0.1)
        if arrived is None or arrived:
            return


def _ask_raw(session: zenoh.Session, key: str, payload: bytes) -> str:
    """Ask with bytes; return the first answer's."""
    for reply in session.get(key, payload=payload, timeout=10):
        printed = reply.ok or reply.err
        return str(printed.payload.to_bytes().decode(errors="replace")) if printed is not None else ""
    return ""


MESSAGES: tuple[Attack, ...] = (
    forged_sender,
    run_time_name,
    claimed_names,
    percept_injection,
    action_injection,
    replayed_action,
    flood,
    oversized,
    nested,
)
