"""Report machines that this board's router refuses. Zenoh only logs failed handshakes, on standard output; these lines
are read, logged and counted for health. They do not identify the peer.
"""

from __future__ import annotations

import logging
import os
import re
import sys
import threading
import time
from collections import Counter

import zenoh

from commd.process.output import stdout

COUNTED = "refused"
"""Counter in commd's health."""
_FILTER = "off,zenoh_link_tls=warn"
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_ALERT = re.compile(r"zenoh_link_tls\S*: (.*?)\.? Hint:")
MEANINGS = (
    ("peer sent no certificates", "it showed no certificate"),
    ("certificate expired", "its certificate has expired"),
    ("certificate not valid yet", "its certificate is not valid yet, by the clock here"),
    ("BadSignature", "its certificate is of another authority"),
    ("UnknownIssuer", "its certificate is of another authority, or was revoked"),
    ("received fatal alert", "it does not accept the certificate of this board"),
    ("corrupt message", "it speaks no TLS"),
    ("eof", "it hung up"),
)
"""Parts of Zenoh's messages and their meaning; the first match counts."""
LOG_EVERY = 60.0
"""Wall seconds between two lines about the same reason: a refused machine keeps dialling."""
LONGEST = 200
"""Characters of a message that is not in `MEANINGS`."""
REASONS = 100
"""Different reasons at most: unknown messages depend on what was sent."""
log = logging.getLogger("refusals")
counters: Counter[str] = Counter()
"""Refusals in this process."""
_logged: dict[tuple[str, str], float] = {}
_unlogged: Counter[tuple[str, str]] = Counter()


def count_rejection(why: str, address: str = "") -> None:
    """Count a refusal, and log it unless the same reason was logged within `LOG_EVERY`."""
    counters[COUNTED] += 1
    reason = why, address
    if len(_logged) >= REASONS and reason not in _logged and why not in dict(MEANINGS).values():
        reason = "for another reason", ""
    _unlogged[reason] += 1
    if time.monotonic() - _logged.get(reason, -LOG_EVERY) >= LOG_EVERY:
        _logged[reason] = time.monotonic()
        whose = f" address={reason[1]}" if reason[1] else ""
        log.warning("refused a machine that dials this board: %s count=%d%s", reason[0], _unlogged.pop(reason), whose)


def hear_refusals() -> None:
    """Read Zenoh's messages about handshakes from now on, unless RUST_LOG is set.

    Descriptor 1 is Zenoh's then; `output.stdout` and Python's `print` still write to the former standard output.
    """
    if "RUST_LOG" in os.environ:
        return
    stdout().keep()
    sys.stdout = os.fdopen(os.dup(1), "w", buffering=1, encoding=sys.stdout.encoding, errors="backslashreplace")
    read, write = os.pipe()
    os.dup2(write, 1)
    os.close(write)
    zenoh.init_log_from_env_or(_FILTER)
    threading.Thread(target=_read, args=(read,), name="refusals", daemon=True).start()


def _read(descriptor: int) -> None:
    with open(descriptor, encoding="utf-8", errors="replace") as lines:
        for line in lines:
            if (text := _ALERT.search(_COLOUR.sub("", line))) is None:
                continue
            count_rejection(reason_of(text[1]))


def reason_of(text: str) -> str:
    """Return the meaning of Zenoh's message; an unknown one is shortened."""
    return next((words for part, words in MEANINGS if part in text), text[:LONGEST])
