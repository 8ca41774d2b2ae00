"""Activity of an agent for operators: flying, acting, reasoning, waiting or idle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from argosy.fleet_model.members import FleetAgent
from argosy.fleet_model.model import FleetModel
from argosy.fleet_model.robots import AIRBORNE

Doing = Literal["", "reasoning", "waiting", "paused", "idle", "acting", "flying"]
"""`acting`: an intention waits for an action; `flying`: the same in the air; `idle`: no intention; empty: unknown."""


@dataclass(frozen=True)
class Activity:
    """Activity of an agent, and the action that it waits for, as its program writes it."""

    doing: Doing
    action: str = ""


def activity(model: FleetModel, agent: FleetAgent) -> Activity:
    """Return the activity of an agent; a running action counts before the intention that waits for it."""
    mind = agent.mind
    if mind is not None and mind.state == "paused":
        return Activity("paused")
    actions = [one for one in model.actions.open(agent.name) if one.silent(model.as_of) is None]
    if actions and agent.there:
        robot = model.robots.get(agent.robot)
        airborne = robot is not None and robot.seen.armed and (robot.seen.altitude or 0.0) > AIRBORNE
        return Activity("flying" if airborne else "acting", actions[-1].text)
    if mind is None:
        return Activity("")
    if mind.state == "waiting" and not mind.intentions and not mind.intentions_left_out:
        return Activity("idle")
    return Activity(mind.state)
