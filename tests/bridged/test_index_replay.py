"""The simulated copter answers what a real ArduCopter answered: every exchange of tests/data/INDEX.json, replayed.

`pytest tests/bridged/test_index_replay.py -s` prints the report.
"""

from __future__ import annotations

import copy
from collections.abc import Callable
from functools import cache

import pytest

from tests.bridged.exchanges import Playback, Record, differences, index, play

KNOWN_DIFFERENCES: dict[tuple[str, str], str] = {}
"""(file, entry): why the simulated copter answers otherwise. What is listed must differ, all else must match."""

EXCHANGES = 284
"""Entries of the index without its markers, at which nothing is sent and nothing expected."""

FILES = sorted(index())


@cache
def playback_of(name: str) -> Playback:
    return play(name, index()[name])


def exchanges_of(name: str) -> list[Record]:
    return [entry for entry in index()[name] if not entry.get("marker")]


@pytest.mark.parametrize("name", FILES)
def test_each_recorded_exchange_is_answered_as_recorded(name: str) -> None:
    playback = playback_of(name)
    unlisted, healed, matched = [], [], 0
    for entry in exchanges_of(name):
        found = differences(playback, entry)
        listed = KNOWN_DIFFERENCES.get((name, entry["name"]))
        matched += not found
        if found and listed is None:
            unlisted.append(f"{entry['name']} (vehicle {entry.get('sysid')}): {'; '.join(found)}")
        if not found and listed is not None:
            healed.append(f"{entry['name']} matches now, but is listed: {listed}")
    print(f"\n{name}: {matched} of {len(exchanges_of(name))} exchanges as recorded")
    assert not unlisted, "\n".join(unlisted)
    assert not healed, "\n".join(healed)


def test_all_exchanges_of_the_index_are_answered_as_recorded_but_the_listed_ones() -> None:
    answers = [not differences(playback_of(name), entry) for name in FILES for entry in exchanges_of(name)]
    print(
        f"\nindex: {sum(answers)} of {len(answers)} exchanges as recorded, {len(KNOWN_DIFFERENCES)} listed differences"
    )
    assert len(answers) == EXCHANGES
    assert sum(answers) >= EXCHANGES - len(KNOWN_DIFFERENCES)


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
        (
            "failsafe.tlog.gz",
            "ready",
            lambda entry: entry.update(t_seen_us=entry["t_seen_us"] - 5_000_000),
            "ready at",
        ),
    ],
)
def test_the_comparison_notices_a_wrong_answer(
    name: str, entry: str, change: Callable[[Record], None], noticed: str
) -> None:
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
