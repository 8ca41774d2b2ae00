"""The lists in the paper's INI manifests: fields of a message, and types of parameters.

    args        = mode, pose.position.x, status[](name, values[](key, value))
    params_type = float, int[], geometry_msgs/Point[](x, y), bool

Empty entries at the end of a list count for nothing. Pure: text in, entries out; nothing is imported for a type's name.
"""

from __future__ import annotations

import re

from schemas.manifest.model import Field, Parameter, ParameterType

MAX_DEPTH = 8
"""Lists of structures within one another."""
TYPES: dict[str, ParameterType] = {
    "str": "string",
    "string": "string",
    "float": "float",
    "int": "int",
    "long": "int",
    "bool": "boolean",
    "list": "list",
}
"""The names of Python's types that `params_type` may use, and what they are here."""
ELEMENT: tuple[ParameterType, ...] = ("int", "float", "boolean", "string", "list")
"""What a field in a structure may be: `Type[](a, b)` names its fields, not their types."""

_PATH = re.compile(r"[A-Za-z_]\w*(?:\.\w+)*", re.ASCII)
_LISTED = re.compile(r"([^\[\](),]*)\[\s*(\d*)\s*\]\s*(?:\((.*)\))?", re.ASCII | re.DOTALL)
_TYPE = re.compile(r"\w+(?:/\w+)*", re.ASCII)


class BadList(ValueError):
    """A list that does not read; says where and what was expected."""


def read_fields(text: str) -> tuple[str | Field, ...]:
    """Return the fields that `args` names: paths, and lists of structures. Raises BadList."""
    return tuple(_field(entry, 0) for entry in split(text))


def read_names(text: str) -> tuple[str, ...]:
    """Return the paths that `params_name` names. Raises BadList."""
    return tuple(_path(entry) for entry in split(text))


def read_defaults(text: str) -> tuple[tuple[str, str], ...]:
    """Return the fields that `defaults` names, and the text of each value. Raises BadList."""
    found: list[tuple[str, str]] = []
    for entry in split(text):
        path, equals, value = entry.partition("=")
        if not equals or not value.strip():
            raise BadList(f"expected a field and its value such as `width=3`, got `{entry}`")
        found.append((_path(path.strip()), value.strip()))
    return tuple(found)


def read_parameter(name: str, text: str) -> Parameter:
    """Return the parameter of an action with the type that `text` names. Raises BadList."""
    listed = _LISTED.fullmatch(text)
    if listed is None:
        if text in TYPES:
            return Parameter(name=name, type=TYPES[text])
        known = ", ".join(TYPES)
        raise BadList(f"no type `{text}`; expected one of {known}, a list such as `int[]` or `Type[](a, b)`")
    if listed[1] and not _TYPE.fullmatch(listed[1].strip()):
        raise BadList(f"`{listed[1].strip()}` is not the name of a type, in `{text}`")
    each = () if listed[3] is None else read_fields(listed[3])
    if listed[3] is not None and not each:
        raise BadList(f"expected fields between the brackets, in `{text}`")
    return Parameter(name=name, type="list", each=tuple(_element(field) for field in each))


def split(text: str) -> list[str]:
    """Cut a list at the commas outside brackets; what is empty at its end is left out. Raises BadList."""
    entries, depth, start = [""], 0, 0
    for at, sign in enumerate(text):
        depth += (sign in "([") - (sign in ")]")
        if depth < 0:
            raise BadList(f"`{sign}` closes nothing, in `{text.strip()}`")
        if sign == "," and depth == 0:
            entries[-1] = text[start:at].strip()
            entries.append("")
            start = at + 1
    if depth:
        raise BadList(f"a bracket is not closed, in `{text.strip()}`")
    entries[-1] = text[start:].strip()
    while entries and not entries[-1]:
        entries.pop()
    if "" in entries:
        raise BadList(f"entry {entries.index('') + 1} of the list is empty, in `{text.strip()}`")
    return entries


def _field(text: str, depth: int) -> str | Field:
    if depth > MAX_DEPTH:
        raise BadList(f"nested deeper than {MAX_DEPTH}")
    if "[" not in text and "(" not in text:
        return _path(text)
    listed = _LISTED.fullmatch(text)
    if listed is None:
        raise BadList(f"expected a field such as `pose.position.x` or `status[](name, level)`, got `{text}`")
    path = _path(listed[1].strip())
    each = tuple(_field(entry, depth + 1) for entry in split(listed[3] or ""))
    if not each:
        raise BadList(f"`{text}`: expected its fields in brackets, or `{path}` for the whole list")
    return Field(field=path, each=each)


def _path(text: str) -> str:
    if not _PATH.fullmatch(text):
        raise BadList(f"`{text}` is not a field; expected a path such as `pose.position.x`")
    return text


def _element(field: str | Field) -> Parameter:
    if isinstance(field, str):
        return Parameter(name=field, type=ELEMENT)
    return Parameter(name=field.field, type="list", each=tuple(_element(one) for one in field.each))
