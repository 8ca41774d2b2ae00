"""What of all that is heard goes into a recording, and under which key."""

from __future__ import annotations

from typing import Final

from argosy.recording.file import json_conversion
from argosy.recording.file.key_filter import is_plain
from argosy.recording.file.mind_inputs import PART
from argosy.recording.file.records import PREFIX, TokenSeen, Unread
from argosy.recording.file.write_queue import Heard
from argosy.recording.record.minds import Minds, Whose
from schemas.wire import keys
from schemas.wire.codec import codec

NOTES: Final = "argosy/recorder"
"""The topic of what the recorder says of itself."""
MOST_STREAMS: Final = 60_000
"""Keys of which is known what was heard last."""


class Sieve:
    """Takes what was heard, in order, and leaves out what was heard before."""

    def __init__(self, minds: Minds, *, several: bool) -> None:
        """`minds` are told of their inputs and ends. `several`: the same may be heard by more than one way."""
        self.wild = 0
        """Messages that were put on many keys at once."""
        self._minds, self._several = minds, several
        self._newest: dict[str, tuple[str, int]] = {}

    def new(self, heard: Heard) -> Heard | None:
        """Return what is to be written of a message; None if it was heard already."""
        if not is_plain(heard.key):
            return self._wild(heard)
        return heard if self._wanted(heard) else None

    def _wild(self, heard: Heard) -> Heard:
        """Return what was put on many keys at once as something that the recorder tells: it is no topic."""
        self.wild += 1
        payload = json_conversion.unread(heard.payload, heard.encoding, deleted=heard.deleted, key=heard.key)
        return Heard(heard.at, NOTES, payload, f"application/json;{PREFIX}{Unread.__name__}/1", "recorder")

    def _wanted(self, heard: Heard) -> bool:
        """Whether a message is new: what is asked for may have been heard already, and so what comes by two routers."""
        if heard.origin == "token":
            self._token(heard)
        if heard.deleted or heard.origin in ("token", "recorder"):
            return True
        inputs = heard.key.endswith(PART)
        asked_for = "/percept/" in heard.key or heard.key.endswith("/manifest")
        if heard.origin == "put" and not (inputs or asked_for or self._several):
            return True
        said = json_conversion.said_in(heard.payload, heard.encoding)
        if said is None or not said.header.boot:
            return True
        header = said.header
        if inputs and (parsed := keys.parse(heard.key)) is not None:
            return self._minds.heard(Whose(parsed[0], parsed[1], header.boot), said.number, final=said.final)
        boot, seq = self._newest.get(heard.key, ("", -1))
        old = boot == header.boot and header.seq <= seq
        if old and (self._several or heard.origin == "query"):
            return False
        if len(self._newest) >= MOST_STREAMS:
            self._newest.clear()
        self._newest[heard.key] = (header.boot, max(header.seq, seq) if boot == header.boot else header.seq)
        return True

    def _token(self, heard: Heard) -> None:
        """Note which agents are gone."""
        seen = codec(TokenSeen).decode(heard.payload)
        parsed = keys.parse(seen.key)
        if parsed is not None and not seen.alive and parsed[2][:2] == ["alive", "agentd"]:
            self._minds.gone(Whose(parsed[0], parsed[1], parsed[2][-1]))
