"""The shared model of a running fleet, for `argosy watch` and `argosy ui`: what is there, and what happens."""

from argosy.team.activity import Activity, activity
from argosy.team.letters import Letter, Letters
from argosy.team.members import Member, TeamAgent, TeamBoard, TeamRobot
from argosy.team.mission_clock import MissionClock
from argosy.team.model import TeamModel
from argosy.team.places import Place, Places
from argosy.team.still import still
from argosy.team.timeline import Entry, Timeline
from argosy.team.watcher import TeamWatcher, steady_clock

__all__ = [
    "Activity",
    "Entry",
    "Letter",
    "Letters",
    "Member",
    "MissionClock",
    "Place",
    "Places",
    "TeamAgent",
    "TeamBoard",
    "TeamModel",
    "TeamRobot",
    "TeamWatcher",
    "Timeline",
    "activity",
    "steady_clock",
    "still",
]
