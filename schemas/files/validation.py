"""Convert plain data (from TOML, JSON or YAML) to msgspec models, and find every mismatch.

msgspec itself stops at the first problem, and does not say in which entry of a mapping it is. Two threads that use a
type for the first time together end the process by SIGSEGV (msgspec 0.22), so types are converted, and codecs are
made, under a lock.
"""

from __future__ import annotations

import math
import re
import threading
import types
import typing
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

import msgspec

from schemas.files.findings import did_you_mean, near_miss

T = TypeVar("T")

FIRST_USE: Final = threading.RLock()
"""Held while msgspec may inspect a type for the first time."""


def convert(value: object, kind: type[T], dec_hook: Callable[[type, Any], Any]) -> T:
    """Call `msgspec.convert` under the lock. Raises msgspec.ValidationError."""
    with FIRST_USE:
        return msgspec.convert(value, kind, dec_hook=dec_hook)


Path = tuple[str | int, ...]
Hook = Callable[[type, Any], Any]
MAX_DEPTH = 40
"""No model of ours is nested deeper."""


class Misfit(NamedTuple):
    """A mismatch: an unknown key, a missing field, a value of another kind."""

    path: Path
    text: str
    at_key: bool = False
    """Whether it is about the key, not about the value."""


def misfits(value: object, model: Any, hook: Hook, path: Path = ()) -> Iterator[Misfit]:
    """Yield each mismatch between plain data and a model.

    `hook` is msgspec's `dec_hook`: it raises ValueError for a value that it cannot decode.
    """
    if len(path) > MAX_DEPTH:
        yield Misfit(path, "nested too deeply")
        return
    options = _options(model)
    structs = [one for one in options if is_struct(one)]
    mapping = next((one for one in options if get_origin(one) is dict), None)
    array = next((one for one in options if get_origin(one) in (tuple, list)), None)
    if isinstance(value, dict) and len(structs) == 1:
        yield from _fields(value, structs[0], hook, path)
    elif isinstance(value, dict) and structs:
        yield from _tagged(value, structs, hook, path)
    elif isinstance(value, dict) and mapping is not None:
        for key, item in value.items():
            yield from misfits(item, get_args(mapping)[1], hook, (*path, str(key)))
    elif isinstance(value, list) and array is not None and len(items := _items(array, len(value))) == len(value):
        for index, item in enumerate(value):
            yield from misfits(item, items[index], hook, (*path, index))
    elif isinstance(value, float) and not math.isfinite(value) and float in options:
        yield Misfit(path, f"expected a finite number, got `{value}`")
    else:
        try:
            convert(value, model, hook)
        except msgspec.ValidationError as error:
            expected = _described(model)
            got = f"expected {expected}, got `{str(value)[:40]}`"
            yield Misfit(path, got if expected else _plain(error, value, options))


def _items(array: Any, count: int) -> Sequence[Any]:
    """Return the types of the elements of a list with `count` of them: each its own, if the length is fixed."""
    kinds = get_args(array)
    return kinds if get_origin(array) is tuple and Ellipsis not in kinds else kinds[:1] * count


def _fields(value: dict[str, Any], model: Any, hook: Hook, path: Path) -> Iterator[Misfit]:
    fields = _fields_of(model)
    for name, item in value.items():
        if name in fields:
            yield from misfits(item, fields[name].type, hook, (*path, name))
        else:
            yield Misfit((*path, name), f"there is no such field{did_you_mean(name, fields)}", at_key=True)
    for name, field in fields.items():
        if field.required and name not in value:
            yield Misfit(path, f"needs the field `{name}`", at_key=True)


def _tagged(value: dict[str, Any], structs: Sequence[Any], hook: Hook, path: Path) -> Iterator[Misfit]:
    """Yield the mismatches with one of several models, which the value of a field names."""
    field, models = structs[0].__struct_config__.tag_field, {one.__struct_config__.tag: one for one in structs}
    tag = str(value.get(field, ""))
    if tag in models:
        yield from _fields({name: item for name, item in value.items() if name != field}, models[tag], hook, path)
    else:
        got = f"`{tag[:40]}`{near_miss(tag, models)}" if tag else "none"
        yield Misfit(path, f"`{field}`: expected one of {', '.join(models)}, got {got}")


@lru_cache(maxsize=64)
def _fields_of(model: type[msgspec.Struct]) -> Mapping[str, msgspec.structs.FieldInfo]:
    """The fields of a model by their names in files; cached, because msgspec evaluates the annotations in each call."""
    return MappingProxyType({field.encode_name: field for field in msgspec.structs.fields(model)})


def _options(model: Any) -> tuple[Any, ...]:
    """Return the members of a union without their annotations."""
    origin = get_origin(model)
    if origin is typing.Annotated:
        return _options(get_args(model)[0])
    if _is_union(model):
        return tuple(option for member in get_args(model) for option in _options(member))
    return (model,)


def _is_union(model: Any) -> bool:
    return get_origin(model) in (Union, types.UnionType)


def _described(model: Any) -> str:
    """Return the description of a type that has one (`msgspec.Meta`): what is expected, for people."""
    metas = (one for one in get_args(model) if isinstance(one, msgspec.Meta) and one.description)
    if meta := next(metas, None):
        return meta.description or ""
    return next(filter(None, map(_described, get_args(model))), "") if _is_union(model) else ""


def is_struct(model: Any) -> bool:
    """Whether a type is a msgspec struct."""
    return isinstance(model, type) and issubclass(model, msgspec.Struct)


def _plain(error: msgspec.ValidationError, value: object, options: tuple[Any, ...]) -> str:
    """Return msgspec's message without its path, in the terms of files, with the value if that is short."""
    message = str(error).partition(" - at `")[0]
    choices = [choice for one in options if get_origin(one) is Literal for choice in get_args(one)]
    if message.startswith("Invalid enum") or (choices and isinstance(value, str)):
        listed = ["a list"] if any(get_origin(one) in (tuple, list) for one in options) else []
        return f"expected {' or '.join([*(f'`{choice}`' for choice in choices), *listed])}, got `{value}`"
    scalar, shown = isinstance(value, str | int | float), str(value)[:40]
    if scalar and message.startswith("Expected `"):  # the value says more than its kind
        shown = f'"{shown}"' if isinstance(value, str) else shown.lower() if isinstance(value, bool) else shown
        message = message.partition(", got")[0]
    plain = _KINDS.sub(_kinds, message)
    if scalar and ", got" not in plain:
        plain += f", got `{shown}`"
    return plain[:1].lower() + plain[1:]


def _kinds(quoted: re.Match[str]) -> str:
    """Return msgspec's quoted types, such as `str | object | null`, in the terms of files."""
    names = [name for name in quoted[1].split(" | ") if name != "null"] or ["null"]
    return " or ".join(_WORDS.get(name, f"`{name}`") for name in names)


_KINDS = re.compile(r"`([a-z |]+)`")
_WORDS = {
    "object": "a table",
    "array": "a list",
    "null": "nothing",
    "str": "a text",
    "int": "an integer",
    "float": "a number",
    "bool": "`true` or `false`",
}
