"""Daemons of another major version of the records: refused at the start, and told of for as long as they are heard."""

from __future__ import annotations

import logging
from collections.abc import Callable

from schemas.wire import keys
from schemas.wire.records import VERSION, Note

HEARD = 60.0
"""Wall seconds after its last record for which a stranger is told of."""
MOST = 20
"""Strangers that are told of."""
log = logging.getLogger("versions")


class Strangers:
    """Who says what this version cannot understand, by what stands in their keys."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._heard: dict[str, tuple[str, float]] = {}

    def heard(self, key: str, said: str) -> None:
        """Note a record of another version, and tell of it if it is the first of these."""
        parsed = keys.parse(key)
        who = "/".join((parsed[1], *parsed[2][:1])) if parsed is not None else key
        self._forget()
        if who not in self._heard:
            if len(self._heard) >= MOST:
                return
            log.error("other_version %s", _text(who, said))
        self._heard[who] = (said, self._now())

    def notes(self) -> tuple[Note, ...]:
        """Return a note for each sender heard lately."""
        self._forget()
        return tuple(Note("other_version", _text(who, said), who) for who, (said, _) in self._heard.items())

    def _forget(self) -> None:
        since = self._now() - HEARD
        self._heard = {who: met for who, met in self._heard.items() if met[1] >= since}


def _text(who: str, said: str) -> str:
    return (
        f"{who}: records of version {said or '?'}, this daemon speaks version {VERSION}: they are not understood;"
        " install releases of Argosy that go together (docs/guides/operations.md)"
    )
