"""Compares plain data (what TOML or JSON holds) with a msgspec model, and tells everything that does not fit.

msgspec itself stops at the first problem and does not say in which entry of a mapping it is.
"""

from __future__ import annotations

import re
import types
import typing
from collections.abc import Callable, Iterator, Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Literal, Union, get_args, get_origin

import msgspec

from schemas.files import first_use
from schemas.files.yaml_positions import did_you_mean

Path = tuple[str, ...]
Hook = Callable[[type, Any], Any]
MAX_DEPTH = 40
"""Values nested deeper fit no model of ours."""


def misfits(value: object, model: Any, hook: Hook, path: Path = ()) -> Iterator[tuple[Path, str]]:
    """Each thing that is wrong with `value`, and where: an unknown key, a missing field, a value of another kind.

    What `hook` cannot decode it tells by a ValueError in words, as msgspec's `dec_hook` does.
    """
    if len(path) > MAX_DEPTH:
        yield path, "nested too deeply"
        return
    options = _options(model)
    struct = next((one for one in options if _is_struct(one)), None)
    mapping = next((one for one in options if get_origin(one) is dict), None)
    array = next((one for one in options if get_origin(one) in (tuple, list)), None)
    if isinstance(value, dict) and struct is not None:
        yield from _fields(value, struct, hook, path)
    elif isinstance(value, dict) and mapping is not None:
        for key, item in value.items():
            yield from misfits(item, get_args(mapping)[1], hook, (*path, str(key)))
    elif isinstance(value, list) and array is not None:
        for index, item in enumerate(value):
            yield from misfits(item, get_args(array)[0], hook, (*path, str(index)))
    else:
        try:
            first_use.convert(value, model, hook)
        except msgspec.ValidationError as error:
            yield path, _plain(error, value, options)


def _fields(value: dict[str, Any], model: Any, hook: Hook, path: Path) -> Iterator[tuple[Path, str]]:
    fields = _fields_of(model)
    for name, item in value.items():
        if name in fields:
            yield from misfits(item, fields[name].type, hook, (*path, name))
        else:
            yield (*path, name), f"there is no such field{did_you_mean(name, fields)}"
    for name, field in fields.items():
        if field.required and name not in value:
            yield path, f"needs the field `{name}`"


@lru_cache(maxsize=64)
def _fields_of(model: type[msgspec.Struct]) -> Mapping[str, msgspec.structs.FieldInfo]:
    """The fields of a model by their names in files; msgspec reads the annotations anew each time it is asked."""
    return MappingProxyType({field.encode_name: field for field in msgspec.structs.fields(model)})


def _options(model: Any) -> tuple[Any, ...]:
    """The members of a union, without what annotates them."""
    origin = get_origin(model)
    if origin is typing.Annotated:
        return _options(get_args(model)[0])
    if origin in (Union, types.UnionType):
        return tuple(option for member in get_args(model) for option in _options(member))
    return (model,)


def _is_struct(model: Any) -> bool:
    return isinstance(model, type) and issubclass(model, msgspec.Struct)


def _plain(error: msgspec.ValidationError, value: object, options: tuple[Any, ...]) -> str:
    """msgspec's sentence without its path, in words of files and with what came if that is short."""
    said = str(error).partition(" - at `")[0]
    choices = [choice for one in options if get_origin(one) is Literal for choice in get_args(one)]
    if said.startswith("Invalid enum") or (choices and isinstance(value, str)):
        return f"expected {' or '.join(f'`{choice}`' for choice in choices)}, got `{value}`"
    plain = _KINDS.sub(_kinds, said)
    if ", got" not in plain and isinstance(value, str | int | float):
        plain += f", got `{str(value)[:40]}`"
    return plain[:1].lower() + plain[1:]


def _kinds(quoted: re.Match[str]) -> str:
    """The kinds in msgspec's backquotes, such as `str | object | null`."""
    names = [name for name in quoted[1].split(" | ") if name != "null"]
    return " or ".join(_WORDS.get(name, f"`{name}`") for name in names)


_KINDS = re.compile(r"`([a-z |]+)`")
_WORDS = {"object": "a table", "array": "a list", "null": "nothing"}
