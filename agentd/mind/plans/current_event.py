"""Contexts that ask for the intention they are evaluated for: the event in hand is noted for them alone."""

from __future__ import annotations

from typing import Any, Final

from agentd.language.syntax_tree import nodes
from agentd.mind.beliefs.unification import Trail
from agentd.mind.data.frames import Frame
from agentd.mind.data.intention import Intention
from agentd.mind.plans.nested_plans import select_nested

_ASKING: Final = frozenset({".intention", ".current_intention"})


def asks_for_intention(formula: Any) -> bool:
    """Whether a formula looks at intentions."""
    pending = [formula]
    while pending:
        match pending.pop():
            case nodes.InternalAction(name=name) if name in _ASKING:
                return True
            case nodes.InternalAction(args=args):
                pending.extend(args)
            case nodes.And(left=left, right=right) | nodes.Or(left=left, right=right):
                pending += (left, right)
            case nodes.Not(operand=operand):
                pending.append(operand)
    return False


def select_noted(mind: Any, trail: Trail, event: Any) -> Frame | None:
    """The frame of the first applicable plan, with the event known to its context as the one in hand."""
    mind.plans.taken = event
    try:
        return select_nested(mind, trail, event)
    finally:
        mind.plans.taken = None


def intention_in_hand(mind: Any) -> Intention | None:
    """The intention that is running, or whose event is being given a plan."""
    taken = mind.plans.taken
    found: Intention | None = mind.current if taken is None else taken[3]
    return found
