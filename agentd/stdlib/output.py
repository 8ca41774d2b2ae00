"""Printing and logging."""

from __future__ import annotations

import re
from typing import Any

from agentd.language.numbers import double_text, number_text
from agentd.language.term_text import printed, text
from agentd.language.terms import List, Literal, Var, deref, split
from agentd.mind.effects import Log, Print
from agentd.mind.failed import Failed, wrong_arguments
from agentd.mind.intentions import values_of
from agentd.mind.resolving import resolve
from agentd.mind.unifier import Trail, unify
from agentd.stdlib.registry import internal_action


@internal_action(".print", (0, None))
@internal_action(".println", (0, None))
def print_terms(mind: Any, trail: Trail, *args: Any) -> bool:
    """``.print(T, ...)``: the texts of the terms, joined, as one line."""
    mind.effects.append(Print("".join([printed(resolve(a)) for a in args])))
    return True


_LEVELS = {"severe": "error", "warning": "warning", "info": "info"}


@internal_action(".log", (1, None))
def log(mind: Any, trail: Trail, level: Any, *args: Any) -> bool:
    """``.log(Level, T, ...)``: below info nothing is shown."""
    name = deref(level)
    if type(name) is not Literal:
        raise Failed("unknown", ".log takes a level first")
    shown = _LEVELS.get(name.sig.functor, "debug" if name.sig.functor in ("fine", "finer", "finest") else "info")
    line = "".join([printed(resolve(a)) for a in args])
    mind.effects.append(Log(shown, line) if shown == "debug" else Print(line))
    return True


_FORMAT = re.compile(r"%(-?0?\d*)(?:\.(\d+))?([sdfn%])")


@internal_action(".printf", (1, None))
def printf(mind: Any, trail: Trail, pattern: Any, *args: Any) -> bool:
    """``.printf(Format, T, ...)``: Java's format; every number is a double."""
    form = deref(pattern)
    if type(form) is not str:
        wrong_arguments(".printf takes a format string first")
    values = [deref(resolve(a)) for a in args]

    def piece(match: re.Match[str]) -> str:
        width, digits, kind = match.groups()
        if kind == "n":
            return "\n"
        if kind == "%":
            return "%"
        if not values:
            raise Failed("unknown", "more places than values in the format")
        return _padded(_formatted(values.pop(0), kind, digits), width)

    mind.effects.append(Print(_FORMAT.sub(piece, form)))
    return True


def _formatted(value: Any, kind: str, digits: str | None) -> str:
    if kind == "d":
        raise Failed("unknown", "%d needs an integer; every number is a floating point number")
    if kind == "f":
        if type(value) is not float:
            raise Failed("unknown", "%f needs a number")
        from decimal import ROUND_HALF_UP, Decimal

        places = Decimal(1).scaleb(-(int(digits) if digits else 6))
        return str(Decimal(repr(value)).quantize(places, ROUND_HALF_UP))
    return double_text(value) if type(value) is float else _java_text(value)


def _java_text(value: Any) -> str:
    if type(value) is float:
        return number_text(value)
    if type(value) is List:
        members, _ = split(value)
        return f"[{', '.join(_java_text(deref(m)) for m in members)}]"
    return value if type(value) is str else text(value)


def _padded(piece: str, width: str) -> str:
    if not width:
        return piece
    if width.startswith("-"):
        return piece.ljust(int(width[1:] or 0))
    if width.startswith("0") and len(width) > 1:
        return piece.zfill(int(width))
    return piece.rjust(int(width))


_PLACE = re.compile(r"#\{([A-Za-z_]\w*)\}")


@internal_action(".puts", (1, 2))
def puts(mind: Any, trail: Trail, pattern: Any, result: Any = None) -> bool:
    """``.puts("... #{X} ..."[, S])``: variables of the plan by name; with S the text is returned."""
    form = deref(pattern)
    if type(form) is not str:
        wrong_arguments(".puts takes a string")
    values = values_of(mind.current.stack[-1]) if mind.current is not None and mind.current.stack else {}

    def piece(match: re.Match[str]) -> str:
        value = values.get(match.group(1))
        return match.group(1) if value is None else printed(resolve(value))

    line = _PLACE.sub(piece, form)
    if result is None:
        mind.effects.append(Print(line))
        return True
    return type(deref(result)) is Var and unify(result, line, trail)
