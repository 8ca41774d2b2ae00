"""`make field`: lets agents, bridges, routers and boards fail in flight, and writes
docs/measurements/faults.md; some 30 minutes.

`--times N` (default 3) flies each row so often; names of rows (`agents.hung`) fly those alone and write nothing.
"""

import argparse
import os
import platform
import signal
import sys
import tempfile
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from tests.docs.pages import with_part
from tests.field.agents import AGENTS, BOARDS
from tests.field.bridges import BRIDGES
from tests.field.machine import SYSTEMD
from tests.field.rows import Maker, Row, table
from tests.field.units import UnitFile
from tests.support.processes import ROOT

ALL = (*AGENTS, *BOARDS, *BRIDGES, *SYSTEMD)
PAGE = ROOT / "docs/measurements/faults.md"


def main() -> int:
    """Fly the rows. Returns the exit code: 1 if one does not hold."""
    parser = argparse.ArgumentParser(prog="python -m tests.field", description=__doc__)
    parser.add_argument("rows", nargs="*", metavar="ROW")
    parser.add_argument("--times", type=int, default=3)
    args = parser.parse_args()
    if os.geteuid():
        print("boards that are cut off are network namespaces, and these need root", file=sys.stderr)
        return 2
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # what it has started ends with it
    makers = {f"{make.__module__.rpartition('.')[2]}.{make.__name__}": make for make in ALL}
    chosen = [make for name, make in makers.items() if not args.rows or name in args.rows]
    runs = [[fly(make) for _ in range(args.times)] for make in chosen]
    failed = [row for rows in runs for row in rows if row.problems]
    if not failed and not args.rows:
        flights = "\n".join([head(args.times), "", *table(runs), ""])
        PAGE.write_text(with_part(PAGE, "flights", flights), encoding="utf-8")
    return 1 if failed else 0


def fly(make: Maker) -> Row:
    """Fly a row, and print what came of it."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            row = make(Path(folder))
        except AssertionError as error:  # the other rows are flown all the same
            row = Row(make.__name__, "", problems=[str(error)])
    print(f"{make.__name__}: {'; '.join(row.problems) or 'holds'}: {', '.join(map(str, row.figures))}", flush=True)
    return row


def head(times: int) -> str:
    """Say where the figures come from."""
    unit = UnitFile.read("agentd")
    often, figures = "once", ""
    if times > 1:
        often, figures = f"{times} times", ": the median, and in brackets the extremes"
    return (
        f"Flown by `make field` on {datetime.now(UTC):%Y-%m-%d}, each row {often} at speed 1: Python "
        f"{platform.python_version()}, eclipse-zenoh\n{version('eclipse-zenoh')}, {os.cpu_count()} cores of "
        f"{platform.machine()} for all daemons and the vehicle. Units: `WatchdogSec={unit.watchdog:g}`, "
        f"`RestartSec={unit.restart_after:g}`,\n`TimeoutAbortSec={unit.abort:g}`. Seconds after the fault{figures}. "
        f"Load average of the machine at the end: {os.getloadavg()[2]:.0f}; what is "
        "started again takes\nas long as that lets it."
    )


if __name__ == "__main__":
    sys.exit(main())
