"""Search and rescue as deployed: mutual TLS between three boards, a socket on each, access rules from the mission.

    python -m tests.soak.secured

Keys and routers' configurations are made as for real boards; each daemon is started by its own command. The referee
judges by the simulators' logs. Then the same without keys and rules, by plain TCP, to compare. Writes its section of
docs/measurements/soak.md.
"""

import asyncio
import re
import sys
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from pathlib import Path

from argosy.cli.fleet_bus import open_fleet_bus
from argosy.simulate.referee import Verdict, judge_run
from commd.bus.bus import Bus, open_bus
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from schemas.wire.records import Mailboxes
from tests.soak.report import table, write_section
from tests.support.ports import free_port
from tests.support.processes import ROOT, Daemon
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

    def start(self, board: str, daemon: str, *options: str) -> Daemon:
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
            believed = {belief.text.partition("[")[0] for belief in reply.record.beliefs}
            found[reply.record.agent] = wanted[reply.record.agent] in believed
    return found


@asynccontextmanager
async def _operator(fleet: Secured, secured: bool) -> AsyncIterator[Bus]:
    """An operator's bus: with keys it reaches each board at its own router, for none passes on minds."""
    if secured:
        async with open_fleet_bus(fleet.mission, fleet.tls("ops"), 5, name="ops", daemon="argosy") as bus:
            yield bus
        return
    async with open_bus(
        fleet.socket("pi1"), fleet=fleet.mission.fleet, name="ops", daemon="argosy", patience=5
    ) as alone:
        yield alone


async def watch(fleet: Secured, secured: bool) -> tuple[float, int]:
    """Wait until the mission is done, by the eyes of an operator. Returns the seconds and the mail that still waits."""
    began = time.monotonic()
    async with _operator(fleet, secured) as bus:
        while not all((await done(bus)).values()):
            if time.monotonic() - began > PATIENCE:
                raise SystemExit(f"not done within {PATIENCE:g} s: {await done(bus)}")
            await asyncio.sleep(1)
        took, waiting = time.monotonic() - began, 0
        async for reply in bus.query(keys.mailboxes(bus.fleet, "*"), None, Mailboxes, 3):
            if reply.record is not None:
                waiting += sum(queue.messages for queue in reply.record.queues)
    return took, waiting


@dataclass(frozen=True)
class Flown:
    """How one run went."""

    took: float
    """Wall seconds."""
    waiting: int
    """Messages that wait at the end."""
    denied: list[str]
    """Lines in which a daemon says that it is denied something."""
    verdict: Verdict


def fly(kind: type[Secured]) -> Flown:
    """Fly the mission once, and judge it."""
    with kind(mission_text(), SHIPPED.with_suffix("")) as fleet:
        report = fleet.folder / "report"
        fleet.routers()
        for board in fleet.ports:
            how = ("--board", board, "--router", fleet.socket(board), "--report", str(report))
            fleet.run("argosy", "simulate", str(fleet.path), *how).says("simulated copter", 60)
        for daemon in [fleet.start(board, "bridged") for board in fleet.ports]:
            daemon.says("serving ", 60)
        for daemon in [fleet.start(board, "agentd") for board in fleet.ports]:
            daemon.says("agents=", 60)
        took, waiting = asyncio.run(watch(fleet, kind is Secured))
        denied = [line for daemon in fleet.daemons for line in daemon.lines if "denie" in line]
        return Flown(took, waiting, denied, judge_run(fleet.mission, report))


def reported(flown: Flown) -> str:
    """Return a run as a cell of a table."""
    rescues = flown.verdict.rescues.values()
    return f"{flown.took:.0f} s, {sum(len(drops) == 1 for drops in rescues)} of {len(rescues)} victims got one buoy"


def main() -> int:
    """Fly it secured and open, and judge both. Returns the exit code."""
    runs: dict[str, Flown] = {}
    for title, kind in (("mutual TLS, sockets, access rules", Secured), ("plain TCP, no rules", Open)):
        flown = runs[title] = fly(kind)
        print(f"{title}: {flown.took:.0f} s, {flown.waiting} messages wait\n{flown.verdict}", flush=True)
        print(*flown.denied, sep="\n")
    good = all(one.verdict.good and not one.denied and not one.waiting for one in runs.values())
    if good:
        rows = ((name, reported(one)) for name, one in runs.items())
        write_section("Search and rescue, secured", table("boards linked by | mission done after", rows))
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
