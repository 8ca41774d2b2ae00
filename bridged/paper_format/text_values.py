"""The paper's text semantics, for manifests with `values = "text"` (design section 12;
docs/reference/manifests.md).

The paper's bridge sent each value of a percept as Python's text of it, without single quotes, and the agent read that
text as a term; arguments of actions went the other way as texts and were converted by `params_type`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from schemas.manifest.ini import truth
from schemas.manifest.loader import Parameter
from schemas.wire.term_text import BadTerm, read, write
from schemas.wire.terms import Atom, Map, OpenList, Queue, Set, Source, Structure, Term, Variable


def percept_value(value: object) -> Term:
    """Return the term that the paper's agent had of a value: numbers stay numbers, `True` is "True", `guided` an atom.

    What reads as a variable, holds one, or does not read at all is a string. Items of a list are read one by one.
    """
    match value:
        case list() | tuple() | bytes() | bytearray():
            return [percept_value(item) for item in value]
        case Atom():
            return value
        case int() | float() if not isinstance(value, bool) and math.isfinite(value):
            return value
    text = _python_text(value).replace("'", "")
    try:
        term = read(text)
    except BadTerm:
        return text
    return text if _is_open(term) else term


def argument(parameter: Parameter, term: Term) -> Term:
    """Return an argument as the parameter's type reads the text of it; the term itself where it does not.

    A string is its own text, a free variable its name: `arm_motors(True)`, `arm_motors("True")` and `arm_motors(true)`
    are the same. Unlike in the paper's implementation, a text that is no truth value is not taken as False.
    """
    if isinstance(term, list) and "list" in parameter.types:
        return term
    if isinstance(term, str) and "string" in parameter.types:
        return term
    text = term if isinstance(term, str) else write(term)
    for kind in parameter.types:
        match kind:
            case "string":
                return text
            case "boolean":
                if (value := truth(text)) is not None:
                    return value
            case "list" | "int" | "float":
                try:
                    read_back = read(text.strip())
                except BadTerm:
                    continue
                if isinstance(read_back, list if kind == "list" else int | float):
                    return read_back
    return term


def _python_text(value: object) -> str:
    """Python's text of a value; a structure as ROS shows a message, one field a line."""
    if isinstance(value, Mapping):
        return "\n".join(_field_text(name, item) for name, item in value.items())
    return str(value)


def _field_text(name: Any, value: object) -> str:
    inner = _python_text(value)
    if isinstance(value, Mapping):
        return "\n  ".join([f"{name}:", *inner.splitlines()])
    return f"{name}: {inner}"


def _is_open(term: Term) -> bool:
    """Whether a term is or holds a variable, or is code: no belief of a robot."""
    match term:
        case Variable() | Source() | OpenList() | Map() | Set() | Queue():
            return True
        case list():
            return any(map(_is_open, term))
        case Structure():
            return any(map(_is_open, (*term.args, *term.annotations)))
    return False
