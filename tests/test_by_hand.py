"""The daemons of the first mission started by hand, as on a board: the router dies in flight."""

import re
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from tests.support.processes import ROOT, Daemon, running

SPEED = "5"


def test_a_router_killed_in_flight_and_back_within_3_s_costs_nothing(
    tmp_path: Path, endpoint: str, free_port: Callable[[], int]
) -> None:
    port, mission = free_port(), tmp_path / "single_uav.yaml"
    mission.write_text((ROOT / "missions" / "single_uav.yaml").read_text().replace(":14550", f":{port}"))
    (tmp_path / "single_uav").mkdir()
    (tmp_path / "single_uav" / "uav.asl").write_text((ROOT / "missions" / "single_uav" / "uav.asl").read_text())
    with ExitStack() as stack:

        def start(*arguments: str) -> Daemon:
            return stack.enter_context(running(*arguments))

        def serve(daemon: str, *more: str) -> Daemon:
            return start(daemon, "serve", str(mission), *more, "--router", endpoint)

        commd = serve("commd")
        copter = start("bridged", "simulate", "copter", "--link", f"udpout:127.0.0.1:{port}", "--speed", SPEED)
        bridged = serve("bridged", "uav1", "--state", str(tmp_path / "state"), "--speed", SPEED)
        agentd = serve("agentd", "uav", "--speed", SPEED)
        agentd.says("[uav] flying to")
        commd.kill()
        for daemon in (bridged, agentd):
            daemon.says("router lost")
        again = serve("commd")
        again.says("router board=local")
        agentd.says("action=goto")
        assert "state=succeeded" in next(line for line in agentd.lines if "action=goto" in line)
        agentd.says("[uav] mission done", 120)
        assert "bridge_lost" not in agentd.text
        assert "is lost" not in bridged.text
        assert copter.process.poll() is None
        assert not re.search("Traceback|defect", agentd.text + bridged.text + again.text)
