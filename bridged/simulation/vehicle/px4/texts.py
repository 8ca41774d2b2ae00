"""What PX4 reports of itself: a STATUSTEXT that ends with a tab has an EVENT of the same news, some have one alone."""

from bridged.simulation.vehicle.notifications import Severity

EVENTS: dict[str, tuple[int, int]] = {
    "Arming denied": (16910493, 98),
    "Armed by": (26266355, 102),
    "Disarmed by": (32794487, 102),
    "Disarming denied": (25868725, 98),
    "Switching to": (27280279, 98),
    "Unsupported main": (19545959, 51),
    "Unsupported auto": (19869445, 51),
    "Mission start denied": (23844490, 98),
    "Takeoff detected": (21054825, 102),
    "Landing detected": (26622124, 102),
    "Landing at": (20099806, 102),
    "Returning to": (20262116, 102),
    "Already higher": (19098816, 99),
    "Using default": (20656071, 102),
    "Reposition is": (30272452, 99),
    "Executing Mission": (32375217, 102),
    "Climb to": (24986204, 102),
    "Mission finished, loitering": (21455606, 102),
    "Mission finished, landed": (24580612, 102),
    "RTL: start": (22161044, 102),
    "RTL: land": (16962474, 102),
    "RTL: completed": (33502559, 102),
    "RTL Mission": (27006470, 102),
    "Pilot took": (18523838, 102),
    "GCS connection": (31011876, 102),
    "Connection to mission": (27900317, 34),
    "Connection to ground": (27571288, 100),
    "Preflight Fail: no heading": (30203637, 51),
    "Preflight Fail: no valid global": (26788467, 51),
    "Preflight Fail: No connection to the ground": (23579003, 51),
    "Low battery": (21826980, 34),
    "Critical battery": (19404811, 34),
    "Failsafe activated: entering": (21279712, 66),
    "Failsafe activated": (31382480, 66),
    "IGN MISSION_ITEM": (33469040, 51),
    "Mission sync": (31217896, 51),
    "WPM: WP CURR": (30345769, 51),
    "Geofence violation": (19608877, 99),
    "SET_POSITION_TARGET_LOCAL": (28329281, 51),
    "SET_POSITION_TARGET_GLOBAL": (27739955, 51),
}
"""Number and log_levels of the EVENT of a text, by the text's first words; recorded."""

TAKEOFF_NOT_FIRST = (33440290, 99)
GLIDE_SLOPE_TOO_STEEP = (21551397, 99)
"""Why a mission is not feasible: EVENTs without a text."""

INFO, CRITICAL = Severity.INFO, Severity.CRITICAL


def event_of(text: str) -> tuple[int, int] | None:
    """Return the EVENT of a text; None: it has none."""
    return next((event for words, event in EVENTS.items() if text.startswith(words)), None)
