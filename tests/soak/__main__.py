"""What takes too long for CI: `make soak` flies the first mission ten times in a row at 20 times real time.

Writes its section of docs/measurements/soak.md and exits with 0 only if all flights were done.
"""

import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from tests.soak.report import ROOT, table, write_section

FLIGHTS = 10
SPEED = 20
PATIENCE = 120.0
"""Wall seconds for one flight."""
FIGURES = {
    "memory, MB": r"memory +([\d.]+) MB at most",
    "in flight, % of a core": r"processor +([\d.]+) %",
    "idle, % of a core": r"idle +([\d.]+) %",
}


def fly(folder: Path) -> tuple[int, float, dict[str, float]]:
    """Fly once. Returns exit code, wall seconds and the figures of the summary."""
    arguments = ["run", "missions/single_uav.yaml", "--plain", "--speed", str(SPEED), "--report", str(folder)]
    started = time.monotonic()
    run = subprocess.run(
        [sys.executable, "-m", "argosy", *arguments], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE
    )
    took = time.monotonic() - started
    if run.returncode:
        print(run.stdout[-3000:], run.stderr[-1000:])
    found = {name: re.search(shape, run.stdout) for name, shape in FIGURES.items()}
    return run.returncode, took, {name: float(match[1]) for name, match in found.items() if match}


def main() -> int:
    """Fly, print and write the report."""
    rows, failed = [], 0
    for number in range(1, FLIGHTS + 1):
        with tempfile.TemporaryDirectory() as folder:
            code, took, figures = fly(Path(folder))
        failed += code != 0
        rows.append((took, figures))
        print(f"flight {number}: {'done' if code == 0 else f'exit {code}'} in {took:.1f} s {figures}", flush=True)
    lines = [
        f"The first mission flown {FLIGHTS} times in a row at {SPEED} times real time: "
        f"**{FLIGHTS - failed} of {FLIGHTS} done**.",
        "",
    ]
    columns = {"wall seconds": [took for took, _ in rows]}
    for name in FIGURES:
        columns[f"{name} (commd + bridged + agentd)"] = [figures[name] for _, figures in rows if name in figures]
    cells = ((name, f"{statistics.median(one):.1f}", f"{max(one):.1f}") for name, one in columns.items() if one)
    write_section("Flights", [*lines, *table(" | median | most", cells)])
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
