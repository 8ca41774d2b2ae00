"""What a mind shows of itself: bounded, filtered as asked for, with sources and ages of beliefs; on a real bus."""

import time
from typing import Any

import pytest

from agentd.conversion.mind_view import (
    MOST_BELIEFS,
    BadParameter,
    Beliefs,
    Look,
    Plans,
    decisions_of,
    events_of,
    intentions_of,
)
from agentd.language.terms.format import flat_text, text
from agentd.mind.data.inputs import ActionDone, BeliefAdded, GoalAdded, Mail, PerceptReplaced
from agentd.mind.introspection.snapshots import question_views
from agentd.mind.persistence.change_tracking import Keeper
from commd.bus.bus import Bus
from commd.bus.errors import QueryFailed
from schemas.wire import keys
from schemas.wire.mind_records import BeliefView, MindView, WaitView
from tests.agentd.hosts import Board
from tests.agentd.minds import World, mind_of, term
from tests.support.buses import served, until


def shown(world: World, look: Look | None = None) -> list[BeliefView]:
    return list(Beliefs(world.mind).shown(look or Look(), world.now)[0])


def kept(source: str) -> World:
    """A mind that is kept, as agents are on a board; its beliefs are marked after each run, as the host does."""
    return World(mind_of(source, keeper=Keeper(None)))


def run(world: World, now: float) -> None:
    world.at(now)
    world.mind.beliefs.mark(now)


def test_a_belief_is_shown_with_its_sources_and_since_when() -> None:
    world = kept("map(1).")
    run(world, 1.0)
    world.feed(PerceptReplaced(term("altitude(20)")), Mail("ana", "tell", term("victim(3,4)")))
    run(world, 5.0)
    world.feed(PerceptReplaced(term("altitude(21)")), Mail("eva", "tell", term("victim(3,4)")))
    run(world, 7.5)
    assert shown(world) == [
        BeliefView(text="map(1)[source(self)]", sources=("self",), since=1.0),
        BeliefView(text="altitude(21)[source(percept)]", sources=("percept",), since=7.5),
        BeliefView(text="victim(3,4)[source(ana),source(eva)]", sources=("ana", "eva"), since=5.0),
    ], "a source that joins later does not make a belief younger"


async def test_nobody_knows_since_when_a_belief_of_a_former_life_is(board: Board) -> None:
    bus = await board.connect()
    first = await board.host("bob", "!go. +!go <- +seen(1).", bus=bus)
    await until(lambda: any("seen" in belief.text for belief in first.host.viewer.view().beliefs), "it believes")
    await first.end()
    again = await board.host("bob", "!go. +!go <- +seen(1).", bus=bus)
    again.tell(Mail("ana", "tell", term("news(1)")))
    await until(lambda: len(again.host.viewer.view().beliefs) == 2, "it believes again")
    old, new = again.host.viewer.view().beliefs
    assert (old.text, old.since) == ("seen(1)[source(self)]", None)
    assert new.since is not None
    assert new.since <= again.host.viewer.view().time


def test_a_mind_that_is_not_kept_tells_the_age_of_what_came_between_two_looks() -> None:
    world = World(mind_of("old(1)."))
    world.at(10.0)
    beliefs = Beliefs(world.mind)
    (old,), _ = beliefs.shown(Look(), 10.0)
    world.feed(BeliefAdded(term("new(1)"))).at(12.0)
    views, _ = beliefs.shown(Look(), 12.0)
    assert [(view.text, view.since) for view in views] == [
        ("old(1)[source(self)]", None),
        ("new(1)[source(self)]", 12.0),
    ]
    assert old.since is None
    later, _ = beliefs.shown(Look(), 20.0)
    assert [view.since for view in later] == [None, 12.0]


def test_old_ages_get_coarse_and_the_memory_for_them_stays_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.mind.persistence.belief_store.MOST_MARKS", 64)
    world = kept("")
    for second in range(1, 1001):
        world.feed(BeliefAdded(term(f"at({second})")))
        run(world, float(second))
    base: Any = world.mind.beliefs
    assert len(base._book._marks) <= 64
    ages = {view.text: view.since for view in shown(world, Look(beliefs=MOST_BELIEFS, about="at"))}
    late = [(ages[f"at({s})[source(self)]"] or 0.0) - s for s in range(501, 1001)]
    assert min(late) >= 0.0, "never earlier than it was"
    assert late[-30:] == [0.0] * 30
    assert max(late) < 500


def test_no_predicate_is_left_out_for_another_with_many_facts() -> None:
    many = " ".join(f"cell({number})." for number in range(3000))
    world = World(mind_of(f"{many} pose(1). home(2)."))
    views, left = Beliefs(world.settle().mind).shown(Look(), 0.0)
    assert len(views) == MOST_BELIEFS
    assert left == 3002 - MOST_BELIEFS
    names = {view.text.partition("(")[0] for view in views}
    assert names == {"cell", "pose", "home"}
    views, left = Beliefs(world.mind).shown(Look(beliefs=10), 0.0)
    assert (len(views), left) == (10, 2992)
    views, left = Beliefs(world.mind).shown(Look(about="home"), 0.0)
    assert ([view.text for view in views], left) == (["home(2)[source(self)]"], 0)
    assert Beliefs(world.mind).shown(Look(beliefs=0), 0.0) == ((), 3002)


def test_a_belief_that_changes_without_a_word_is_read_again_at_each_look() -> None:
    world = World(mind_of("!go. +!go <- .map.create(M); +store(M); .wait({+more}); .map.put(M, a, 1)."))
    beliefs = Beliefs(world.settle().mind)
    (before,), _ = beliefs.shown(Look(), 0.0)
    world.feed(GoalAdded(term("nothing")), BeliefAdded(term("more"))).settle()
    after = beliefs.shown(Look(), 0.0)[0][0]
    assert before.text != after.text


def test_a_huge_belief_is_cut_short() -> None:
    world = World(mind_of("!go. +!go <- .range(I, 1, 5); +x(I). +!go <- true."))
    world.feed(BeliefAdded(term(f"data([{','.join(map(str, range(50_000)))}])")))
    (view,) = [one for one in shown(world) if one.text.startswith("data")]
    assert len(view.text) < 2_001


def test_a_question_is_shown_until_its_answer_comes() -> None:
    world = World(mind_of("!go. +!go <- .send([ana,eva], askOne, where(home,X), A, 5000); .print(A).", has_team=True))
    world.at(2.0)
    asked = question_views(world.mind, "5f")
    assert [(one.receiver, one.performative, one.asked, one.until) for one in asked] == [
        ("ana", "askOne", 0.0, 5.0),
        ("eva", "askOne", 0.0, 5.0),
    ]
    assert asked[0].content == "where(home,X)"
    assert asked[0].position == "test.asl:1"
    (intention,), left = intentions_of(world.mind)
    assert (intention.since, asked[0].intention, left) == (0.0, intention.id, 0)
    assert intention.waits_for == WaitView(kind="answer", agents=("ana", "eva"))
    world.feed(Mail("ana", "tell", term("where(home,3)"), "mid1.ana", asked[0].id.removesuffix(".5f")))
    assert [one.receiver for one in question_views(world.mind, "5f")] == ["eva"]
    assert world.at(6.0).mind.questions == {}


def test_an_intention_says_since_when_it_waits_for_its_action() -> None:
    world = World(mind_of("!go. +!go <- .wait(3000); fly(1); fly(2)."))
    world.at(3.0)
    ((intention,), _) = intentions_of(world.mind)
    assert (intention.state, intention.since) == ("waiting", 3.0)
    assert intention.waits_for == WaitView(kind="action", name="fly")
    world.at(8.0).feed(ActionDone(1, True))
    ((intention,), _) = intentions_of(world.mind)
    assert intention.since == 8.0


def test_the_events_that_wait_are_shown_the_next_one_first() -> None:
    mind = mind_of("!a(1). !b(2). +!a(X) <- true. +!b(X) <- true.")
    shown_events, left = events_of(mind, "")
    assert [(event.text, event.intention) for event in shown_events] == [
        ("+!a(1)[source(self)]", 0),
        ("+!b(2)[source(self)]", 0),
    ]
    assert left == 0
    assert [event.text for event in events_of(mind, "b")[0]] == ["+!b(2)[source(self)]"]


def test_plans_are_shown_if_asked_for_with_what_they_are_for() -> None:
    mind = mind_of("@p[atomic] +!go(X) : at(Y) & X > Y <- fly(X); !!rest. +!rest <- true.")
    plans = Plans(mind)
    assert plans.shown(Look()) == ()
    go, rest = plans.shown(Look(plans=True))
    assert (go.label, go.trigger, go.position) == ("p[atomic]", "+!go(X)", "test.asl:1")
    assert go.context == "at(Y) & (X > Y)"
    assert go.uses == {"fly/1": "test.asl:1", "!!rest/0": "test.asl:1"}
    assert "fly(X)" in go.source
    assert [plan.trigger for plan in plans.shown(Look(plans=True, about="rest"))] == [rest.trigger]
    assert plans.shown(Look(plans=True))[0] is go, "what has not changed is not made anew"


def test_decisions_can_be_asked_for_by_name() -> None:
    world = World(mind_of("!a. +!a <- !b; !c. +!b <- true. +!c <- .fail.", decisions=50)).settle()
    decisions, failures = decisions_of(world.mind, Look(about="c"))
    assert [decision.event for decision in decisions] == ["+!c"]
    assert [failure.formula for failure in failures] == [".fail"]
    decisions, failures = decisions_of(world.mind, Look(last=1))
    assert len(decisions) + len(failures) == 1
    assert decisions_of(world.mind, Look(last=0)) == ((), ())


def test_a_decision_whose_outcome_is_known_is_not_made_again_and_others_are_sent_as_they_go_on() -> None:
    world = World(mind_of("!a. +!a <- !b; .wait(1000); .fail. +!b <- true.", decisions=50)).settle()
    (a, b), _ = decisions_of(world.mind)
    assert (a.outcome, b.outcome) == ("running", "ended")
    assert decisions_of(world.mind)[0] == (a, b)
    assert decisions_of(world.mind)[0][1] is b
    world.at(2.0)
    (again, same), (failure,) = decisions_of(world.mind)
    assert same is b
    assert (again.event, again.outcome, again.failure) == (a.event, "failed", failure)


def test_what_onlookers_were_shown_is_not_held_for_them(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World(mind_of("+!a(X) <- true.", decisions=10))
    for number in range(100):
        world.feed(GoalAdded(term(f"a({number})")))
        assert decisions_of(world.mind)[0][-1].event == f"+!a({number})"
    assert len(world.mind.recorder.shown) == 10
    world.mind.recorder.let_go()
    assert world.mind.recorder.shown == {}
    assert len(decisions_of(world.mind)[0]) == 10


@pytest.mark.parametrize(
    ("parameters", "told"),
    [
        ({"last": "201"}, "last=201: expected a number from 0 to 200"),
        ({"last": "-1"}, "last=-1: expected a number from 0 to 200"),
        ({"beliefs": "all"}, "beliefs=all: expected a number from 0 to 500"),
        ({"plans": "maybe"}, "plans=maybe: expected plans=true, last=N, beliefs=N or about=NAME"),
        ({"about": "a b"}, "about=a b: expected plans=true, last=N, beliefs=N or about=NAME"),
        ({"lats": "3"}, "lats=3: expected plans=true, last=N, beliefs=N or about=NAME"),
    ],
)
def test_a_bad_parameter_is_refused_in_words(parameters: dict[str, str], told: str) -> None:
    with pytest.raises(BadParameter) as error:
        Look.of(parameters)
    assert str(error.value) == told


def test_good_parameters_are_read() -> None:
    assert Look.of({}) == Look()
    assert Look.of({"plans": "", "last": "200", "beliefs": "0", "about": "go/2"}) == Look(True, 200, 0, "go")


async def ask(bus: Bus, selector: str) -> tuple[MindView | None, str]:
    try:
        return await bus.ask_one(selector, None, MindView, 10.0), ""
    except QueryFailed as failed:
        return None, str(failed)


async def test_an_observer_says_in_the_selector_what_it_wants_to_see(board: Board) -> None:
    agents, observer = await board.connect("board1"), await board.connect("eyes")
    bob = await board.host("bob", "a(1). b(2). !go. +!go <- .print(there).", bus=agents)
    key = keys.mind("test", "bob")
    await served(observer, key)
    await until(lambda: bob.prints == ["there"], "it has run")
    view, _ = await ask(observer, f"{key}?plans=true;about=a")
    assert view is not None
    assert [one.text for one in view.beliefs] == ["a(1)[source(self)]"]
    assert (view.plans, view.plan_count, view.program, view.state) == ((), 1, "bob.asl", "waiting")
    view, _ = await ask(observer, f"{key}?plans=true")
    assert view is not None
    assert [plan.trigger for plan in view.plans] == ["+!go"]
    assert [decision.event for decision in view.decisions] == ["+!go"]
    assert await ask(observer, f"{key}?last=many") == (None, "last=many: expected a number from 0 to 200")
    again, _ = await ask(observer, f"{key}?plans=true")
    assert again is not None


async def test_whoever_asks_all_the_time_is_shown_the_same_look_again(board: Board) -> None:
    agents, observer = await board.connect("board1"), await board.connect("eyes")
    await board.host("bob", "a(1).", bus=agents)
    key = keys.mind("test", "bob")
    await served(observer, key)
    numbers = []
    began = time.monotonic()
    for _ in range(100):
        view, _ = await ask(observer, key)
        numbers.append(view.header.seq)
    looks = len(set(numbers))
    assert looks <= (time.monotonic() - began) / 0.2 + 2
    assert looks < 100


@pytest.mark.parametrize(
    "written",
    [
        "a",
        "a(1)",
        '~b(c,"x")[source(self)]',
        "ns::go(1.5,f(g(h)))",
        "a[b,c(1)]",
        "a(-1)",
        "a([1])",
        "a(X)",
        "a(f(f(f(f(f(1))))))",
    ],
)
def test_the_quick_way_to_a_text_leads_to_the_same_text(written: str) -> None:
    assert flat_text(term(written)) in (None, text(term(written)))


def test_a_belief_that_is_looked_at_before_its_time_is_known_gets_it_later() -> None:
    world = kept("map(1).")
    beliefs = Beliefs(world.mind)
    assert [view.since for view in beliefs.shown(Look(), 0.0)[0]] == [None]
    run(world, 2.0)
    assert [view.since for view in beliefs.shown(Look(), 2.0)[0]] == [2.0]
