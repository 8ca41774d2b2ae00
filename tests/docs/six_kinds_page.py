"""The table of one program and six kinds of vehicles in docs/guides/mavlink.md: `python -m tests.docs.six_kinds_page`.

Each row is a run of missions/relay with one vehicle, without faults and in virtual time: the same each time.
"""

import re
import tempfile
from pathlib import Path

from argosy.trial.single_run import Outcome, Request
from argosy.trial.workers import workers
from bridged.simulation.vehicle.kinds import KINDS
from tests.docs.pages import ROOT, with_part

PAGE = ROOT / "docs/guides/mavlink.md"
_ACTIONS = ("takeoff", "goto", "return_to_launch")
NAMES = {"ardupilot": "ArduPilot", "px4": "PX4"}
_MISSION = """\
mission: task
agents:
  uav:
    program: {program}
    robot: uav1
    beliefs: ["height(40)", "next(nobody)"{landing}]
    goals: ["carry(-27.600433, -48.518363)"]
robots:
  uav1:
    manifest: {vehicle}
    link: udpin:127.0.0.1:14550
    limits: {{{altitude}radius: 1000}}
    simulate: {{vehicle: {vehicle}, autopilot: {autopilot}, home: [-27.604033, -48.518363, 21.0]}}
done: "uav: carried"
failed: "uav: gave_up(_)"
timeout: 20min
bring_home: 10s
"""


LANDING = (
    'landing([["MAV_CMD_DO_LAND_START"], ["MAV_CMD_NAV_LOITER_TO_ALT", -27.604033, -48.510447, 40, 0, 60, 0, 1], '
    '["land", -27.604033, -48.518363, 0]])'
)
"""Of a plane with PX4, from 780 m east of home."""


def mission(vehicle: str, autopilot: str) -> str:
    """Return a mission file that flies the relay's program by one kind of vehicle."""
    program = ROOT / "missions/relay" / ("driving.asl" if vehicle == "rover" else "flying.asl")
    altitude = "" if vehicle == "rover" else "altitude: 100, "
    landing = f", '{LANDING}'" if (vehicle, autopilot) == ("plane", "px4") else ""
    return _MISSION.format(program=program, vehicle=vehicle, autopilot=autopilot, altitude=altitude, landing=landing)


def flights() -> dict[tuple[str, str], Outcome]:
    """Fly each kind once; the outcomes by vehicle and autopilot."""
    with tempfile.TemporaryDirectory() as folder, workers(1) as run_all:  # one after the other: in order
        requests = []
        for vehicle, autopilot in KINDS:
            path = Path(folder) / f"{vehicle}_{autopilot}.yaml"
            path.write_text(mission(vehicle, autopilot), encoding="utf-8")
            requests.append(Request(str(path), 1, (), journal=True))
        return dict(zip(KINDS, run_all(requests), strict=True))


def block(outcomes: dict[tuple[str, str], Outcome]) -> str:
    """Return the table: whether the task was carried, how long the actions took, the perceived modes, and the end."""
    heads = ("vehicle", "autopilot", "carried", "s", "of which takeoff, way there, way home", "modes perceived", "end")
    rows = [heads, ("---",) * len(heads)]
    for (vehicle, autopilot), outcome in outcomes.items():
        text = "\n".join(outcome.journal)
        found = [re.search(rf"uav: {one}\(?.* succeeded after ([\d.]+) s", text) for one in _ACTIONS]
        took = ", ".join("-" if one is None else one[1] for one in found)
        modes = ", ".join(re.findall(r"uav1: mode (\w+)", text))
        carried = "yes" if "uav: done: carried" in text else f"no: {outcome.why}"
        end = "disarmed" if "its bridge left it: not armed" in text else "armed"
        rows.append((vehicle, NAMES[autopilot], carried, f"{outcome.seconds:.0f}", took, modes, end))
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


if __name__ == "__main__":
    PAGE.write_text(with_part(PAGE, "six kinds", block(flights())), encoding="utf-8")
