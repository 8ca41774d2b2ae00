"""The events ``+jag_sleeping`` and ``+jag_awaking``: an agent has nothing left to do, and has something again (Jason).

They are inputs that a mind gives itself, recorded as others. Only programs with plans for them have them.
"""

from __future__ import annotations

from typing import Final

from agentd.mind.data.inputs import SignalRaised
from agentd.mind.state import MindState

_SLEEPING: Final = SignalRaised.named("jag_sleeping")
_AWAKING: Final = SignalRaised.named("jag_awaking")


def wake_up(mind: MindState) -> None:
    """Before cycles: end the sleep if there is an input, a message or a timer that is due. Its event comes first."""
    inputs, heap = mind.inputs, mind.timers.heap
    told = bool(inputs) and inputs[0] is _SLEEPING
    if mind.asleep and (len(inputs) > told or mind.mailbox or (heap and heap[0].due <= mind.now)):
        mind.asleep = False
        inputs.insert(int(told), _AWAKING)


def fall_asleep(mind: MindState) -> None:
    """After cycles without effect: begin a sleep if there is nothing left to do but to wait. Once until it ends."""
    if mind.asleep is not False or mind.atomic is not None:
        return
    mind.asleep = True
    if mind.ready:
        mind.asleep = False
    else:
        mind.inputs.append(_SLEEPING)
