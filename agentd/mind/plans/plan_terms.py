"""Plans, triggers and bodies as terms or texts: ``{ +!g }``, ``.add_plan``, ``.relevant_plans``, tellHow, askHow."""

from __future__ import annotations

from typing import Any

from msgspec.structs import replace

from agentd.language.parse import parse_plan, parse_trigger
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import SyntaxErrors
from agentd.language.syntax_tree.signatures import signature
from agentd.language.terms.from_ast import Instantiation, instantiate
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import is_source, source
from agentd.language.terms.terms import TRUE, Code, Literal, Term, deref, proper
from agentd.language.terms.to_ast import ToSyntax
from agentd.mind.beliefs.term_copy import is_ground, resolve
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.beliefs.work_limit import PARSING, work
from agentd.mind.data.formula_failure import Failed, wrong_arguments
from agentd.mind.plans.plan_library import GENERATED, Plan
from agentd.mind.state import MindState


def capture(node: Any, values: dict[str, Any]) -> Code:
    """Return the term for code in braces, with the variables of the plan that it is linked to."""
    return Code(node, {name: deref(v) for name, v in values.items()})


def trigger_literal(code: Code) -> Literal:
    """Return the literal of a trigger term; its variables are those of the plan that wrote it."""
    literal = instantiate(code.syntax.literal, dict(code.values))
    literal = deref(literal)
    if type(literal) is not Literal:
        raise Failed("body_var_not_literal", "the trigger's literal is a variable without a value")
    return literal


def parts_of(code: Code) -> list[Term]:
    """Label, trigger, context and body of a plan term, as ``=..`` gives them."""
    node, values = code.syntax, code.values
    if isinstance(node, nodes.Plan):
        made = Instantiation(dict(values), {})
        label = TRUE if node.label is None else made.term(node.label)
        context = TRUE if node.context is None else made.term(node.context)
        return [label, Code(node.trigger, values, bare=True), context, Code(node.body, values, bare=True)]
    return [code]


_LINE, _FILE, _URL = signature("code_line", 1), signature("code_src", 1), signature("url", 1)

DEEPEST_LABEL = 100
"""Terms in labels may be nested so deep."""


def is_label(label: object) -> bool:
    """Return whether a plan's label names it (``@[tag]`` and a variable do not)."""
    return isinstance(label, nodes.Structure) and bool(label.functor)


def add_plans(mind: MindState, term: Term, teller: Term, first: bool) -> None:
    """Add a plan term, a text, or a list of both. A plan that is there already gets one source more.

    Fails with ``unknown`` where a text does not parse.
    """
    members = proper(term)
    for item in [term] if members is None else members:
        item = deref(item)
        if type(item) is str:
            work(mind, PARSING * len(item))
            try:
                node, values = parse_plan(item, "<plan>"), {}
            except SyntaxErrors as errors:
                raise Failed("unknown", f"the plan cannot be read: {errors}") from errors
        elif type(item) is Code and isinstance(item.syntax, nodes.Plan):
            node, values = item.syntax, {name: resolve(v) for name, v in item.values.items() if is_ground(v)}
        else:
            wrong_arguments("a plan, the text of a plan, or a list of them is needed")
        _add_plan(mind, node, values, teller, first)


def _add_plan(mind: MindState, node: nodes.Plan, values: dict[str, Any], teller: Any, first: bool) -> None:
    known = _same_plan(mind, node, values)
    if known is not None:
        if teller not in known.sources:
            known.sources.append(teller)
            mind.plans.version += 1
        return
    label = node.label
    if isinstance(label, nodes.Structure) and label.functor.startswith(GENERATED):
        node = replace(node, label=replace(label, functor=""))
    elif isinstance(label, nodes.Structure):
        refuse_label(mind, label)
    plan = mind.plans.make(node, values)
    plan.sources = [teller]
    mind.plans.add(plan, first=first)


def refuse_label(mind: MindState, label: Any) -> None:
    """Fail where a plan of the library has this label already: labels name one plan each."""
    if is_label(label) and any(p.label.sig.functor == label.functor for p in mind.plans):
        raise Failed("internal_action", f"there is a plan with the label {label.functor} already")


def _same_plan(mind: MindState, node: nodes.Plan, values: dict[str, Any]) -> Plan | None:
    """Return the plan of the library with the same trigger, context and body, whatever its label."""
    plan: Plan
    for plan in mind.plans:
        other = plan.syntax
        same = other.trigger == node.trigger and other.context == node.context and other.body == node.body
        if same and plan.values == values and _rest(other) == _rest(node):
            return plan
    return None


def _rest(node: nodes.Plan) -> tuple[Any, ...]:
    return node.goal_condition, node.subplans


def remove_plans(mind: MindState, term: Any, teller: Any) -> None:
    """Remove a source from the plans with a label (or a list of labels), and a plan with its last source."""
    members = proper(term)
    for item in [term] if members is None else members:
        item = deref(item)
        if type(item) is Code and isinstance(item.syntax, nodes.Plan) and is_label(item.syntax.label):
            name = str(getattr(item.syntax.label, "functor", ""))
        elif type(item) is Literal:
            name = item.sig.functor
        elif type(item) is str:
            name = item
        else:
            wrong_arguments("a plan label or plan is needed")
        for plan in [p for p in mind.plans if p.label.sig.functor == name and teller in p.sources]:
            plan.sources.remove(teller)
            mind.plans.version += 1
            if not plan.sources:
                mind.plans.remove(plan)


def read_trigger(mind: MindState, term: Term) -> Code:
    """Return a trigger term, or the text of one."""
    term = deref(term)
    if type(term) is str:
        work(mind, PARSING * len(term))
        try:
            return Code(parse_trigger(term))
        except SyntaxErrors as errors:
            raise Failed("unknown", f"the trigger cannot be read: {errors}") from errors
    if type(term) is Code and isinstance(term.syntax, nodes.Trigger):
        return term
    return wrong_arguments("a trigger in braces or its text is needed")


def relevant_plans(mind: MindState, term: Term, told_by: Term | None = None) -> list[Code]:
    """Return the plans for a trigger, as terms."""
    return [term_of(plan, told_by) for plan in plans_for(mind, read_trigger(mind, term))]


def plans_for(mind: MindState, trigger: Code) -> list[Plan]:
    """Return the plans whose trigger unifies with this one, in order."""
    node = trigger.syntax
    literal = deref(instantiate(node.literal, dict(trigger.values)))
    if type(literal) is not Literal:
        fits = [p.syntax.trigger for p in mind.plans]
        return [p for p, t in zip(mind.plans, fits, strict=True) if t.operator == node.operator and t.goal == node.goal]
    relevant = mind.plans.relevant(node.operator, node.goal, literal.sig)
    return [p for p in relevant.plans if _asked_fits(literal, p)]


def _asked_fits(asked: Literal, plan: Plan) -> bool:
    """Return whether a trigger that is asked for unifies with that of a plan, which may ask for more annotations."""
    trail: Trail = []
    fits = unify(asked, instantiate(plan.syntax.trigger.literal, dict(plan.values)), trail)
    undo(trail, 0)
    return fits


def label_of(plan: Plan) -> Literal:
    """Return the label of a plan with its sources, and with ``url("file:...")`` if a file holds it."""
    file = [Literal(_URL, (f"file:{plan.file}",))] if plan.file else []
    return _annotated(plan, *map(source, plan.sources), *file)


def label_with_line(plan: Plan) -> Literal:
    """`label_of` with ``code_line(N)`` and ``code_src(File)``, where the plan begins."""
    place, label = plan.syntax.position, label_of(plan)
    at = Literal(_LINE, (float(place.line),)), Literal(_FILE, (place.file,))
    return label.with_annots(sorted_annots((*label.annots, *at)))


def _annotated(plan: Plan, *annots: Literal) -> Literal:
    """Return the label of a plan with these annotations and its own, except the sources in it."""
    own = [a for a in plan.label.annots if not is_source(a)]
    return plan.label.with_annots(sorted_annots((*own, *annots)))


def term_of(plan: Plan, told_by: Term | None = None) -> Code:
    """Return a plan of the library as a term, with its label; ``told_by`` is its source for another agent."""
    return _labelled(plan, label_of(plan) if told_by is None else _annotated(plan, source(told_by)))


def shown_term(plan: Plan) -> Code:
    """Return a plan as a term for people: its label has its sources, but not its file."""
    return _labelled(plan, _annotated(plan, *map(source, plan.sources)))


def _labelled(plan: Plan, label: Literal) -> Code:
    return Code(replace(plan.syntax, label=ToSyntax(DEEPEST_LABEL).term(label)), plan.values)
