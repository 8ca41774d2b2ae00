"""The JSON Schema of a record, as Foxglove accepts it.

Foxglove requires an object at the top, `properties` in each object, and one type for each property; lists are of
objects, strings, numbers or booleans. Other fields (terms, lists of lists) are in `patternProperties`, which validators
read and Foxglove ignores: it shows such fields all the same.
"""

from __future__ import annotations

import re
from functools import cache
from typing import Any

import msgspec

from schemas.wire.records import Record

Schema = dict[str, Any]
PLAIN = ("boolean", "integer", "number", "string")


@cache
def json_schema(record: type[Record]) -> bytes:
    """Return the schema as JSON text."""
    (ref,), definitions = msgspec.json.schema_components([record], schema_hook=_hook)
    schema = _object(_inlined(ref, definitions))
    schema["title"] = record.__name__
    schema["description"] = (record.__doc__ or "").strip()
    return msgspec.json.encode({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema})


def _hook(kind: type) -> Schema:
    if kind.__name__ == "Term":  # as schemas.wire.terms.decode_hook knows it
        return {"description": "a term"}
    raise NotImplementedError


def _inlined(schema: Any, definitions: dict[str, Any]) -> Any:
    """Replace references by their definitions; none of our records contains itself."""
    if isinstance(schema, list):
        return [_inlined(item, definitions) for item in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return _inlined(definitions[schema["$ref"].rsplit("/", 1)[-1]], definitions)
    return {name: _inlined(value, definitions) for name, value in schema.items()}


def _object(schema: Schema) -> Schema:
    """Return an object's schema, with the properties that Foxglove can read apart from the others."""
    properties: Schema = {}
    others: Schema = {}
    for name, given in schema.get("properties", {}).items():
        known, simple = _simple(given)
        if simple:
            properties[name] = known
        else:
            others[f"^{re.escape(name)}$"] = known
    made: Schema = {"type": "object", "properties": properties}
    if others:
        made["patternProperties"] = others
    if schema.get("required"):
        made["required"] = schema["required"]
    if isinstance(extra := schema.get("additionalProperties"), dict):
        made["additionalProperties"] = _simple(extra)[0]
    return made


def _simple(given: Schema) -> tuple[Schema, bool]:
    """Return a property's schema, and whether Foxglove can read it."""
    schema = {name: value for name, value in given.items() if name not in ("default", "title", "description")}
    if "anyOf" in schema:  # our encoders leave null out, others may send it
        options = [option for option in schema["anyOf"] if option.get("type") != "null"]
        if len(options) == 1:
            return _simple(options[0])
        return {"anyOf": [_simple(option)[0] for option in options]}, False
    if "enum" in schema and all(isinstance(value, str) for value in schema["enum"]):
        return {"type": "string", "enum": schema["enum"]}, True
    match schema.get("type"):
        case "object":
            return _object(schema), True
        case "array":
            return _array(schema)
        case kind if kind in PLAIN:
            return schema, True
    return schema, False


def _array(schema: Schema) -> tuple[Schema, bool]:
    items = schema.get("items")
    if "prefixItems" in schema or not isinstance(items, dict):
        places = [_simple(place)[0] for place in schema.get("prefixItems", ())]
        return {**schema, "prefixItems": places} if places else schema, False
    item, simple = _simple(items)
    bounds: Schema = {name: schema[name] for name in ("minItems", "maxItems") if name in schema}
    return {"type": "array", "items": item, **bounds}, simple and item.get("type") != "array"
