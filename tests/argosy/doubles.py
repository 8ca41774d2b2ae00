"""Stand-ins for the daemons of a mission: real processes on a real bus that play a short flight.

`python doubles.py run ARGS...` is `argosy run ARGS...` with these in place of simulator, bridge and agent; the router
is the real one. The environment variable FAULT chooses what goes wrong, and the file that CUE names, once it is there,
says when.
"""

import asyncio
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

from commd.bus.bus import Bus, Query, open_bus
from commd.common.clock import Clock
from commd.process.process import report_health
from schemas.mission.model import THIS_MACHINE, load_mission
from schemas.wire import keys, log_lines
from schemas.wire.log_lines import LogLine, RobotLeft
from schemas.wire.mind_records import IntentionView, MindView
from schemas.wire.records import ActionStatus, AgentHealth, Outcome, Perception, Perceptions, StopOrder
from schemas.wire.terms import Term

HERE = str(Path(__file__).resolve())
FAULT, CUE = os.environ.get("FAULT", ""), Path(os.environ.get("CUE", ""))
LANDED: tuple[Term, ...] = ("RTL", True, False)
HOME, AWAY = (-27.604033, -48.518363), (-27.603683, -48.518052)


def percept(bus: Bus, name: str, *parameters: Term) -> None:
    """Tell one percept of the agent `uav`."""
    change = Perception(header=bus.header("percepts"), name=name, parameters=parameters)
    bus.put(keys.percepts(bus.fleet, "uav"), Perceptions(changes=(change,)))
    bus.put(keys.percept(bus.fleet, "uav", name), change)


def say(line: LogLine) -> None:
    """Write a line as a daemon does."""
    print(log_lines.encode(line).decode(), file=sys.stderr, flush=True)


async def fly(bus: Bus, clock: Clock) -> None:
    """Arm, fly one leg, come back, disarm: 20 s of mission time."""
    state, steps = "uav:1:", 20
    percept(bus, "state", "STABILIZE", True, False)
    percept(bus, "home_pos", *HOME)
    percept(bus, "battery", 0, 12.6, 99)

    def status(number: int, name: str, what: str, *parameters: Term, reason: str = "") -> None:
        record = ActionStatus(id=f"{state}{number}", state=what, name=name, parameters=parameters, reason=reason)  # type: ignore[arg-type]
        bus.put(keys.status(bus.fleet, "uav", name), record)

    status(1, "arm_motors", "failed", True, reason="Arm: Need Position Estimate")
    status(2, "goto", "running", *AWAY, 40)
    percept(bus, "state", "GUIDED", True, True)
    for step in (*range(steps + 1), *range(steps, -1, -1)):
        share = step / steps
        place = [home + (away - home) * share for home, away in zip(HOME, AWAY, strict=True)]
        percept(bus, "altitude", 40 * share)
        percept(bus, "global_pos", *place)
        if step == steps:
            status(2, "goto", "succeeded", *AWAY, 40)
            percept(bus, "state", "RTL", True, True)
        await clock.sleep(0.5)
    percept(bus, "state", *LANDED)


async def bridge(bus: Bus, clock: Clock, stop: asyncio.Event) -> None:
    """Fly as soon as the agent is there, answer the operator, and order `rtl` at the end."""
    begun = asyncio.Event()

    async def ordered(query: Query[StopOrder]) -> None:
        query.reply(Outcome(ok=query.record.order != "land", reason=f"told to {query.record.order}"))

    async def fly_with_agent() -> None:
        await begun.wait()
        await fly(bus, clock)

    bus.serve(keys.stop(bus.fleet, "uav1"), StopOrder, ordered)
    bus.watch(keys.alive(bus.fleet, "uav", "agentd", "*"), lambda key, alive: begun.set())
    await bus.claim("uav1")
    say(LogLine(text="serving uav1", level="info"))
    flying = asyncio.create_task(fly_with_agent())
    await stop.wait()
    if FAULT in ("stubborn", "done-aloft"):
        await asyncio.sleep(60)
    flew = begun.is_set() and not flying.done()
    flying.cancel()
    if flew:
        percept(bus, "state", "RTL", True, True)
        left = RobotLeft(robot="uav1", state="ordered", order="rtl", text="rtl: the vehicle does it")
        say(LogLine(text="leaving uav1: rtl: the vehicle does it", level="info", event=left))
        await asyncio.sleep(0.2)


async def agent(bus: Bus, clock: Clock, stop: asyncio.Event) -> None:
    """Show a mind that is done when the flight is and everything is said."""
    landed, said = asyncio.Event(), asyncio.Event()

    def heard(_key: str, perceptions: Perceptions) -> None:
        if any(change.parameters == LANDED for change in perceptions.changes):
            landed.set()

    async def mind(query: Query[MindView]) -> None:
        done = (landed.is_set() or FAULT == "done-aloft") and said.is_set() and FAULT != "never-done"
        running = IntentionView(
            id=1, state="waiting", stack=("+!visited(-27.6,-48.5,40)", "+!fly_mission"), at="uav.asl:41"
        )
        view = MindView(
            agent="uav",
            cycle=int(clock.wall() * 10),
            intentions=() if done else (running,),
            done={"mission_done": done},
            failed={"mission_failed(_)": False},
        )
        query.reply(view)

    bus.serve(keys.mind(bus.fleet, "uav"), MindView, mind)
    bus.subscribe(keys.percepts(bus.fleet, "uav"), Perceptions, heard)
    if FAULT != "agent-mute":
        await bus.claim("uav")
    for text in ("taking off to 5 m", "flying to -27.6, -48.5 at 40 m", "mission done"):
        await asyncio.sleep(0.8)
        say(LogLine(text=text, level="info", agent="uav"))
    said.set()
    await stop.wait()


async def daemon(kind: str, mission_file: str, router: str, speed: float) -> None:
    """Run one stand-in until it is told to stop."""
    mission, clock, stop = load_mission(mission_file), Clock(speed), asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGTERM, stop.set)
    name = {"bridged": "uav1", "agentd": "uav"}[kind]
    async with open_bus(router, fleet=mission.fleet, name=name, daemon=kind, stop=stop) as bus:
        agents = {"uav": lambda: AgentHealth(idle=False)} if kind == "agentd" else {}
        named = THIS_MACHINE if agents else name
        health = asyncio.create_task(report_health(bus, named, clock, agents=lambda: agents))
        await (bridge if kind == "bridged" else agent)(bus, clock, stop)
        health.cancel()


def simulate() -> None:
    """Be there; leave a child behind if asked to."""
    if FAULT == "orphan":
        subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
    while FAULT != "simulator-dies" or not CUE.exists():
        time.sleep(0.05)
    print("the sky grew dark")
    print("error: simulator: the wind was too strong", file=sys.stderr)
    sys.exit(3)


def run(arguments: list[str]) -> int:
    """`argosy run` with the stand-ins in the table of processes."""
    from argosy.__main__ import main  # the stand-ins themselves do without: it is most of what there is to import
    from argosy.processes import process_table
    from argosy.run import mission_runner

    def command(kind: str) -> process_table.Kind:
        original = next(one for one in process_table.KINDS if one.name == kind)
        if kind in ("commd", "recorder"):
            return original
        return replace(
            original, command=lambda setup, subject: ["doubles", kind, setup.file, setup.router, str(setup.speed)]
        )

    for bound in ("STARTUP_PATIENCE", "LEAVE"):
        setattr(mission_runner, bound, float(os.environ.get(bound, getattr(mission_runner, bound))))
    process_table.KINDS = tuple(command(kind.name) for kind in process_table.KINDS)
    sys.path.insert(0, str(Path(HERE).parent))
    os.environ["PYTHONPATH"] = str(Path(HERE).parent)
    return main(["run", *arguments])


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["run", *arguments]:
            sys.exit(run(arguments))
        case ["simulator", *_]:
            simulate()
        case [kind, mission_file, router, speed]:
            asyncio.run(daemon(kind, mission_file, router, float(speed)))
