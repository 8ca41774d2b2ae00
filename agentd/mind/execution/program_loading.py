"""Programs into a mind: when it begins, when it includes a file, when it is a clone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from msgspec.structs import replace

from agentd.language.compiler.compile import CompiledProgram
from agentd.language.parser.fact_runs import GroundFact
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.signatures import DEFAULT
from agentd.language.terms.from_ast import Instantiation
from agentd.mind.beliefs.belief_base import RuleClause
from agentd.mind.beliefs.dynamic_formulas import FunctionsOf, by_rule
from agentd.mind.beliefs.term_copy import is_ground
from agentd.mind.data.effects import Log
from agentd.mind.data.formula_failure import as_failed
from agentd.mind.execution.belief_updates import SCHEMA, add_belief, add_rule
from agentd.mind.execution.goal_execution import add_goal
from agentd.mind.execution.input_handling import perceived
from agentd.mind.plans.plan_terms import refuse_label
from agentd.mind.state import MindState

_SOURCE_SELF = nodes.Structure("source", (nodes.Structure("self"),))


def load_program(mind: MindState, program: CompiledProgram) -> None:
    """Give a new mind its program: functions, plans, initial beliefs and goals; log the warnings."""
    register_functions(mind, program.functions)
    mind.compiler.namespaced |= program.namespaced
    mind.plans.extend(list(program.plans))
    _begin(mind, program)
    warn(mind, program)


def include_program(mind: MindState, program: CompiledProgram | None, namespace: str = DEFAULT) -> None:
    """Add the contents of a file: beliefs with their events, goals, plans. None: the file was missing (logged already).

    Fails with ``internal_action``, before anything is added, where a label is taken already; other namespaces than the
    default one have labels of their own.
    """
    if program is None:
        return
    if namespace == DEFAULT:
        for node in program.plans:
            refuse_label(mind, node.label)
    register_functions(mind, program.functions)
    mind.compiler.namespaced |= program.namespaced
    for node in program.plans:
        mind.plans.add(mind.plans.make_of_file(node))
    _begin(mind, program)
    warn(mind, program)


def register_functions(mind: MindState, functions: Iterable[tuple[str, int, str]]) -> None:
    """Let rules compute functions: the name and number of arguments of each, and the name of the rule."""
    for name, arity, rule in functions:
        mind.compiler.register_function(name, arity, by_rule(rule, arity))
        mind.compiler.rules_of_functions[(name, arity)] = rule


def warn(mind: MindState, program: CompiledProgram) -> None:
    """Log the warnings of a program."""
    for warning in program.warnings:
        mind.effects.append(Log("warning", warning))


def _begin(mind: MindState, program: CompiledProgram) -> None:
    """Believe the initial beliefs, begin with the initial goals."""
    functions = FunctionsOf(mind)
    computed = any("." not in name for name, _ in functions)
    for item in reversed(program.beliefs):
        if isinstance(item, nodes.Rule):
            add_rule(mind, item, {})
            continue
        if isinstance(item, GroundFact) and not computed:
            add_belief(mind, item.term())
            continue
        with _left_out(mind, item):
            literal = Instantiation({}, functions).term(item.literal)
            if is_ground(literal):
                add_belief(mind, literal)
            else:
                add_rule(mind, _schema(item), {})
    for goal in program.goals:
        with _left_out(mind, goal):
            add_goal(mind, Instantiation({}, functions).term(goal.literal), goal.operator)


def _schema(belief: nodes.Belief) -> nodes.Rule:
    """Return the rule that an initial belief with variables is, as in Jason: each use has variables of its own."""
    annots = belief.literal.annotations or nodes.ListTerm()
    if not any(isinstance(a, nodes.Structure) and (a.functor, len(a.args)) == ("source", 1) for a in annots.items):
        annots = replace(annots, items=(*annots.items, _SOURCE_SELF))
    return nodes.Rule(replace(belief.literal, annotations=annots), SCHEMA, belief.position)


@contextmanager
def _left_out(mind: MindState, item: nodes.Belief | nodes.Goal) -> Iterator[None]:
    """Leave out a belief or goal that is nested too deep, or whose functions raise whatever they may, and say so."""
    try:
        yield
    except Exception as error:
        why = "is nested too deep" if isinstance(error, RecursionError) else f"cannot be computed: {as_failed(error)}"
        message = f"{item.position}: {item.literal.functor}/{len(item.literal.args)} {why}; it is left out"
        mind.effects.append(Log("error", message))


def copy_mind(mind: MindState, other: MindState) -> None:
    """Take over another mind's functions, beliefs, rules and plans, without their events (``.clone``)."""
    mind.compiler.copy_functions(other.compiler)
    for predicate in other.beliefs.predicates():
        own = mind.beliefs.predicate(predicate.sig)
        for entry in list(predicate.entries.values()):
            if type(entry) is RuleClause:
                add_rule(mind, entry.syntax, entry.values)
            else:
                own.add(entry.args, entry.annots)
    for sig, present in other.percepts.items():
        perceived(mind, sig).args.update(present.args)
    for plan in other.plans:
        copy = mind.plans.make(plan.syntax, plan.values)
        copy.label, copy.sources, copy.file = plan.label, list(plan.sources), plan.file
        mind.plans.add(copy)
