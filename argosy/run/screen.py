"""The live view of a run on one screen, for a terminal of 80 x 24 and larger."""

from __future__ import annotations

from contextlib import suppress

from rich.console import Console, ConsoleOptions, RenderResult
from rich.live import Live
from rich.rule import Rule
from rich.segment import Segment
from rich.table import Table
from rich.text import Text

from argosy.cli.journal import Entry, Level
from argosy.fleet_model.actions import ActionSeen
from argosy.fleet_model.members import FleetAgent, FleetRobot
from argosy.fleet_model.robots import Track
from argosy.processes.resource_usage import MEGABYTE
from argosy.run.armed_warnings import age
from argosy.run.run_status import Status
from argosy.why.wording import awaited
from schemas.geo import distance
from schemas.humanize import count, printable

STYLES: dict[Level, str] = {
    "info": "",
    "print": "cyan",
    "action": "blue",
    "good": "green",
    "warning": "yellow",
    "error": "bold red",
    "output": "dim",
    "detail": "dim",
}
AIRY = 30
"""Lines of a terminal from which on blank lines separate the sections."""
_BARS = "▁▂▃▄▅▆▇█"
_AROUND = 10
"""Columns for margins, the mark of an action and the ellipsis."""


class LiveView:
    """Shows the run on the terminal's alternate screen, so that the former content returns at the end."""

    def __init__(self, status: Status, console: Console) -> None:
        self._screen = Screen(status)
        self._live = Live(self._screen, console=console, screen=True, auto_refresh=False)

    def __enter__(self) -> LiveView:
        self._live.start(refresh=True)
        return self

    def __exit__(self, *_: object) -> None:
        with suppress(OSError):
            self._live.stop()

    def show(self, entry: Entry) -> None:
        """Entries appear with the next refresh."""

    def refresh(self) -> None:
        """Draw the present state. A lost terminal must not end the run."""
        with suppress(OSError):
            self._live.refresh()


class Screen:
    """The whole screen: vehicles, agents and processes, then as much of the journal as fits."""

    def __init__(self, status: Status) -> None:
        self.status = status

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        width, height = options.max_width, options.height or console.height
        options = options.update(height=None)
        agents = (self._agent(agent, width) for agent in self.status.agents.values())
        sections: list[tuple[str, list[Table | Text]]] = [
            ("vehicle", self._vehicles(width)),
            ("agent", [*agents, *self._done()]),
            ("processes", self._processes()),
        ]
        lines = [line for part in self._head() for line in console.render_lines(part, options, pad=False)]
        airy = height >= AIRY
        for title, parts in sections:
            lines += [[]] if airy else []
            for part in (_title(title), *parts):
                lines += console.render_lines(part, options, pad=False)
        lines += [[]] if airy else []
        if (room := height - len(lines) - 2) > 0:
            lines += console.render_lines(_title("what happened"), options, pad=False)
            for entry in list(self.status.journal.entries)[-room:]:
                lines += console.render_lines(_line(entry), options, pad=False)
        for line in lines[: height - 1]:
            yield from line
            yield Segment.line()

    def _head(self) -> list[Table | Rule]:
        status = self.status
        mission, speed = status.setup.mission, status.setup.speed
        now = status.now()
        left = Text.assemble(" ", (mission.name, "bold"), "   ", _phase(status))
        right = Text(f"{now:.0f} s of mission, {now / speed:.0f} s here, x{speed:g}{_timeout(status)} ", style="dim")
        row = Table.grid(expand=True)
        row.add_column(no_wrap=True, overflow="ellipsis", ratio=1)
        row.add_column(no_wrap=True, justify="right")
        row.add_row(left, right)
        return [row, Rule(style="dim", characters="─")]

    def _vehicles(self, width: int) -> list[Table | Text]:
        status = self.status
        now, robots = status.model.now(), status.robots.values()
        table = Table.grid(padding=(0, 2), pad_edge=True)
        others = [robot for robot in robots if robot.seen.reported and not robot.seen.mode]
        for robot in robots:
            if robot not in others:
                silent = status.mission_seconds(now - robot.seen.heard)
                table.add_row(*_robot(robot, width, silent, age(status, robot)))
        return [*([table] if table.row_count else []), *map(_no_vehicle, others)]

    def _agent(self, agent: FleetAgent, width: int) -> Table:
        status, model = self.status, self.status.model
        table = Table.grid(padding=(0, 2), pad_edge=True)
        table.add_column(no_wrap=True, style="bold")
        table.add_column(no_wrap=True, overflow="ellipsis", ratio=1)
        table.expand = True
        name = agent.name
        actions = model.actions.open(agent.name)
        for intention in () if agent.mind is None else agent.mind.intentions:
            stack = printable(" ‹ ".join(intention.stack)) or f"intention {intention.id}"
            waits = awaited(intention.waits_for, " for ")
            why = "" if actions or intention.state == "running" else f"  {intention.state}{waits}"
            place = intention.at.rpartition("/")[2]
            table.add_row(name, Text.assemble(stack, (printable(f"  {place}{why}"), "dim")))
            name = ""
        if name:
            up = agent.name in model.holders("agentd")
            table.add_row(name, Text("no intentions" if up else "not there yet", style="dim"))
        for action in actions:
            age = f"  {action.state} {status.mission_seconds(action.age(model.now())):.0f} s  "
            feedback = _feedback(action, width - len(agent.name) - len(action.text) - len(age) - _AROUND)
            text = Text.assemble(("▸ ", "blue"), (printable(action.text), "blue"), age, (printable(feedback), "dim"))
            table.add_row("", text)
        for line in agent.prints:
            table.add_row("", Text(f"“{printable(line)}”", style="cyan"))
        return table

    def _done(self) -> list[Text]:
        wanted = self.status.setup.mission.done
        if not wanted:
            return []
        minds = [self.status.model.agents[one.agent].mind for one in wanted]
        held = [mind is not None and mind.done.get(one.formula, False) for one, mind in zip(wanted, minds, strict=True)]
        text = Text.assemble(" ", ("done when  ", "dim"))
        for one, holds in zip(wanted, held, strict=True):
            text.append("● " if holds else "○ ", style="green" if holds else "dim")
            text.append(f"{one.agent}: {one.formula}   ", style="green" if holds else "")
        text.append(f"{sum(held)} of {len(held)}", style="dim")
        text.truncate(1000)
        return [text]

    def _processes(self) -> list[Table | Text]:
        table = Table.grid(padding=(0, 2), pad_edge=True)
        for _ in range(2):
            table.add_column(no_wrap=True)
        for _ in range(2):
            table.add_column(no_wrap=True, justify="right")
        table.add_column(no_wrap=True, overflow="ellipsis")
        for child in self.status.children:
            usage = self.status.meter.usage.get(child.pid)
            if child.replaced:
                state, text = ("○", "yellow"), "died, is started again"
            elif not child.alive:
                state, text = (
                    ("●", "red") if child.dead else ("●", "dim"),
                    child.how_it_ended() if child.dead else "left",
                )
            elif self.status.serves(child):
                state, text = ("●", "green"), self._health(child.process.kind.name, child.process.subject)
            else:
                state, text = ("○", "yellow"), "coming up"
            number = self.status.restarts[child.name]
            restarted = f"restarted {count(number, 'time')}" if number else ""
            table.add_row(
                Text.assemble(state, " ", child.name),
                Text(f"pid {child.pid}", style="dim"),
                f"{usage.cpu * 100:.1f} %" if usage and child.alive else "",
                f"{usage.memory / MEGABYTE:.1f} MB" if usage and child.alive else "",
                Text(printable(", ".join(filter(None, (text, restarted)))), style="dim"),
            )
        return [table]

    def _health(self, daemon: str, subject: str) -> str:
        reports = [self.status.model.health_of(name, daemon) for name in subject.split()]
        drops = sum(health.drops for health in reports if health)
        bad = sum(health.bad_input for health in reports if health)
        counted = [f"{drops} dropped"] if drops else []
        counted += [f"{bad} bad inputs"] if bad else []
        return ", ".join(counted)


def _phase(status: Status) -> Text:
    if status.waiting_for and status.phase == "starting":
        return Text(printable(f"waiting for {status.waiting_for}"), style="yellow")
    orders = dict.fromkeys(robot.seen.operator for robot in status.robots.values() if robot.seen.operator)
    if status.phase == "running" and orders:
        return Text(f"stopped by the operator ({', '.join(orders)})", style="bold yellow")
    if status.phase == "running" and (paused := status.paused()):
        return Text(f"paused ({', '.join(paused)})", style="bold yellow")
    style = {"running": "green", "done": "bold green", "failed": "bold red"}.get(status.phase, "yellow")
    waits = f", waiting for {status.waiting_for}" if status.waiting_for else ""
    return Text(status.phase.replace("_", " ") + waits, style=style)


def _timeout(status: Status) -> str:
    """Return how much mission time is left, in seconds only when that is little."""
    if status.timeout_at is None or status.phase != "running":
        return ""
    left = max(0.0, status.timeout_at - status.now())
    return f", timeout in {left / 60:.0f} min" if left >= 120 else f", timeout in {left:.0f} s"


def _robot(member: FleetRobot, width: int, silent: float, old: float) -> list[Text]:
    """Return the cells of a vehicle's row; `silent` and `old` are mission seconds, `old` is 0 for what is fresh."""
    robot = member.seen
    if not robot.mode:
        return [Text(robot.name, style="bold"), Text("not heard yet", style="yellow")]
    if robot.lost:
        line = Text(printable(f"LOST, last heard {silent:.0f} s ago: {robot.last_known()}"), style="bold red")
        return [Text(robot.name, style="bold"), line]
    cells = [
        Text.assemble((robot.name, "bold"), (f" {old:.0f} s ago:", "bold red") if old else ""),
        Text(printable(robot.mode), style="magenta"),
        Text("armed", style="green") if robot.armed else Text("disarmed", style="dim"),
    ]
    if robot.paused:
        cells.append(Text("PAUSED", style="bold yellow"))
    if robot.altitude is not None:
        height = Text(f"{robot.altitude + 0.0:5.1f} m up", style="bold")
        cells.append(height.append(f" {_spark(robot.track, 16):16}", style="blue") if width >= 100 else height)
    if robot.position is not None:
        if robot.home is not None:
            cells.append(Text(f"{distance(robot.position, robot.home):4.0f} m off home"))
        cells.append(Text(f"{robot.position[0]:.6f} {robot.position[1]:.6f}", style="dim"))
    if robot.battery is not None and width >= 90:
        cells.append(Text(f"{robot.battery:.0f} %", style="dim"))
    return cells


def _no_vehicle(robot: FleetRobot) -> Text:
    """Return the line of a robot that is not a vehicle: its percepts."""
    percepts = printable("  ".join(robot.seen.reported.values()))
    return Text.assemble(" ", (robot.name, "bold"), "  ", (percepts, "dim"), no_wrap=True, overflow="ellipsis")


def _feedback(action: ActionSeen, room: int) -> str:
    """Return as many whole figures of an action as fit into `room` columns."""
    figures = ""
    for key, value in action.feedback.items():
        more = f"{figures}  {key} {value:.1f}".strip()
        if len(more) > room:
            return f"{figures} …".strip()
        figures = more
    return figures


def _spark(track: Track, width: int) -> str:
    """Return the altitude of the last minute or so as a line of bars."""
    heights = [altitude for _, altitude in track.heights[-width * 20 :: 20]]
    top = max([*heights, 1.0])
    return "".join(_BARS[max(0, min(7, round(height / top * 7)))] for height in heights)


def _line(entry: Entry) -> Text:
    parts = (f" {entry.at:7.1f}  ", "dim"), (f"{entry.who}  ", "dim bold"), (entry.text, STYLES[entry.level])
    return Text.assemble(*parts, no_wrap=True, overflow="ellipsis")


def _title(text: str) -> Text:
    return Text(f" {text.upper()}", style="dim bold")
