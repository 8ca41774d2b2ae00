"""The faults that need processes of their own: a flood of percepts, a slow agent, a killed bridge."""

import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import zenoh

from schemas.wire.records import ActionStatus, State
from tests.faults.rows import Ended, Maker, Row
from tests.support.ports import free_port
from tests.support.processes import Daemon, poll, running

RATE = 500
"""Samples a second of the flood."""
SAMPLES = 2000
SLEEPS = (500, 1750)
"""The samples at which a slow agent stops to read and begins again."""
GROWTH = 25.0
"""MB that a daemon may grow while it is flooded."""
_SENSOR = """\
[robot]
driver = "zenoh"

[percepts.sample]
source = "robot/sample"
args = ["n"]

[actions.ping]
service = "robot/ping"
deadline = "10s"
motion = false
"""
_FLOOD = """\
mission: flood
agents:
  reader: {program: reader.asl, robot: sensor}
robots:
  sensor: {manifest: ./sensor.toml}
"""
_READER = """\
taken(0).
+sample(LAST) : taken(T) <- .print("last ", LAST, " after ", T, " others"); !!pinged.
@counted[atomic] +sample(_) : taken(T) <- -+taken(T + 1).
+!pinged <- ping; .print("ping succeeded").
-!pinged[reason(R)] <- .print("ping failed: ", R).
"""
_KILLED = """\
mission: killed
speed: 10
agents:
  uav: {program: uav.asl, robot: uav1}
robots:
  uav1:
    manifest: copter
    link: udpin:127.0.0.1:PORT
    simulate: {vehicle: copter, home: [-27.604033, -48.518363, 21.0]}
"""
_FLIER = """\
!fly.
+!fly <- set_mode("GUIDED"); arm_motors(true); takeoff(10); .print("going");
         goto(-27.601, -48.516, 20); .print("goto succeeded").
-!fly[reason(R)] <- .print("goto failed: ", R); .wait(state(_, true, _)); ?state(Mode, _, Armed);
                    .print("perceived of the vehicle: state(", Mode, ", true, ", Armed, ")"); !home.
+!home <- return_to_launch; .print("return_to_launch succeeded"); ?state(Mode, Heard, Armed);
         .print("then: state(", Mode, ", ", Heard, ", ", Armed, ")").
-!home[reason(R)] <- .print("return_to_launch failed: ", R).
"""


_TOLD = ("state(GUIDED, true, true)", "state(RTL, true, false)")
"""In flight after the restart, and when it is home."""


def resident(daemon: Daemon) -> float:
    """MB that a process holds now."""
    found = re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{daemon.process.pid}/status").read_text())
    return int(found[1]) / 1024 if found else 0.0


def flood(state: Path) -> Row:
    """Five hundred percepts a second, each of them another one, and an action among them."""
    row = Row("500 percepts/s", f"real Zenoh: a robot puts {SAMPLES} samples at {RATE} Hz; the agent takes each")
    _flooded(row, state)
    return row


def slow_agent(state: Path) -> Row:
    """An agent that reads none of its percepts for a while, and then must not be told all of them."""
    stopped = (SLEEPS[1] - SLEEPS[0]) / RATE
    row = Row("slow agent", f"real Zenoh: as above, and SIGSTOP keeps the agent from reading for {stopped:g} s")
    _flooded(row, state, SLEEPS)
    return row


def bridge_killed(state: Path) -> Row:
    """The bridge is killed with an action under way, and started again at once."""
    row = Row("bridge killed and restarted with an action in flight", "real processes: kill -9 in `goto`, then restart")
    port, endpoint = free_port(), f"tcp/127.0.0.1:{free_port()}"
    mission = _written(state, _KILLED.replace("PORT", str(port)), uav=_FLIER)
    bridge = ("bridged", "serve", mission, "uav1", "--router", endpoint, "--state", str(state / "state"))
    copter = ("bridged", "simulate", "copter", "--link", f"udpout:127.0.0.1:{port}", "--speed", "10")
    with running("commd", "serve", mission, "--router", endpoint), running(*copter), running(*bridge) as first:
        first.says("serving uav1")
        with running("agentd", "serve", mission, "uav", "--router", endpoint) as agent:
            agent.says("going")
            first.until(lambda text: re.search(r"action \S+ goto\[", text) is not None, "goto has begun")
            at = time.monotonic()
            first.kill()
            with running(*bridge) as second:
                second.says("serving uav1")
                before = resident(second)
                agent.says("[uav] goto ")
                _note(row, agent, "goto", time.monotonic() - at)
                agent.says("[uav] then: ", 90)
                _note(row, agent, "return_to_launch", time.monotonic() - at)
                reported = re.findall(r"\] (perceived of the vehicle: |then: )(.*)", agent.text)
                row.seen += [f"{when}`{what}`" for when, what in reported]
                row.expect([what for _, what in reported] == list(_TOLD), f"the vehicle's state is told: {_TOLD}")
                goals = re.findall(r"action \S+ goto\[", second.text)
                row.seen.append(f"the new bridge began {len(goals)} `goto`: the id is not executed again")
                row.expect(not goals, "no action is executed twice")
                row.bound = f"bridge +{resident(second) - before:.1f} MB"
    states = [ended.finals[-1].state for ended in row.ended]
    row.expect(states == ["failed", "succeeded"], f"goto fails and the way home succeeds, got {states}")
    return row


REAL: tuple[Maker, ...] = (flood, slow_agent, bridge_killed)


def _flooded(row: Row, state: Path, sleeps: tuple[int, int] = (0, 0), patience: float = 30) -> None:
    """Let samples come, with the agent stopped between two of them; note how late it has the last, and what it cost."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    (state / "sensor.toml").write_text(_SENSOR)
    mission = _written(state, _FLOOD, reader=_READER.replace("LAST", str(SAMPLES)))
    with (
        running("commd", "serve", mission, "--router", endpoint) as router,
        running("bridged", "serve", mission, "sensor", "--router", endpoint, "--state", str(state)) as bridge,
        running("agentd", "serve", mission, "reader", "--router", endpoint) as agent,
    ):
        bridge.says("serving sensor")
        agent.says("agents=reader")
        with _robot(endpoint) as put:
            put(0)
            daemons = {"commd": router, "bridged": bridge, "agentd": agent}
            before = {name: resident(daemon) for name, daemon in daemons.items()}
            began = time.monotonic()
            for number in range(1, SAMPLES + 1):
                time.sleep(max(0.0, began + number / RATE - time.monotonic()))
                put(number)
                if number in sleeps:
                    agent.signal(signal.SIGSTOP if number == sleeps[0] else signal.SIGCONT)
            sent = time.monotonic()
            agent.says(f"last {SAMPLES}", patience)
            late = time.monotonic() - sent
            found = re.search(r"last \d+ after (\d+) others", agent.text)
            taken = int(found[1]) if found else 0
            row.seen.append(f"{SAMPLES} put in {sent - began:.1f} s; the agent had the last one {late:.2f} s later")
            row.seen.append(f"it took {taken} before that")
            row.expect(bool(sleeps[1]) or taken > SAMPLES / 2, "an agent that reads takes most of them")
            agent.says("[reader] ping ", patience)
        _note(row, agent, "ping", time.monotonic() - began)
        grown = {name: resident(daemon) - before[name] for name, daemon in daemons.items()}
        row.bound = ", ".join(f"{name} +{value:.1f} MB" for name, value in grown.items())
        row.expect(max(grown.values()) < GROWTH, f"no daemon grows by more than {GROWTH:g} MB")
        row.expect(row.ended[0].finals[0].state == "succeeded", "the action among them succeeds")


def _note(row: Row, agent: Daemon, action: str, seconds: float) -> None:
    """Note an action as the agent's program has told it."""
    reported = re.findall(rf"\] {action} (succeeded|failed)(?:: (.*))?$", agent.text, re.MULTILINE)
    finals = tuple(ActionStatus(id=action, state=_state(state), reason=reason) for state, reason in reported[:1])
    row.ended.append(Ended(action, finals, held=True, seconds=seconds))


def _state(text: str) -> State:
    return "succeeded" if text == "succeeded" else "failed"


def _written(folder: Path, mission: str, **programs: str) -> str:
    for name, program in programs.items():
        (folder / f"{name}.asl").write_text(program)
    path = folder / "m.yaml"
    path.write_text(mission)
    return str(path)


@contextmanager
def _robot(endpoint: str) -> Iterator[Callable[[int], None]]:
    """A robot on Zenoh that answers `robot/ping`; gives what puts one sample."""
    config = zenoh.Config()
    for key, value in (
        ("mode", '"client"'),
        ("scouting/multicast/enabled", "false"),
        ("connect/endpoints", f'["{endpoint}"]'),
    ):
        config.insert_json5(key, value)

    def answer(query: zenoh.Query) -> None:
        with query:
            query.reply("robot/ping", b"{}", encoding=zenoh.Encoding.APPLICATION_JSON)

    with zenoh.open(config) as session:
        session.declare_queryable("robot/ping", answer)
        publisher: Any = session.declare_publisher("robot/sample", encoding=zenoh.Encoding.APPLICATION_JSON)
        poll(lambda: publisher.matching_status.matching, "the bridge subscribes to robot/sample")
        yield lambda number: publisher.put(f'{{"n": {number}}}'.encode())
