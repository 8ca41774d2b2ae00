"""`argosy plot`: a recording as a figure for a paper, or as tables."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path

from argosy.cli.errors import BadInput, CommandError
from argosy.plot.csv_tables import write_tables
from argosy.plot.data import Heard, Scene, SceneReader, part_of
from argosy.plot.figure import FORMATS, NOTHING, PANELS, Panel, has, write_plot
from argosy.plot.style import INCH, WIDTHS
from argosy.recording.metadata import SECOND
from argosy.recording.reader import Recording
from commd.process.command_line import finite_number
from commd.process.process import EXIT_DONE
from schemas.files.findings import Findings
from schemas.humanize import count
from schemas.mission.model import Mission, read_mission
from schemas.wire import keys
from schemas.wire.mind_records import MindActivity
from schemas.wire.records import ActionStatus, Perception

PROMPT = 0.5
"""Wall seconds within which a record counts as heard when it was stamped, by the clock of its sender."""
LEAST, MOST = 50.0, 600.0
"""Millimetres that a figure may be wide."""


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy plot`."""
    seconds = finite_number(lambda _: True, "a number of seconds")
    parser.add_argument("file", type=Path, help="recording (MCAP file)")
    parser.add_argument(
        "-o", "--out", type=Path, metavar="FILE", help="figure: .svg, .png or .pdf (default: the recording's name .svg)"
    )
    parser.add_argument(
        "--panels",
        type=_panels,
        metavar="LIST",
        help=f"panels, separated by commas (default: those of {','.join(PANELS)} that were recorded)",
    )
    parser.add_argument("--robot", action="append", default=[], metavar="R", help="only this robot (repeatable)")
    parser.add_argument("--from", dest="begin", type=seconds, metavar="S", help="begin at this mission second")
    parser.add_argument("--to", dest="end", type=seconds, metavar="S", help="end at this mission second")
    parser.add_argument(
        "--width",
        type=_width,
        default=WIDTHS["two"],
        metavar="W",
        help="`one` or `two` columns of a paper (88 and 181 mm), or millimetres (default: two)",
    )
    parser.add_argument("--fleet", metavar="NAME", help="fleet to plot, if several were recorded")
    parser.add_argument("--csv", type=Path, metavar="DIR", help="write tables there instead of a figure")


def _panels(text: str) -> list[Panel]:
    named = [name.strip() for name in text.split(",")]
    if not named or not set(named) <= set(PANELS):
        raise ValueError
    return [panel for panel in PANELS if panel in named]


_panels.__name__ = f"panels (of {', '.join(PANELS)})"


def _width(text: str) -> float:
    width = WIDTHS[text] if text in WIDTHS else float(text.removesuffix("mm"))
    if not LEAST <= width <= MOST:
        raise ValueError
    return width


_width.__name__ = f"width (one, two, or {LEAST:g} to {MOST:g} millimetres)"


def run(args: Namespace) -> int:
    """Plot a recording. Returns the exit code. Raises BadInput, and CommandError where there is nothing to plot."""
    if args.csv is None and args.out is not None and args.out.suffix not in FORMATS:
        raise BadInput(f"--out {args.out}: expected a name that ends in {', '.join(FORMATS)}")
    recording = Recording(args.file)
    if recording.missing:
        print(f"warning: {recording.missing}", file=sys.stderr)
    try:
        scene = part_of(read_scene(recording, args.fleet, args.robot), args.robot, args.begin, args.end)
        text = _tables(scene, args) if args.csv is not None else _figure(scene, args)
    except ValueError as error:
        raise BadInput(f"{args.file}: {error}") from None
    except OSError as error:
        raise CommandError(f"{error.filename or args.csv}: {error.strerror}") from None
    for note in scene.notes:
        print(f"note: {note}", file=sys.stderr)
    print(text)
    return EXIT_DONE


def read_scene(recording: Recording, fleet: str | None = None, wanted: Iterable[str] = ()) -> Scene:
    """Return the scene of one fleet in a recording.

    Raises ValueError if it is not clear of which, and before all is read if a `wanted` robot cannot be in it.
    """
    fleets = recording.fleets
    if fleet is not None and fleet not in fleets:
        raise ValueError(f"there is no fleet {fleet} in it; there are {', '.join(fleets) or 'none'}")
    if fleet is None and len(fleets) > 1:
        raise ValueError(f"it has several fleets, choose one with --fleet: {', '.join(fleets)}")
    whose = fleet or (fleets[0] if fleets else "*")
    title, robot_of, agents, mission = _team(recording, whose)
    robots = dict.fromkeys(robot_of.values())
    for name in wanted:
        if name not in robots:
            raise ValueError(f"--robot {name}: there is no such robot in it; there are {', '.join(robots) or 'none'}")
    unread: Counter[str] = Counter()
    speed = next((one.speed for _, one in recording.typed(MindActivity)), recording.facts.speed)
    reader = SceneReader(title, whose, robot_of, agents, mission=mission, speed=speed)
    scene = reader.read(_heard(recording, whose, speed, unread))
    for name, number in unread.items():
        scene.notes.append(f"{number} of its records {name} cannot be read: another version of Argosy wrote them")
    return scene


def _team(recording: Recording, fleet: str) -> tuple[str, dict[str, str], list[str], Mission | None]:
    """Return title, robots of agents, all agents and the mission. Without the mission each agent is its own robot."""
    facts = recording.facts
    if facts.mission_text:
        try:
            mission = read_mission(facts.mission_text, Path(facts.mission_file or "mission.yaml"))
        except Findings:
            pass  # of another version: the records are enough
        else:
            if mission.fleet == fleet:
                robots = {agent: robot for robot in mission.robots for agent in mission.agents_of(robot)}
                return mission.name, robots, list(mission.mailboxes), mission
    parsed = [keys.parse(topic.key) for topic in recording.topics if topic.record == Perception.__name__]
    seen = dict.fromkeys(one[1] for one in parsed if one is not None and one[0] == fleet and "percept" in one[2])
    return facts.mission or fleet, {name: name for name in seen}, [], None


def _heard(recording: Recording, fleet: str, speed: float, unread: Counter[str]) -> Iterator[Heard]:
    """Yield the records of a plot in order, with mission seconds since the beginning; count unreadable ones."""
    only = (f"{keys.ROOT}/{fleet}/**",)
    for message in recording.messages(only=only, records=(Perception, ActionStatus, MindActivity)):
        if (record := message.record) is None:
            unread[message.name] += 1
        else:
            late = (message.at - message.stamp) / SECOND  # answers to queries have older stamps
            yield Heard((message.seconds - (late if 0 < late < PROMPT else 0)) * speed, message.key, record)


def _figure(scene: Scene, args: Namespace) -> str:
    out = args.out if args.out is not None else args.file.with_suffix(".svg")
    there = [panel for panel in PANELS if has(scene, panel)]
    lacking = [panel for panel in args.panels or PANELS if panel not in there]
    if (args.panels and lacking) or not there:
        raise CommandError(f"{args.file}: it has {NOTHING[lacking[0]]}; {_counts(scene)}")
    unknown = [panel for panel in lacking if panel != "messages" or not scene.has_activity]
    scene.notes.extend(f"it has {NOTHING[panel]}" for panel in unknown)
    write_plot(scene, args.panels or there, args.width, out)
    return f"{out}: {_counts(scene)}, {scene.begin:.1f} s to {scene.end:.1f} s, {args.width / INCH:.2f} in wide"


def _tables(scene: Scene, args: Namespace) -> str:
    written = write_tables(scene, args.csv)
    if not written:
        raise CommandError(f"{args.file}: it has {NOTHING['track']}; {_counts(scene)}")
    return f"{args.csv}: {', '.join(written)}: {_counts(scene)}"


def _counts(scene: Scene) -> str:
    figures = ((len(scene.robots), "robot"), (len(scene.actions), "action"), (len(scene.messages), "message"))
    return ", ".join(count(number, noun) for number, noun in figures)
