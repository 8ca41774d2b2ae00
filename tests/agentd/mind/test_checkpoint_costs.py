"""What keeping a mind costs, in instructions of the interpreter: as much as has changed, and nothing if not kept."""

from collections.abc import Callable
from pathlib import Path

import pytest

from agentd.mind.beliefs.belief_base import Predicate
from agentd.mind.data.inputs import BeliefAdded, GoalAdded, Mail, PerceptReplaced
from agentd.persistence.checkpoint import AgentRows, Checkpoint
from tests.agentd.kept_minds import Life, begun
from tests.agentd.mind.test_mind_costs import instructions
from tests.agentd.minds import World, mind_of, run, term

SOURCE = """
+!add(N) <- +new(N). +!del(N) <- -fact(N, N). +!note(N) <- +fact(N, N)[noted(N)]. +!rest <- .wait(1000000).
+!send(N) <- .send(ann, tell, N). +got(X) <- +had(X).
"""


def life_with(facts: int) -> Life:
    life = begun(SOURCE)
    life.feed(*[BeliefAdded(term(f"fact({number}, {number})")) for number in range(facts)])
    life.save()
    return life


def cost_of(act: Callable[[Life], object], facts: int) -> int:
    """What it costs to save after an act, the second time: what is made once is there then."""
    life = life_with(facts)
    act(life)
    life.keeper.changes()
    act(life)
    return instructions(life.keeper.changes)


@pytest.mark.parametrize(
    "act",
    [
        lambda life: life.feed(GoalAdded(term(f"add({life.mind.cycle})"))),
        lambda life: life.feed(GoalAdded(term(f"del({life.mind.cycle % 20})"))),
        lambda life: life.feed(GoalAdded(term("note(3)"))),
        lambda life: life.feed(Mail("ann", "tell", term(f"got({life.mind.cycle})"), "mid1")),
        lambda life: life.feed(PerceptReplaced(term(f"at({life.mind.cycle})"))),
        lambda life: None,
    ],
    ids=["a fact added", "a fact deleted", "a fact annotated", "a message", "a percept", "nothing"],
)
def test_a_save_costs_as_much_as_has_changed_however_many_beliefs_there_are(act: Callable[[Life], object]) -> None:
    few, many = cost_of(act, 20), cost_of(act, 2000)
    assert many <= few * 1.1, f"{few} instructions with 20 facts, {many} with 2000"


def test_a_save_costs_in_proportion_to_what_has_changed() -> None:
    def add(number: int) -> Callable[[Life], object]:
        return lambda life: life.feed(*[BeliefAdded(term(f"b({life.mind.cycle}, {n})")) for n in range(number)])

    ten, hundred = cost_of(add(10), 20), cost_of(add(100), 20)
    assert hundred < ten * 12


def test_a_save_writes_only_rows_that_have_changed(tmp_path: Path) -> None:
    life = life_with(2000)
    checkpoint = Checkpoint.open(tmp_path / "bob.minds")
    checkpoint.save({"bob": AgentRows(mind=life.keeper.changes())})
    before = checkpoint._database.total_changes
    life.feed(GoalAdded(term("add(1)")), GoalAdded(term("note(7)")), GoalAdded(term("rest")))
    checkpoint.save({"bob": AgentRows(mind=life.keeper.changes())})
    assert checkpoint._database.total_changes - before <= 8  # two beliefs, one goal, predicates new


def test_intentions_that_wait_on_are_not_written_again() -> None:
    life = begun(SOURCE).feed(*[GoalAdded(term("rest"))] * 50)
    assert len(life.save().pending) == 50
    changes = life.feed(GoalAdded(term("add(1)"))).save()
    assert changes.pending == []
    assert changes.pending_gone == []


def test_a_percept_costs_a_mind_that_is_kept_little_more() -> None:
    def cost(world: World) -> int:
        for value in range(3):
            world.feed(PerceptReplaced(term(f"at({value})")))
        world.mind.feed(PerceptReplaced(term("at(9)")))
        return instructions(lambda: world.mind.run(0.0, 1))

    assert cost(begun(SOURCE)) <= cost(run(SOURCE)) * 1.4


def test_a_mind_that_is_not_kept_has_nothing_of_it() -> None:
    mind = mind_of("p(1). !g. +!g <- +q(1).")
    assert all(type(predicate) is Predicate for predicate in mind.beliefs.predicates())
    assert mind.origins is None
