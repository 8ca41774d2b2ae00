"""Goals, tests, external actions and bodies that a running plan asks for and that generated code leaves to the mind."""

from __future__ import annotations

from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.terms.format import text
from agentd.language.terms.from_ast import instantiate
from agentd.language.terms.terms import Code, Expression, Literal, Open, Term, Var, deref
from agentd.mind.beliefs.dynamic_formulas import solve
from agentd.mind.beliefs.term_copy import closed, detach, is_ground, resolve, resolve_all, resolve_annots, with_source
from agentd.mind.data.effects import PerformAction
from agentd.mind.data.formula_failure import Failed
from agentd.mind.data.intention import STEP, Frame, Intention, Step
from agentd.mind.execution.belief_updates import change_term, known_value
from agentd.mind.execution.execution import await_something
from agentd.mind.execution.goal_states import pending, raise_state
from agentd.mind.plans.nested_plans import nested_plans
from agentd.mind.plans.plan_library import Relevant
from agentd.mind.plans.plan_terms import trigger_literal
from agentd.mind.state import MindState
from schemas.wire.mind_records import WaitView


def literal_of(term: Term) -> Literal:
    """Return the literal that a variable in a body holds. Raises Failed according to rule 62."""
    term = known_value(term)
    if type(term) is Code and isinstance(term.syntax, nodes.Trigger):
        return trigger_literal(term)
    if type(term) is Code and isinstance(term.syntax, nodes.Body):
        match term.syntax.formulas:
            case (nodes.Step(nodes.Operator.ACHIEVE | nodes.Operator.ACTION, written),):
                goal = deref(instantiate(written, dict(term.values)))
                if type(goal) is Literal:
                    return goal
    if type(term) is not Literal:
        raise Failed("body_var_not_literal", f"The term '{text(term)}' is not a literal.")
    return term


def qualify(namespace: Term, literal: Literal) -> Any:
    """``N::p(1)`` as a term: a literal if N is bound, else an open one."""
    return closed(Open(Var(), None, False, deref(namespace), literal)) if literal else None


def add_goal(mind: MindState, literal: Literal, operator: str = "!") -> None:
    """Raise the event of a goal of its own."""
    relevant = mind.plans.relevant("+", operator, literal.sig)
    annots = resolve_annots(with_source(literal.annots))
    if mind.plans.has_meta:
        raise_state(mind, relevant, literal.args, annots, "pending")
    mind.post(relevant, detach(literal.args), annots)


def achieve_term(mind: MindState, intention: Intention, term: Term, new_focus: bool) -> bool | None:
    """``!X`` or ``!!X``."""
    literal = literal_of(term)
    relevant = mind.plans.relevant("+", "!", literal.sig)
    annots = with_source(literal.annots)
    if mind.plans.has_meta:
        pending(mind, relevant, literal.args, annots)
    if new_focus:
        mind.post(relevant, detach(literal.args), resolve_annots(annots))
        return None
    mind.events.append((relevant, literal.args, annots, intention))
    return True


def test_event(
    mind: MindState, intention: Intention, relevant: Relevant, args: tuple[Term, ...], annots: tuple[Term, ...]
) -> bool:
    """``?g`` that the beliefs do not answer: its event if there are plans for it, else a failure."""
    if not relevant.plans and not (
        mind.plans.has_nested and any(True for _ in nested_plans(mind, relevant, intention))
    ):
        raise Failed("test_goal_failed")
    if mind.plans.has_meta:
        pending(mind, relevant, args, annots)
    mind.events.append((relevant, args, annots, intention))
    return True


def test_term(mind: MindState, intention: Intention, term: Term) -> bool | None:
    """``?X``."""
    formula = known_value(term)
    for _ in solve(mind, formula, intention.trail):
        return None
    if type(formula) is Literal:
        relevant = mind.plans.relevant("+", "?", formula.sig)
        return test_event(mind, intention, relevant, formula.args, with_source(formula.annots))
    raise Failed("test_goal_failed")


def perform(mind: MindState, intention: Intention, action: Any) -> bool:
    """Start an external action; the intention waits for its end."""
    if type(action) is not Literal:
        action = literal_of(action)
    name, args = action.sig.name, action.args
    if args or action.annots:
        open_ = not is_ground(action)
        if open_ and "." in name:
            raise Failed("action_failed", f"there is no internal action {action.sig.indicator}")
        if open_ and not mind.names_variables:
            raise Failed("action_failed", f"the action {text(action)} has a variable without a value")
        args = detach(args) if open_ else resolve_all(args)
    if mind.actions is not None and name not in mind.actions:
        raise Failed("action_failed", f"nobody can perform the action {action.sig.indicator}")
    mind.action_count += 1
    number = intention.action = mind.action_count
    mind.action_client[number] = intention
    mind.effects.append(PerformAction(number, name, args))
    await_something(mind, intention, WaitView(kind="action", name=name))
    return True


def run_term(mind: MindState, intention: Intention, frame: Frame, step: Step, term: Term) -> bool | None:
    """Run a variable as formula of a body: the body, goal, test, belief change or action that it holds."""
    term = known_value(term)
    if type(term) is Code:
        return _run_code(mind, intention, frame, term)
    if type(term) is Expression and term.operator != "not":
        for _ in solve(mind, term, intention.trail):
            return None
        raise Failed("constraint_failed")
    if type(term) is Expression:
        raise Failed("action_failed", f"{text(term)} is no action; write ?({text(term)}) to test it")
    literal = literal_of(term)
    if "." in literal.sig.functor:
        for _ in solve(mind, literal, intention.trail):
            return None
        raise Failed("ia_failed")
    return perform(mind, intention, literal)


def _run_code(mind: MindState, intention: Intention, frame: Frame, code: Code) -> bool | None:
    body = code.syntax
    if isinstance(body, nodes.Trigger):
        literal = literal_of(code)
        if body.goal == "!":
            return achieve_term(mind, intention, literal, False)
        if body.goal == "?":
            return test_term(mind, intention, literal)
        return change_term(mind, intention, body.operator, literal)
    if not isinstance(body, nodes.Body):
        raise Failed("body_var_not_literal", "Only bodies, goals and actions can be run.")
    plan = frame[1]
    values = {name: resolve(v) for name, v in code.values.items() if is_ground(v)}
    frame[STEP] = plan.fragment(body, values, frame[STEP])
    frame.extend([None] * (plan.size - len(frame)))
    return None
