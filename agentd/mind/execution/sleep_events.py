"""The events ``+jag_sleeping`` and ``+jag_awaking``: an agent has nothing left to do, and has something again (Jason).

They are inputs that a mind gives itself, recorded as others. Only programs with plans for them have them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from agentd.language.syntax_tree.nodes import Structure, Trigger
from agentd.mind.data.inputs import SignalRaised

if TYPE_CHECKING:
    from agentd.mind.mind import Mind

_SLEEPING: Final = SignalRaised.named("jag_sleeping")
_AWAKING: Final = SignalRaised.named("jag_awaking")


def is_about_sleep(trigger: Trigger) -> bool:
    """Whether a plan's trigger is for one of these events."""
    literal = trigger.literal
    return isinstance(literal, Structure) and literal.functor in ("jag_sleeping", "jag_awaking") and not literal.args


def wake_up(mind: Mind) -> None:
    """Before cycles: end the sleep if there is an input, a message or a timer that is due. Its event comes first."""
    inputs, heap = mind.inputs, mind.timers.heap
    told = bool(inputs) and inputs[0] is _SLEEPING
    if mind.asleep and (len(inputs) > told or mind.mailbox or (heap and heap[0].due <= mind.now)):
        mind.asleep = False
        inputs.insert(int(told), _AWAKING)


def fall_asleep(mind: Mind) -> None:
    """After cycles without effect: begin a sleep if there is nothing left to do but to wait. Once until it ends."""
    if mind.asleep is not False or mind.atomic is not None:
        return
    mind.asleep = True
    if mind.ready:
        mind.asleep = False
    else:
        mind.inputs.append(_SLEEPING)
