"""What there is to say at the end of a run."""

from __future__ import annotations

from argosy.fleet_model.robots import ActionSeen, RobotSeen
from argosy.processes.resource_usage import MEGABYTE, Window
from argosy.run.armed_warnings import in_the_air
from argosy.run.end_conditions import Ending
from argosy.run.failure_summary import last_words
from argosy.run.run_status import Status
from commd.process.process import EXIT_DONE
from schemas.humanize import columns, shortened

TOGETHER = "commd + bridged + agentd together:"
MOST_ACTIONS = 40
"""Actions that are listed, the last ones; a robot that is steered by velocities has hundreds."""
Row = tuple[str, str, str, str]


def summary(status: Status, ending: Ending, phases: list[tuple[str, float]]) -> str:
    """Return the summary as text; `phases` are the stretches besides the actions, in mission seconds."""
    lines = [f"{status.setup.mission.name}: {ending.text}", ""]
    lines += _times(status, phases)
    lines += last_words(status, ending) if ending.code != EXIT_DONE else []
    for robot in status.picture.robots.values():
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
    actions = list(status.picture.actions.values())
    rows += [_action(action, status.now(), speed) for action in actions[-MOST_ACTIONS:]]
    rows += [_row(name, "", seconds, speed) for name, seconds in rest]
    table = [("", "mission", "wall", ""), *((name, mission, wall, state) for name, state, mission, wall in rows)]
    lines = [f"  {line}" for line in columns(table, right=(1, 2))]
    forgotten = status.picture.actions_forgotten + len(actions[:-MOST_ACTIONS])
    return [*lines, *([f"  and {forgotten} earlier actions"] if forgotten else []), ""]


def _row(name: str, state: str, seconds: float, speed: float) -> Row:
    return name, state, f"{seconds:.1f} s", f"{seconds / speed:.1f} s"


def _action(action: ActionSeen, now: float, speed: float) -> Row:
    reason = f": {action.reason}" if action.reason and action.state != "succeeded" else ""
    state = f"{action.state}{reason}" if action.ended is not None else f"{action.state}, without an outcome"
    name = f"{action.agent}  {action.text}"
    return _row(shortened(name, 60), state, action.age(now), speed)


def _left(status: Status, robot: RobotSeen) -> str:
    """Return how a vehicle was left."""
    if not robot.mode:
        return ", ".join(robot.told.values()) or "never heard"
    old = f"{status.now() - status.picture.heard_of(robot):.0f} s ago: "
    marked = f"LOST, last heard {old}" if robot.lost else old if robot.name in status.frozen else ""
    told = [robot.mode, "armed" if robot.armed else "disarmed"]
    if robot.altitude is not None:
        told.append(f"{robot.altitude + 0.0:.1f} m above home")
    left = marked + ", ".join(told)
    if (highest := robot.track.highest()) is not None:
        left += f"; flew {robot.track.length():.0f} m, {highest:.1f} m high at most"
    return left


def _daemons(status: Status) -> list[str]:
    counts, health, meter = status.picture.counts, status.picture.health.values(), status.meter
    mail = sum(int(one.counters.get("mail_received", 0)) for one in health)
    drops, bad = sum(one.drops for one in health), sum(one.bad_input for one in health)
    heard = f"{counts['percepts']} percepts, {counts['statuses']} statuses, {mail} letters"
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
