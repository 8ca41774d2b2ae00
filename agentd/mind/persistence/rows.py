"""Rows of bytes that a checkpoint keeps of a mind."""

from __future__ import annotations

from msgspec import Struct, field

Row = tuple[int, bytes]
"""The place of a row and its content."""
PendingKey = tuple[int, int]
"""The place of a pending event: see `agentd.mind.persistence.pending_events`."""
PendingRow = tuple[PendingKey, int, bytes]
"""The place of an event, its `Origin`, and the event."""


class MindRows(Struct):
    """The changes of a mind since the last call, false if there are none; or their sum: the mind as it was, in rising
    order."""

    beliefs: list[Row] = field(default_factory=list)
    """Facts and rules that are new or different, by their rank; the highest rank of a predicate is asked first."""
    beliefs_gone: list[int] = field(default_factory=list)
    predicates: list[Row] = field(default_factory=list)
    """Predicates that are new, by their number: the order in which they were first mentioned."""
    plans: list[Row] = field(default_factory=list)
    """Plans that the run has added, by their rank; those below 0 precede the program's."""
    plans_gone: list[int] = field(default_factory=list)
    pending: list[PendingRow] = field(default_factory=list)
    pending_gone: list[PendingKey] = field(default_factory=list)
    values: dict[str, bytes] = field(default_factory=dict)
    """Whatever is kept as a whole, by name, where it is different."""
    unkept: list[str] = field(default_factory=list)
    """Descriptions of items that cannot be kept, each once. They have no rows; older rows of them are removed."""

    def __bool__(self) -> bool:
        return self != _UNCHANGED


_UNCHANGED = MindRows()
