"""The records on docs/reference/records.md, from their declarations: `python -m tests.docs.records_page`."""

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import get_args

import schemas.wire.records
from schemas.wire.keys import CHANNELS
from schemas.wire.records import VERSION
from tests.docs.pages import ROOT, with_part

SOURCES = tuple(ROOT / f"schemas/wire/{name}.py" for name in ("records", "vehicle_records", "mind_records"))
PAGE = ROOT / "docs/reference/records.md"
_HEAD = f"""\
<!-- Written by `make reference` from schemas/wire/records.py, vehicle_records.py and mind_records.py. -->

What travels on the [keys](bus-keys.md), as JSON objects (or MessagePack maps). The Encoding of a sample names its
record and major version: `application/json;argosy.Perception/{VERSION}`. A field that has its default is left out.
Fields that a reader does not know are ignored and counted; new fields are optional, so that newer and older daemons
[work together](../guides/operations.md#versions). A Term is written as [described there](bus-keys.md#terms).
"""


@dataclass(frozen=True)
class RecordPage:
    """A record as its declaration tells it."""

    name: str
    text: str
    fields: list[tuple[str, str, str, str]] = field(default_factory=list)
    """Name, type, default and meaning."""


def records() -> Iterator[RecordPage]:
    """The records in the order of the file, without what they derive from."""
    for node in (node for source in SOURCES for node in ast.parse(source.read_text(encoding="utf-8")).body):
        if isinstance(node, ast.ClassDef) and node.name != "Record":
            reported = RecordPage(node.name, _paragraphs(ast.get_docstring(node) or ""))
            for at, one in enumerate(node.body):
                if isinstance(one, ast.AnnAssign) and isinstance(one.target, ast.Name):
                    default = "needed" if one.value is None else _default(ast.unparse(one.value))
                    reported.fields.append(
                        (one.target.id, _type(one.annotation), default, _meaning(node.body[at + 1 :]))
                    )
            yield reported


def _paragraphs(text: str) -> str:
    return re.sub(r"(?<!\n)\n(?!\n)", " ", text)


def _meaning(following: list[ast.stmt]) -> str:
    """The text below a field, if there is one."""
    match following[:1]:
        case [ast.Expr(value=ast.Constant(value=str(text)))]:
            return re.sub(r"\s+", " ", text)
    return ""


def _type(annotation: ast.expr) -> str:
    text = re.sub(r"\btuple\[(.*), \.\.\.\]", r"list of \1", ast.unparse(annotation).replace(" | None", ""))
    for alias, plain in (("Finite", "float"), ("Int64", "int"), ("Boot", "str")):
        text = re.sub(rf"\b{alias}\b", plain, text)
    if words := get_args(getattr(schemas.wire.records, text, None)):  # such as `State`
        return ", ".join(f"`{word}`" for word in words)
    if reported := re.fullmatch(r"Literal\[(.*)\]", text):
        return ", ".join(f"`{word}`" for word in reported[1].replace("'", "").split(", "))
    text = re.sub(r"\bstr\b", "string", re.sub(r"\bfloat\b", "number", re.sub(r"\bbool\b", "true or false", text)))
    text = re.sub(r"dict\[(\w+), (.*)\]", r"object: \1 to \2", text)
    return re.sub(r"tuple\[(.*), \.\.\.\]", r"list of \1", re.sub(r"\bint\b", "integer", text)).replace(
        "Any", "anything"
    )


def _default(text: str) -> str:
    shown = {"()": "`[]`", "Header()": "", "None": "none", "''": '`""`', "True": "`true`", "False": "`false`"}
    return shown.get(text, f"`{text}`".replace("'", '"'))


def _carried(name: str) -> str:
    """The keys that carry a record."""
    asked = [f"`{one.key}`" for one in CHANNELS if one.carries is not None and one.carries.__name__ == name]
    given = [f"`{one.key}`" for one in CHANNELS if one.answers is not None and one.answers.__name__ == name]
    parts = [f"on {', '.join(asked)}"] * bool(asked) + [f"in answers of {', '.join(given)}"] * bool(given)
    text = ", ".join(parts)
    return f"{text[0].upper()}{text[1:]}.\n\n" if text else ""


def page() -> str:
    """Return the page with the records as they are declared."""
    parts = [_HEAD]
    for reported in records():
        parts.append(f"\n## {reported.name}\n\n{reported.text}\n\n{_carried(reported.name)}{table(reported)}")
    return with_part(PAGE, "records", "".join(parts))


def table(reported: RecordPage) -> str:
    """The fields of a record."""
    rows = "".join(f"| `{name}` | {' | '.join(_cell(one) for one in rest)} |\n" for name, *rest in reported.fields)
    return f"| field | type | default | meaning |\n|---|---|---|---|\n{rows}"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
