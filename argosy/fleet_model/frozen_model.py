"""A model as it stood at one moment, to be looked at in peace while the fleet and its model go on."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import TypeVar

from argosy.fleet_model.members import Member
from argosy.fleet_model.model import TeamModel

M = TypeVar("M", bound=Member)


def still(model: TeamModel) -> TeamModel:
    """Return what a model shows now: it takes nothing in any more, and its clock stands."""
    at, held = model.now(), copy(model)
    held.now = lambda: at
    held.agents, held.boards, held.clients = _copies(model.agents), _copies(model.boards), _copies(model.clients)
    held.robots = {name: replace(robot, seen=copy(robot.seen)) for name, robot in model.robots.items()}
    held.timeline = copy(model.timeline)
    held.timeline.entries = model.timeline.entries.copy()
    held.hold_actions()
    return held


def _copies(members: dict[str, M]) -> dict[str, M]:
    return {name: copy(member) for name, member in members.items()}
