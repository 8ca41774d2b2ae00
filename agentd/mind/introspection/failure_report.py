"""Reports of failures that nothing handles: which formula, with its values, where, for which goal, and why.

In minds without decision records the reason why no plan was applicable is found at the moment of failure. A context is
asked again only if that has no effect: beliefs, rules, comparisons, internal actions without effect. It is asked in the
same step, so the state is that of the decision.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

from agentd.language.compiler.constants import signature_of
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import CLOSE, near
from agentd.language.syntax_tree.traversal import parts
from agentd.language.terms.terms import Literal, deref
from agentd.mind.beliefs.belief_base import RuleClause
from agentd.mind.beliefs.unification import undo
from agentd.mind.beliefs.work_limit import PURE
from agentd.mind.data.effects import Log
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import PLAN, RELEVANT, Event, Frame
from agentd.mind.data.registry import ACTIONS, find_action
from agentd.mind.introspection.decision_views import PASSED_OVER, event_text, plan_view, rejected_view, what_failed
from agentd.mind.introspection.failure_text import as_they_are, failure_of
from agentd.mind.introspection.snapshots import place, short_text
from agentd.mind.plans.nested_plans import candidates
from agentd.mind.plans.plan_library import Plan, Relevant
from agentd.mind.state import MindState
from schemas.files.findings import nearest
from schemas.wire.mind_records import RejectedView

_MOST_SHOWN: Final = 5
"""Plans, goals or beliefs that are named; further ones are counted."""


def failure_report(mind: MindState, failed: Failed, goals: Sequence[str], frames: Sequence[Frame], because: str) -> Log:
    """Return the note for a failure that ends its intention.

    ``goals`` are the texts of the goals that end, innermost first, and ``frames`` those of their plans; ``because`` is
    why nothing handles it, empty where no plan is there to do so.
    """
    position = failed.step.syntax.position if failed.step is not None else None
    details = list(_hints(mind, failed))
    if goals:
        details.append(called_by(goals, frames))
    if because:
        details.append(f"{because}: the intention ends")
    else:
        relevant = [f[RELEVANT] for f in frames] or [failed.goal]
        details.append(_unhandled(failed, [goal for goal in relevant if goal.operator == "+" and goal.goal]))
    return Log("warning", _sentence(failed), tuple(details), position, ends=True)


def called_by(goals: Sequence[str], frames: Sequence[Frame]) -> str:
    """Return for what a formula was run: the texts of the first goals, innermost first, with the places of the plans.

    ``frames`` are those of the plans, which may be more.
    """
    begins = [frame[PLAN].syntax.position for frame in frames[: len(goals)]]
    calls = [f"{goal} ({place(at) if at.line else 'message'})" for goal, at in zip(goals, begins, strict=True)]
    return f"in the plan for {', called by '.join(calls)}{', ...' if len(frames) > len(goals) else ''}"


def unhandled_report(mind: MindState, event: Event) -> Log:
    """Return the log line for a failed goal whose failure plans do not match; its event's annotations describe it."""
    relevant, args, annots, _ = event
    failed, position = failure_of(annots)
    if failed.error in ("no_relevant", "no_applicable"):
        failed.goal = relevant.counterpart("+")
    goal = event_text(relevant, as_they_are(args))
    plans = rejected_lines(rejected_plans(mind, event))
    last = f"no plan for {goal} is applicable: the intention ends"
    return Log("warning", _sentence(failed), (*_hints(mind, failed), *plans, last), position, ends=True)


def _unhandled(failed: Failed, goals: list[Relevant]) -> str:
    """Say that no failure plan is there; ``goals`` are the `Relevant` of those that could have one."""
    without_plan = [failed.goal] if failed.goal is not None and failed.tried else []
    handlers = list(dict.fromkeys(f"-{goal.goal}{goal.sig.name}" for goal in (*without_plan, *goals)))
    if not handlers:
        return "the intention ends"
    some = " or ".join(handlers[:3]) + (" or ..." if len(handlers) > 3 else "")
    return f"no plan {some} handles error({failed.error}): the intention ends"


def _sentence(failed: Failed) -> str:
    """Return the failed formula or goal and the reason, as far as the failure contains it."""
    what = what_failed(failed, failed.code)
    why = f": {failed.message}" if failed.message else ""
    match failed.error:
        case "constraint_failed":
            return f"{what} does not hold"
        case "test_goal_failed":
            return f"{what} finds nothing"
        case "no_relevant":
            return f"there is no plan for {what}"
        case "no_applicable":
            return f"no plan for {what} is applicable"
        case "wait_timeout":
            return f"{what} has waited in vain"
        case "ia_failed":
            return f"{what} does not succeed{why}"
        case "undefined_number":
            return f"{what} cannot be computed{why}"
        case "recursion_too_deep":
            return f"{what} is too deep{why}"
        case "body_var_without_value" | "body_var_not_literal":
            return f"{what} cannot be run{why}"
        case "action_failed" if _unknown_action(failed):
            return f"there is no internal action {_unknown_action(failed)}"
        case "action_failed":
            return f"the action {what} fails{why}"
    return f"{what} fails{why}"


def _unknown_action(failed: Failed) -> str:
    """Return name and arity of an internal action that does not exist; empty for one that does."""
    code = failed.code
    if type(code) is not Literal or failed.error != "action_failed" or not code.sig.functor.startswith("."):
        return ""
    if find_action(code.sig.functor, code.sig.arity) is None:
        return str(code.sig.indicator)
    return ""


def _hints(mind: MindState, failed: Failed) -> Iterable[str]:
    """Hints for mending the program."""
    match failed.error:
        case "test_goal_failed":
            yield from _beliefs_like(mind, failed)
        case "no_relevant":
            yield from _goals_like(mind, failed.goal)
        case "no_applicable":
            yield from rejected_lines(failed.tried)
        case "action_failed" if _unknown_action(failed):
            yield from _alike(failed.code.sig.functor, ACTIONS)
        case "receiver_not_found" if mind.agents is not None and type(failed.code) is Literal and failed.code.args:
            yield from _alike(short_text(failed.code.args[0]), [name for name in mind.agents() if name != mind.name])


def rejected_lines(plans: Sequence[RejectedView]) -> Iterable[str]:
    """Yield a line for each plan that was tried."""
    for rejected in plans[:_MOST_SHOWN]:
        label = f"@{rejected.plan.label} " if rejected.plan.label else ""
        yield f"{label}{rejected.plan.trigger} ({rejected.plan.position}): {_why(rejected)}"
    if len(plans) > _MOST_SHOWN:
        yield f"and {len(plans) - _MOST_SHOWN} more plans"


def _why(rejected: RejectedView) -> str:
    bindings = rejected.plan.bindings
    if rejected.why != "context" or not bindings:
        return rejected.message
    return (
        f"{rejected.literal} does not hold, with {', '.join(f'{name} = {value}' for name, value in bindings.items())}"
    )


def _beliefs_like(mind: MindState, failed: Failed) -> Iterable[str]:
    asked = deref(failed.code)
    if type(asked) is not Literal:
        return
    predicate = mind.beliefs.known(asked.sig)
    facts = [] if predicate is None else list(predicate.facts())
    if facts:
        shown = ", ".join(short_text(fact.bare()) for fact in facts[:_MOST_SHOWN])
        more = f" and {len(facts) - _MOST_SHOWN} more" if len(facts) > _MOST_SHOWN else ""
        yield f"believed are {shown}{more}" if len(facts) > 1 else f"believed is {shown}"
    elif predicate is None or not predicate.rules:
        known = [p.sig for p in mind.beliefs.predicates() if p.entries]
        same = [s.indicator for s in known if s.name == asked.sig.name]
        hint = f"; there is {', '.join(same)}" if same else near(asked.sig.indicator, [s.indicator for s in known])
        yield f"nothing is believed about {asked.sig.indicator}{hint}"


def _goals_like(mind: MindState, goal: Any) -> Iterable[str]:
    if goal is None:
        return
    known: dict[str, Any] = {}
    for plan in mind.plans:
        trigger = plan.syntax.trigger
        if trigger.operator == "+" and trigger.goal == goal.goal and isinstance(trigger.literal, nodes.Structure):
            known.setdefault(trigger.literal.functor, plan)
    same = known.get(goal.sig.functor)
    if same is not None and len(same.syntax.trigger.literal.args) != goal.sig.arity:
        view, arity = plan_view(same), len(same.syntax.trigger.literal.args)
        yield f"the plan {view.trigger} ({view.position}) takes {_arguments(arity)}, not {goal.sig.arity}"
        return
    if found := nearest(goal.sig.functor, known, CLOSE):
        view = plan_view(known[found])
        yield f"did you mean `{view.trigger}` ({view.position})?"


def _arguments(number: int) -> str:
    return "1 argument" if number == 1 else f"{number} arguments" if number else "no argument"


def _alike(word: str, known: Iterable[str]) -> Iterable[str]:
    """Yield the question whether one of the known names is meant, if one is like a word."""
    if found := nearest(word, known, CLOSE):
        yield f"did you mean `{found}`?"


# --- why no plan was applicable ---


def rejected_plans(mind: MindState, event: Event) -> tuple[RejectedView, ...]:
    """Return why each plan that is relevant for an event was not applicable just now."""
    if mind.recorder is not None:
        return tuple(rejected_view(plan, reason) for plan, reason in mind.recorder.last_rejected())
    return tuple(_rejected(mind, plan, around, event) for plan, around in candidates(mind, event[0], event[3]))


def _rejected(mind: MindState, plan: Plan, around: Frame | None, event: Event) -> RejectedView:
    if not harmless(mind, plan.syntax.context):
        return rejected_view(plan, ())
    relevant, args, annots, intention = event
    trail: list[Any] = [] if intention is None else intention.trail
    mark, effects = len(trail), len(mind.effects)
    try:
        found = plan.tracing()(mind, trail, relevant, args, annots, around)
    except Exception as error:  # as when the plan was tried
        found = error
    undo(trail, mark)
    del mind.effects[effects:]
    if type(found) is list:
        found = PASSED_OVER if mind.compiler.form == "options" else ()
    return rejected_view(plan, found)


def harmless(mind: MindState, formula: nodes.Term | None, seen: frozenset[Any] = frozenset()) -> bool:
    """Return whether asking a formula (or building a term) has no effect."""
    match formula:
        case nodes.Variable(namespace=None) | nodes.Number() | nodes.String() | None:
            return True
        case nodes.InternalAction(name, args):
            known = name in PURE or mind.compiler.is_own_function(name, len(args))
        case nodes.Structure():
            known = _harmless_rules(mind, formula, seen)
        case _:
            known = True
    inner = parts(formula)
    return known and inner is not None and all(harmless(mind, part, seen) for part in inner)


def _harmless_rules(mind: MindState, formula: nodes.Structure, seen: frozenset[Any]) -> bool:
    if isinstance(formula.namespace, nodes.Variable):
        return False
    sig = signature_of(formula)
    if sig in seen:
        return True
    predicate = mind.beliefs.known(sig)
    rules = [] if predicate is None else [e for e in predicate.entries.values() if type(e) is RuleClause]
    return all(harmless(mind, rule.syntax.body, seen | {sig}) for rule in rules)
