"""What the body of a plan does, by what it names: the goals it sets itself, its actions, its messages, its beliefs."""

from __future__ import annotations

from typing import Final

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.printer import source_text

MOST_USES: Final = 60
"""So many formulas of a plan are named."""


def plan_context(plan: nodes.Plan) -> str:
    """The context of a plan as written; empty if it has none."""
    return "" if plan.context is None else source_text(plan.context)


def plan_uses(plan: nodes.Plan) -> dict[str, str]:
    """What a plan's body does, each with the ``file:line`` where it does so first.

    ``!go/1`` and ``!!serve/0`` are goals, ``?where/1`` tests, ``+found/3`` and ``-found/3`` changes of beliefs,
    ``takeoff/1`` actions, ``.send/4`` internal actions.
    """
    found: dict[str, str] = {}
    pending: list[object] = [plan.body]
    while pending and len(found) < MOST_USES:
        node = pending.pop(0)
        match node:
            case nodes.Body(formulas=formulas):
                pending[:0] = formulas
            case nodes.If(branches=branches, otherwise=otherwise):
                pending[:0] = [body for _, body in branches] + ([] if otherwise is None else [otherwise])
            case nodes.While(body=body) | nodes.For(body=body):
                pending.insert(0, body)
            case nodes.Fork(branches=bodies):
                pending[:0] = bodies
            case nodes.Step(operator=operator, term=term, position=position):
                name = _name(term)
                if name:
                    found.setdefault(operator.value + name, f"{position.file}:{position.line}")
    return found


def _name(term: nodes.Term) -> str:
    match term:
        case nodes.Structure(functor=functor, args=args, negated=negated):
            return f"{'~' if negated else ''}{functor}/{len(args)}"
        case nodes.InternalAction(name=name, args=args):
            return f"{name}/{len(args)}"
    return ""
