"""A fleet that says what a terminal takes for commands wherever it can, and numbers that are none.

`hostile ROUTER`, or `hostile ROUTER markup` for what a browser or `rich` takes for markup. `hostile SOCKET markup FLEET
AGENT ROBOT` is a member of a secured board, which says it in the names that it may use there.
"""

import asyncio
import sys
import time
from contextlib import AbstractContextManager

from commd.bus.bus import Bus, Query, open_bus
from schemas.wire import keys
from schemas.wire.mind_records import (
    ActivityEvent,
    BeliefView,
    DecisionView,
    EventView,
    FailureView,
    IntentionView,
    MindActivity,
    MindView,
    QuestionView,
    WaitView,
)
from schemas.wire.records import (
    ActionStatus,
    DeadLetter,
    Health,
    Mailboxes,
    Message,
    Note,
    Perception,
    Perceptions,
    Queue,
    Refusal,
    RunningMission,
    RunState,
)
from schemas.wire.terms import Number, Term
from tests.argosy.beside import there

_, KIND, *NAMES = [*sys.argv[1:], "commands"][:5] if __name__ == "__main__" else ("", "commands")
FLEET, AGENT, ROBOT = NAMES if len(NAMES) == 3 else ("hostile", "scout", "uav1")
OPEN = len(NAMES) != 3
MARKUP = (
    "<img src=x onerror=\"window.hacked=1;document.title='hacked'\"><script>window.hacked=1</script>"
    "<b class=evil>b</b><a href='javascript:window.hacked=1'>a</a>[bold red]rich[/][link=file:///etc/passwd]l[/link]"
)
BAD = MARKUP if KIND == "markup" else "\x1b]0;PWNED\x07\x1b[5;5HPWNED\x9b2J\u202e\r\nFORGED"
RAW = (b"\x1b]0;PWNED", b"\x1b[5;5HPWNED", b"\x9b2J", "\x9b".encode(), "\u202e".encode(), b"\nFORGED", b"\rFORGED")
"""What a terminal would take for commands, or a reader for another line."""
IN_KEY = BAD.replace("/", "").replace("#", "").replace("?", "").replace("$", "").replace("*", "")
"""What may be in a key of Zenoh's."""


def saying(*arguments: str) -> AbstractContextManager[None]:
    """Have a process of its own that says it, with the arguments above."""
    return there("-m", "tests.argosy.watch.hostile", *arguments)


async def serve(router: str) -> None:
    """Say it until the process is ended."""
    mode = "router" if OPEN else "client"
    async with open_bus(router, fleet=FLEET, name="h", daemon="agentd", mode=mode) as bus:
        for name, daemon in ((AGENT, "agentd"), (ROBOT, "bridged"), ("pi1", "commd"), (f"bad{IN_KEY}name", "agentd")):
            bus.token(keys.alive(FLEET, name, daemon, "b"))
        bus.token(keys.alive(f"other{IN_KEY}", "scout", "agentd", "b"))
        bus.serve(keys.mind(FLEET, AGENT), MindView, _mind)
        bus.serve(keys.mailboxes(FLEET, "pi1"), Mailboxes, _mailboxes)
        bus.serve(keys.mission(FLEET, "pi1"), RunningMission, _mission)
        print("there", flush=True)
        while True:
            _say(bus)
            await asyncio.sleep(0.5)


async def _mind(query: Query[MindView]) -> None:
    view = MindView(
        agent=AGENT,
        state="waiting",
        beliefs=(BeliefView(text=f"a{BAD}", sources=(BAD, "x")),),
        events=(EventView(text=BAD),),
        questions=(QuestionView(id=BAD, receiver=BAD, performative=BAD, content=BAD, asked=0.0),),
        intentions=(
            IntentionView(
                id=1, state="waiting", waits_for=WaitView(kind="action", name=BAD), stack=(f"+!evil{BAD}", BAD), at=BAD
            ),
        ),
        decisions=(DecisionView(cycle=1, time=0.0, event=BAD, kind="+!", name=BAD, outcome="running"),),
        failures=(FailureView(cycle=1, time=0.0, formula=BAD, position=BAD, error=BAD, reason=BAD),),
        dropped={BAD: 3},
        done={BAD: True},
        failed={f"x{BAD}": True},
    )
    query.reply(view)


async def _mailboxes(query: Query[Mailboxes]) -> None:
    queue = Queue(box="inbox", sender=BAD, receiver=AGENT, messages=2, oldest=3.0, state=BAD)
    message = Message(id=BAD, sender=AGENT, performative=BAD, receiver=BAD, content=BAD)
    dead = (DeadLetter(message=message, reason=Refusal(code=BAD, text=BAD), stamp=1),)
    boxes = Mailboxes(board="pi1", store=BAD, queues=(queue,), dead=dead, dead_count=1)
    query.reply(boxes, keys.mailboxes(FLEET, "pi1"))


async def _mission(query: Query[RunningMission]) -> None:
    query.reply(RunningMission(file=BAD, text=f"mission: {BAD!r}\n{BAD}: x\n"))


def _say(bus: Bus) -> None:
    for name, daemon in ((AGENT, "agentd"), ("pi1", "commd")):
        bus.put(keys.health(FLEET, name, daemon), Health(daemon=daemon, notes=(Note(BAD, BAD, BAD),)))
    bus.put(
        keys.health(FLEET, ROBOT, "bridged"),
        Health(daemon="bridged", percepts={AGENT: "b:1:0"}, notes=(Note(BAD, BAD),)),
    )
    bus.put(keys.run(FLEET, "h"), RunState(phase="failed", why=BAD, report=BAD, recording=BAD, dead=(BAD,)))
    none = Number("Infinity")
    _percept(bus, "state", f"{BAD}GUIDED", True, True)
    for name in ("altitude", "heading"):
        _percept(bus, name, none)
    for name in ("global_pos", "home_pos", "gps"):
        _percept(bus, name, none, Number("NaN"))
    _percept(bus, "battery", 1, 1, none)
    _percept(bus, "holder", BAD)
    _percept(bus, "override", BAD)
    status = ActionStatus(id=f"{AGENT}:b:1", state="running", name="goto", parameters=(BAD,), feedback={BAD: 1.0})
    bus.put(keys.status(FLEET, AGENT, "goto"), status)
    over = ActionStatus(id=f"{AGENT}:b:{time.monotonic()}", state="failed", name="land", parameters=(BAD,), reason=BAD)
    bus.put(keys.status(FLEET, AGENT, "land"), over)
    events = (
        ActivityEvent(kind="print", text=BAD),
        ActivityEvent(kind="sent", id=BAD, other=BAD, performative=BAD, text=BAD),
        ActivityEvent(kind="undelivered", id=BAD, other=BAD, performative=BAD, text=BAD, reason=BAD),
    )
    bus.put(keys.trace(FLEET, AGENT, "activity"), MindActivity(agent=AGENT, events=events))


def _percept(bus: Bus, name: str, *parameters: Term) -> None:
    told = Perception(header=bus.header("percepts", AGENT), name=name, parameters=parameters)
    bus.put(keys.percepts(FLEET, AGENT), Perceptions(changes=(told,)))


if __name__ == "__main__":
    asyncio.run(serve(sys.argv[1]))
