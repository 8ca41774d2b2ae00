"""Whole flights of real processes in which somebody hangs, is killed, changes its mind or takes over."""

import re
import signal
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from argosy.__main__ import main
from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from tests.support.ports import free_port
from tests.support.processes import Daemon, running

LOITER, RTL = 5, 6
MISSION = """\
mission: wrong
speed: 10
agents:
  uav: {program: uav.asl, robot: uav1}
  wing: {program: wing.asl, robot: uav1}
robots:
  uav1:
    manifest: copter
    link: udpin:127.0.0.1:PORT
    failsafe: {gcs: bridge}
    simulate: {vehicle: copter, home: [-27.604033, -48.518363, 21.0]}
"""
FLIER = """\
!fly.
+!fly <- set_mode("GUIDED"); arm_motors(true); takeoff(10); .print("going"); !away.
+!away <- goto(-27.600, -48.515, 20); .print("arrived").
-!away[error(E), state(S), reason(R)] <- .print("away: ", E, ", ", S, ", ", R).
"""
CHANGES_ITS_MIND = """\
!fly.
+!fly <- set_mode("GUIDED"); arm_motors(true); takeoff(10); !away.
+!away <- goto(-27.600, -48.515, 20); .print("arrived").
+feedback(goto, distance, D) : D < 520 & not dropped(_, _) <- ?global_pos(A, B); +dropped(A, B);
                                                              .drop_intention(away); !hover.
degrees_from(A, B, D) :- global_pos(C, E) & D = math.max(math.abs(A - C), math.abs(B - E)).
+!hover <- ?global_pos(A, B); .wait(1000); ?degrees_from(A, B, Moved); !hovered(Moved).
+!hovered(Moved) : Moved > 0.000005 <- !hover.
+!hovered(_) : dropped(A, B) & degrees_from(A, B, D) <- .print("hovers ", math.round(D * 1000), "e-3 off"); !again.
+!again <- .print("again"); goto(-27.600, -48.515, 20).
-!again[state(S), reason(R)] <- .print("again: ", S, ", ", R); .wait(override(M)); .print("pilot in ", M); !down.
+!down <- land.
-!down[state(S), reason(R)] <- .print("down: ", S, ", ", R); set_mode("GUIDED");
                                hand_over(wing); .print("handed"); !late.
+!late <- land.
-!late[state(S), reason(R)] <- .print("late: ", S, ", ", R).
"""
WING = """\
+altitude(A) : A > 5 & holder(uav) & not tried <- +tried; !try.    // between two actions nobody may hold it
+!try <- set_mode("RTL").
-!try[state(S), reason(R)] <- .print("try: ", S, ", ", R).
+holder(wing) <- .print("mine"); .wait(1000); land; .print("landed").
"""


class Field:
    """The processes of one flight: router, copter with a second link for a pilot, bridge, agents."""

    def __init__(self, folder: Path, uav: str, wing: str, failsafe: int = 1) -> None:
        """`failsafe`: whether the copter comes home by itself without a ground station."""
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        port, self.pilots = free_port(), free_port()
        for name, text in (("uav.asl", uav), ("wing.asl", wing), ("m.yaml", MISSION.replace("PORT", str(port)))):
            (folder / name).write_text(text)
        self.mission = str(folder / "m.yaml")
        self.router = running("commd", "serve", self.mission, "--router", self.endpoint)
        links = ("--link", f"udpout:127.0.0.1:{port}", "--link", f"udpin:127.0.0.1:{self.pilots}")
        self.copter = running(
            "bridged", "simulate", "copter", *links, "--speed", "10", "--param", f"FS_GCS_ENABLE={failsafe}"
        )
        self._state = folder / "state"
        self.bridge = ("bridged", "serve", self.mission, "uav1", *self._common())

    def agents(self, *names: str) -> tuple[str, ...]:
        """The command that serves these agents, or all of them."""
        return ("agentd", "serve", self.mission, *names, *self._common())

    def _common(self) -> tuple[str, ...]:
        return ("--router", self.endpoint, "--state", str(self._state))

    def pilot_sets(self, mode: int) -> None:
        """Somebody at another ground station sets a mode."""
        with self._station() as (_, say):
            say(dialect.MAVLink_set_mode_message(1, 1, mode))

    def mode_becomes(self, mode: int, seconds: float = 20) -> None:
        """Wait until the copter itself tells another ground station that it is in a mode."""
        framer, seen = Framer(WireCounters()), set[int]()
        with self._station() as (station, say):
            until = time.monotonic() + seconds
            while mode not in seen:
                assert time.monotonic() < until, f"the copter was in {seen}, never in {mode}"
                say(dialect.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))
                with suppress(TimeoutError):
                    for message in framer.feed(station.recv(2048), datagram=True):
                        if message.get_type() == "HEARTBEAT":
                            seen.add(message.custom_mode)

    @contextmanager
    def _station(self) -> Iterator[tuple[socket.socket, Callable[[dialect.MAVLink_message], object]]]:
        encoder = Encoder(254, 190)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as station:
            station.settimeout(0.5)
            yield station, lambda message: station.sendto(encoder.pack(message), ("127.0.0.1", self.pilots))


def printed(agent: Daemon, who: str, start: str) -> str:
    """Wait for a line that an agent prints."""
    agent.until(lambda text: f"[{who}] {start}" in text, f"{who} prints `{start}`")
    found = re.search(rf"\[{who}\] ({re.escape(start)}.*)", agent.text)
    return found[1]


def test_the_operator_stops_a_robot_whose_agent_hangs_and_a_killed_bridge_leaves_it_to_its_failsafe(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    field = Field(tmp_path, FLIER, "!nothing. +!nothing.")
    with field.router, field.copter, running(*field.bridge) as bridge:
        bridge.says("serving uav1")
        with running(*field.agents("uav")) as agent:
            printed(agent, "uav", "going")
            bridge.until(lambda text: re.search(r"action \S+ goto\[", text) is not None, "goto has begun")
            agent.signal(signal.SIGSTOP)
            try:
                assert main(["stop", "hold", "uav1", "--router", field.endpoint]) == 0
                assert "uav1: hold confirmed" in capsys.readouterr().out
                bridge.says("goto failed operator: hold")
            finally:
                agent.signal(signal.SIGCONT)
            assert printed(agent, "uav", "away:") == "away: action_failed, failed, operator: hold"
            bridge.kill()
            field.mode_becomes(RTL)  # nobody speaks to the copter now: its own failsafe brings it home
            with running(*field.bridge) as again:
                again.says("is heard now: RTL, armed")
                assert "action uav:" not in again.text


def test_an_agent_drops_its_goal_loses_the_robot_to_a_pilot_takes_it_again_and_hands_it_over(tmp_path: Path) -> None:
    field = Field(tmp_path, CHANGES_ITS_MIND, WING)
    with field.router, field.copter, running(*field.bridge) as bridge:
        bridge.says("serving uav1")
        with running(*field.agents()) as agent:
            refused = printed(agent, "wing", "try:")
            assert refused.startswith("try: refused, held by uav for "), refused
            bridge.says("goto cancelled cancelled by uav")
            assert printed(agent, "uav", "hovers") == "hovers 0e-3 off", "near where it was when the goal was dropped"
            printed(agent, "uav", "again")
            bridge.until(lambda text: len(re.findall(r"action \S+ goto\[", text)) == 2, "the second goto has begun")
            field.pilot_sets(LOITER)
            assert "the mode became LOITER, which nobody here asked for" in printed(agent, "uav", "again: failed")
            assert printed(agent, "uav", "pilot") == "pilot in LOITER"
            assert printed(agent, "uav", "down:").startswith("down: refused, override: others have set LOITER")
            printed(agent, "uav", "handed")
            printed(agent, "wing", "mine")
            assert printed(agent, "uav", "late:").startswith("late: refused, held by wing for ")
            printed(agent, "wing", "landed")
        assert "arrived" not in agent.text
