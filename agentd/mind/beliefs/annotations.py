"""Annotation lists as a mind completes them: with the source that is not written, with the tail of ``[a|T]``."""

from __future__ import annotations

from typing import Any

from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import SELF, SOURCE_SELF, is_source, source, told_by
from agentd.language.terms.terms import Rest, Var, atom, deref, elements


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


def nested_source(annots: tuple[Any, ...], name: str) -> tuple[Any, ...]:
    """Annotations of what an agent says: its sources, without source(self), become annotations of source(name)."""
    if not annots:
        return SELF if name == "self" else told_by(name)
    others = [a for a in annots if not is_source(a)]
    inner = tuple(a for a in annots if is_source(a) and a != SOURCE_SELF)
    who = source(atom(name))
    return sorted_annots((*others, who.with_annots(inner) if inner else who))
