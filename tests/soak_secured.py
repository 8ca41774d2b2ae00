"""Search and rescue as deployed: mutual TLS between three boards, a socket on each, access rules from the mission.

    python -m tests.soak_secured [--open]

Keys and routers' configurations are made as for real boards; each daemon is started by its own command. The referee
judges by the simulators' logs. With `--open` the same without keys and rules, by plain TCP, to compare. Prints seconds
and the verdict.
"""

from __future__ import annotations

import argparse
import asyncio
import re
import sys
import time
from pathlib import Path

from argosy.referee import judge_run
from commd.bus import Bus, open_bus
from schemas import keys
from schemas.records import Mailboxes, MindView
from tests.support.ports import free_port
from tests.support.processes import ROOT
from tests.support.secured import Secured

SHIPPED = ROOT / "missions" / "search_and_rescue.yaml"
PATIENCE = 400.0
"""Wall seconds of the mission."""


class Open(Secured):
    """The same fleet by plain TCP, as on a table."""

    def __init__(self, text: str, programs: Path) -> None:
        super().__init__(text, programs)
        self._inside = {board: f"tcp/127.0.0.1:{free_port()}" for board in self.ports}

    def socket(self, board: str) -> str:
        return self._inside[board]

    def start(self, board: str, daemon: str, *options: str):  # type: ignore[no-untyped-def]
        """Start a daemon of a board by plain TCP."""
        how = ["--router", self.socket(board)]
        if daemon == "commd":
            how += ["--listen", self.link(board).replace("tls/", "tcp/")]
            for other in list(self.ports)[: list(self.ports).index(board)]:
                how += ["--connect", self.link(other).replace("tls/", "tcp/")]
        state = ["--state", str(self.folder / "state" / board)]
        return self.run(daemon, "serve", str(self.path), "--board", board, *state, *how, *options)


def mission_text() -> str:
    """The shipped mission with its boards to be filled in, an operator, and ports of its own."""
    text = re.sub(r"boards:\n(  pi\d: .*\n)+", "boards: BOARDS\n", SHIPPED.read_text(encoding="utf-8"))
    text = re.sub(r"127\.0\.0\.1:1455\d", lambda _: f"127.0.0.1:{free_port()}", text)
    return text + "security: {operators: [ops]}\n"


async def done(bus: Bus) -> dict[str, bool]:
    """Ask each agent whether its part is done."""
    wanted = {"scout": "mission_done", "rescuer1": "resting", "rescuer2": "resting"}
    found = dict.fromkeys(wanted, False)
    async for reply in bus.query(keys.mind(bus.fleet, "*"), None, MindView, 3):
        if reply.record is not None and reply.record.agent in wanted:
            believed = {belief.partition("[")[0] for belief in reply.record.beliefs}
            found[reply.record.agent] = wanted[reply.record.agent] in believed
    return found


async def watch(fleet: Secured, secured: bool) -> tuple[float, int]:
    """Wait until the mission is done, by the eyes of an operator. Returns the seconds and the mail that still waits."""
    began = time.monotonic()
    endpoint, tls = (fleet.link("pi1"), fleet.tls("ops")) if secured else (fleet.socket("pi1"), None)
    async with open_bus(
        endpoint, fleet=fleet.mission.fleet, name="ops", daemon="argosy", stamp=time.time_ns, tls=tls, patience=5
    ) as bus:
        while not all((await done(bus)).values()):
            if time.monotonic() - began > PATIENCE:
                raise SystemExit(f"not done within {PATIENCE:g} s: {await done(bus)}")
            await asyncio.sleep(1)
        took, waiting = time.monotonic() - began, 0
        async for reply in bus.query(keys.mailboxes(bus.fleet, "*"), None, Mailboxes, 3):
            if reply.record is not None:
                waiting += sum(queue.messages for queue in reply.record.queues)
    return took, waiting


def main() -> int:
    """Fly it and judge it. Returns the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--open", action="store_true", help="by plain TCP and without rules, to compare")
    args = parser.parse_args()
    kind = Open if args.open else Secured
    with kind(mission_text(), SHIPPED.with_suffix("")) as fleet:
        report = fleet.folder / "report"
        fleet.routers()
        for board in fleet.ports:
            fleet.run(
                "argosy", "simulate", str(fleet.path), "--board", board, "--router", fleet.socket(board),
                "--report", str(report),
            ).says("simulated copter", 60)  # fmt: skip
        bridges = [fleet.start(board, "bridged") for board in fleet.ports]
        for daemon in bridges:
            daemon.says("serving ", 60)
        agents = [fleet.start(board, "agentd") for board in fleet.ports]
        for daemon in agents:
            daemon.says("agents=", 60)
        took, waiting = asyncio.run(watch(fleet, not args.open))
        verdict = judge_run(fleet.mission, report)
        denied = [line for daemon in fleet.daemons for line in daemon.lines if "denie" in line]
        print(f"done after {took:.0f} s, {waiting} messages wait, {len(denied)} denials told\n{verdict}")
        print(*denied, sep="\n")
    return 0 if verdict.good and not denied else 1


if __name__ == "__main__":
    sys.exit(main())
