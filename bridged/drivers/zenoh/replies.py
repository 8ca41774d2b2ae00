"""What a reply of a robot's service says: that it was done, or why it was not."""

from __future__ import annotations

import json
from collections.abc import Mapping

from bridged.drivers.api import Outcome
from bridged.drivers.zenoh.payload_codecs import BadPayload, codec_for
from commd.bus.raw import Sample

DONE = ("success", "ok")
"""Fields that say by true or false whether it was done."""
RESULT = "result"
"""A field that says it by a number, 0 for done, or by true or false."""
WHY = ("message", "reason", "error")
"""Fields that say why not, in words."""
_WORDS = 200
"""Characters of a reply that are told."""


def read_reply(key: str, reply: Sample, payload: str) -> tuple[Outcome, Mapping[str, object]]:
    """Return how a service's work went by one of its replies, and the reply's fields.

    `payload` is what it speaks if its Encoding does not say it.
    """
    if reply.error:
        said = reply.payload.decode(errors="replace").strip()[:_WORDS]
        return Outcome("failed", f"{key}: {said or 'an error without words'}"), {}
    try:
        fields = codec_for(reply.encoding, payload).decode(reply.payload)
    except BadPayload as bad:
        return Outcome("failed", f"{key}: its reply cannot be read: {bad}"), {}
    if not _refuses(fields):
        return Outcome("succeeded"), fields
    found = [text for name in WHY if isinstance(text := fields.get(name), str) and text]
    why = found[0] if found else json.dumps(fields, default=str)
    return Outcome("failed", f"{key}: {why[:_WORDS]}"), fields


def _refuses(fields: Mapping[str, object]) -> bool:
    """Whether a reply says that it was not done; `success` and `ok` stand above `result`."""
    said = [done for name in DONE if isinstance(done := fields.get(name), bool)]
    if said:
        return not all(said)
    result = fields.get(RESULT)
    if isinstance(result, bool):
        return not result
    return isinstance(result, int | float) and result != 0
