"""`make attacks`: tries every attack of the table, prints what came of it and writes docs/measurements/attacks.md."""

import asyncio
import sys
import time

from tests.attacks.admission import ADMISSION
from tests.attacks.links import LINKS
from tests.attacks.mail import MAIL
from tests.attacks.messages import MESSAGES
from tests.attacks.programs import PROGRAMS
from tests.attacks.readers import READERS
from tests.attacks.text_and_files import TEXT_AND_FILES
from tests.attacks.vehicle import VEHICLE
from tests.attacks.world import TEXT, Row, World
from tests.soak.report import ROOT, here, table
from tests.support.secured import Secured

PAGE = ROOT / "docs/measurements/attacks.md"
HEAD = """\
# Attacks

Written by `make attacks`; each row is also a test of `make test`. Three boards with routers as they are deployed
(mutual TLS between them, a socket on each, access rules from the mission), real `commd` and `bridged` processes on
loopback. The attacker mostly is `pi3`: a board that has the fleet's trust and abuses it. Agent `a` and robot `r1` are
on pi1, `b` on pi2, `c` on pi3. Each row also shows that permitted traffic still passes; otherwise it would not count.
"""


def main() -> int:
    """Try every row. Returns the exit code: 1 if one does not hold."""
    rows: list[Row] = []
    with Secured(TEXT) as fleet:
        world = World(fleet)
        world.begin()
        for attack in (*LINKS, *ADMISSION, *READERS, *MESSAGES, *MAIL, *VEHICLE, *PROGRAMS, *TEXT_AND_FILES):
            began = time.monotonic()
            rows.append(asyncio.run(asyncio.wait_for(attack(world), 240)))
            row = rows[-1]
            print(
                f"{row.attack} ({time.monotonic() - began:.1f} s): {'; '.join(row.problems) or 'refused'}", flush=True
            )
            for line in row.seen:
                print(f"    {line}", flush=True)
    failed = [row for row in rows if row.problems]
    print(f"{len(rows) - len(failed)} of {len(rows)} hold")
    if not failed:
        cells = ((row.attack, row.tried, row.refused, "<br>".join(row.seen)) for row in rows)
        lines = [HEAD, f"On {here()}.\n", *table("attack | tried | refused by | seen", cells), ""]
        PAGE.write_text("\n".join(lines), encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
