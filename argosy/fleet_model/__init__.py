"""The shared model of a running fleet, for `argosy watch` and `argosy ui`: what is there, and what happens."""

from argosy.fleet_model.activity import Activity, activity
from argosy.fleet_model.frozen_model import still
from argosy.fleet_model.members import Member, TeamAgent, TeamBoard, TeamRobot
from argosy.fleet_model.message_log import LoggedMessage, MessageLog
from argosy.fleet_model.mission_clock import MissionClock
from argosy.fleet_model.model import TeamModel
from argosy.fleet_model.observer import TeamWatcher, steady_clock
from argosy.fleet_model.places import Place, Places
from argosy.fleet_model.timeline import Entry, Timeline

__all__ = [
    "Activity",
    "Entry",
    "LoggedMessage",
    "Member",
    "MessageLog",
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
