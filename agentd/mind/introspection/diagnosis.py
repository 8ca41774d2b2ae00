"""Why no plan was applicable, found at the moment of failure in minds that keep no decision records.

A context is asked again only if that changes nothing: nothing but beliefs, rules, comparisons and internal actions that
have no effect. The state is the one of the decision, since it is asked in the same step.
"""

from __future__ import annotations

from typing import Any, Final

from agentd.language.compiler.constants import signature_of
from agentd.language.syntax_tree import nodes
from agentd.mind.beliefs.belief_base import RuleClause
from agentd.mind.beliefs.unification import undo
from agentd.mind.data.intention import Event, Frame
from agentd.mind.introspection.decision_views import PASSED_OVER, RejectedView, rejected_view
from agentd.mind.plans.effect_free import WITHOUT_EFFECT
from agentd.mind.plans.nested_plans import candidates
from agentd.mind.plans.plan_library import Plan
from agentd.mind.state import MindState

_RANDOM: Final = "math.random"


def rejected_plans(mind: MindState, event: Event) -> tuple[RejectedView, ...]:
    """Why each plan that is relevant for an event was not applicable just now."""
    if mind.recorder is not None:
        return tuple(rejected_view(plan, reason) for plan, reason in mind.recorder.last_rejected())
    return tuple(_rejected(mind, plan, around, event) for plan, around in candidates(mind, event[0], event[3]))


def _rejected(mind: MindState, plan: Plan, around: Frame | None, event: Event) -> RejectedView:
    if not harmless(mind, plan.syntax.context):
        return rejected_view(plan, ())
    relevant, args, annots, intention = event
    trail: list[Any] = [] if intention is None else intention.trail
    mark, told = len(trail), len(mind.effects)
    try:
        found = plan.tracing()(mind, trail, relevant, args, annots, around)
    except Exception as error:  # as when the plan was tried
        found = error
    undo(trail, mark)
    del mind.effects[told:]
    if type(found) is list:
        found = PASSED_OVER if mind.compiler.form == "options" else ()
    return rejected_view(plan, found)


def harmless(mind: MindState, formula: Any, seen: frozenset[Any] = frozenset()) -> bool:
    """Whether asking a formula (or building a term) has no effect."""
    match formula:
        case nodes.InternalAction(name=name, args=args):
            known = name in WITHOUT_EFFECT or (mind.compiler.is_function(name, len(args)) and name != _RANDOM)
            return known and all(harmless(mind, arg, seen) for arg in args)
        case nodes.And(left=left, right=right) | nodes.Or(left=left, right=right):
            return harmless(mind, left, seen) and harmless(mind, right, seen)
        case nodes.Not(operand=operand):
            return harmless(mind, operand, seen)
        case nodes.Relation(left=left, right=right):
            return harmless(mind, left, seen) and harmless(mind, right, seen)
        case nodes.Arithmetic(operands=operands):
            return all(harmless(mind, operand, seen) for operand in operands)
        case nodes.Structure(args=args):
            return all(harmless(mind, arg, seen) for arg in args) and _harmless_rules(mind, formula, seen)
        case nodes.ListTerm(items=items):
            return all(harmless(mind, item, seen) for item in items)
        case nodes.Variable(namespace=None) | nodes.Number() | nodes.String() | None:
            return True
    return False


def _harmless_rules(mind: MindState, formula: nodes.Structure, seen: frozenset[Any]) -> bool:
    if isinstance(formula.namespace, nodes.Variable):
        return False
    sig = signature_of(formula)
    if sig in seen:
        return True
    predicate = mind.beliefs.known(sig)
    rules = [] if predicate is None else [e for e in predicate.entries.values() if type(e) is RuleClause]
    return all(harmless(mind, rule.syntax.body, seen | {sig}) for rule in rules)
