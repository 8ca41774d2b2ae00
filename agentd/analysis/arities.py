"""Names with the numbers of arguments that they take."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TypeAlias

Arities: TypeAlias = Mapping[str, int | Collection[int]]
"""Names with the numbers of arguments that they take; a `range` is such a collection."""


def takes(arities: int | Collection[int], arity: int) -> bool:
    return arity == arities if isinstance(arities, int) else arity in arities


def arguments(arities: int | Collection[int]) -> str:
    """How many arguments something takes, in words."""
    if isinstance(arities, range) and len(arities) > 9:
        return f"at least {arities.start} argument{'s' * (arities.start != 1)}" if arities.start else "any arguments"
    numbers = [arities] if isinstance(arities, int) else sorted(set(arities))
    if numbers == [0]:
        return "no arguments"
    words = [str(number) for number in numbers]
    text = " or ".join([", ".join(words[:-1]), words[-1]]) if len(words) > 1 else words[0]
    return f"{text} argument{'s' * (numbers != [1])}"
