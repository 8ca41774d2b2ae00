"""Who offers what, who joined, who is told: without a bus or a disk."""

import pytest

from commd.directory.registry import Problem, Services
from schemas.mission.access_rules import MOST_SERVICES, checked
from schemas.wire.records import BoardServices, Header
from tests.support.notes import identities

MISSION = {"a": "pi1", "b": "pi2", "c": "pi1"}


@pytest.fixture
def here() -> Services:
    return Services("pi1", MISSION, ("pi1", "pi2"), frozenset({"uav1", "pi1", "pi2"}))


def says(version: int, *, boot: str = "x", board: str = "pi2", **agents: tuple[str, ...]) -> BoardServices:
    return BoardServices(header=Header(boot=boot), board=board, version=version, agents=agents)


def test_the_agents_of_the_mission_are_known_before_any_board_has_said_anything(here: Services) -> None:
    assert here.homes() == MISSION
    assert here.agents() == {"a": (), "c": ()}


def test_who_joins_is_known_until_it_leaves(here: Services) -> None:
    joined = here.join("kid")
    assert joined.homes() == {**MISSION, "kid": "pi1"}
    assert joined.join("kid") is joined, "a client that starts again"
    left = joined.leave("kid")
    assert left.homes() == MISSION
    assert (here.own.version, joined.own.version, left.own.version) == (0, 1, 2)


def test_who_stays_does_so_until_it_joins_without_saying_so_or_leaves(here: Services) -> None:
    staying = here.join("kid", stays=True)
    assert staying.own.staying == ("kid",)
    assert staying.join("kid", stays=True) is staying
    assert staying.join("kid").own.staying == ()
    assert here.join("kid").join("kid", stays=True).own.staying == ("kid",)
    assert staying.leave("kid").own.staying == ()


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("b", "the name `b` is taken on board pi2"),
        ("far", "the name `far` is taken on board pi2"),
        ("uav1", "the name `uav1` is taken"),
        ("pi2", "the name `pi2` is taken"),
        ("no name", "Expected a name of letters"),
    ],
)
def test_a_name_that_is_taken_anywhere_cannot_join(here: Services, name: str, why: str) -> None:
    here, _, _ = here.heard(says(1, b=(), far=()))
    with pytest.raises(Problem, match=why):
        here.join(name)


def test_an_agent_of_the_mission_joins_and_leaves_its_own_board_without_being_forgotten(here: Services) -> None:
    assert here.join("a") is here
    offering, _ = here.register("a", "cook")
    assert offering.leave("a").agents() == {"a": (), "c": ()}


def test_several_agents_leave_together_in_one_change(here: Services) -> None:
    offering = here.register("a", "cook")[0].register("c", "sing")[0].subscribe("c", "cook")[0]
    left = offering.leave("a", "c")
    assert (left.agents(), left.own.wants) == ({"a": (), "c": ()}, {})
    assert left.own.version == offering.own.version + 1


def test_providers_stand_in_the_order_of_the_mission_whatever_came_first(here: Services) -> None:
    here, _, _ = here.heard(says(1, b=("cook",)))
    for agent in ("c", "a"):
        here, _ = here.register(agent, "cook")
    assert here.providers("cook") == ("a", "c", "b")
    assert here.deregister("a", "cook").providers("cook") == ("c", "b")
    assert here.deregister("a", "unknown") is here


def test_a_subscriber_is_told_of_those_there_and_once_of_each_to_come(here: Services) -> None:
    here, _ = here.register("a", "cook")
    here, told = here.subscribe("c", "cook")
    assert told == [("c", "a", "cook")]
    here, told = here.register("a", "cook")
    assert told == []
    here, told, _ = here.heard(says(1, b=("cook",)))
    assert told == [("c", "b", "cook")]
    here, told, _ = here.heard(says(1, boot="y", b=("cook", "sing")))
    assert told == []
    here, told = here.leave("c").register("c", "cook")
    assert told == [], "who has left is told nothing"


def test_what_a_board_said_before_is_no_news_but_its_new_life_is(here: Services) -> None:
    here, _, _ = here.heard(says(3))
    assert not here.news(says(3))
    assert not here.news(says(2)), "an answer that was overtaken"
    assert here.news(says(4))
    assert here.news(says(1, boot="y")), "a board that has lost its file counts anew"


def test_who_left_another_board_is_forgotten_and_the_missions_agents_are_not(here: Services) -> None:
    here, _, gone = here.heard(says(1, b=(), kid=("cook",)))
    assert here.homes()["kid"] == "pi2"
    assert gone == []
    here, _, gone = here.heard(says(2))
    assert gone == ["kid"]
    assert here.homes() == MISSION
    assert here.providers("cook") == ()


def test_a_board_says_nothing_of_agents_that_the_mission_puts_elsewhere(here: Services) -> None:
    here, _, _ = here.heard(says(1, a=("cook",)))
    assert here.homes() == MISSION
    assert here.providers("cook") == ()


def test_an_agent_that_joined_two_boards_that_did_not_see_each_other_is_told_of_and_ours_counts(here: Services) -> None:
    here, _, _ = here.join("kid").heard(says(1, kid=()))
    assert identities(here.doubled()) == [("agent_twice", "kid")]
    assert here.homes()["kid"] == "pi1"


def test_only_agents_of_this_board_register_here_and_no_more_than_is_sane(here: Services) -> None:
    with pytest.raises(Problem, match="`b` is no agent of board pi1 but of pi2"):
        here.register("b", "cook")
    with pytest.raises(Problem, match=r"`nobody` is no agent of board pi1$"):
        here.subscribe("nobody", "cook")
    with pytest.raises(Problem, match="expected the name of a service"):
        here.register("a", "")
    for number in range(MOST_SERVICES):
        here, _ = here.register("a", f"s{number}")
    with pytest.raises(Problem, match=f"an agent offers at most {MOST_SERVICES} services"):
        here.register("a", "one more")


def test_of_a_board_only_names_are_taken_that_it_may_speak_for() -> None:
    said = says(1, boot="x", board="pi2", b=("cook",), pi2_kid=(), pi1_kid=(), uav1=())
    assert checked(said, MISSION, secured=False) is said
    taken = checked(said, MISSION, secured=True)
    assert taken.agents == {"b": ("cook",), "pi2_kid": ()}
