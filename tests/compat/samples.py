"""Samples of every record, made from what the record declares: each field set, only those that must be, each choice."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from typing import Any

import msgspec
from msgspec import inspect

from schemas.wire import mind_records, records
from schemas.wire.codec import codec
from schemas.wire.records import Record
from schemas.wire.terms import (
    Atom,
    Map,
    Number,
    OpenList,
    Queue,
    Set,
    Source,
    Structure,
    Term,
    Variable,
    decode_hook,
)

TERMS: tuple[Term, ...] = (
    1,
    2.5,
    "text",
    True,
    [1, [2]],
    Atom("guided"),
    Number("Infinity"),
    Structure("pos", (1, Variable("X")), (Structure("source", (Atom("uav"),)),), negated=True, namespace="lab"),
    OpenList((1,), Variable("T")),
    Source("plan", "+!g <- !a."),
    Map(((1, Atom("a")),)),
    Set((1, 2)),
    Queue((2, 1), priority=True),
)


def all_records() -> dict[str, type[Record]]:
    """Return the records of this version by their names."""
    found = (
        one
        for one in (vars(records) | vars(mind_records)).values()
        if isinstance(one, type) and issubclass(one, Record)
    )
    return {one.__name__: one for one in found if one is not Record}


def samples(record: type[Record]) -> Iterator[Record]:
    """Yield a record with all fields, one with only those that it must have, and one with each choice of a field."""
    fields = _fields(record)
    full = {field.name: _sample(field.name, field.type, field.default) for field in fields}
    yield _made(record, full)
    yield _made(record, {field.name: full[field.name] for field in fields if field.required})
    for field in fields:
        if isinstance(field.type, inspect.LiteralType):
            for value in field.type.values:
                yield _made(record, {**full, field.name: value})


def _fields(record: type[Record]) -> tuple[inspect.Field, ...]:
    declared = inspect.type_info(record)
    assert isinstance(declared, inspect.StructType)
    return declared.fields


def _made(record: type[Record], values: dict[str, Any]) -> Record:
    return msgspec.convert(values, record, dec_hook=decode_hook)


def _sample(name: str, kind: inspect.Type, default: Any = None) -> Any:
    """Return a value of a type that is not its default."""
    match kind:
        case inspect.BoolType():
            return default is not True
        case inspect.IntType():
            return 7
        case inspect.FloatType():
            return 1.5
        case inspect.StrType():
            return f"some {name}"
        case inspect.LiteralType(values=values):
            return next(value for value in values if value != default)
        case inspect.UnionType(types=types):
            return _sample(name, next(one for one in types if not isinstance(one, inspect.NoneType)), default)
        case inspect.VarTupleType(item_type=inspect.CustomType()):
            return TERMS
        case inspect.VarTupleType(item_type=item):
            return (_sample(name, item),)
        case inspect.DictType(key_type=key, value_type=value):
            return {_sample(name, key): _sample(name, value)}
        case inspect.StructType(cls=cls):
            return next(samples(cls))
        case inspect.CustomType() | inspect.AnyType():
            return TERMS[7] if isinstance(kind, inspect.CustomType) else 5
    raise AssertionError(f"no sample of {kind} for {name}")


def recorded() -> dict[str, list[dict[str, str]]]:
    """Return the samples of all records as they go over the wire."""
    return {
        name: [
            {
                "encoding": codec(record).encoding("json"),
                "json": codec(record).encode(one, "json").decode(),
                "msgpack": base64.b64encode(codec(record).encode(one, "msgpack")).decode(),
            }
            for one in samples(record)
        ]
        for name, record in sorted(all_records().items())
    }
