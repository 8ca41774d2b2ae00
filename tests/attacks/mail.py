"""Attacks by mail that its sender may send: plans and goals for a robot of another board, and orders without a key."""

import asyncio
from contextlib import AsyncExitStack

import zenoh

from commd.bus.bus import Bus, Query, open_bus
from commd.client import Client, join
from schemas.wire import keys
from schemas.wire.mind_records import (
    ActivityEvent,
    BeliefView,
    MindActivity,
    MindDecisions,
    MindInput,
    MindInputs,
    MindView,
)
from schemas.wire.records import ActionStatus, Health, Mail, Message, Receipt
from schemas.wire.term_text import write
from schemas.wire.terms import Atom, Structure
from tests.attacks.world import NAME, Attack, Row, World, ask, attack, health_of
from tests.commd.old_comm import OldCommNode
from tests.support.buses import until
from tests.support.ports import free_port
from tests.support.secured import Secured

FLEET = """
mission: three
security: {operators: [ops], observers: [eye]}
boards: BOARDS
agents:
  a: {board: pi1, program: nothing.asl, robot: r1}
  willing: {board: pi1, program: nothing.asl, robot: r2, accepts: {hunter: [tellHow, achieve], old: [achieve]}}
robots:
  r1: {board: pi1, manifest: turtle, prefix: r1, simulate: {vehicle: turtle}}
  r2: {board: pi1, manifest: turtle, prefix: r2, simulate: {vehicle: turtle}}
clients: {hunter: {board: pi3}}
gateway: {board: pi1, listen: "LISTEN", nodes: {old: "NODE"}}
"""
TRACE = ("inputs", "decisions", "activity")
MEMBER = "a member of pi3"
PLAN = "+!go <- cmd_vel(1, 0, 0)."


@attack(
    "remote control by mail",
    "`hunter` of pi3 sends `a` of pi1 `tellHow` of `go` (a plan that moves r1) and lets it `achieve` that; a gateway "
    "node of no key sends `achieve`; pi3 sends it as `mail`. The same to `willing`, which names them in `accepts`",
    "agentd of `a`: `tellHow` is for its own board, a node's mail and the notices of `mail` are no orders",
)
async def plans_by_mail(row: Row, _: World) -> None:
    """A board teaches an agent of another board a plan and has it carried out; so do a datagram and a notice."""
    node = OldCommNode()
    listen = f"127.0.0.1:{free_port()}"
    text = FLEET.replace("LISTEN", listen).replace("NODE", node.address)
    try:
        with Secured(text) as fleet:
            await asyncio.to_thread(_begin, fleet)
            async with (
                open_bus(fleet.socket("pi1"), fleet=NAME, name="x", daemon="attack", patience=5) as looker,
                open_bus(
                    fleet.link("pi1"),
                    fleet=NAME,
                    name="pi3",
                    daemon="attack",
                    tls=fleet.tls("pi3"),
                    patience=5,
                ) as attacker,
                join("hunter", mission=fleet.mission, router=fleet.socket("pi3")) as hunter,
            ):
                moved: dict[str, set[str]] = {"a": set(), "willing": set()}

                def note(key: str, status: ActionStatus) -> None:
                    if status.state == "succeeded":
                        moved[key.split("/")[2]].add(status.id)

                looker.subscribe(keys.status(NAME, "*", "cmd_vel"), ActionStatus, note)
                for receiver in moved:
                    await hunter.send(receiver, "tellHow", PLAN)
                    await hunter.send(receiver, "achieve", Atom("go"))
                await until(lambda: bool(moved["willing"]), "the robot of who allows it moves")
                reason = await _refusal(hunter)
                row.expect(reason == "not_accepted", f"hunter is told: {reason}")
                for receiver in moved:
                    node.send(f"<m-{receiver},old,achieve,{receiver},go>", listen)
                await until(lambda: any("undelivered(a," in one for one in node.heard), "the node is told")
                await until(lambda: len(moved["willing"]) == 2, "and moves the robot of who allows it")
                forged = Message(id="f", sender="mail", performative="achieve", receiver="a", content=Atom("go"))
                taken = await ask(attacker, keys.mail(NAME, "a", "mail"), Mail(messages=(forged,)), Receipt)
                row.expect(taken == [Receipt(taken=1)], f"the board takes what is sent as mail: {taken}")

                async def counted() -> bool:
                    return (await health_of(looker, "pi1", "agentd")).agents["a"].counters.get("mail_not_accepted") == 3

                await until(counted, "three messages are counted as not accepted")
                row.expect(moved["a"] == set(), f"r1 has not moved: {moved['a']}")
    finally:
        await node.close()
    reported = next(one for one in node.heard if "undelivered(a," in one)
    row.seen.append('hunter: `undelivered(a, tellHow, _, "not_accepted")`, and `go` has no plan; r1 stood')
    row.seen.append(
        f"node: `{reported}`; agentd: `mail_not_accepted` 3 in the health of `a`; r2 of `willing` moved twice"
    )


@attack(
    "reading others' mail",
    "`a` of pi1 has a secret in its mind and its trace. `eye` (telemetry), `mate` (minds), `judge` "
    "(mail), pi3 and a member of pi3 subscribe to `argosy/**`, and ask `a/mind`, `*/mind` and `a/trace/inputs`",
    "pi1's router: records beyond a right are neither delivered nor answered; boards have `telemetry` of others",
)
async def reading_mail(row: Row, world: World) -> None:
    """A board and observers read the mail of another board: in a mind, in a trace, by a wide subscription."""
    mind, inputs, decisions, activity = keys.mind(NAME, "a"), *(keys.trace(NAME, "a", part) for part in TRACE)
    minds, mail = {decisions, mind}, {inputs, activity}
    rights = {"ops": minds | mail, "judge": minds | mail, "mate": minds, "eye": set(), "pi3": set(), MEMBER: set()}
    async with AsyncExitStack() as stack:
        agent = await stack.enter_async_context(world.member("pi1", "a"))
        readers = {who: world.member("pi3") if who == MEMBER else world.machine(who, "pi1") for who in rights}
        buses = {who: await stack.enter_async_context(reader) for who, reader in readers.items()}
        seen: dict[str, set[str]] = {who: set() for who in rights}
        reported: dict[str, set[str]] = {who: set() for who in rights}

        async def view(query: Query[MindView]) -> None:
            query.reply(MindView(agent="a", beliefs=(BeliefView(text="meet(7)[source(b)]"),)), mind)

        async def course(query: Query[MindInputs]) -> None:
            query.reply(MindInputs(agent="a", inputs=(MindInput(cycle=1, kind="Mail"),)), inputs)

        agent.serve(mind, MindView, view)
        agent.serve(inputs, MindInputs, course)
        for who, bus in buses.items():
            await asyncio.to_thread(_listen, bus, seen[who], reported[who])

        def heard() -> bool:
            agent.put(inputs, MindInputs(agent="a", inputs=(MindInput(cycle=1, kind="Mail"),)))
            agent.put(decisions, MindDecisions(agent="a"))
            agent.put(activity, MindActivity(agent="a", events=(ActivityEvent(kind="received", text="meet(7)"),)))
            agent.put(keys.health(NAME, "a", "agentd"), Health(daemon="agentd"))
            return all(reported.values()) and mail | {decisions} <= seen["ops"] & seen["judge"]

        await until(heard, "everybody hears what it may", 240)
        for who, bus in buses.items():
            for key, kind in ((mind, MindView), (keys.mind(NAME, "*"), MindView), (inputs, MindInputs)):
                if await ask(bus, key, None, kind, 2):
                    seen[who].add(key.replace("*", "a"))
    for who, may in rights.items():
        row.expect(seen[who] == may, f"{who} sees {sorted(may)}: {sorted(seen[who])}")
    row.seen.append("eye, pi3 and its member: the health of `a`, and nothing of its mind and trace; no reply")
    row.seen.append(
        "mate: the mind and `trace/decisions`; judge and the operator: `trace/inputs` and `trace/activity`, too"
    )


def _listen(bus: Bus, seen: set[str], reported: set[str]) -> None:
    """Subscribe to everything; note what is told of the mind and trace of `a`, and whether its health is."""

    def note(sample: zenoh.Sample) -> None:
        key = str(sample.key_expr)
        if key == keys.health(NAME, "a", "agentd"):
            reported.add(key)
        elif key.startswith((keys.trace(NAME, "a", ""), keys.mind(NAME, "a"))):
            seen.add(key)

    bus._session.declare_subscriber(f"{keys.ROOT}/**", note)


def _begin(fleet: Secured) -> None:
    """Start three boards, and on pi1 turtles, bridge and agents."""
    fleet.routers()
    simulator = fleet.run("argosy", "simulate", str(fleet.path), "--board", "pi1", "--router", fleet.socket("pi1"))
    simulator.says("simulated turtle")
    bridged, agentd = fleet.start("pi1", "bridged"), fleet.start("pi1", "agentd")
    bridged.says("serving r2")
    agentd.says("agents=")


async def _refusal(client: Client) -> str:
    """The reason of the first message that comes back."""
    async with asyncio.timeout(120):
        async for message in client.messages():
            match message.content:
                case Structure(functor="undelivered", args=(_, _, _, why)):
                    client.done(message)
                    return why if isinstance(why, str) else write(why)
    return ""


MAIL: tuple[Attack, ...] = (plans_by_mail, reading_mail)
