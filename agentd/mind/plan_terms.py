"""Plans given and taken as terms or texts: ``.add_plan``, ``.relevant_plans``, tellHow, askHow."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from agentd.language import syntax
from agentd.language.errors import SyntaxErrors
from agentd.language.instantiate import instantiate
from agentd.language.parser import parse_plan, parse_trigger
from agentd.language.terms import Code, Literal, deref, proper
from agentd.mind.code_terms import trigger_literal
from agentd.mind.failed import Failed, wrong_arguments
from agentd.mind.plans import Plan
from agentd.mind.resolving import is_ground, resolve
from agentd.mind.unifier import Trail, undo, unify


def is_label(label: Any) -> bool:
    """Whether a plan's label names it (``@[tag]`` and a variable do not)."""
    return isinstance(label, syntax.Structure) and bool(label.functor)


def read_plan(text: str) -> syntax.Plan:
    """A plan from its text. Fails with ``unknown`` where it does not parse."""
    try:
        return parse_plan(text, "<plan>")
    except SyntaxErrors as errors:
        raise Failed("unknown", f"the plan cannot be read: {errors}") from errors


def add_plans(mind: Any, term: Any, source: Any, first: bool) -> None:
    """Add a plan term, a text, or a list of both."""
    members = proper(term)
    for item in [term] if members is None else members:
        item = deref(item)
        if type(item) is str:
            plan = mind.plans.make(read_plan(item))
        elif type(item) is Code and isinstance(item.syntax, syntax.Plan):
            plan = mind.plans.make(item.syntax, {name: resolve(v) for name, v in item.values.items() if is_ground(v)})
        else:
            wrong_arguments("a plan, the text of a plan, or a list of them is needed")
        plan.source = source
        mind.plans.add(plan, first=first)


def remove_plans(mind: Any, term: Any, source: Any) -> None:
    """Remove the plans with a label (or a list of labels) that come from a source."""
    members = proper(term)
    for item in [term] if members is None else members:
        item = deref(item)
        if type(item) is Code and isinstance(item.syntax, syntax.Plan) and is_label(item.syntax.label):
            name = str(getattr(item.syntax.label, "functor", ""))
        elif type(item) is Literal:
            name = item.sig.functor
        elif type(item) is str:
            name = item
        else:
            wrong_arguments("a plan label or plan is needed")
        for plan in [p for p in mind.plans if p.label.sig.functor == name and p.source == source]:
            mind.plans.remove(plan)


def read_trigger(term: Any) -> Code:
    """A trigger term, or the text of one."""
    term = deref(term)
    if type(term) is str:
        try:
            return Code(parse_trigger(term))
        except SyntaxErrors as errors:
            raise Failed("unknown", f"the trigger cannot be read: {errors}") from errors
    if type(term) is Code and isinstance(term.syntax, syntax.Trigger):
        return term
    return wrong_arguments("a trigger in braces or its text is needed")


def relevant_plans(mind: Any, term: Any) -> list[Code]:
    """The plans for a trigger, as terms."""
    return [term_of(plan) for plan in plans_for(mind, read_trigger(term))]


def plans_for(mind: Any, trigger: Code) -> list[Plan]:
    """The plans whose trigger unifies with this one, in order."""
    node = trigger.syntax
    if isinstance(node.literal, syntax.Variable):
        fits = [p.syntax.trigger for p in mind.plans]
        return [p for p, t in zip(mind.plans, fits, strict=True) if t.operator == node.operator and t.goal == node.goal]
    literal = trigger_literal(trigger)
    relevant = mind.plans.relevant(node.operator, node.goal, literal.sig)
    return [p for p in relevant.plans if _asked_fits(literal, p)]


def _asked_fits(asked: Literal, plan: Plan) -> bool:
    """Whether a trigger that is asked for unifies with that of a plan, which may ask for more annotations."""
    trail: Trail = []
    fits = unify(asked, instantiate(plan.syntax.trigger.literal, dict(plan.values)), trail)
    undo(trail, 0)
    return fits


def term_of(plan: Plan) -> Code:
    """A plan of the library as a term, with its label."""
    node = plan.syntax
    if not is_label(node.label):
        annots = node.label.annotations if isinstance(node.label, syntax.Structure) else None
        node = replace(node, label=syntax.Structure(plan.label.sig.functor, annotations=annots))
    return Code(node, plan.values)
