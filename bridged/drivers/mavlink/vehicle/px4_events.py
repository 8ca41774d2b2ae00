"""What PX4 reports as an EVENT, in our words: reasons for which it sends no text, or none to a companion.

An EVENT carries a number; PX4's own words are in a file of each of its builds. These numbers are those of its main
branch of 2026-08. Arming checks that speak of a mode nobody asked for are left out.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

from pymavlink.dialects.v20 import ardupilotmega as dialect

_CRITICAL, _WARNING, _INFO = (
    dialect.MAV_SEVERITY_CRITICAL,
    dialect.MAV_SEVERITY_WARNING,
    dialect.MAV_SEVERITY_INFO,
)


CHECK = "Preflight Fail: "
"""Prefix of PX4's texts of failed arming checks."""


class Event(NamedTuple):
    """One event as text."""

    severity: int
    """MAV_SEVERITY."""
    text: str
    alone: bool = False
    """PX4 sends no text for it, to anybody."""
    check: bool = False
    """It is a failed arming check."""


HOLDS_FIRST = frozenset({0x1D11DF6, 0x144B3E0})
"""A failsafe holds for COM_FAIL_ACT_T before it acts; the mode may be the one that was set."""
ACTS = frozenset({0x194CA8A, 0x1DEDBD0})
"""A failsafe acts. The arguments are the mode that was set (four bytes), what the failsafe does, and its cause."""
_DOES, _HOLD = 4, 5
"""Place of what a failsafe does, and its number there for that it holds."""
_ACTIONS = {
    _HOLD: "holds", 6: "returns", 7: "lands", 8: "descends", 9: "stops its motors", 10: "terminates the flight",
}  # fmt: skip
_HOLDS = Event(_CRITICAL, "a failsafe acts: the vehicle holds first")
EVENTS: Mapping[int, Event] = MappingProxyType({
    0x1FE4222: Event(_CRITICAL, "mission rejected: the takeoff is not its first item that is flown", alone=True),
    0x148D925: Event(_CRITICAL, "mission rejected: its landing is steeper than FW_LND_ANG", alone=True),
    0x1B09425: Event(_CRITICAL, "the approach of the landing must begin lower or farther away", alone=True),
    0x12B352D: Event(_CRITICAL, "mission rejected: an item is outside the fence"),
    0x1FEB270: Event(_CRITICAL, "a mission item is invalid", alone=True),
    0x1DC58E8: Event(_WARNING, "the vehicle gave up waiting for mission items"),
    0x1CF0A29: Event(_WARNING, "the mission has no such item"),
    0x16BD68A: Event(_CRITICAL, "there is no mission that can be flown"),
    0x1CDEBC4: Event(_CRITICAL, "the target is outside the fence"),
    0x1022EAB: Event(_WARNING, "the vehicle is at the fence or outside"),
    0x1236CC0: Event(_CRITICAL, "the vehicle is above the altitude of the takeoff already"),
    0x102089D: Event(_CRITICAL, "arming denied: a check of the vehicle's health fails"),
    0x11C8F61: Event(_CRITICAL, "arming denied: the mode cannot take off", alone=True),
    0x18AB9B5: Event(_CRITICAL, "disarming denied: the vehicle has not landed"),
    0x1CCDEF5: Event(_WARNING, f"{CHECK}the heading is not known", check=True),
    0x1D31BB9: Event(_WARNING, f"{CHECK}the local position is not known", check=True),
    0x198C273: Event(_WARNING, f"{CHECK}the global position is not known", check=True),
    0x167C97B: Event(_WARNING, f"{CHECK}no ground station is heard", check=True),
    0x14D0DA4: Event(_WARNING, "battery low"),
    0x128180B: Event(_CRITICAL, "battery critical"),
    0x1AD1B07: Event(_CRITICAL, "battery at the emergency level"),
    0x1A04397: Event(_CRITICAL, "the mode cannot be entered now"),
    0x11AA6BE: Event(_INFO, "the pilot took over by the sticks"),
    0x1A4B458: Event(_WARNING, "the ground station is lost"),
    **dict.fromkeys(ACTS, Event(_CRITICAL, "a failsafe acts")),
    **dict.fromkeys(HOLDS_FIRST, _HOLDS),
})  # fmt: skip


def event_of(message: dialect.MAVLink_message) -> Event | None:
    """Return an EVENT in words, None for one without.

    A check that fails and does not hinder arming is reported for information only: it has none.
    """
    event = EVENTS.get(message.id)
    if message.id in ACTS and (does := _ACTIONS.get(message.arguments[_DOES])):
        return Event(_CRITICAL, f"a failsafe acts: the vehicle {does}")
    hinders = message.log_levels & 0xF <= _WARNING  # its severity for others than the log
    return None if event is None or (event.check and not hinders) else event


def acts(message: dialect.MAVLink_message) -> bool:
    """Whether an EVENT says that a failsafe acts from now on, whatever it does."""
    return message.id in HOLDS_FIRST or message.id in ACTS


def holds(message: dialect.MAVLink_message) -> bool:
    """Whether an EVENT says that a failsafe holds the vehicle, first or for good: the mode may be the one before."""
    return message.id in HOLDS_FIRST or (message.id in ACTS and message.arguments[_DOES] == _HOLD)
