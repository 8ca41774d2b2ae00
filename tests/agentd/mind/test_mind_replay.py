"""A recording of a mind's inputs, each with its cycle, replays to the same decisions."""

from __future__ import annotations

from typing import Any

from agentd.mind.data.effects import Effect
from agentd.mind.data.inputs import ActionDone, Input, Mail, PerceptReplaced, TimeRead
from tests.agentd.minds import mind_of, term

PROGRAM = """
    +altitude(A) : A > 10 <- .random(R); .print("high ", A, " ", R); land.
    +altitude(A) <- .nano_time(T); .print("low ", A, " at ", T).
    +hello(X)[source(S)] <- .print(S, " says ", X); .send(S, tell, hello(X)).
    !start.
    +!start <- .wait(500); .print("half a second"); !start.
"""


def _inputs(cycle: int) -> list[Input]:
    """What the world does, by cycle."""
    found: list[Input] = []
    if cycle % 7 == 0:
        found.append(PerceptReplaced(term(f"altitude({cycle % 13})")))
    if cycle % 11 == 0:
        found.append(Mail("ann", "tell", term(f"hello({cycle})")))
    if cycle % 29 == 0:
        found.append(ActionDone(cycle // 29, cycle % 2 == 0, "blocked"))
    return found


def test_the_same_inputs_in_the_same_cycles_give_the_same_effects() -> None:
    log: list[tuple[int, Input]] = []
    times = [0.0]
    mind = mind_of(PROGRAM, seed=7, clock=lambda: times[0], on_input=lambda cycle, item: log.append((cycle, item)))
    effects: list[tuple[int, Effect]] = []
    clock: dict[int, float] = {}
    for step in range(400):
        times[0] = step * 0.013
        for item in _inputs(step):
            mind.feed(item)
        clock[mind.cycle + 1] = times[0]
        found = mind.step(times[0])
        effects += [(mind.cycle, e) for e in found]
    assert len(effects) > 50
    assert any(isinstance(item, TimeRead) for _, item in log)

    readings = iter([item.seconds for _, item in log if isinstance(item, TimeRead)])
    again = mind_of(PROGRAM, seed=7, clock=lambda: next(readings))
    replayed: list[tuple[int, Any]] = []
    while again.cycle < mind.cycle:
        cycle = again.cycle + 1
        for at, item in log:
            if at == cycle and not isinstance(item, TimeRead):
                again.feed(item)
        found = again.step(clock[cycle])
        replayed += [(again.cycle, e) for e in found]
    assert replayed == effects


def test_two_minds_with_the_same_seed_and_inputs_agree_and_another_seed_differs() -> None:
    def decisions(seed: int) -> list[Effect]:
        mind = mind_of("!s. +!s <- .random(X); .random([a,b,c,d,e,f],Y); .print(X, Y).", seed=seed)
        return [e for _ in range(10) for e in mind.step(0.0)]

    assert decisions(1) == decisions(1)
    assert decisions(1) != decisions(2)
