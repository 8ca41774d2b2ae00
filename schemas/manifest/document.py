"""A manifest as plain data and as TOML text.

`tomli_w` is not used: it writes each element of a list on its own line, 410 lines for `copter` instead of 265.
"""

from __future__ import annotations

import json
import re
from typing import Any

import msgspec

from schemas.files.units import Duration
from schemas.manifest.model import Manifest

LINE = 110
"""Characters beyond which a list is written with an element a line."""
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+", re.ASCII)
_AS_WRITTEN = frozenset({"fields", "value", "default"})
"""Where a whole number may be meant as one, so that 1.0 stays 1.0; all other figures are of one type."""


def document(manifest: Manifest) -> dict[str, Any]:
    """Return the plain data that a TOML file of this manifest holds: `read_document` makes an equal manifest of it."""
    made: dict[str, Any] = {"robot": _data(manifest.robot)}
    if manifest.orders:
        made["orders"] = dict(manifest.orders)
    if manifest.percepts:
        made["percepts"] = {name: _data(entry) for name, entry in manifest.percepts.items()}
    if manifest.actions:
        made["actions"] = {name: _data(entry) for name, entry in manifest.actions.items()}
    return made


def write_toml(manifest: Manifest) -> str:
    """Return a manifest as the text of a TOML file."""
    return write_document(document(manifest))


def write_document(document: dict[str, Any]) -> str:
    """Return the plain data of a manifest, or of one table of it, as TOML. Entries are tables, the rest is inline."""
    blocks: list[str] = []
    for table in ("robot", "orders"):
        if content := document.get(table):
            blocks.append(_table((table,), content))
    for table in ("percepts", "actions"):
        blocks += [_table((table, name), entry) for name, entry in document.get(table, {}).items()]
    return "\n".join(blocks)


def write_value(value: object) -> str:
    """Return a value in TOML syntax, on one line."""
    match value:
        case bool():
            return "true" if value else "false"
        case str():
            return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
        case int() | float():
            return repr(value)
        case list() | tuple():
            return f"[{', '.join(map(write_value, value))}]"
        case dict():
            return f"{{{', '.join(f'{_key(name)} = {write_value(item)}' for name, item in value.items())}}}"
    raise TypeError(f"TOML has no {type(value).__name__}")


def _table(path: tuple[str, ...], content: dict[str, Any]) -> str:
    lines = [f"[{'.'.join(map(_key, path))}]"]
    for name, value in content.items():
        line = f"{_key(name)} = {write_value(value)}"
        if len(line) > LINE and isinstance(value, list):
            line = "\n".join([f"{_key(name)} = [", *(f"  {write_value(item)}," for item in value), "]"])
        lines.append(line)
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if _BARE_KEY.fullmatch(name) else write_value(name)


def _data(entry: msgspec.Struct) -> Any:
    return _tidy(msgspec.to_builtins(entry, enc_hook=plain))


def plain(value: object) -> object:
    """Return a duration as people write it, if nothing of it is lost: msgspec's `enc_hook`."""
    if isinstance(value, Duration):
        text = str(value)
        try:
            return text if Duration.read(text) == value else float(value)
        except ValueError:
            return float(value)
    raise NotImplementedError(f"no encoding for {type(value).__name__}")


def _tidy(value: Any) -> Any:
    """The same with whole numbers written as such: `rate = 10`."""
    if isinstance(value, dict):
        return {name: item if name in _AS_WRITTEN else _tidy(item) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [_tidy(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() and abs(value) < 1e15 else value
