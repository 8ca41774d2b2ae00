"""A fleet that says what a terminal takes for commands wherever it can, and numbers that are none: `hostile ROUTER`."""

from __future__ import annotations

import asyncio
import sys
import time

from commd.bus import Bus, Query, open_bus
from schemas import keys
from schemas.minds import (
    BeliefView,
    DecisionView,
    Deed,
    EventView,
    FailureView,
    IntentionView,
    MindDeeds,
    MindView,
    QuestionView,
)
from schemas.records import ActionStatus, Health, Mailboxes, Perception, Queue
from schemas.terms import Number, Term

FLEET = "hostile"
BAD = "\x1b]0;PWNED\x07\x1b[5;5HPWNED\x9b2J\u202e"


async def serve(router: str) -> None:
    """Say it until the process is ended."""
    async with open_bus(router, fleet=FLEET, name="h", daemon="agentd", stamp=time.time_ns, mode="router") as bus:
        for name, daemon in (("scout", "agentd"), ("uav1", "bridged"), ("pi1", "commd"), (f"bad{BAD}name", "agentd")):
            bus.token(keys.alive(FLEET, name, daemon, "b"))
        bus.token(keys.alive(f"other{BAD}", "scout", "agentd", "b"))
        bus.serve(keys.mind(FLEET, "scout"), MindView, _mind)
        bus.serve(keys.mailboxes(FLEET, "pi1"), Mailboxes, _mailboxes)
        print("there", flush=True)
        while True:
            _say(bus)
            await asyncio.sleep(0.5)


async def _mind(query: Query[MindView]) -> None:
    view = MindView(
        agent="scout",
        state="waiting",
        believed=(BeliefView(text=f"a{BAD}", sources=(BAD, "x")),),
        events=(EventView(text=BAD),),
        questions=(QuestionView(id=BAD, receiver=BAD, performative=BAD, content=BAD, asked=0.0),),
        intentions=(IntentionView(id=1, state="waiting", reason=BAD, stack=(f"+!evil{BAD}", BAD), at=BAD),),
        decisions=(DecisionView(cycle=1, time=0.0, event=BAD, kind="+!", name=BAD, outcome="running"),),
        failures=(FailureView(cycle=1, time=0.0, formula=BAD, position=BAD, error=BAD, reason=BAD),),
        dropped={BAD: 3},
        done={BAD: True},
        failed={f"x{BAD}": True},
    )
    query.reply(view)


async def _mailboxes(query: Query[Mailboxes]) -> None:
    queue = Queue(box="inbox", sender=BAD, receiver="scout", messages=2, oldest=3.0, state=BAD)
    query.reply(Mailboxes(board="pi1", queues=(queue,)), keys.mailboxes(FLEET, "pi1"))


def _say(bus: Bus) -> None:
    for name, daemon in (("scout", "agentd"), ("pi1", "commd")):
        bus.put(keys.health(FLEET, name, daemon), Health(daemon=daemon, notes=(BAD,)))
    bus.put(keys.health(FLEET, "uav1", "bridged"), Health(daemon="bridged", percepts={"scout": "b:1:0"}, notes=(BAD,)))
    none = Number("Infinity")
    _percept(bus, "state", f"{BAD}GUIDED", True, True)
    for name in ("altitude", "heading"):
        _percept(bus, name, none)
    for name in ("global_pos", "home_pos", "gps"):
        _percept(bus, name, none, Number("NaN"))
    _percept(bus, "battery", 1, 1, none)
    _percept(bus, "holder", BAD)
    _percept(bus, "override", BAD)
    status = ActionStatus(id="scout:b:1", state="running", name="goto", parameters=(BAD,), feedback={BAD: 1.0})
    bus.put(keys.status(FLEET, "scout", "goto"), status)
    over = ActionStatus(id=f"scout:b:{time.monotonic()}", state="failed", name="land", parameters=(BAD,), reason=BAD)
    bus.put(keys.status(FLEET, "scout", "land"), over)
    deeds = (
        Deed(kind="print", text=BAD),
        Deed(kind="sent", id=BAD, other=BAD, performative=BAD, text=BAD),
        Deed(kind="undelivered", id=BAD, other=BAD, performative=BAD, text=BAD, reason=BAD),
    )
    bus.put(keys.trace(FLEET, "scout", "deeds"), MindDeeds(agent="scout", deeds=deeds))


def _percept(bus: Bus, name: str, *parameters: Term) -> None:
    told = Perception(header=bus.header("percepts", "scout"), name=name, parameters=parameters)
    bus.put(keys.percept(FLEET, "scout", name), told)


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1]))
