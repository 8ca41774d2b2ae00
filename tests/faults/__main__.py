"""`make faults`: inject every fault of the table, print the results and write docs/measurements/faults.md."""

import os
import sys
import tempfile
from pathlib import Path

import pytest

from tests.docs.pages import with_part
from tests.faults.mail import MAIL_INPUT
from tests.faults.mail_files import AS_ROOT, MAIL_FILES
from tests.faults.poison import POISON
from tests.faults.real import REAL
from tests.faults.rows import Row, of_actions, of_mail
from tests.faults.virtual import VIRTUAL
from tests.soak.report import ROOT, here

FLOWN = (*VIRTUAL, *REAL)
PAGE = ROOT / "docs/measurements/faults.md"
MAIL_HEAD = """
### Mail

Real `commd` and `agentd` processes, real files, real datagrams; cuts, kills and full disks by the dozen are in
[soak.md](soak.md).
"""


def main() -> int:
    """Run every row. Returns the exit code: 1 if one does not hold."""
    rows: list[Row] = []
    if os.geteuid():
        print("rows that need a file system of their own need root", file=sys.stderr)
        return 2
    for make in (*FLOWN, *MAIL_INPUT, *MAIL_FILES, *POISON, *AS_ROOT):
        with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
            patch.setenv("XDG_STATE_HOME", f"{folder}/state_home")  # else an earlier run's agents go on
            rows.append(make(Path(folder)))
        row = rows[-1]
        print(f"{row.fault}: {'; '.join(row.wrong()) or 'holds'}", flush=True)
        for line in (*map(str, row.ended), *row.seen, row.bound):
            print(f"    {line}", flush=True)
    failed = [row for row in rows if row.wrong()]
    print(f"{len(rows) - len(failed)} of {len(rows)} hold")
    if not failed:
        count = len(FLOWN)
        lines = [f"On {here()}.\n", *of_actions(rows[:count]), MAIL_HEAD, *of_mail(rows[count:]), ""]
        PAGE.write_text(with_part(PAGE, "faults", "\n".join(lines)), encoding="utf-8")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
