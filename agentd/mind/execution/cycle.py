"""The reasoning cycle: inputs, due timers, conditions, one message, one event, one formula of one intention."""

from __future__ import annotations

from typing import TYPE_CHECKING

from agentd.mind.execution.dropping import check_goal_conditions
from agentd.mind.execution.execution import run_intention
from agentd.mind.execution.input_handling import take_inputs
from agentd.mind.execution.messages import receive
from agentd.mind.execution.waiting import check_conditions
from agentd.mind.state import MindState

if TYPE_CHECKING:
    from agentd.mind.data.inputs import Mail


def run_cycles(mind: MindState, cycles: int) -> None:
    """Run at most ``cycles`` cycles; stop after the first that has an effect or leaves nothing to do."""
    inputs, mailbox, events, running, timers, conditions, goal_conditions = mind.queues
    effects, take_event = mind.effects, mind.take_event
    for _ in range(cycles):
        mind.cycle += 1
        if (
            inputs
            and take_inputs(mind)
            and not (events or running or mailbox or inputs or goal_conditions)
            and mind.atomic is None
            and not (timers and timers[0].due <= mind.now)
        ):  # percepts that no plan is for: as most cycles of an agent with a robot are
            if conditions and mind.changes != mind.changes_seen:
                mind.changes_seen = mind.changes
                check_conditions(mind)
            if not (running or events or effects):
                mind.still += 1
                return
        if timers and timers[0].due <= mind.now:
            mind.timers.run(mind.now)
        if (conditions or goal_conditions) and mind.changes != mind.changes_seen:
            mind.changes_seen = mind.changes
            check_conditions(mind)
            check_goal_conditions(mind)
        if mind.atomic is not None:
            if not atomic_cycle(mind):
                return
            if effects:
                return
            continue
        if mailbox:
            mail = mailbox.popleft()
            if mind.on_input is None and mind.recorder is None:  # nobody to notify: one call less for each message
                receive(mind, mail)
            else:
                take_mail(mind, mail)
        while events:
            if take_event(mind, events.popleft()):
                break
        if running and mind.atomic is None:
            run_intention(mind, running.popleft())
        elif not (events or inputs or mailbox):
            return
        if effects:
            return


def take_mail(mind: MindState, mail: Mail) -> None:
    """Handle one message out of the mailbox."""
    if mind.on_input is not None:
        mind.on_input(mind.cycle, mail)
    if mind.recorder is not None:
        mind.recorder.given(mind.cycle, mail)
    receive(mind, mail)


def atomic_cycle(mind: MindState) -> bool:
    """A cycle while an atomic plan runs: one message, then its own events and formulas alone. False when it waits."""
    atomic = mind.atomic
    assert atomic is not None
    if mind.mailbox and not mind.crowded:  # an event waits for the plan's end and needs room
        take_mail(mind, mind.mailbox.popleft())
        if atomic.waiting is not None:
            return True
    events, running = mind.events, mind.running
    if not running or running[-1] is not atomic:
        for place in range(len(events) - 1, -1, -1):  # its own is the last one as a rule
            event = events[place]
            if event[3] is atomic:
                del events[place]
                mind.take_event(mind, event)
                break
    if running and running[-1] is atomic:  # as a rule
        running.pop()
    elif atomic in running:
        running.remove(atomic)
    else:
        return mind.atomic is not atomic or mind.atomic_can_run
    run_intention(mind, atomic)
    return True
