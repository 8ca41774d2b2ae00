"""`argosy run` whose simulated copters have a second MAVLink link, for a test that judges by the vehicle itself.

python -m tests.support.observed_run udpout:127.0.0.1:PORT run MISSION ...
"""

from __future__ import annotations

import sys

from argosy.__main__ import main
from argosy.processes import simulators

if __name__ == "__main__":
    link, command = sys.argv[1], simulators.command
    simulators.command = lambda *arguments, **named: [*command(*arguments, **named), "--link", link]
    sys.exit(main(sys.argv[2:]))
