"""What a page is told: what is new since it last asked, whole when it is new, and never a backlog."""

import json
from typing import Any

from argosy.fleet_model.timeline import MOST, Timeline
from argosy.ui.view_diff import AT_FIRST, AT_ONCE, Seen, Shown


def no_events() -> Timeline:
    return Timeline(lambda at: None)


def happen(timeline: Timeline, count: int) -> None:
    for _ in range(count):
        timeline.add(1000.0, "scout", "print", "x")


def numbers(told: dict[str, Any]) -> list[int]:
    return [one["number"] for one in told["events"]]


def news(shown: Shown, seen: Seen, *looks_at: str) -> dict[str, Any]:
    told: dict[str, Any] = json.loads(shown.news(seen, looks_at, 12.5))
    assert told.pop("now") == 12.5
    return told


def test_a_new_page_gets_everything_once_and_then_what_changes() -> None:
    shown, seen = Shown(no_events(), lambda: {"uav1": [(1.0, 2.0)]}), Seen()
    shown.show({"head": {"fleet": "sar"}, "agent/scout": {"cycle": 1}})
    assert news(shown, seen) == {
        "tracks": {"uav1": [[1.0, 2.0]]},
        "set": {"head": {"fleet": "sar"}, "agent/scout": {"cycle": 1}},
    }
    assert news(shown, seen) == {}
    shown.show({"head": {"fleet": "sar"}, "agent/scout": {"cycle": 2}})
    assert news(shown, seen) == {"set": {"agent/scout": {"cycle": 2}}}
    shown.show({"head": {"fleet": "sar"}})
    assert news(shown, seen) == {"gone": ["agent/scout"]}


def test_an_open_page_gets_the_tracks_anew_when_a_run_begins_and_only_then() -> None:
    tracks = {"uav1": [(1.0, 2.0)]}
    shown, seen = Shown(no_events(), lambda: tracks), Seen()
    shown.show({"head": {"fleet": "sar"}})
    news(shown, seen)
    shown.begin_run()
    shown.show({"head": {"fleet": "sar"}})
    tracks.clear()
    assert news(shown, seen) == {"tracks": {}}
    assert news(shown, seen) == {}


def test_a_slow_page_gets_the_newest_and_nothing_of_what_was_between() -> None:
    shown, seen = Shown(no_events()), Seen()
    for cycle in range(1_000):
        shown.show({"agent/scout": {"cycle": cycle}})
    assert news(shown, seen)["set"] == {"agent/scout": {"cycle": 999}}


def test_what_came_and_went_while_a_page_was_away_is_not_told() -> None:
    shown, seen = Shown(no_events()), Seen()
    shown.show({"head": {}})
    news(shown, seen)
    shown.show({"head": {}, "order/1": {}})
    shown.show({"head": {}})
    assert news(shown, seen) == {}


def test_a_mind_is_told_to_pages_that_look_at_it_alone() -> None:
    shown, one, other = Shown(no_events()), Seen(), Seen()
    shown.show({"mind/scout": {"cycle": 1}, "plans/scout": [], "head": {}})
    assert news(shown, one, "scout")["set"].keys() == {"mind/scout", "plans/scout", "head"}
    assert news(shown, other)["set"].keys() == {"head"}
    assert news(shown, other, "scout")["set"].keys() == {"mind/scout", "plans/scout"}, "it looks now"
    assert news(shown, other) == {"gone": ["mind/scout", "plans/scout"]}


def test_events_come_once_in_order_and_in_bounded_portions() -> None:
    timeline = no_events()
    shown, seen = Shown(timeline), Seen()
    happen(timeline, 3)
    assert numbers(news(shown, seen)) == [1, 2, 3]
    assert "events" not in news(shown, seen)
    happen(timeline, AT_ONCE + 10)
    assert len(told := numbers(news(shown, seen))) == AT_ONCE
    assert told[-1] == AT_ONCE + 3
    assert numbers(news(shown, seen)) == list(range(AT_ONCE + 4, AT_ONCE + 14))


def test_a_new_page_gets_the_last_events_and_a_slow_one_is_told_how_many_it_missed() -> None:
    timeline = no_events()
    shown, late, slow = Shown(timeline), Seen(), Seen()
    happen(timeline, 1)
    news(shown, slow)
    happen(timeline, MOST + 1_000)
    told = news(shown, late)
    assert numbers(told)[0] == MOST + 1001 - AT_FIRST + 1
    assert "left_out" not in told
    told = news(shown, slow)
    assert told["left_out"] == 1_000
    assert numbers(told)[0] == 1_002


def test_an_event_has_the_mission_second_of_the_run_in_which_it_happened() -> None:
    zero: list[float | None] = [None, 100.0, 900.0]
    timeline = Timeline(lambda at: None if zero[0] is None else at - zero[0])
    shown, seen = Shown(timeline), Seen()
    happen(timeline, 1)
    zero.pop(0)
    happen(timeline, 1)
    zero.pop(0)
    assert [one.get("mission") for one in news(shown, seen)["events"]] == [None, 900.0]
