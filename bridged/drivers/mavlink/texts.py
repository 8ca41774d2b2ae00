"""STATUSTEXTs of a vehicle, kept for a while: they come before or after the acknowledgement that they explain."""

from __future__ import annotations

from collections import deque

from pymavlink.dialects.v20 import ardupilotmega as dialect

MAX_TEXTS = 50
MAX_PARTS = 16
"""Chunks of one long text (MAVLink 2: 50 characters each)."""
MAX_INFORMATION = 3
"""Texts of no weight that a reason shows when there was no warning; the last ones."""
NOTABLE = dialect.MAV_SEVERITY_WARNING
"""Refusals come as warnings and worse; information is left out of reasons when there is something worse."""


class Texts:
    """The last texts with the time at which they came."""

    def __init__(self) -> None:
        self._texts: deque[tuple[float, int, str]] = deque(maxlen=MAX_TEXTS)
        self._parts: dict[int, list[str]] = {}

    def receive(self, message: dialect.MAVLink_message, now: float) -> None:
        """Take in a STATUSTEXT, or one chunk of a long one."""
        text = message.text
        if message.id:
            parts = self._parts.setdefault(message.id, [])
            parts.append(text)
            if len(text) == 50 and len(parts) < MAX_PARTS:
                if len(self._parts) > MAX_TEXTS:
                    self._parts.pop(next(iter(self._parts)))
                return
            text = "".join(self._parts.pop(message.id))
        text = text.strip()
        if text:
            self._texts.append((now, message.severity, text))

    def since(self, when: float) -> str:
        """What was said since `when`, without repetitions: the warnings, or the last lines if there was no warning."""
        said = [text for at, _, text in self._texts if at >= when]
        return self.warnings(when) or "; ".join(dict.fromkeys(said[-MAX_INFORMATION:]))

    def warnings(self, when: float) -> str:
        """The warnings and worse since `when`, without repetitions."""
        return "; ".join(dict.fromkeys(text for at, how, text in self._texts if at >= when and how <= NOTABLE))
