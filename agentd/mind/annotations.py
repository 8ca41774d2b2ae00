"""Annotation lists as a mind completes them: with the source that is not written, with the tail of ``[a|T]``."""

from __future__ import annotations

from typing import Any

from agentd.language.order import sorted_annots
from agentd.language.sources import SELF, is_source
from agentd.language.terms import Rest, Var, deref, elements


def with_source(annots: tuple[Any, ...]) -> tuple[Any, ...]:
    """Annotations with source(self) added if they name no source."""
    if not annots:
        return SELF
    if any(is_source(a) for a in annots):
        return annots
    return sorted_annots(annots + SELF)


def annots_with_tail(annots: tuple[Any, ...], tail: Any) -> tuple[Any, ...]:
    """``[a|T]`` as annotations: with the elements of T if it has a value, else T stands for the rest."""
    end = deref(tail)
    if type(end) is Var:
        return (*sorted_annots(annots), Rest(end))
    return sorted_annots((*annots, *elements(end)))
