"""Mail while an atomic plan waits: the rescuers' negotiation of the paper, in minds on virtual time.

Each rescuer claims a victim in an atomic plan, waits for a random time and tests what the other has told meanwhile.
"""

import pytest

from agentd.mind.data.inputs import Mail
from tests.agentd.minds import World, mind_of, term
from tests.agentd.teams import Stage, played

FIRST_COME = """
@claim[atomic]
+!claim(V) : other(Other)
   <- .random(R); .wait(R * 1000);
      if (taken(V)[source(Other)]) { .print("stays ", V) } else { .send(Other, tell, taken(V)); .print("goes ", V) }.
"""
LOWEST_BID = """
@claim[atomic]
+!claim(V) : other(Other)
   <- .random(R); .wait(R * 300); .send(Other, tell, bid(V, R));
      .wait(bid(V, _), 30000, _);
      if (bid(V, Bid)[source(Other)] & Bid < R) { .print("stays ", V) } else { .print("goes ", V) }.
"""
RESCUER = "other({other}). +victim(V) <- !claim(V).\n"
SCOUT = "!go. +!go <- for (.member(V, [v1, v2, v3])) { .send([r1, r2], tell, victim(V)); .wait(3000) }.\n"


def rescuers(claim: str) -> dict[str, str]:
    return {"r1": RESCUER.format(other="r2") + claim, "r2": RESCUER.format(other="r1") + claim}


def decisions(lines: list[str]) -> dict[str, list[str]]:
    """What was decided for each victim, by both rescuers."""
    found: dict[str, list[str]] = {}
    for line in lines:
        _, decision, victim = line.split()
        found.setdefault(victim, []).append(decision)
    return found


@pytest.mark.parametrize("claim", [FIRST_COME, LOWEST_BID], ids=["first come", "lowest bid"])
def test_of_two_rescuers_that_claim_in_an_atomic_plan_exactly_one_goes(claim: str) -> None:
    for seed in range(20):
        seeded = {
            name: f"!seed. +!seed <- .set_random_seed({seed * 7 + place}).\n" for place, name in ((1, "r1"), (2, "r2"))
        }
        agents = {name: seeded[name] + text for name, text in rescuers(claim).items()}
        stage = Stage({**agents, "scout": SCOUT})
        stage.run()
        found = decisions(stage.lines)
        assert found.keys() == {"v1", "v2", "v3"}
        assert all(sorted(both) == ["goes", "stays"] for both in found.values()), (seed, stage.lines)


ATOMIC = "@busy[atomic] +!go <- {body}; .print(over). +note(N) <- .print(note, N). +!g(N) <- .print(goal, N)."


def in_an_atomic_plan(body: str, *mail: Mail) -> World:
    """Bob's world when mail has come while his atomic plan waits, before its wait is over."""
    world = World(mind_of("!go. fact(7). " + ATOMIC.format(body=body), agents=lambda: ["bob", "amy"], has_team=True))
    return world.settle().feed(*mail)


def test_a_wait_of_an_atomic_plan_ends_by_what_is_told() -> None:
    world = in_an_atomic_plan(".wait(note(_), 30000)", Mail("amy", "tell", term("note(1)")))
    assert world.prints == ["over", "note1"]


def test_an_answer_reaches_the_atomic_plan_that_asked() -> None:
    assert played({"bob": "!go. @a[atomic] +!go <- .send(amy, askOne, fact(_), F); .print(F).", "amy": "fact(7)."}) == [
        "[bob] fact(7)[source(amy)]"
    ]


def test_what_is_no_single_literal_has_its_effect_after_the_atomic_plan_in_the_order_of_arrival() -> None:
    world = in_an_atomic_plan(
        ".wait(1000); if (note(_)) { .print(known) }",
        Mail("amy", "tell", term("[note(1), note(2)]")),
        Mail("amy", "askOne", term("fact(_)"), "m1"),
        Mail("amy", "achieve", term("g(3)")),
        Mail("amy", "signal", term("note(4)")),
    )
    assert world.prints == []
    assert not world.mind.mailbox, "all is taken: what waits are events, which a checkpoint holds"
    world.at(1.0)
    assert world.prints == ["over", "goal3", "note1", "note2", "note4"]


def test_mail_waits_at_its_board_while_there_is_no_room_for_its_events(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("agentd.mind.state.MOST_FOCUSES", 3)
    told = [Mail("amy", "tell", term(f"note({number})")) for number in range(1, 6)]
    world = in_an_atomic_plan(".wait(1000)", *told)
    assert len(world.mind.mailbox) == 3
    assert world.mind.drops.counts == {}
    assert world.at(1.0).prints == ["over", "note1", "note2", "note3", "note4", "note5"]
