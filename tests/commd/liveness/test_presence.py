"""When an agent counts as gone: virtual time, no bus."""

from __future__ import annotations

import math

import pytest

from commd.liveness.presence import CATCH_UP, Presence, Silence
from schemas.liveness import AGENT_GRACE, BUS_GRACE, FIRST_HEALTH, ROUTER_GRACE, SILENT_AFTER


@pytest.fixture
def presence() -> Presence:
    presence = Presence(["uav", "other"])
    presence.token("uav", "b1", True, 10.0)
    return presence


def test_an_agent_that_never_came_cannot_be_lost() -> None:
    assert Presence(["uav"]).lost(1000.0) == {}


def test_a_missing_token_counts_after_a_grace_through_a_live_router(presence: Presence) -> None:
    presence.token("uav", "b1", False, 20.0)
    assert presence.lost(20.0 + AGENT_GRACE / 2) == {}
    assert presence.lost(20.0 + AGENT_GRACE) == {"uav": "no liveliness token"}


def test_an_agent_that_is_restarted_within_the_grace_was_never_lost(presence: Presence) -> None:
    presence.token("uav", "b1", False, 20.0)
    presence.token("uav", "b2", True, 20.3)
    assert presence.lost(30.0) == {}


def test_the_old_life_going_after_the_new_one_came_is_no_loss(presence: Presence) -> None:
    presence.token("uav", "b2", True, 20.0)
    presence.token("uav", "b1", False, 22.0)
    assert presence.lost(30.0) == {}


def test_an_agent_that_had_the_robot_before_the_bridge_restarted_is_lost_if_it_does_not_come(
    presence: Presence,
) -> None:
    presence.expect("other", 20.0)
    assert not presence.complete
    assert presence.lost(20.0 + ROUTER_GRACE - 0.1) == {}, "on a busy board a daemon takes its time to reconnect"
    assert presence.lost(20.0 + ROUTER_GRACE) == {"other": "it has not come back since the bridge restarted"}


def test_an_agent_that_is_expected_and_comes_is_lost_like_any_other_when_it_goes(presence: Presence) -> None:
    presence.expect("other", 20.0)
    presence.token("other", "b1", True, 21.0)
    assert presence.complete
    assert presence.lost(30.0) == {}
    presence.token("other", "b1", False, 30.0)
    assert presence.lost(30.0 + AGENT_GRACE) == {"other": "no liveliness token"}


def test_a_router_that_restarts_takes_no_agent_with_it(presence: Presence) -> None:
    presence.router(False, 20.0)
    presence.token("uav", "b1", False, 20.0)
    assert presence.lost(20.0 + BUS_GRACE - 0.1) == {}
    presence.router(True, 23.0)
    assert presence.lost(23.2) == {}
    presence.token("uav", "b1", True, 23.3)
    assert presence.lost(40.0) == {}


def test_an_agent_that_does_not_come_back_with_the_router_is_lost(presence: Presence) -> None:
    presence.router(False, 20.0)
    presence.token("uav", "b1", False, 20.0)
    presence.router(True, 23.0)
    assert presence.lost(23.0 + ROUTER_GRACE - 0.1) == {}, "on a busy board a daemon takes its time to reconnect"
    assert presence.lost(23.0 + ROUTER_GRACE) == {"uav": "no liveliness token"}


def test_who_came_is_known_until_the_bridge_ends(presence: Presence) -> None:
    presence.token("uav", "b1", False, 20.0)
    assert presence.known() == {"uav"}


def test_without_a_router_for_long_nobody_could_tell_the_robot_anything(presence: Presence) -> None:
    presence.router(False, 20.0)
    assert presence.lost(20.0 + BUS_GRACE) == {"uav": "no router for 5 s"}


def test_only_while_nobody_is_missing_nothing_need_be_looked_at(presence: Presence) -> None:
    assert not Presence(["uav"]).complete, "a robot that nobody came for"
    assert presence.complete
    presence.token("uav", "b1", False, 20.0)
    assert not presence.complete
    presence.token("uav", "b2", True, 20.3)
    presence.router(False, 21.0)
    assert not presence.complete
    presence.router(True, 22.0)
    assert presence.complete


HOMES = {"uav": "pi2", "other": "pi1"}


@pytest.fixture
def fleet() -> Presence:
    """All agents, with the boards that they live on: pi1 is ours."""
    presence = Presence(None, HOMES.get)
    for board in ("pi1", "pi2"):
        presence.board(board, "b1", True, 10.0)
    for agent in HOMES:
        presence.token(agent, "b1", True, 10.0)
    return presence


@pytest.mark.parametrize("before", [-0.1, 0.0, 0.1])
def test_an_agent_that_goes_together_with_its_boards_commd_has_time_to_come_back(
    fleet: Presence, before: float
) -> None:
    fleet.board("pi2", "b1", False, 20.0 + before)
    fleet.token("uav", "b1", False, 20.0)
    assert fleet.lost(20.0 + ROUTER_GRACE - 0.1) == {}
    assert fleet.lost(20.0 + ROUTER_GRACE) == {"uav": "no liveliness token"}


def test_a_router_of_another_board_that_restarts_takes_no_agent_with_it(fleet: Presence) -> None:
    fleet.board("pi2", "b1", False, 20.0)
    fleet.token("uav", "b1", False, 20.0)
    fleet.board("pi2", "b2", True, 23.0)
    assert fleet.lost(23.0 + ROUTER_GRACE - 0.1) == {}, "its agents reconnect each at its own pace"
    fleet.token("uav", "b1", True, 27.0)
    assert fleet.lost(60.0) == {}


def test_an_agent_that_does_not_come_back_with_its_boards_router_is_lost(fleet: Presence) -> None:
    fleet.board("pi2", "b1", False, 20.0)
    fleet.token("uav", "b1", False, 20.0)
    fleet.board("pi2", "b2", True, 23.0)
    assert fleet.lost(23.0 + ROUTER_GRACE) == {"uav": "no liveliness token"}


def test_an_agent_that_dies_on_a_board_that_stays_is_lost_after_the_short_grace(fleet: Presence) -> None:
    fleet.board("pi2", "b1", False, 20.0)
    fleet.board("pi2", "b2", True, 21.0)
    fleet.token("uav", "b1", False, 40.0)
    assert fleet.lost(40.0 + AGENT_GRACE) == {"uav": "no liveliness token"}


def test_another_boards_router_says_nothing_of_the_agents_here(fleet: Presence) -> None:
    fleet.board("pi2", "b1", False, 20.0)
    fleet.token("other", "b1", False, 20.0)
    assert fleet.lost(20.0 + AGENT_GRACE) == {"other": "no liveliness token"}


def test_who_is_lost_stays_lost_until_it_comes_whatever_the_routers_do(fleet: Presence) -> None:
    fleet.board("pi2", "b1", False, 20.0)
    fleet.token("uav", "b1", False, 20.0)
    assert set(fleet.lost(30.0)) == {"uav"}
    fleet.board("pi2", "b2", True, 31.0)
    assert set(fleet.lost(31.5)) == {"uav"}
    fleet.router(False, 40.0)
    fleet.router(True, 41.0)
    assert set(fleet.lost(41.5)) == {"uav"}
    fleet.token("uav", "b2", True, 42.0)
    assert fleet.lost(42.0) == {}


def test_whose_token_never_went_is_there_again_with_the_router(fleet: Presence) -> None:
    fleet.router(False, 20.0)
    assert set(fleet.lost(20.0 + BUS_GRACE)) == {"uav", "other"}
    fleet.router(True, 30.0)
    assert fleet.lost(30.0) == {}


def test_who_has_ended_for_good_is_not_lost(fleet: Presence) -> None:
    fleet.token("uav", "b1", False, 20.0)
    fleet.forget("uav")
    assert fleet.lost(60.0) == {}
    assert fleet.known() == {"other"}


def test_it_is_known_when_the_next_agent_will_be_lost(fleet: Presence) -> None:
    assert fleet.due == math.inf
    fleet.token("uav", "b1", False, 20.0)
    assert fleet.due == 20.0 + AGENT_GRACE
    fleet.board("pi2", "b1", False, 20.5)
    assert fleet.due == 20.0 + ROUTER_GRACE
    fleet.board("pi2", "b2", True, 22.0)
    assert fleet.due == 22.0 + ROUTER_GRACE
    fleet.lost(22.0 + ROUTER_GRACE)
    assert fleet.due == math.inf
    fleet.router(False, 40.0)
    assert fleet.due == 40.0 + BUS_GRACE
    fleet.lost(40.0 + BUS_GRACE)
    assert fleet.due == math.inf


def test_a_thousand_agents_that_go_one_after_the_other_are_lost_each_in_its_turn() -> None:
    names = [f"a{number}" for number in range(1000)]
    presence = Presence(None, lambda _: "pi1")
    presence.board("pi1", "b1", True, 0.0)
    for number, name in enumerate(names):
        presence.token(name, "b1", True, 1.0)
        presence.token(name, "b1", False, 10.0 + number)
    assert len(presence.lost(500.0 + AGENT_GRACE)) == 491
    assert presence.due == 501.0 + AGENT_GRACE


def looked_at(silence: Silence, begin: float, end: float) -> list[tuple[float, str]]:
    """Look twice a second; return when somebody was found silent first."""
    found: dict[str, float] = {}
    wall = begin
    while wall <= end:
        for name in silence.silent(wall):
            found.setdefault(name, wall)
        wall += 0.5
    return [(at, name) for name, at in found.items()]


@pytest.fixture
def silence() -> Silence:
    """An agent that has spoken at 10.0."""
    silence = Silence()
    silence.token("uav", "b1", True, 9.0)
    silence.word("uav", "b1", 10.0)
    return silence


def test_who_speaks_once_a_second_is_not_silent(silence: Silence) -> None:
    for second in range(11, 60):
        assert not looked_at(silence, second - 1, second - 0.5)
        silence.word("uav", "b1", second)


def test_who_says_nothing_any_more_is_silent_after_the_patience(silence: Silence) -> None:
    assert looked_at(silence, 10, 30) == [(10 + SILENT_AFTER, "uav")]


def test_who_speaks_again_is_not_silent_any_more(silence: Silence) -> None:
    looked_at(silence, 10, 20)
    silence.word("uav", "b1", 20.2)
    assert not silence.silent(20.5)


def test_the_first_word_may_take_longer() -> None:
    silence = Silence()
    silence.token("uav", "b1", True, 0.0)
    assert looked_at(silence, 0, 60) == [(FIRST_HEALTH, "uav")]


def test_a_patience_that_is_longer_than_the_first_word_may_take_counts_for_it_too() -> None:
    silence = Silence(FIRST_HEALTH + 10)
    silence.token("uav", "b1", True, 0.0)
    assert looked_at(silence, 0, 60) == [(FIRST_HEALTH + 10, "uav")]


def test_who_has_no_token_is_not_judged(silence: Silence) -> None:
    silence.token("uav", "b1", False, 11.0)
    silence.word("uav", "b1", 12.0)
    assert not looked_at(silence, 10, 60)


def test_a_new_life_speaks_for_the_old_one_whose_token_is_still_there(silence: Silence) -> None:
    silence.token("uav", "b2", True, 14.0)
    assert looked_at(silence, 14, 60) == [(14 + FIRST_HEALTH, "uav")]
    silence.word("uav", "b2", 60.0)
    assert not silence.silent(60.5)


def test_after_a_pause_of_our_own_others_have_time_to_be_heard(silence: Silence) -> None:
    assert not looked_at(silence, 10, 12)
    assert looked_at(silence, 40, 60) == [(40 + CATCH_UP, "uav")]


def test_a_pause_of_our_own_excuses_nobody_for_longer_than_that(silence: Silence) -> None:
    assert not looked_at(silence, 10, 11)
    assert looked_at(silence, 13, 60) == [(10 + SILENT_AFTER, "uav")]


def test_after_the_router_was_away_words_have_time_to_come(silence: Silence) -> None:
    silence.excuse(14.0, SILENT_AFTER)
    assert looked_at(silence, 14, 60) == [(14 + SILENT_AFTER, "uav")]


def test_who_hangs_and_then_dies_was_not_back_between(silence: Silence) -> None:
    looked_at(silence, 10, 20)
    silence.token("uav", "b1", False, 20.0)
    assert silence.silent(20.5) == ["uav"]
    silence.token("uav", "b2", True, 22.0)
    assert not silence.silent(22.5), "another life of it is there"


def test_who_hangs_hangs_on_when_its_token_is_told_again(silence: Silence) -> None:
    looked_at(silence, 10, 20)
    silence.excuse(20.0, SILENT_AFTER)
    silence.token("uav", "b1", True, 20.0)
    assert silence.silent(20.5) == ["uav"]
    silence.word("uav", "b1", 21.0)
    assert not silence.silent(21.5)


def test_who_has_spoken_has_no_first_word_to_say_when_its_token_comes_again(silence: Silence) -> None:
    silence.token("uav", "b1", False, 11.0)
    silence.token("uav", "b1", True, 12.0)
    assert looked_at(silence, 12, 60) == [(12 + SILENT_AFTER, "uav")]
