"""How many recorded exchanges the simulated vehicles answer as recorded: `python -m tests.bridged.index_replay`."""

from dataclasses import dataclass, field
from functools import cache

from tests.bridged.exchanges import Playback, Record, differences, index, play

_BY_REASON: dict[str, dict[str, tuple[str, ...]]] = {
    "an upload resets the state of the mission before it, which the recorded one told as ended": {
        "ardu_plane": ("mission_upload_with_landing",)
    },
    "home does not move with the noise of the GPS": {
        "ardu_plane": ("mode_auto_on_ground", "arm_in_auto"),
        "ardu_rover": ("disarm",),
    },
    "begins elsewhere on its circle": {
        "ardu_plane_failsafe": ("do_land_start", "lands"),
        "px4_plane": ("hold", "land_in_the_air", "rtl_without_landing"),
    },
    "reaches the first waypoint, or leaves the takeoff, seconds earlier or later": {
        "px4_plane": ("change_altitude_80m", "mission_flown_landed", "rtl_with_mission_landing"),
    },
    "turns and gains speed otherwise, and so is elsewhere by some metres or arrives up to 3 s earlier": {
        "ardu_rover": (
            "velocity_body",
            "setpoint_outside_guided",
            "mission_driven",
            "rtl",
            "mission_start_again",
            "disarm_while_driving",
            "mode_guided_3",
            "gcs_back",
        ),
        "px4_rover": ("offboard_stops", "mode_hold_4", "land_of_a_rover"),
    },
    "ready for arming, and its preflight texts, at another moment after power on: it varies by seconds": {
        "px4_quad_failsafe": ("intervals",),
        "px4_quad_refusals": ("intervals",),
    },
    "streams at the rates of a slow link, and not all of them": {"px4_quad_flight": ("default_streams_10s",)},
    "brakes or turns otherwise, and so is elsewhere by some metres or seconds": {
        "px4_quad_flight": ("offboard_velocity_body", "hold_again_2", "rtl", "rtl_landed"),
        "px4_quad_mission": ("mission_continue", "mission_ends_in_the_air"),
        "px4_quad_refusals": ("offboard_after_one_setpoint", "hold_9", "offboard_bad_frame"),
    },
    "setpoints at the limit of their timeout: the pauses between the recorded ones were no longer by chance": {
        "px4_quad_refusals": ("offboard_1", "offboard_1hz"),
    },
    "has fewer parameters, at other indices": {"px4_quad_mission": ("param_read_5",)},
    "a changed parameter is announced once, and at once": {
        "px4_quad_mission": ("param_set_float_back", "request_mission_current"),
    },
    "the rhythm in which an item is asked for again varies": {
        "px4_quad_mission": ("mission_upload_broken_off",),
    },
    "the way home does not lead around the fence": {
        "px4_quad_mission": ("fence_breach", "rtl_after_breach_landed"),
    },
    "the battery of PX4's simulator fills and its shutdown is tried otherwise": {
        "px4_quad_failsafe": ("battery_low", "battery_landed"),
    },
}

KNOWN_DIFFERENCES: dict[tuple[str, str], str] = {
    (f"{name}.tlog.gz", entry): reason
    for reason, files in _BY_REASON.items()
    for name, entries in files.items()
    for entry in entries
}
"""(file, entry): why the simulated vehicle answers otherwise. What is listed must differ, all else must match."""

FILES = sorted(index())


@cache
def playback_of(name: str) -> Playback:
    """What the simulated vehicles of one file say when they are told what the recorded ones were told."""
    return play(name, index()[name])


@dataclass
class Tally:
    """The exchanges of one file, and how the simulated vehicle's answers differ."""

    exchanges: list[Record]
    markers: int
    """Further entries, at which nothing was sent and nothing awaited."""
    different: dict[str, list[str]] = field(default_factory=dict)

    @property
    def matched(self) -> int:
        """How many are answered as recorded."""
        return sum(entry["name"] not in self.different for entry in self.exchanges)


@cache
def tally_of(name: str) -> Tally:
    """Compares all entries of one file."""
    entries = index()[name]
    exchanges = [entry for entry in entries if not entry.get("marker")]
    tally = Tally(exchanges, len(entries) - len(exchanges))
    for entry in exchanges:
        if found := differences(playback_of(name), entry):
            tally.different.setdefault(entry["name"], []).extend(f"vehicle {entry.get('sysid')}: {x}" for x in found)
    return tally


def summary() -> str:
    """The line that docs/guides/simulation.md quotes."""
    tallies = [tally_of(name) for name in FILES]
    matched, exchanges = sum(one.matched for one in tallies), sum(len(one.exchanges) for one in tallies)
    markers = sum(one.markers for one in tallies)
    return (
        f"{matched} of {exchanges} exchanges as recorded; the other {markers} of the {exchanges + markers} entries "
        "are markers at which nothing was sent"
    )


def main() -> None:
    """Prints the figures per file, and each difference with its reason."""
    for name in FILES:
        tally = tally_of(name)
        print(f"{name}: {tally.matched} of {len(tally.exchanges)}")
        for entry, found in tally.different.items():
            reason = KNOWN_DIFFERENCES.get((name, entry), "not listed")
            print(f"  {entry}: {'; '.join(found)} ({reason})")
    print(summary())


if __name__ == "__main__":
    main()
