"""The simulated vehicles answer what recorded ones answered: every exchange of the INDEX.json files, replayed."""

import copy
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.bridged.exchanges import Playback, Record, differences
from tests.bridged.index_replay import FILES, KNOWN_DIFFERENCES, playback_of, summary, tally_of

PAGE = Path(__file__).parent.parent.parent / "docs/guides/simulation.md"
ENTRIES = 755


@pytest.mark.parametrize("name", FILES)
def test_each_recorded_exchange_is_answered_as_recorded_but_the_listed_ones(name: str) -> None:
    tally = tally_of(name)
    listed = {entry for file, entry in KNOWN_DIFFERENCES if file == name}
    assert tally.exchanges
    assert {entry: found for entry, found in tally.different.items() if entry not in listed} == {}
    assert listed <= set(tally.different), "matches now, but is listed"


def test_the_page_of_the_simulated_vehicles_tells_how_many_exchanges_are_answered_as_recorded() -> None:
    tallies = [tally_of(name) for name in FILES]
    assert sum(len(tally.exchanges) + tally.markers for tally in tallies) == ENTRIES
    assert summary() in " ".join(PAGE.read_text().split())


def reply_of(entry: Record, kind: str) -> Record:
    found: Record = next(reply for reply in entry["replies"] if reply["msg"] == kind)
    return found


def tampered(name: str, entry: str, change: Callable[[Record], None]) -> list[str]:
    """Differences that the comparison finds after `change` to the recorded side."""
    played = playback_of(name)
    playback = Playback(copy.deepcopy(played.entries), played.begin, played.scale, played.said, played.truth)
    target = next(item for item in playback.entries if item["name"] == entry)
    change(target)
    return differences(playback, target)


@pytest.mark.parametrize(
    ("name", "entry", "change", "noticed"),
    [
        (
            "refusals.tlog.gz",
            "reposition_long",
            lambda entry: reply_of(entry, "COMMAND_ACK").update(result=0),
            "missing",
        ),
        ("refusals.tlog.gz", "takeoff_10", lambda entry: entry["replies"].clear(), "not recorded"),
        (
            "refusals.tlog.gz",
            "set_mode_unknown_99",
            lambda entry: reply_of(entry, "STATUSTEXT").update(text="No such mode"),
            "missing",
        ),
        (
            "refusals.tlog.gz",
            "set_mode_brake",
            lambda entry: reply_of(entry, "HEARTBEAT").update(custom_mode=5),
            "missing",
        ),
        (
            "single_uav.tlog.gz",
            "rtl_disarmed",
            lambda entry: reply_of(entry, "EXTENDED_SYS_STATE").update(dt_ms=14000.0),
            "missing",
        ),
        (
            "mission_upload.tlog.gz",
            "param_set_out_of_range",
            lambda entry: reply_of(entry, "PARAM_VALUE").update(param_value=1000.0),
            "missing",
        ),
        (
            "dynamics.tlog.gz",
            "f1_leg30_setpoint",
            lambda entry: reply_of(entry, "POSITION_TARGET_GLOBAL_INT").update(lat_int=0),
            "missing",
        ),
        ("failsafe.tlog.gz", "ready", lambda entry: entry.update(t_seen_us=entry["t_seen_us"] - 5_000_000), "ready at"),
    ],
)
def test_the_comparison_notices_errors(name: str, entry: str, change: Callable[[Record], None], noticed: str) -> None:
    assert not tampered(name, entry, lambda entry: None)
    assert any(noticed in difference for difference in tampered(name, entry, change))


def test_the_comparison_notices_a_copter_in_the_wrong_place() -> None:
    played = playback_of("single_uav.tlog.gz")
    moved = copy.deepcopy(played.said)
    for item in moved[1]:
        if item.message.get_type() == "GLOBAL_POSITION_INT":
            item.message.lat += 10_000
    playback = Playback(played.entries, played.begin, played.scale, moved, played.truth)
    entry = next(entry for entry in played.entries if entry["name"] == "goal_reached")
    assert any("away" in difference for difference in differences(playback, entry))
