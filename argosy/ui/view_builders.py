"""Builds the views of a fleet's members from its model."""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Sequence
from typing import Literal

from msgspec.structs import replace

from argosy.cli.remedies import level_of
from argosy.fleet_model.actions import ActionSeen
from argosy.fleet_model.activity import activity
from argosy.fleet_model.fleet_status import Standing
from argosy.fleet_model.members import FleetAgent, FleetBoard, FleetRobot, Member
from argosy.fleet_model.model import FleetModel
from argosy.ui.view_structs import AgentView, BoardView, NoteView, RobotView, RunningView
from schemas.liveness import MIND_STALE_AFTER
from schemas.mission.model import Ending, Robot
from schemas.wire.records import Note

INTENTIONS = 4
"""Intentions of an agent that the list shows."""


def note_view(note: Note, names: Sequence[str] = ()) -> NoteView:
    """Return the view of a note; `names`: the members that have it, if it is shown for all of them."""
    return NoteView(code=note.code, text=note.text, about=note.about, level=level_of(note), names=tuple(names))


def agent_view(model: FleetModel, agent: FleetAgent, shared: Container[Note]) -> AgentView:
    """Return the view of an agent; `shared` notes are shown elsewhere."""
    mind, does = agent.mind, activity(model, agent)
    counted = {} if mind is None else {
        "program": mind.program,
        "cycle": mind.cycle,
        "intentions": tuple(replace(one, stack=one.stack[:1]) for one in mind.intentions[:INTENTIONS]),
        "intention_count": len(mind.intentions) + mind.intentions_left_out,
        "belief_count": len(mind.beliefs) + mind.beliefs_left_out,
        "event_count": len(mind.events) + mind.events_left_out,
        "question_count": len(mind.questions),
        "mailbox": mind.mailbox + model.mail_for(agent.name),
        "dropped": sum(mind.dropped.values()),
    }  # fmt: skip
    return AgentView(
        name=agent.name,
        board=agent.board,
        robot=agent.robot,
        standing=_standing(agent),
        since=agent.since,
        notes=tuple(note_view(note) for note in agent.notes if note not in shared),
        state=does.doing,
        action=does.action[:200],
        stale=agent.heard if (agent.age(model.as_of) or 0.0) > MIND_STALE_AFTER else None,
        silent=agent.silent,
        why_silent=agent.why_silent,
        actions=tuple(_running(one, model.as_of) for one in model.actions.open(agent.name)[-INTENTIONS:]),
        **counted,  # type: ignore[arg-type]
    )


def _running(action: ActionSeen, now: float) -> RunningView:
    return RunningView(
        id=action.id,
        text=action.text[:200],
        state=action.state,
        began=action.began,
        silent=None if action.silent(now) is None else action.heard,
        feedback={name: round(value, 1) for name, value in list(action.feedback.items())[:4] if math.isfinite(value)},
    )


def robot_view(model: FleetModel, robot: FleetRobot, named: Robot | None, shared: Container[Note]) -> RobotView:
    """Return the view of a robot; `named` is its entry in the mission."""
    seen, age = robot.seen, robot.age(model.as_of)
    velocity = seen.velocity
    return RobotView(
        name=robot.name,
        board=robot.board,
        agents=robot.agents,
        standing=_standing(robot),
        since=robot.since,
        notes=tuple(note_view(note) for note in robot.notes if note not in shared),
        stale=round(model.as_of - age, 1) if age is not None and robot.stale(model.as_of) else None,
        lost=seen.lost,
        mode=seen.mode,
        armed=seen.armed,
        position=_place(seen.position),
        altitude=_rounded(seen.altitude, 1),
        heading=_rounded(seen.heading, 0),
        speed=None if velocity is None else _rounded(math.hypot(velocity[0], velocity[1]), 1),
        battery=_rounded(seen.battery, 0),
        satellites=seen.satellites,
        home=_place(seen.home),
        radius=None if named is None or named.limits.radius is None else float(named.limits.radius),
        operator=seen.operator,
        paused=seen.paused,
        reported=dict(list(seen.reported.items())[:8]),
    )


def board_view(board: FleetBoard) -> BoardView:
    """Return the view of a board."""
    return BoardView(
        name=board.name,
        standing=_standing(board),
        since=board.since,
        notes=tuple(map(note_view, board.notes)),
        waiting=board.waiting(),
        problem=board.problem,
    )


def formulas(model: FleetModel, endings: Iterable[Ending], what: str) -> dict[str, bool]:
    """Return the mission's formulas of one kind and whether they hold, as far as known."""
    held: dict[str, bool] = {}
    for one in endings:
        mind = model.agents[one.agent].mind if one.agent in model.agents else None
        held[f"{one.agent}: {one.formula}"] = bool(mind and getattr(mind, what).get(one.formula, False))
    return held


def _standing(member: Member) -> Standing | Literal["ended"]:
    return "ended" if member.ended else member.standing


def _place(at: tuple[float, float] | None) -> tuple[float, float] | None:
    """Return a position on earth, or None: JSON has no infinity."""
    return at if at is not None and abs(at[0]) <= 90 and abs(at[1]) <= 180 else None


def _rounded(value: float | None, digits: int) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value + 0.0, digits)
