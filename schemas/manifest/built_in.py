"""What the bridge of every robot offers its agents besides the robot's manifest: two actions and some percepts."""

from __future__ import annotations

from schemas.files.durations import Duration
from schemas.manifest.model import ActionEntry, Parameter

ACTIONS: dict[str, ActionEntry] = {
    "release": ActionEntry(motion=False, deadline=Duration(1)),
    "hand_over": ActionEntry(params=(Parameter(name="agent", type="string"),), motion=False, deadline=Duration(1)),
}
"""`release` lets go of the robot, `hand_over(Agent)` gives it to another of its agents (docs/reference/actions.md)."""
ACTION_ARITIES: dict[str, int] = {name: entry.arity for name, entry in ACTIONS.items()}
PERCEPTS: dict[str, int] = {
    "bridge": 1,
    "override": 1,
    "restarted": 1,
    "holder": 1,
    "feedback": 3,
    "link": 1,
    "paused": 1,
}
"""Beliefs that a program may ask for although no manifest declares them, with their numbers of arguments:
`bridge(up)`, `override(Mode)`, `restarted(N)`, `holder(Agent)`, `feedback(Action, What, Value)`, `link(State)`,
`paused(Who)`."""
