"""The JSON Schema of manifests, for editors: types, ranges, choices and descriptions.

`msgspec.json.schema` cannot write a default that is a `Duration`, and takes no docstrings of fields.

It cannot express rules between fields (a key beyond the arguments, a minimum above the maximum) and what drivers know:
`argosy manifest check` checks those too.
"""

from __future__ import annotations

import ast
import json
from inspect import cleandoc, getsource
from typing import Annotated, Any

import msgspec
from msgspec import Meta, inspect

from schemas.files.units import Duration
from schemas.manifest.document import plain
from schemas.manifest.model import WAYS, ActionEntry, Manifest, PerceptEntry, RobotEntry
from schemas.manifest.rules import FUNCTOR, RESERVED
from schemas.wire.records import Order

FILE = "manifest.schema.json"
"""Its name beside the shipped manifests."""
DURATION: dict[str, Any] = {
    "description": "A length of time: `5s`, `500ms`, `15min`, `1h`, or a number of seconds.",
    "anyOf": [
        {"type": "number", "minimum": 0},
        {"type": "string", "pattern": r"^\s*\d+(\.\d+)?\s*(ms|s|min|m|h)?\s*$"},
    ],
}
Name = Annotated[str, Meta(pattern=f"^{FUNCTOR.pattern}$")]


class Document(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """A robot, declaratively: its percepts, its actions, and their driver."""

    robot: RobotEntry
    percepts: dict[Name, PerceptEntry] = {}
    actions: dict[Name, ActionEntry] = {}
    orders: dict[Order, str] = {}


def schema_text() -> str:
    """Return the schema as it is shipped."""
    return json.dumps(schema(), indent=2, ensure_ascii=False) + "\n"


def schema() -> dict[str, Any]:
    """Return the JSON Schema of a manifest."""
    definitions: dict[str, Any] = {}
    document = _struct(inspect.type_info(Document), definitions)
    definitions["ActionEntry"]["oneOf"] = [{"required": [way]} for way in WAYS]
    for table, names in RESERVED.items():
        document["properties"][table]["propertyNames"]["not"] = {"enum": sorted(names)}
    head = {"$schema": "https://json-schema.org/draft/2020-12/schema", "$id": "urn:argosy:manifest"}
    return {**head, **document, "title": "Argosy manifest", "$defs": dict(sorted(definitions.items()))}


def _node(kind: inspect.Type, definitions: dict[str, Any]) -> dict[str, Any]:
    """Return the schema of one type; structs go into `definitions`."""
    match kind:
        case inspect.StructType(cls=cls):
            if cls.__name__ not in definitions:
                definitions[cls.__name__] = {}  # one that holds itself refers to this
                definitions[cls.__name__] = _struct(kind, definitions)
            return {"$ref": f"#/$defs/{cls.__name__}"}
        case inspect.CustomType(cls=cls) if cls is Duration:
            return DURATION
        case inspect.Metadata(type=inner):
            return _node(inner, definitions)
        case inspect.NoneType():
            return {}
        case inspect.BoolType():
            return {"type": "boolean"}
        case inspect.IntType() | inspect.FloatType():
            bounds = {"minimum": kind.ge, "maximum": kind.le, "exclusiveMinimum": kind.gt, "exclusiveMaximum": kind.lt}
            name = "integer" if isinstance(kind, inspect.IntType) else "number"
            return {"type": name} | {bound: figure for bound, figure in bounds.items() if figure is not None}
        case inspect.StrType(pattern=pattern):
            return {"type": "string"} | ({"pattern": pattern} if pattern else {})
        case inspect.LiteralType(values=values):
            return {"enum": list(values)}
        case inspect.VarTupleType(item_type=item):
            return {"type": "array", "items": _node(item, definitions)}
        case inspect.DictType(key_type=key, value_type=value):
            node = {"type": "object", "additionalProperties": _node(value, definitions)}
            return node if key == inspect.StrType() else node | {"propertyNames": _node(key, definitions)}
        case inspect.UnionType(types=kinds):
            options = [option for one in kinds if (option := _node(one, definitions))]
            return options[0] if len(options) == 1 else {"anyOf": options}
    raise NotImplementedError(f"no schema for {kind!r}")


def _struct(kind: inspect.Type, definitions: dict[str, Any]) -> dict[str, Any]:
    assert isinstance(kind, inspect.StructType)
    texts = _docs(Manifest if kind.cls is Document else kind.cls)
    properties: dict[str, Any] = {}
    for field in kind.fields:
        node = _node(field.type, definitions)
        if text := texts.get(field.encode_name):
            node = {"description": text} | {name: part for name, part in node.items() if name != "description"}
        if field.default is not msgspec.NODEFAULT and field.default not in (None, "", (), msgspec.UNSET):
            node = node | {"default": msgspec.to_builtins(field.default, enc_hook=plain)}
        properties[field.encode_name] = node
    return {
        "title": kind.cls.__name__,
        "description": " ".join(cleandoc(kind.cls.__doc__ or "").split()),
        "type": "object",
        "properties": properties,
        "required": [field.encode_name for field in kind.fields if field.required],
        "additionalProperties": False,
    }


def _docs(kind: type) -> dict[str, str]:
    """Return the docstrings of a class's fields, which Python itself does not keep."""
    body = ast.parse(getsource(kind)).body[0]
    assert isinstance(body, ast.ClassDef)
    texts: dict[str, str] = {}
    for field, after in zip(body.body, body.body[1:], strict=False):
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and isinstance(after, ast.Expr):
            text = ast.literal_eval(after.value)
            texts[field.target.id] = " ".join(cleandoc(text).split())
    return texts
