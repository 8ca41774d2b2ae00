"""What becomes of a vehicle whose agent fails: killed, stopped, hung in a function, cut off with its board."""

import re
import signal
import time

from commd.bus.session import LEASE_MS
from schemas.liveness import AGENT_GRACE, BUS_GRACE, ROUTER_GRACE, SILENT_AFTER
from tests.field.flight import Flight
from tests.field.rows import MARGIN, Maker, Row
from tests.field.scene import Scene, flown

LEASE = LEASE_MS / 1000
HOLD = 5.0
"""`on_agent_loss: [hold 5s, rtl]`."""
KILLED = AGENT_GRACE, "1 s of grace for a lost token"
STOPPED = LEASE + AGENT_GRACE, "2 s until the router misses the process, 1 s of grace"
HUNG = SILENT_AFTER, "`agent_silence: 5s`"
CUT = LEASE + ROUTER_GRACE, "2 s until the routers miss each other, 5 s of grace for a whole board"
ASKER = BUS_GRACE, "`bus_grace` without a report of the bridge"
SHORT = 3.0
"""Seconds of a cut that no flight fails by: longer than the lease of the routers, shorter than any grace."""
WATCHDOG = 10.0
"""`WatchdogSec` of the units, from the last time that it was fed: a loop feeds it within half of that."""
_BACK = 30.0


@flown("agentd, killed", "SIGKILL; nobody starts it again", restart=False)
def killed(row: Row, scene: Scene) -> None:
    """agentd is killed, and nobody starts it again."""
    at = scene.thinker.signal(signal.SIGKILL)
    safe(row, scene, at, *KILLED)


@flown("agentd, killed", "SIGKILL; `Restart=on-failure`")
def killed_and_restarted(row: Row, scene: Scene) -> None:
    """agentd is killed, and started again by its unit."""
    at = scene.thinker.signal(signal.SIGKILL)
    ready = scene.thinker.happened.ready
    scene.until(lambda: len(ready) > 1, "the daemon is ready again", _BACK)
    returned(row, scene, at, ready[1] - at)
    row.expect(scene.shows("RTL", at) is None, "rtl is left out, since the agent is back before it")


@flown("agentd, stopped", "SIGSTOP; no watchdog", restart=False, watchdog=False)
def stopped(row: Row, scene: Scene) -> None:
    """agentd is stopped, and nobody looks."""
    at = scene.thinker.signal(signal.SIGSTOP)
    safe(row, scene, at, *STOPPED)


@flown("agentd, stopped", "SIGSTOP; `WatchdogSec=10`, `Restart=on-failure`")
def stopped_and_watched(row: Row, scene: Scene) -> None:
    """agentd is stopped; its watchdog ends it, and its unit starts it again."""
    at = scene.thinker.signal(signal.SIGSTOP)
    row.figure("hold", scene.until_shown("BRAKE", at), *STOPPED)
    watched(row, scene, at)


@flown(
    "agentd, hung in a Python function", "its Zenoh threads keep its token; no watchdog", restart=False, watchdog=False
)
def hung(row: Row, scene: Scene) -> None:
    """A Python function of the program's does not return, and nobody looks."""
    at = scene.hang()
    safe(row, scene, at, *HUNG)


@flown("agentd, hung in a Python function", "`WatchdogSec=10`, `Restart=on-failure`")
def hung_and_watched(row: Row, scene: Scene) -> None:
    """A Python function of the program's does not return; the watchdog ends the process, its unit starts it again."""
    at = scene.hang()
    row.figure("hold", scene.until_shown("BRAKE", at), *HUNG)
    # It holds for the silence, not because the watchdog has ended the agent.
    words = "it is present and has been silent for 5 s: it hangs"
    scene.until(lambda: words in scene.daemons["bridged"].text, "the bridge says why", 90)
    watched(row, scene, at)


@flown(
    "the link between two boards", "the agent on pi1, its robot on pi2; pi1's cable is unplugged", boards=("pi1", "pi2")
)
def cut(row: Row, scene: Scene) -> None:
    """The link between the agent's board and the robot's is cut."""
    at = time.monotonic()
    scene.network.unplug("pi1")
    safe(row, scene, at, *CUT)
    row.seen.append(f"the agent is notified `{failure(row, scene, at, *ASKER)}`")


@flown(f"the link between two boards, for {SHORT:g} s", "as above, and plugged in again", boards=("pi1", "pi2"))
def cut_for_a_moment(row: Row, scene: Scene) -> None:
    """The link between the agent's board and the robot's is cut for less than the grace."""
    at = time.monotonic()
    scene.network.unplug("pi1")
    time.sleep(SHORT)
    scene.network.plug("pi1")
    time.sleep(CUT[0] + 4)
    row.expect(not scene.shown(at), f"the flight goes on, shown: {scene.shown(at)}")
    row.expect(scene.said("goto failed", at) is None, "the action goes on")
    row.seen.append("no mode changes, the action goes on")


@flown(
    "agentd, killed", "`on_agent_loss: [land]`; SIGKILL, nobody starts it again", on_agent_loss="[land]", restart=False
)
def landing(row: Row, scene: Scene) -> None:
    """A mission that declares to land at once."""
    at = scene.thinker.signal(signal.SIGKILL)
    row.figure("land", scene.until_shown("LAND", at), *KILLED)
    scene.until(lambda: down(scene, at) is not None, "the vehicle is down", 60)
    row.figure("on the ground, disarmed", down(scene, at))


def safe(row: Row, scene: Scene, at: float, declared: float, why: str) -> None:
    """Note when the vehicle holds and turns home."""
    row.figure("hold", scene.until_shown("BRAKE", at), declared, why)
    row.figure("rtl", scene.until_shown("RTL", at), declared + HOLD, f"and `hold {HOLD:g}s`")


def down(scene: Scene, at: float) -> float | None:
    """When the vehicle was disarmed, after a moment."""
    return next((when for when, _, armed in scene.shown(at) if not armed), None)


def watched(row: Row, scene: Scene, at: float) -> None:
    """Note when the watchdog has found the agent hung, and when it is back."""
    ended_by_watchdog(row, scene, "agentd", at)
    told = [line.partition("error: ")[2] for _, line in scene.thinker.lines if "ended by SIGABRT" in line]
    row.seen += [re.sub(r"/\S*/", "", line) for line in told]  # where the test's own files are is nobody's business
    back(row, scene, at)


def ended_by_watchdog(row: Row, scene: Scene, daemon: str, at: float) -> None:
    """Note when the watchdog has found a daemon hung."""
    happened = scene.daemons[daemon].happened
    scene.until(lambda: bool(happened.watchdog), "the watchdog finds it hung", 30)
    found = happened.watchdog[0] - at
    row.figure("ended by its watchdog", found)
    row.expect(found <= WATCHDOG + MARGIN, f"the watchdog finds it within {WATCHDOG:g} s")


def ready_again(row: Row, scene: Scene, daemon: str, at: float) -> None:
    """Note when a daemon that was started again is ready."""
    ready = scene.daemons[daemon].happened.ready
    scene.until(lambda: len(ready) > 1, f"{daemon} is ready again", _BACK)
    row.figure("ready again", ready[1] - at)


def failure(row: Row, scene: Scene, at: float, declared: float, why: str) -> str:
    """Note when the agent was told that its action has failed. Returns by which words."""
    failed = scene.said("goto failed: ", at)
    row.figure("the agent is notified", None if failed is None else failed - at, declared, why)
    words = [line.partition("goto failed: ")[2] for _, line in scene.thinker.lines if "goto failed: " in line]
    return words[0] if words else ""


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
