"""Types that are used for the first time by two threads at once: msgspec alone ends the process then."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
TRIES = 10
"""Without the lock one in three dies."""
PROGRAM = """\
import sys, threading
from pathlib import Path
from schemas.mission.model import load_mission

sys.setswitchinterval(1e-6)
both, read = threading.Barrier(2), []

def load():
    both.wait()
    read.append(load_mission(Path("missions/search_and_rescue.yaml")).name)

threads = [threading.Thread(target=load) for _ in range(2)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join(30)
print(*read)
"""


def test_two_threads_may_read_the_first_mission_of_a_process_at_once() -> None:
    for _ in range(TRIES):
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False
        )
        assert (done.returncode, done.stdout.split()) == (0, ["search-and-rescue"] * 2), done.stderr
