"""The codec `argosy` of zenoh-cli: `--decoder argosy` shows any record in one line, `--encoder argosy` reads text.

A plug-in of that tool (entry points `zenoh_cli.codecs.decoders` and `.encoders`); it is given the key and the bytes,
and not the Encoding.
"""

from __future__ import annotations

import re

from argosy.tools.record_text import line_of, read_action
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.mind_records import MindOrder
from schemas.wire.records import Action, Cancel, Perception, Record, StopOrder
from schemas.wire.term_text import BadTerm

_CALLED = re.compile(r"[^\s\"(]*\(")
"""How `takeoff(5)` begins, and `set_mode "a (b)"` does not."""
_NAME = re.compile(r"[a-z]\w*", re.ASCII)
_WORD = re.compile(r'"(?:\\.|[^"\\])*"|\S+')
FORMS = "an action (`takeoff(5)`), a percept (`victim(1,2)`, `+victim(1,2)`, `-victim`), the id of an action to cancel"


def decode(key: object, value: bytes) -> str:
    """Return what was put or answered on a key in one line, JSON or MessagePack."""
    return line_of(str(key), value)


def encode(key: object, value: str) -> bytes:
    """Return the record, as JSON, that a text means on a key. Ends zenoh-cli with an error if it means none."""
    if value.lstrip().startswith("{"):
        return value.encode()
    try:
        record = _record(str(key).partition("?")[0], value.strip())
    except BadTerm as bad:
        raise SystemExit(f"error: {bad}") from None
    return codec(type(record)).encode(record)


def _record(key: str, text: str) -> Record:
    parsed = keys.parse(key)
    match (parsed[2] if parsed is not None else []), text.split(maxsplit=1):
        case ["action", *_], [_, *_]:
            name, parameters = read_action(*_named(text))
            return Action(name=name, parameters=parameters)
        case ["percept_by_hand", *_], [_, *_]:
            name, parameters = read_action(*_named(text.lstrip("+-")))
            update = {"+": "add", "-": "remove"}.get(text[0], "replace")
            return Perception(name=name, parameters=parameters, update=update)  # type: ignore[arg-type]
        case ["cancel"], [identity]:
            return Cancel(id=identity)
        case ["stop"], ["hold" | "land" | "rtl" | "release" | "pause" | "continue" as order]:
            return StopOrder(order=order)
        case ["control"], [("pause" | "step" | "resume" | "goal" | "belief") as do, *rest]:
            return MindOrder(do=do, text="".join(rest))
    raise BadTerm(f"`{text}` means nothing on {key}: expected JSON, {FORMS}, a stop order or an order to a mind")


def _named(text: str) -> tuple[str, tuple[str, ...]]:
    """Split `takeoff 5` into name and arguments; leave `takeoff(5)` as it is. Raises BadTerm for no name."""
    if _CALLED.match(text):
        return text, ()
    first, *rest = _WORD.findall(text) or ("",)
    if not _NAME.fullmatch(first):
        raise BadTerm(f"expected the name of an action or a percept, got `{first}`")
    return first, tuple(rest)
