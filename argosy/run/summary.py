"""The summary of a run, and its report."""

from __future__ import annotations

import subprocess
from pathlib import Path

from argosy.fleet_model.actions import ActionSeen
from argosy.fleet_model.members import FleetRobot
from argosy.processes.process_table import python_command
from argosy.processes.resource_usage import MEGABYTE, Window
from argosy.run.armed_warnings import in_the_air
from argosy.run.end_conditions import Ending
from argosy.run.run_status import Status
from commd.process.process import EXIT_DONE
from commd.process.state_dir import write_output
from schemas.humanize import columns, count, shortened

TOGETHER = "commd + bridged + agentd together:"
MOST_ACTIONS = 40
"""Actions that are listed, the last ones; a robot that is steered by velocities has hundreds."""
Row = tuple[str, str, str, str]
MOST = 10
"""Journal entries that are repeated."""
MOST_LINES = 5
"""Last lines of each dead process."""
FIGURE = "track.svg"
PLOT_PATIENCE = 120.0
"""Wall seconds that the figure may take."""


def summary(status: Status, ending: Ending, phases: list[tuple[str, float]]) -> str:
    """Return the summary as text; `phases` are the stretches besides the actions, in mission seconds."""
    lines = [f"{status.setup.mission.name}: {ending.text}", ""]
    lines += _times(status, phases)
    lines += last_words(status, ending) if ending.code != EXIT_DONE else []
    for robot in status.robots.values():
        lines.append(_field(robot.name, _left(status, robot)))
    if status.recorded:
        lines.append(_field("recording", status.recorded))
    if status.restarts:
        lines.append(_field("restarts", ", ".join(f"{name} {count}" for name, count in status.restarts.items())))
    lines += _daemons(status)
    if flying := in_the_air(status):
        lines += ["", *flying]
    return "\n".join(lines) + "\n"


def _times(status: Status, phases: list[tuple[str, float]]) -> list[str]:
    speed = status.setup.speed
    first, *rest = phases
    rows = [_row(first[0], "", first[1], speed)]
    actions, now = list(status.model.actions.by_id.values()), status.model.now()
    rows += [_action(action, status.mission_seconds(action.age(now)), speed) for action in actions[-MOST_ACTIONS:]]
    rows += [_row(name, "", seconds, speed) for name, seconds in rest]
    table = [("", "mission", "wall", ""), *((name, mission, wall, state) for name, state, mission, wall in rows)]
    lines = [f"  {line}" for line in columns(table, right=(1, 2))]
    forgotten = status.model.actions.forgotten + len(actions[:-MOST_ACTIONS])
    return [*lines, *([f"  and {forgotten} earlier actions"] if forgotten else []), ""]


def _row(name: str, state: str, seconds: float, speed: float) -> Row:
    return name, state, f"{seconds:.1f} s", f"{seconds / speed:.1f} s"


def _action(action: ActionSeen, seconds: float, speed: float) -> Row:
    reason = f": {action.reason}" if action.reason and action.state != "succeeded" else ""
    state = f"{action.state}{reason}" if action.ended is not None else f"{action.state}, without an outcome"
    name = f"{action.agent}  {action.text}"
    return _row(shortened(name, 60), state, seconds, speed)


def _left(status: Status, robot: FleetRobot) -> str:
    """Return how a vehicle was left."""
    seen = robot.seen
    if not seen.mode:
        bad = 0 if robot.health is None else robot.health.bad_input
        unheard = f"heard, but nothing of it became a belief: {count(bad, 'bad input')}" if bad else "never heard"
        return ", ".join(seen.reported.values()) or unheard
    old = f"{status.mission_seconds(robot.age(status.model.now()) or 0.0):.0f} s ago: "
    marked = f"LOST, last heard {old}" if seen.lost else old if robot.name in status.frozen else ""
    parts = [seen.mode, "armed" if seen.armed else "disarmed"]
    if seen.altitude is not None:
        parts.append(f"{seen.altitude + 0.0:.1f} m above home")
    left = marked + ", ".join(parts)
    if (highest := seen.track.highest()) is not None:
        left += f"; flew {seen.track.length():.0f} m, {highest:.1f} m high at most"
    return left


def _daemons(status: Status) -> list[str]:
    model, meter = status.model, status.meter
    counts, members = model.counts, (model.agents, model.robots, model.boards, model.clients)
    health = [one.health for kind in members for one in kind.values() if one.health is not None]
    mail = sum(int(one.counters.get("mail_received", 0)) for one in health)
    drops, bad = sum(one.drops for one in health), sum(one.bad_input for one in health)
    heard = f"{counts['percepts']} percepts, {counts['statuses']} statuses, {mail} messages"
    lines = [_field("bus", f"{heard}; {drops} dropped, {bad} bad inputs"), "", f"  {TOGETHER}"]
    if samples := meter.flight_memory:
        most, mean = max(samples) / MEGABYTE, sum(samples) / len(samples) / MEGABYTE
        lines.append(_field("memory", f"{most:.1f} MB at most, {mean:.1f} MB mean in flight (PSS)"))
    lines.append(_field("processor", f"{_share(meter.flight)} in flight"))
    if meter.idle.share is None:
        lines.append(_field("idle", "not measured: only after a mission that is done, with every vehicle disarmed"))
    else:
        window = f"for {meter.idle.wall:.1f} s after the end, at speed {status.setup.speed:g}"
        lines.append(_field("idle", f"{_share(meter.idle)} {window}"))
    return lines


def _share(window: Window) -> str:
    return "not measured" if window.share is None else f"{window.share * 100:.2f} % of a core"


def _field(name: str, text: str) -> str:
    return f"  {name:<10} {text}"


def last_words(status: Status, ending: Ending) -> list[str]:
    """Return the last warnings and errors of a run and the last lines of dead processes, nothing twice."""
    warnings: dict[tuple[str, str], str] = {}
    for entry in status.journal.entries:
        if entry.level in ("warning", "error") and entry.text not in ending.text:
            warnings.pop((entry.who, entry.text), None)  # keep the last place of repeated entries
            warnings[entry.who, entry.text] = str(entry)
    lines = ["  last warnings", *(f"  {text}" for text in list(warnings.values())[-MOST:])] if warnings else []
    for child in status.children:
        if not child.dead:
            continue
        texts = [f"[{line.agent}] {line.text}" if line.agent else line.text for line in child.lines]
        new = [text for text in texts if text not in ending.text and (child.name, text) not in warnings][-MOST_LINES:]
        lines += [f"  last lines of {child.name}", *(f"    {text}" for text in new)] if new else []
    return [*lines, ""] if lines else []


def write_report(folder: Path, recording: Path | None, text: str) -> str:
    """Write `summary.txt`, and `track.svg` as `argosy plot` draws it. Returns why there is none. Raises OSError."""
    write_output(folder / "summary.txt", text.encode())
    (folder / FIGURE).unlink(missing_ok=True)
    if recording is None or not recording.exists():
        return "there is no recording"
    command = [*python_command(), "argosy", "plot", str(recording), "--out", str(folder / FIGURE)]
    try:
        plotted = subprocess.run(command, capture_output=True, text=True, timeout=PLOT_PATIENCE, check=False)
    except subprocess.TimeoutExpired:
        return f"it was not drawn within {PLOT_PATIENCE:g} s"
    return plotted.stderr.strip().removeprefix("error: ") if plotted.returncode else ""
