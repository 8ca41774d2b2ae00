"""What becomes of a vehicle whose bridge, router or whole board fails."""

from __future__ import annotations

import signal
import time
from pathlib import Path

from schemas.liveness import BRIDGE_GRACE, BUS_GRACE
from tests.field.agents import LEASE, WATCHDOG, safe
from tests.field.flight import Flight
from tests.field.rows import EARLY, MARGIN, Maker, Row
from tests.field.scene import Scene

FAILSAFE = 5.0, "the vehicle's own: `FS_GCS_TIMEOUT` after our last heartbeat"
ROUTER_GONE = BUS_GRACE, "`bus_grace` without a router"
ROUTER_STOPPED = LEASE + BUS_GRACE, "2 s until the router is missed, and `bus_grace`"
_BACK = 30.0


def bridge_killed(folder: Path) -> Row:
    """bridged is killed, and nobody starts it again."""
    row = Row("bridged, killed", "SIGKILL; nobody starts it again; `failsafe: {gcs: bridge}`")
    with Scene(folder, failsafe=True, restart=False) as scene:
        at = scene.daemons["bridged"].signal(signal.SIGKILL)
        row.figure("rtl", scene.until_shown("RTL", at), *FAILSAFE)
        told(row, scene, at, BRIDGE_GRACE, "0.3 s without its token")
    return row


def bridge_killed_and_restarted(folder: Path) -> Row:
    """bridged is killed, and started again by its unit."""
    row = Row("bridged, killed", "SIGKILL; `Restart=on-failure`; `failsafe: {gcs: bridge}`")
    with Scene(folder, failsafe=True) as scene:
        at = scene.daemons["bridged"].signal(signal.SIGKILL)
        told(row, scene, at, BRIDGE_GRACE, "0.3 s without its token")
        bridge_back(row, scene, at)
        time.sleep(8)
        goes_on(row, scene, at)
    return row


def bridge_stopped(folder: Path) -> Row:
    """bridged is stopped; its watchdog ends it."""
    row = Row("bridged, stopped", "SIGSTOP; `WatchdogSec=10`, `Restart=on-failure`; `failsafe: {gcs: bridge}`")
    with Scene(folder, failsafe=True) as scene:
        at = scene.daemons["bridged"].signal(signal.SIGSTOP)
        told(row, scene, at, LEASE + BRIDGE_GRACE, "2 s until the router misses it, 0.3 s of grace")
        row.figure("rtl", scene.until_shown("RTL", at), *FAILSAFE)
        ended_by_watchdog(row, scene, "bridged", at)
        bridge_back(row, scene, at)
    return row


def bridge_told_to_end(folder: Path) -> Row:
    """bridged is told to end, as by `systemctl stop`."""
    row = Row("bridged, told to end", "SIGTERM; `on_shutdown: rtl`")
    with Scene(folder) as scene:
        at = scene.daemons["bridged"].signal(signal.SIGTERM)
        row.figure("rtl", scene.until_shown("RTL", at), 0.0, "`on_shutdown`, at once")
        told(row, scene, at, 0.0, "at once")
        ended = scene.daemons["bridged"].happened.ended
        scene.until(lambda: bool(ended), "the bridge has ended", 30)
        row.expect(ended[0][1] == 0, f"exit code 0, got {ended[0][1]}")
        row.seen += [line.partition("bridged ")[2] for _, line in scene.daemons["bridged"].lines if "leaving" in line]
    return row


def router_killed_and_restarted(folder: Path) -> Row:
    """commd is killed, and started again by its unit."""
    row = Row("commd, killed", "SIGKILL; `Restart=on-failure`")
    with Scene(folder) as scene:
        at = scene.daemons["commd"].signal(signal.SIGKILL)
        ready = scene.daemons["commd"].happened.ready
        scene.until(lambda: len(ready) > 1, "commd is ready again", _BACK)
        row.figure("ready again", ready[1] - at)
        time.sleep(ROUTER_STOPPED[0] + 3)
        row.expect(not scene.shown(at), f"the flight goes on, shown: {scene.shown(at)}")
        row.expect(scene.said("goto failed", at) is None, "the action goes on")
        row.seen.append("no mode changes, the action goes on")
    return row


def router_killed(folder: Path) -> Row:
    """commd is killed, and nobody starts it again."""
    row = Row("commd, killed", "SIGKILL; nobody starts it again")
    with Scene(folder, restart=False) as scene:
        at = scene.daemons["commd"].signal(signal.SIGKILL)
        safe(row, scene, at, *ROUTER_GONE)
    return row


def router_stopped(folder: Path) -> Row:
    """commd is stopped; its watchdog ends it."""
    row = Row("commd, stopped", "SIGSTOP; `WatchdogSec=10`, `Restart=on-failure`")
    with Scene(folder) as scene:
        at = scene.daemons["commd"].signal(signal.SIGSTOP)
        row.figure("hold", scene.until_shown("BRAKE", at), *ROUTER_STOPPED)
        ended_by_watchdog(row, scene, "commd", at)
        ready = scene.daemons["commd"].happened.ready
        scene.until(lambda: len(ready) > 1, "commd is ready again", _BACK)
        row.figure("ready again", ready[1] - at)
        scene.until(lambda: scene.said("bridge up", at) is not None, "the agent perceives again", _BACK)
        back = scene.said("bridge up", at)
        row.figure("the agent perceives again", None if back is None else back - at)
    return row


def board_killed(folder: Path) -> Row:
    """The one process of a board is killed, and started again by its unit."""
    row = Row("argosy board, killed", "SIGKILL; `Restart=on-failure`; `failsafe: {gcs: bridge}`")
    with Scene(folder, one_process=True, failsafe=True) as scene:
        at = scene.thinker.signal(signal.SIGKILL)
        ready = scene.thinker.happened.ready
        scene.until(lambda: len(ready) > 1, "the board is ready again", _BACK)
        row.figure("ready again", ready[1] - at)
        scene.until(lambda: scene.said("goes on", at) is not None, "the program goes on", _BACK)
        on = scene.said("goes on", at)
        row.figure("flown by its program again", None if on is None else on - at)
        goes_on(row, scene, at)
    return row


def board_hung(folder: Path) -> Row:
    """A Python function hangs in the one process of a board: agent and bridge hang together."""
    row = Row(
        "argosy board, hung in a Python function",
        "`WatchdogSec=10`, `Restart=on-failure`; `failsafe: {gcs: bridge}`",
    )
    with Scene(folder, one_process=True, failsafe=True) as scene:
        at = scene.hang()
        row.figure("rtl", scene.until_shown("RTL", at), *FAILSAFE)
        ended_by_watchdog(row, scene, "board", at)
        ready = scene.thinker.happened.ready
        scene.until(lambda: len(ready) > 1, "the board is ready again", _BACK)
        row.figure("ready again", ready[1] - at)
        row.figure("flown by its program again", scene.until_shown("GUIDED", at, _BACK))
    return row


def told(row: Row, scene: Scene, at: float, declared: float, why: str) -> None:
    """Note when the agent's action has failed, and by which words."""
    scene.until(lambda: scene.said("goto failed: ", at) is not None, "the agent is told", 30)
    failed = scene.said("goto failed: ", at)
    row.figure("the agent is told", None if failed is None else failed - at, declared, why)
    words = [line.partition("goto failed: ")[2] for _, line in scene.thinker.lines if "goto failed: " in line]
    row.seen.append(f"the action fails: `{words[0]}`")


def goes_on(row: Row, scene: Flight, at: float) -> None:
    """Note whether our heartbeats were back before the vehicle's own failsafe has acted: that depends on the start."""
    if (home := scene.shows("RTL", at)) is not None:
        row.expect(home >= FAILSAFE[0] - EARLY, f"no failsafe before its time, rtl after {home:.1f} s")
        row.seen.append(f"the vehicle's failsafe was faster than the start: rtl after {home:.1f} s")
    else:
        row.seen.append("the vehicle goes on with what it was told: heartbeats are back before its failsafe acts")


def bridge_back(row: Row, scene: Scene, at: float) -> None:
    """Note when the bridge serves again."""
    ready = scene.daemons["bridged"].happened.ready
    scene.until(lambda: len(ready) > 1, "the bridge is ready again", _BACK)
    row.figure("ready again", ready[1] - at)


def ended_by_watchdog(row: Row, scene: Scene, daemon: str, at: float) -> None:
    """Note when the watchdog has found a daemon hung."""
    happened = scene.daemons[daemon].happened
    scene.until(lambda: bool(happened.watchdog), "the watchdog finds it hung", 30)
    row.figure("ended by its watchdog", happened.watchdog[0] - at)
    within = happened.watchdog[0] - at <= WATCHDOG + MARGIN
    row.expect(within, f"the watchdog finds it within {WATCHDOG:g} s")


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
