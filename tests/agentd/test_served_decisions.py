"""`{agent}/mind` on the bus: the last decisions of an agent, as any observer gets them."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

from commd.bus.bus import open_bus
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from tests.support.processes import running

MISSION = """\
mission: one
agents:
  uav: {program: uav.asl}
done: "uav: never"
"""
PROGRAM = """\
battery(12).
!fly(5).
@careful +!fly(H) : battery(B) & B > 20 <- takeoff(H).
+!fly(H) <- .print("staying down"); ?height(X).
"""


async def _mind(endpoint: str) -> MindView:
    async with open_bus(endpoint, fleet="one", name="observer", daemon="test", stamp=time.time_ns) as bus:
        return await bus.ask_one(keys.mind("one", "uav"), None, MindView, 10.0)


def test_an_observer_reads_which_plan_was_chosen_and_why_not_another(tmp_path: Path, endpoint: str) -> None:
    (tmp_path / "uav.asl").write_text(PROGRAM)
    path = tmp_path / "m.yaml"
    path.write_text(MISSION)
    with (
        running("commd", "serve", str(path), "--router", endpoint),
        running("agentd", "serve", str(path), "--router", endpoint) as agent,
    ):
        agent.says("staying down")
        agent.says("finds nothing; nothing is believed about height/1")
        view = asyncio.run(_mind(endpoint))
    (decision,) = view.decisions
    assert (decision.event, decision.outcome) == ("+!fly(5)", "failed")
    (rejected,) = decision.rejected
    assert (rejected.plan.label, rejected.literal, rejected.filled) == ("careful", "B > 20", "12 > 20")
    assert decision.chosen is not None
    assert decision.chosen.position.endswith("uav.asl:4")
    (failure,) = view.failures
    assert failure == decision.failure
    assert (failure.formula, failure.error) == ("?height(X)", "test_goal_failed")


def test_recording_can_be_turned_off(tmp_path: Path, endpoint: str) -> None:
    (tmp_path / "uav.asl").write_text(PROGRAM)
    path = tmp_path / "m.yaml"
    path.write_text(MISSION)
    with (
        running("commd", "serve", str(path), "--router", endpoint),
        running("agentd", "serve", str(path), "--decisions", "0", "--router", endpoint) as agent,
    ):
        agent.says("staying down")
        view = asyncio.run(_mind(endpoint))
    assert view.decisions == view.failures == ()
