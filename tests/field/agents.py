"""What becomes of a vehicle whose agent fails: killed, stopped, hung in a function, cut off with its board."""

from __future__ import annotations

import re
import signal
import time
from pathlib import Path

from commd.bus.session import LEASE_MS
from schemas.liveness import AGENT_GRACE, BUS_GRACE, ROUTER_GRACE, SILENT_AFTER
from tests.boards.network import Network
from tests.field.flight import Flight
from tests.field.rows import MARGIN, Maker, Row
from tests.field.scene import Scene

LEASE = LEASE_MS / 1000
HOLD = 5.0
"""`on_agent_loss: [hold 5s, rtl]`."""
KILLED = AGENT_GRACE, "1 s of grace for a token that is gone"
STOPPED = LEASE + AGENT_GRACE, "2 s until the router misses the process, 1 s of grace"
HUNG = SILENT_AFTER, "`agent_silence: 5s`"
CUT = LEASE + ROUTER_GRACE, "2 s until the routers miss each other, 5 s of grace for a whole board"
ASKER = BUS_GRACE, "`bus_grace` without a word of the bridge"
SHORT = 3.0
"""Seconds of a cut that no flight fails by: longer than the lease of the routers, shorter than any grace."""
WATCHDOG = 10.0
"""`WatchdogSec` of the units, from the last time that it was fed: a loop feeds it within half of that."""
_BACK = 30.0


def killed(folder: Path) -> Row:
    """agentd is killed, and nobody starts it again."""
    row = Row("agentd, killed", "SIGKILL; nobody starts it again")
    with Scene(folder, restart=False) as scene:
        at = scene.thinker.signal(signal.SIGKILL)
        safe(row, scene, at, *KILLED)
    return row


def killed_and_restarted(folder: Path) -> Row:
    """agentd is killed, and started again by its unit."""
    row = Row("agentd, killed", "SIGKILL; `Restart=on-failure`")
    with Scene(folder) as scene:
        at = scene.thinker.signal(signal.SIGKILL)
        ready = scene.thinker.happened.ready
        scene.until(lambda: len(ready) > 1, "the daemon is ready again", _BACK)
        returned(row, scene, at, ready[1] - at)
        row.expect(scene.shows("RTL", at) is None, "rtl is left out, since the agent is back before it")
    return row


def stopped(folder: Path) -> Row:
    """agentd is stopped, and nobody looks."""
    row = Row("agentd, stopped", "SIGSTOP; no watchdog")
    with Scene(folder, restart=False, watchdog=False) as scene:
        at = scene.thinker.signal(signal.SIGSTOP)
        safe(row, scene, at, *STOPPED)
    return row


def stopped_and_watched(folder: Path) -> Row:
    """agentd is stopped; its watchdog ends it, and its unit starts it again."""
    row = Row("agentd, stopped", "SIGSTOP; `WatchdogSec=10`, `Restart=on-failure`")
    with Scene(folder) as scene:
        at = scene.thinker.signal(signal.SIGSTOP)
        row.figure("hold", scene.until_shown("BRAKE", at), *STOPPED)
        watched(row, scene, at)
    return row


def hung(folder: Path) -> Row:
    """A Python function of the program's does not return, and nobody looks."""
    row = Row("agentd, hung in a Python function", "its Zenoh threads keep its token; no watchdog")
    with Scene(folder, restart=False, watchdog=False) as scene:
        at = scene.hang()
        safe(row, scene, at, *HUNG)
    return row


def hung_and_watched(folder: Path) -> Row:
    """A Python function of the program's does not return; the watchdog ends the process, its unit starts it again."""
    row = Row("agentd, hung in a Python function", "`WatchdogSec=10`, `Restart=on-failure`")
    with Scene(folder) as scene:
        at = scene.hang()
        row.figure("hold", scene.until_shown("BRAKE", at), *HUNG)
        # It holds for the silence, not because the watchdog has ended the agent.
        words = "it is present and has been silent for 5 s: it hangs"
        scene.until(lambda: words in scene.daemons["bridged"].text, "the bridge says why", 90)
        watched(row, scene, at)
    return row


def cut(folder: Path) -> Row:
    """The link between the agent's board and the robot's is cut."""
    row = Row("the link between two boards", "the agent on pi1, its robot on pi2; pi1's cable is unplugged")
    with Network(("pi1", "pi2")) as network, Scene(folder, network=network) as scene:
        at = time.monotonic()
        network.unplug("pi1")
        safe(row, scene, at, *CUT)
        failed = scene.said("goto failed: ", at)
        row.figure("the agent is told", None if failed is None else failed - at, *ASKER)
        told = [line.partition("goto failed: ")[2] for _, line in scene.thinker.lines if "goto failed: " in line]
        row.seen.append(f"the agent is told `{told[0] if told else ''}`")
    return row


def cut_for_a_moment(folder: Path) -> Row:
    """The link between the agent's board and the robot's is cut for less than the grace."""
    row = Row(f"the link between two boards, for {SHORT:g} s", "as above, and plugged in again")
    with Network(("pi1", "pi2")) as network, Scene(folder, network=network) as scene:
        at = time.monotonic()
        network.unplug("pi1")
        time.sleep(SHORT)
        network.plug("pi1")
        time.sleep(CUT[0] + 4)
        row.expect(not scene.shown(at), f"the flight goes on, shown: {scene.shown(at)}")
        row.expect(scene.said("goto failed", at) is None, "the action goes on")
        row.seen.append("no mode changes, the action goes on")
    return row


def landing(folder: Path) -> Row:
    """A mission that declares to land at once."""
    row = Row("agentd, killed", "`on_agent_loss: [land]`; SIGKILL, nobody starts it again")
    with Scene(folder, on_agent_loss="[land]", restart=False) as scene:
        at = scene.thinker.signal(signal.SIGKILL)
        row.figure("land", scene.until_shown("LAND", at), *KILLED)
        scene.until(lambda: down(scene, at) is not None, "the vehicle is down", 60)
        row.figure("on the ground, disarmed", down(scene, at))
    return row


def safe(row: Row, scene: Scene, at: float, declared: float, why: str) -> None:
    """Note when the vehicle holds and turns home."""
    row.figure("hold", scene.until_shown("BRAKE", at), declared, why)
    row.figure("rtl", scene.until_shown("RTL", at), declared + HOLD, f"and `hold {HOLD:g}s`")


def down(scene: Scene, at: float) -> float | None:
    """When the vehicle was disarmed, after a moment."""
    return next((when for when, _, armed in scene.shown(at) if not armed), None)


def watched(row: Row, scene: Scene, at: float) -> None:
    """Note when the watchdog has found the agent hung, and when it is back."""
    unit = scene.thinker
    scene.until(lambda: bool(unit.happened.watchdog), "the watchdog finds it hung", 30)
    found = unit.happened.watchdog[0] - at
    row.figure("ended by its watchdog", found)
    row.expect(found <= WATCHDOG + MARGIN, f"the watchdog finds it within {WATCHDOG:g} s")
    told = [line.partition("error: ")[2] for _, line in unit.lines if "ended by SIGABRT" in line]
    row.seen += [re.sub(r"/\S*/", "", line) for line in told]  # where the test's own files are is nobody's business
    back(row, scene, at)


def back(row: Row, scene: Scene, at: float) -> None:
    """Note when the agent's daemon is ready again, and when its program has the vehicle again."""
    ready = scene.thinker.happened.ready
    scene.until(lambda: len(ready) > 1, "the daemon is ready again", _BACK)
    again = scene.until_shown("GUIDED", at, _BACK)
    if (home := scene.shows("RTL", at)) is not None and home < again:
        row.figure("rtl", home)
    row.figure("ready again", ready[1] - at)
    row.figure("flown by its program again", again)


def returned(row: Row, scene: Flight, at: float, ready: float) -> None:
    """Note what the vehicle did for an agent that was killed, and whose daemon was ready again after so many seconds.

    One that is back within its grace was never lost.
    """
    end = max(at + ready, at + KILLED[0]) + MARGIN
    scene.until(lambda: scene.shows("BRAKE", at) is not None or time.monotonic() > end, "it holds, or not", 60)
    row.figure("ready again", ready)
    if (hold := scene.shows("BRAKE", at)) is None:
        row.expect(ready <= KILLED[0] + MARGIN, "it holds for an agent that is not back within its grace")
        row.expect(not scene.shown(at), "the vehicle flies on")
        row.seen.append("back within its grace: the vehicle flies on")
    else:
        row.figure("hold", hold, *KILLED)
        row.figure("flown by its program again", scene.until_shown("GUIDED", at, _BACK))


AGENTS: tuple[Maker, ...] = (
    killed,
    killed_and_restarted,
    stopped,
    stopped_and_watched,
    hung,
    hung_and_watched,
    landing,
)
BOARDS: tuple[Maker, ...] = (cut, cut_for_a_moment)
"""Rows that need network namespaces."""
