"""The reasoning cycle: inputs, due timers, conditions, one message, one event, one formula of one intention."""

from __future__ import annotations

from typing import Any

from agentd.mind.execution import run_intention
from agentd.mind.goal_conditions import check_goal_conditions
from agentd.mind.intake import take_inputs
from agentd.mind.messages import receive
from agentd.mind.selection import take_event
from agentd.mind.waiting import check_conditions


def run_cycles(mind: Any, cycles: int) -> None:
    """Run up to so many cycles; the end of the first that has an effect, or leaves nothing to do, is the last."""
    events, running, timers = mind.events, mind.running, mind.timers.heap
    while cycles:
        cycles -= 1
        mind.cycle += 1
        if mind.inputs:
            take_inputs(mind)
        if timers and timers[0].due <= mind.now:
            mind.timers.run(mind.now)
        if mind.changes != mind.changes_seen:
            mind.changes_seen = mind.changes
            if mind.conditions:
                check_conditions(mind)
            if mind.goal_conditions:
                check_goal_conditions(mind)
        if mind.atomic is not None:
            if not _atomic_cycle(mind):
                return
            if mind.effects:
                return
            continue
        if mind.mailbox:
            mail = mind.mailbox.popleft()
            if mind.on_input is not None:
                mind.on_input(mind.cycle, mail)
            receive(mind, mail)
        while events:
            if take_event(mind, events.popleft()):
                break
        if mind.atomic is None and running:
            run_intention(mind, running.popleft())
        elif not events and not mind.inputs and not mind.mailbox:
            return
        if mind.effects:
            return


def _atomic_cycle(mind: Any) -> bool:
    """A cycle while an atomic plan runs: only its own events and formulas. False when it has to wait."""
    atomic = mind.atomic
    assert atomic is not None
    for place, event in enumerate(mind.events):
        if event[3] is atomic:
            del mind.events[place]
            take_event(mind, event)
            break
    if atomic in mind.running:
        mind.running.remove(atomic)
        run_intention(mind, atomic)
        return True
    return mind.atomic is not atomic or atomic_can_run(mind)


def atomic_can_run(mind: Any) -> bool:
    """Whether the atomic intention has a formula to run or an event to be taken."""
    atomic = mind.atomic
    return atomic in mind.running or any(e[3] is atomic for e in mind.events)
