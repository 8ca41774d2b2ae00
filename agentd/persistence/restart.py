"""An agent that is back: what it hears, and which of its goals it takes up again (docs/guides/restart.md)."""

from __future__ import annotations

import logging
from collections.abc import Iterable

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.from_ast import Instantiation
from agentd.language.terms.terms import Literal
from agentd.mind import Mind
from agentd.mind.beliefs.dynamic_formulas import FunctionsOf
from agentd.mind.beliefs.term_copy import with_source
from agentd.mind.execution.goal_execution import add_goal
from agentd.mind.persistence.change_tracking import Keeper

log = logging.getLogger("agent")

RESTARTED = signature("restarted", 1)


def come_back(
    mind: Mind, keeper: Keeper, life: int, interrupted: Iterable[Literal], instead: nodes.Goal | None
) -> None:
    """Tell a restored mind that it is back for the `life`-th time, what was interrupted, and what it is to go on with.

    What others have asked for goes on in any case. Its own pending goals do, unless it has a plan for `+restarted(N)`,
    which then decides, or `instead` a goal of the mission file is to be achieved.
    """
    decides = bool(mind.plans.relevant("+", "", RESTARTED).plans)
    raise_event(mind, Literal(RESTARTED, (float(life),)))
    for one in interrupted:
        raise_interrupted(mind, keeper, one)
    own = not decides and instead is None
    posted = keeper.resume(own=own)
    log.info("agent=%s restarted=%d resumed=%d", mind.name, life, posted)
    if not own and keeper.pending_own:
        log.info("agent=%s left to the program: %s", mind.name, "; ".join(map(str, keeper.pending_own)))
    if instead is not None and not decides:
        add_goal(mind, Instantiation({}, FunctionsOf(mind)).term(instead.literal), instead.operator)


def raise_interrupted(mind: Mind, keeper: Keeper, literal: Literal) -> None:
    """Say how an action of a former life has ended. What is pending of that goes on in any case in further lives:
    the action itself is forgotten when this is kept.
    """
    before = len(mind.events)
    raise_event(mind, literal)
    if len(mind.events) > before:
        keeper.give_in_any_case(mind.events[-1])


def raise_event(mind: Mind, literal: Literal) -> None:
    """Raise an event of the agent's own without a belief."""
    mind.post(mind.plans.relevant("+", "", literal.sig), literal.args, with_source(literal.annots))
