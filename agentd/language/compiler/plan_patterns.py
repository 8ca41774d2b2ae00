"""Plan patterns, ``{ begin dg(g) } ... { end }``: how each rewrites the plans in its block (rule 104).

They are the goal patterns of Hübner, Bordini and Wooldridge, "Programming declarative goals using plan patterns" (DALT
2006), as the documentation of Jason lists them:

======================  ===============================================================================================
``dg(g)``               declarative goal: achieved when g is believed, tested after each plan
``bdg(g)``              the same, and an attempt that failed ends there: Jason's retry finds the goal intended already
``ebdg(g)``             the same, and each plan is tried once, one after the other, until one achieves g
``bc(g, F)``            blind commitment: g is tried again and again until it is achieved
``smc(g, f, F)``        single-minded: blind, but g fails when f is believed
``rc(g, m, F)``         relativised: blind, but g is dropped when its motive m is believed no longer
``omc(g, f, m, F)``     open-minded: both
``mg(g, F)``            maintenance: g is adopted whenever it is believed no longer; it is believed at the start
``sga(t, c, g)``        sequenced: each event t with the context c adopts g, one after the other
======================  ===============================================================================================

``F`` is the pattern for the plans of the block, ``bdg(g)`` when it is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from msgspec.structs import replace

from agentd.language.parse import parse_formula, parse_literal, parse_trigger
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import SyntaxErrors

Block = tuple[nodes.Item, ...]
"""The beliefs and plans of a block, in order."""

Args = tuple[nodes.Term, ...]

Pattern = Callable[[nodes.Position, Args, Block], Block]
"""Called with the place of the directive, its arguments and its block. Raises `WrongPattern`."""


class WrongPattern(ValueError):
    """A pattern's arguments are not what it needs."""


def _plan(
    at: nodes.Position,
    operator: str,
    kind: str,
    literal: nodes.Structure | nodes.Variable,
    context: nodes.Formula | None = None,
    steps: tuple[nodes.Step, ...] = (),
) -> nodes.Plan:
    return nodes.Plan(nodes.Trigger(operator, kind, literal, at), context, nodes.Body(steps, at), position=at)


def _call(at: nodes.Position, name: str, *args: nodes.Term) -> nodes.Step:
    return nodes.Step(nodes.Operator.ACTION, nodes.InternalAction(name, args, at), at)


def _goal(args: Args, place: int = 0) -> nodes.Structure:
    if len(args) <= place or not isinstance(args[place], nodes.Structure):
        raise WrongPattern("needs a goal" if place == 0 else f"needs a literal as argument {place + 1}")
    goal = args[place]
    assert isinstance(goal, nodes.Structure)
    return goal


def _declarative(at: nodes.Position, args: Args, block: Block) -> Block:
    goal = _goal(args)
    return (
        _plan(at, "+", "!", goal, goal),
        *(_with_test(item, goal) for item in block),
        _plan(at, "+", "", goal, steps=(_call(at, ".succeed_goal", goal),)),
    )


def _achieves(item: nodes.Item, goal: nodes.Structure) -> bool:
    """Return whether an item is a plan that achieves the goal of the pattern."""
    if not isinstance(item, nodes.Plan) or item.trigger.operator != "+" or item.trigger.goal != "!":
        return False
    return may_unify(item.trigger.literal, goal)


def may_unify(left: nodes.Term, right: nodes.Term) -> bool:
    """Return whether two terms as written can be made equal, as far as their constants show."""
    if isinstance(left, nodes.Variable) or isinstance(right, nodes.Variable):
        return True
    if isinstance(left, nodes.Structure) and isinstance(right, nodes.Structure):
        same = (left.functor, left.negated, left.namespace) == (right.functor, right.negated, right.namespace)
        return same and len(left.args) == len(right.args) and all(map(may_unify, left.args, right.args))
    return type(left) is not type(right) or isinstance(left, nodes.ListTerm | nodes.Arithmetic) or left == right


def _with_test(item: nodes.Item, goal: nodes.Structure) -> nodes.Item:
    """Let a plan that achieves the goal end with a test of it."""
    if not isinstance(item, nodes.Plan) or not _achieves(item, goal):
        return item
    test = nodes.Step(nodes.Operator.TEST, replace(item.trigger.literal, annotations=None), item.position)
    return replace(item, body=replace(item.body, formulas=(*item.body.formulas, test)))


def _backtracking(at: nodes.Position, args: Args, block: Block) -> Block:
    return (*_declarative(at, args, block), _plan(at, "-", "!", _goal(args)))


def _exclusive(at: nodes.Position, args: Args, block: Block) -> Block:
    goal = _goal(args)
    bare = replace(goal, annotations=None)
    marks: list[nodes.Structure] = []
    items: list[nodes.Item] = []
    for item in block:
        if not isinstance(item, nodes.Plan) or not _achieves(item, goal):
            items.append(item)
            continue
        mark = nodes.Structure(f"p__{len(marks) + 1}", (replace(bare, namespace=None),), position=at)
        marks.append(mark)
        untried = nodes.Not(mark, at)
        context = untried if item.context is None else nodes.And(untried, item.context, at)
        noted = nodes.Step(nodes.Operator.ADD, mark, at)
        body = replace(item.body, formulas=(noted, *item.body.formulas))
        items.append(_with_test(replace(item, context=context, body=body), goal))
    forget = tuple(nodes.Step(nodes.Operator.DELETE, mark, at) for mark in marks)
    left: nodes.Formula | None = None
    for mark in marks:
        untried = nodes.Not(mark, at)
        left = untried if left is None else nodes.Or(left, untried, at)
    again = nodes.Step(nodes.Operator.ACHIEVE, bare, at)
    return (
        _plan(at, "+", "!", goal, goal),
        *items,
        *([] if left is None else [_plan(at, "-", "!", goal, left, (again,))]),
        _plan(at, "-", "!", goal, steps=(*forget, _call(at, ".fail"))),
        _plan(at, "+", "", goal, steps=(*forget, _call(at, ".succeed_goal", goal))),
    )


def _inner(at: nodes.Position, args: Args, place: int, block: Block) -> Block:
    """Return the block as the pattern among the arguments makes it."""
    if len(args) <= place:
        return _backtracking(at, args, block)
    pattern = _goal(args, place)
    if pattern.functor not in PATTERNS:
        raise WrongPattern(f"knows no pattern '{pattern.functor}'")
    return PATTERNS[pattern.functor](at, pattern.args or args[:1], block)


def _committed(at: nodes.Position, args: Args, block: Block, hopeless_at: int = 0, motive_at: int = 0) -> Block:
    """Try the goal again until it is achieved, believed to be hopeless, or its motive is lost.

    ``hopeless_at`` and ``motive_at`` are the places of these two among the arguments, from 1; 0: there is none.
    """
    goal = _goal(args)
    hopeless, motive = (_goal(args, place) if place else None for place in (hopeless_at, motive_at))
    again = (nodes.Step(nodes.Operator.ACHIEVE, replace(goal, annotations=None), at),)
    place = 1 + bool(hopeless_at) + bool(motive_at)
    kept = [item for item in _inner(at, args, place, block) if not _gives_up(item, goal)]
    hope = None if hopeless is None else nodes.Not(hopeless, at)
    plans = [_plan(at, "-", "!", goal, hope, again), _plan(at, "+", "!", goal, hope, again)]
    if hopeless is not None:
        plans.append(_plan(at, "-", "!", goal, steps=(_call(at, ".fail"),)))
        plans.append(_plan(at, "+", "", hopeless, steps=(_call(at, ".fail_goal", goal),)))
    if motive is not None:
        plans.append(_plan(at, "-", "", motive, steps=(_call(at, ".succeed_goal", goal),)))
    return (*kept, *plans)


def _gives_up(item: nodes.Item, goal: nodes.Structure) -> bool:
    """Return whether an item is the plan by which the pattern inside lets go of the goal."""
    if not isinstance(item, nodes.Plan) or (item.trigger.operator, item.trigger.goal) != ("-", "!"):
        return False
    return item.trigger.literal is goal or (item.trigger.literal == goal and not item.body.formulas)


def _maintenance(at: nodes.Position, args: Args, block: Block) -> Block:
    goal = _goal(args)
    adopted = _plan(at, "-", "", goal, steps=(nodes.Step(nodes.Operator.ACHIEVE, replace(goal, annotations=None), at),))
    return (nodes.Belief(goal, at), adopted, *_inner(at, args, 1, block))


def _sequence(args: Args) -> tuple[nodes.Trigger, nodes.Term, nodes.Structure]:
    """Trigger, context and goal, each as a term or as a text."""
    match args:
        case (nodes.TriggerTerm(trigger=trigger), context, nodes.Structure() as goal):
            return trigger, context, goal
        case (nodes.String(value=trigger_text), context, goal) if isinstance(goal, nodes.Structure | nodes.String):
            try:
                trigger = parse_trigger(trigger_text)
                context = parse_formula(context.value) if isinstance(context, nodes.String) else context
                return trigger, context, parse_literal(goal.value) if isinstance(goal, nodes.String) else goal
            except SyntaxErrors as errors:
                raise WrongPattern(f"cannot read its arguments: {errors.findings[0].message}") from errors
    raise WrongPattern("needs a trigger, a context and a goal: sga({ +event(X) }, ready, goal(X))")


def _sequenced(at: nodes.Position, args: Args, block: Block) -> Block:
    trigger, context, goal = _sequence(args)
    busy, anyone = (
        nodes.Structure("fl", (goal,), position=at),
        nodes.Structure("fl", (nodes.Variable("_", position=at),), position=at),
    )
    turn = nodes.Structure("fg", (goal,), position=at)
    take, note, forget = (
        nodes.Step(nodes.Operator.ACHIEVE, turn, at),
        nodes.Step(nodes.Operator.ADD, busy, at),
        nodes.Step(nodes.Operator.DELETE, busy, at),
    )
    started = nodes.Plan(trigger, nodes.And(nodes.Not(anyone, at), context, at), nodes.Body((take,), at), position=at)
    queued = nodes.Plan(trigger, nodes.And(anyone, context, at), nodes.Body((note,), at), position=at)
    return (
        *block,
        started,
        queued,
        _plan(at, "+", "!", turn, steps=(note, nodes.Step(nodes.Operator.ACHIEVE, goal, at), forget)),
        _plan(at, "-", "!", turn, steps=(forget,)),
        _plan(at, "-", "", anyone, busy, (take,)),
    )


PATTERNS: Final[dict[str, Pattern]] = {
    "dg": _declarative,
    "bdg": _backtracking,
    "ebdg": _exclusive,
    "bc": _committed,
    "smc": partial(_committed, hopeless_at=1),
    "rc": partial(_committed, motive_at=1),
    "omc": partial(_committed, hopeless_at=1, motive_at=2),
    "mg": _maintenance,
    "sga": _sequenced,
}
"""The patterns by name."""
