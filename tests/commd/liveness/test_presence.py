"""When an agent counts as gone: virtual time, no bus."""

from __future__ import annotations

import math

import pytest

from commd.liveness.presence import Presence
from schemas.liveness import AGENT_GRACE, BUS_GRACE, ROUTER_GRACE


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
