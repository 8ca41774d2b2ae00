"""A router that somebody else runs: `router: {external: true}` makes commd its client."""

import asyncio
from pathlib import Path

from commd.bus.bus import open_bus
from tests.support.processes import running

MISSION = """\
mission: two
agents:
  a: {{program: a.asl, beliefs: ["peer(b)"]}}
  b: {{program: b.asl}}
router: {{endpoint: {endpoint}, external: true}}
"""


async def test_mail_flows_through_a_router_that_somebody_else_runs(tmp_path: Path, endpoint: str) -> None:
    path = tmp_path / "m.yaml"
    path.write_text(MISSION.format(endpoint=endpoint))
    (tmp_path / "a.asl").write_text("!start.\n+!start : peer(P) <- .send(P, tell, hello).\n")
    (tmp_path / "b.asl").write_text('+hello[source(A)] <- .print("hello from ", A).\n')
    async with open_bus(endpoint, fleet="x", name="router", daemon="zenohd", mode="router"):
        with running("commd", "serve", str(path)) as commd, running("agentd", "serve", str(path)) as agents:
            await asyncio.to_thread(agents.says, "[b] hello from a")
            await asyncio.to_thread(commd.says, "client board=local")
