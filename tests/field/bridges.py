"""What becomes of a vehicle whose bridge, router or whole board fails."""

import signal
import time

from schemas.liveness import BRIDGE_GRACE, BUS_GRACE
from tests.field.agents import LEASE, ended_by_watchdog, failure, ready_again, safe
from tests.field.flight import Flight
from tests.field.rows import EARLY, Maker, Row
from tests.field.scene import Scene, flown

FAILSAFE = 5.0, "the vehicle's own: `FS_GCS_TIMEOUT` after our last heartbeat"
ROUTER_GONE = BUS_GRACE, "`bus_grace` without a router"
ROUTER_STOPPED = LEASE + BUS_GRACE, "2 s until the router is missed, and `bus_grace`"
_BACK = 30.0


@flown("bridged, killed", "SIGKILL; nobody starts it again; `failsafe: {gcs: bridge}`", failsafe=True, restart=False)
def bridge_killed(row: Row, scene: Scene) -> None:
    """bridged is killed, and nobody starts it again."""
    at = scene.daemons["bridged"].signal(signal.SIGKILL)
    row.figure("rtl", scene.until_shown("RTL", at), *FAILSAFE)
    told(row, scene, at, BRIDGE_GRACE, "0.3 s without its token")


@flown("bridged, killed", "SIGKILL; `Restart=on-failure`; `failsafe: {gcs: bridge}`", failsafe=True)
def bridge_killed_and_restarted(row: Row, scene: Scene) -> None:
    """bridged is killed, and started again by its unit."""
    at = scene.daemons["bridged"].signal(signal.SIGKILL)
    told(row, scene, at, BRIDGE_GRACE, "0.3 s without its token")
    ready_again(row, scene, "bridged", at)
    time.sleep(8)
    goes_on(row, scene, at)


@flown("bridged, stopped", "SIGSTOP; `WatchdogSec=10`, `Restart=on-failure`; `failsafe: {gcs: bridge}`", failsafe=True)
def bridge_stopped(row: Row, scene: Scene) -> None:
    """bridged is stopped; its watchdog ends it."""
    at = scene.daemons["bridged"].signal(signal.SIGSTOP)
    told(row, scene, at, LEASE + BRIDGE_GRACE, "2 s until the router misses it, 0.3 s of grace")
    row.figure("rtl", scene.until_shown("RTL", at), *FAILSAFE)
    ended_by_watchdog(row, scene, "bridged", at)
    ready_again(row, scene, "bridged", at)


@flown("bridged, terminated", "SIGTERM; `on_shutdown: rtl`")
def bridge_told_to_end(row: Row, scene: Scene) -> None:
    """bridged is told to end, as by `systemctl stop`."""
    at = scene.daemons["bridged"].signal(signal.SIGTERM)
    row.figure("rtl", scene.until_shown("RTL", at), 0.0, "`on_shutdown`, immediately")
    told(row, scene, at, 0.0, "at once")
    ended = scene.daemons["bridged"].happened.ended
    scene.until(lambda: bool(ended), "the bridge has ended", 30)
    row.expect(ended[0][1] == 0, f"exit code 0, got {ended[0][1]}")
    row.seen += [line.partition("bridged ")[2] for _, line in scene.daemons["bridged"].lines if "leaving" in line]


@flown("commd, killed", "SIGKILL; `Restart=on-failure`")
def router_killed_and_restarted(row: Row, scene: Scene) -> None:
    """commd is killed, and started again by its unit."""
    at = scene.daemons["commd"].signal(signal.SIGKILL)
    ready_again(row, scene, "commd", at)
    time.sleep(ROUTER_STOPPED[0] + 3)
    row.expect(not scene.shown(at), f"the flight goes on, shown: {scene.shown(at)}")
    row.expect(scene.said("goto failed", at) is None, "the action goes on")
    row.seen.append("no mode changes, the action goes on")


@flown("commd, killed", "SIGKILL; nobody starts it again", restart=False)
def router_killed(row: Row, scene: Scene) -> None:
    """commd is killed, and nobody starts it again."""
    at = scene.daemons["commd"].signal(signal.SIGKILL)
    safe(row, scene, at, *ROUTER_GONE)


@flown("commd, stopped", "SIGSTOP; `WatchdogSec=10`, `Restart=on-failure`")
def router_stopped(row: Row, scene: Scene) -> None:
    """commd is stopped; its watchdog ends it."""
    at = scene.daemons["commd"].signal(signal.SIGSTOP)
    row.figure("hold", scene.until_shown("BRAKE", at), *ROUTER_STOPPED)
    ended_by_watchdog(row, scene, "commd", at)
    ready_again(row, scene, "commd", at)
    scene.until(lambda: scene.said("bridge up", at) is not None, "the agent perceives again", _BACK)
    back = scene.said("bridge up", at)
    row.figure("the agent perceives again", None if back is None else back - at)


@flown(
    "argosy board, killed", "SIGKILL; `Restart=on-failure`; `failsafe: {gcs: bridge}`", one_process=True, failsafe=True
)
def board_killed(row: Row, scene: Scene) -> None:
    """The one process of a board is killed, and started again by its unit."""
    at = scene.thinker.signal(signal.SIGKILL)
    ready_again(row, scene, "board", at)
    scene.until(lambda: scene.said("goes on", at) is not None, "the program goes on", _BACK)
    on = scene.said("goes on", at)
    row.figure("flown by its program again", None if on is None else on - at)
    goes_on(row, scene, at)


@flown(
    "argosy board, hung in a Python function",
    "`WatchdogSec=10`, `Restart=on-failure`; `failsafe: {gcs: bridge}`",
    one_process=True,
    failsafe=True,
)
def board_hung(row: Row, scene: Scene) -> None:
    """A Python function hangs in the one process of a board: agent and bridge hang together."""
    at = scene.hang()
    row.figure("rtl", scene.until_shown("RTL", at), *FAILSAFE)
    ended_by_watchdog(row, scene, "board", at)
    ready_again(row, scene, "board", at)
    row.figure("flown by its program again", scene.until_shown("GUIDED", at, _BACK))


def told(row: Row, scene: Scene, at: float, declared: float, why: str) -> None:
    """Note when the agent's action has failed, and by which words."""
    scene.until(lambda: scene.said("goto failed: ", at) is not None, "the agent is notified", 30)
    row.seen.append(f"the action fails: `{failure(row, scene, at, declared, why)}`")


def goes_on(row: Row, scene: Flight, at: float) -> None:
    """Note whether our heartbeats were back before the vehicle's own failsafe has acted: that depends on the start."""
    if (home := scene.shows("RTL", at)) is not None:
        row.expect(home >= FAILSAFE[0] - EARLY, f"no failsafe before its time, rtl after {home:.1f} s")
        row.seen.append(f"the vehicle's failsafe was faster than the start: rtl after {home:.1f} s")
    else:
        row.seen.append("the vehicle continues its last command: heartbeats are back before its failsafe acts")


BRIDGES: tuple[Maker, ...] = (
    bridge_told_to_end,
    bridge_killed,
    bridge_killed_and_restarted,
    bridge_stopped,
    router_killed_and_restarted,
    router_killed,
    router_stopped,
    board_killed,
    board_hung,
)
