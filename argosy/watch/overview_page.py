"""The overview of a fleet: a row for each vehicle, agent and board."""

from __future__ import annotations

from collections.abc import Sequence

from rich.text import Text

from argosy.cli.remedies import level_of
from argosy.fleet_model.actions import ActionSeen
from argosy.fleet_model.activity import activity
from argosy.fleet_model.members import MOST, FleetAgent, FleetRobot, Member, notes_of
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.robots import RobotSeen
from argosy.watch.row_text import BAD, DIM, GOOD, WARN, Glyphs, Row, head, joined, place, rounded, safe_text, table
from argosy.why.wording import awaited
from schemas.geo import distance
from schemas.humanize import count, span
from schemas.liveness import LAG_LATE
from schemas.wire.mind_records import WaitView

MOST_NOTES = 4
"""Different notes of vehicles, of agents, of boards that are shown."""
LONGEST_NOTE = 300
"""Characters of a note."""
SOME = 4
"""Names that a note begins with."""
NARROW = 130
"""Columns below which a vehicle's place is left out."""


def overview(model: FleetModel, width: int, glyphs: Glyphs) -> list[Row]:
    """Return the rows of the whole fleet for a screen of `width` columns."""
    rows: list[Row] = []
    if model.robots:
        rows += [head("vehicles"), *_vehicles(model, width, glyphs)]
    if model.agents or model.clients:
        rows += [head("agents"), *_agents(model, width, glyphs)]
    if model.boards:
        rows += [head("boards"), *_boards(model, width, glyphs)]
    if model.roster.forgotten:
        forgotten = count(model.roster.forgotten, "member")
        text = f"{forgotten} forgotten: at most {MOST} of a kind are kept besides the mission's"
        rows.append(Row(Text(text, DIM)))
    return rows


def _vehicles(model: FleetModel, width: int, glyphs: Glyphs) -> list[Row]:
    robots = list(model.robots.values())
    rows = [[_mark(robot, glyphs), Text(robot.name, "bold"), *_robot(model, robot, width, glyphs)] for robot in robots]
    lines = table(rows, width - 1, flex=5, right=(4,))
    return [*(Row(line, f"robot {one.name}") for line, one in zip(lines, robots, strict=True)), *_notes(robots)]


def _robot(model: FleetModel, robot: FleetRobot, width: int, glyphs: Glyphs) -> list[Text]:
    """Return mode, arming, height and all else of a robot."""
    seen, now = robot.seen, model.as_of
    actions = [action for agent in robot.agents for action in model.actions.open(agent)]
    doing = joined(*(action_text(model, action, glyphs) for action in actions))
    if seen.reported and not seen.mode:
        return [Text(), Text(), Text(), joined(doing, ("  ".join(seen.reported.values()), DIM))]
    if not seen.mode:
        word = "its vehicle is not heard yet" if robot.there else _absent(model, robot)
        return [Text(), Text(), Text(), joined((word, WARN), doing)]
    old = robot.age(now) or 0.0
    why = joined(
        (f"LOST, last heard {span(old)} ago" if seen.lost else "", BAD),
        (f"as it was {span(old)} ago: {_absent(model, robot)}" if robot.stale(now) and not seen.lost else "", BAD),
        (f"operator: {seen.operator}" if seen.operator else "", WARN),
        ("PAUSED" if seen.paused else "", WARN),
        (f"taken over: {seen.override}" if seen.override else "", WARN),
        (f"held by {seen.holder}" if seen.holder else "", DIM),
    )
    style = DIM if robot.stale(now) else ""
    return [
        Text(seen.mode, style or "magenta"),
        Text("armed", style or GOOD) if seen.armed else Text("disarmed", DIM),
        Text("" if seen.altitude is None else f"{seen.altitude + 0.0:.1f} m", style),
        joined(why, *_figures(seen, style, width), doing),
    ]


def _figures(seen: RobotSeen, style: str, width: int) -> list[Text]:
    low = seen.battery is not None and seen.battery < 20
    found = [Text("" if seen.battery is None else f"{seen.battery:.0f} %", WARN if low else style)]
    if seen.position is not None and seen.home is not None:
        found.append(Text(f"{distance(seen.position, seen.home):.0f} m off", style))
    if width >= NARROW and seen.position is not None:
        found.append(Text(f"{seen.position[0]:.6f} {seen.position[1]:.6f}", DIM))
    return found


def action_text(model: FleetModel, action: ActionSeen, glyphs: Glyphs, state: str = "") -> Text:
    """Return a running action: its text and `state`, for how long it runs in mission seconds, and its figures."""
    now, figures = model.as_of, "  ".join(f"{name} {value:.1f}" for name, value in action.feedback.items())
    silent = action.silent(now)
    return joined(
        (f"{glyphs.runs} {rounded(action.text)}", "blue"),
        f"{state} {'> ' * action.joined}{span(action.age(now) * model.clock.speed)}".strip(),
        ("" if silent is None else f"not heard for {span(silent)}", BAD),
        (figures, DIM),
    )


def _agents(model: FleetModel, width: int, glyphs: Glyphs) -> list[Row]:
    agents = list(model.agents.values())
    rows = [_agent(model, agent, glyphs) for agent in agents]
    lines = table(rows, width - 1, flex=4, right=(3, 5, 6))
    found = [Row(line, f"agent {one.name}", found_by=one.robot) for line, one in zip(lines, agents, strict=True)]
    clients = (joined(_mark(one, glyphs), (one.name, "bold"), (one.daemon, DIM)) for one in model.clients.values())
    found += [Row(line, f"client {name}") for name, line in zip(model.clients, clients, strict=True)]
    return [*found, *_notes(agents)]


def _agent(model: FleetModel, agent: FleetAgent, glyphs: Glyphs) -> list[Text]:
    """Return mark, name, state, number of intentions, activity, lag and mail."""
    mind, now = agent.mind, model.now()
    lag = Text(f"lag {span(agent.lag)}" if agent.lag >= LAG_LATE else "", BAD)
    waiting = model.mail_for(agent.name) + (mind.mailbox if mind is not None else 0)
    mail = Text(f"mail {waiting}" if waiting else "", WARN if waiting > 10 else "")
    name = Text(agent.name, "bold")
    if not agent.there or mind is None:
        word = _absent(model, agent) if not agent.there else "its mind has not answered yet"
        if agent.silent is not None:
            word = f"its mind has not answered for {span(now - agent.silent)} {agent.why_silent}".strip()
        return [_mark(agent, glyphs), name, Text(), Text(), safe_text(word, DIM if agent.ended else WARN), lag, mail]
    now_does = activity(model, agent)
    state = Text(now_does.doing, {"paused": WARN, "waiting": "", "idle": ""}.get(now_does.doing, GOOD))
    intentions = len(mind.intentions) + mind.intentions_left_out
    does = _does(
        mind.intentions[0].stack if mind.intentions else (),
        mind.intentions[0].waits_for if mind.intentions else None,
        now_does.action,
    )
    if agent.silent is not None:
        does = joined((f"SILENT for {span(now - agent.silent)}; was:", BAD), does)
    elif agent.standing == "silent":
        does = joined(("no reports;", BAD), does)
    at = place(mind.intentions[0].at) if mind.intentions else ""
    return [
        _mark(agent, glyphs),
        name,
        state,
        Text(str(intentions), "" if intentions else DIM),
        joined(does, (at, DIM)),
        lag,
        mail,
    ]


def _does(stack: tuple[str, ...], waits_for: WaitView | None, action: str) -> Text:
    if not stack:
        return joined(rounded(action)) if action else Text("no intentions", DIM)
    waits = awaited(waits_for, "waits for ")
    return joined(rounded(stack[0]), (rounded(action) if action else waits, DIM))


def _boards(model: FleetModel, width: int, glyphs: Glyphs) -> list[Row]:
    boards = list(model.boards.values())
    rows: list[Row] = []
    for board in boards:
        waiting, boxes = board.waiting(), board.mailboxes
        dead = boxes.dead_count if boxes is not None else 0
        old = model.now() - board.heard if board.heard is not None else 0.0
        text = joined(
            joined(_mark(board, glyphs), (board.name, "bold"), gap="  "),
            ("" if board.there else _absent(model, board), WARN),
            ("no mail waits" if boxes is not None and not waiting else "", DIM),
            (f"{count(waiting, 'message')} waiting" if waiting else "", WARN if waiting > 100 else ""),
            (f"{count(dead, 'dead letter')}" if dead else "", WARN),
            (
                f"mail as it was {span(old)} ago: {board.problem}"
                if board.problem and boxes is not None
                else board.problem,
                BAD,
            ),
        )
        rows.append(Row(text, f"board {board.name}"))
    return [*rows, *_notes(boards)]


def _notes(members: Sequence[Member]) -> list[Row]:
    """Return the notes of some members, each note once with the names."""
    rows = []
    noted = notes_of(one for one in members if one.there)
    for note, names in sorted(noted.items(), key=lambda one: level_of(one[0])):  # errors first: the rest may be cut off
        text = joined(f"!  {_some(names)}: {note.text}"[:LONGEST_NOTE], gap="")
        text.stylize(BAD if level_of(note) == "error" else WARN)
        rows.append(Row(text, found_by=" ".join(names)))
    left_out = len(rows) - MOST_NOTES
    return [
        *rows[:MOST_NOTES],
        *([Row(Text(f"!  {left_out} more notes: argosy status", WARN))] if left_out > 0 else []),
    ]


def _some(names: Sequence[str]) -> str:
    return ", ".join(names) if len(names) <= SOME else f"{', '.join(names[:SOME])} and {len(names) - SOME} more"


def _mark(member: Member, glyphs: Glyphs) -> Text:
    if not member.there:
        return Text(glyphs.away, DIM if member.ended else BAD)
    return Text(glyphs.well, GOOD if member.well else BAD)


def _absent(model: FleetModel, member: Member) -> str:
    """Return why a member is not well, as text."""
    if member.there:
        return f"its {member.daemon} is {member.standing}"
    if member.ended:
        return f"its {member.daemon} has ended with the run"
    gone = f"gone for {span(model.now() - member.since)}" if member.since is not None else "was never there"
    return f"its {member.daemon} is not there ({gone})"
