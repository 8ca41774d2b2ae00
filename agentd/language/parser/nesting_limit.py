"""A limit to how deep blocks are nested: beyond it a text is refused, as compiling nests along with it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

from agentd.language.syntax_tree.nodes import Body, BodyFormula, BodyTerm, For, Fork, If, Operator, Plan, Step, While

MOST_BLOCKS: Final = 100
"""The most blocks in { } or ( ) that are nested in one another."""


class BlockDepths:
    """The depths of the bodies and plans of one text; ``refuse`` is told the offset of what is nested too deep."""

    def __init__(self, refuse: Callable[[int, str], None]) -> None:
        self._refuse = refuse
        self._depths: dict[int, int] = {}
        """By identity, of those with blocks in them."""

    def body(self, at: int, body: Body) -> None:
        """A body has been read."""
        self.note(at, body, [block for formula in body.formulas for block in _blocks(formula)])

    def note(self, at: int, owner: Body | Plan, blocks: Sequence[Body | Plan]) -> None:
        """Something with these blocks in it has been read. It is refused once, where it becomes too deep."""
        depth = 1 + max((self._depths.get(id(block), 0) for block in blocks), default=-1)
        if depth == MOST_BLOCKS + 1:
            self.refuse(at)
        if depth:
            self._depths[id(owner)] = depth
        else:
            self._depths.pop(id(owner), None)

    def refuse(self, at: int) -> None:
        message = (
            f"blocks are nested more than {MOST_BLOCKS} deep; write the inner ones as goals with plans of their own"
        )
        self._refuse(at, message)


def _blocks(formula: BodyFormula) -> tuple[Body, ...]:
    """The bodies inside a formula."""
    match formula:
        case If(branches=branches, otherwise=otherwise):
            return (*(body for _, body in branches), *([] if otherwise is None else [otherwise]))
        case While(body=body) | For(body=body) | Step(operator=Operator.ACTION, term=BodyTerm(body=body)):
            return (body,)
        case Fork(branches=bodies):
            return bodies
    return ()
