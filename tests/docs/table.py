"""What of the pages is not done as it stands, each with its reason. An entry that matches nothing fails a test.

A key is a page and how a command, or the text of a block, begins. Forms of commands (`argosy run MISSION`) need no
entry: that they parse is checked, and nothing else can be.
"""

from __future__ import annotations

from typing import Final, NamedTuple, TypeVar

Key = tuple[str, str]
Entry = TypeVar("Entry")

NOT_RUN: Final[dict[Key, str]] = {}
"""Commands that are not run here: the reason. They have to parse all the same."""

INSTEAD: Final[dict[Key, str]] = {}
"""Commands that take minutes: what is run in their place, the same at another speed."""


def entry(table: dict[Key, Entry], page: str, text: str) -> Entry | None:
    """What a table says of a command or block."""
    return next((said for (where, begin), said in table.items() if where == page and text.startswith(begin)), None)


class Stay(NamedTuple):
    """A command that stays up, in a terminal of its own, while the commands after it run."""

    says: str
    """What it says when it is up; the next command runs then."""
    ends: str = "interrupt"
    """`interrupt`: ctrl-C at the end of the page; `itself`: it ends while the page is followed, with exit code 0."""


STAYS: Final[dict[Key, Stay]] = {}

NOT_WELL_FORMED: Final[dict[Key, str]] = {
    ("docs/errors.md", '!start.\n+!start <- .print("hello")\n'): "wrong on purpose: test_errors_page.py",
    ("docs/errors.md", "!start.\n+!start\n  <- .send(bob"): "wrong on purpose: test_errors_page.py",
    ("docs/errors.md", "+!buy(X)"): "wrong on purpose: test_errors_page.py",
    ("docs/errors.md", '!start.\n+!start <- .print("hello)'): "wrong on purpose: test_errors_page.py",
}
"""Blocks of `asl`, `python`, `toml`, ... that no parser of ours takes: the reason."""

NOT_COMMANDS: Final[dict[Key, str]] = {
    ("docs/fleets.md", "commd pi1"): "what `argosy run` calls this process",
    ("docs/fleets.md", "bridged pi1 uav1"): "what `argosy run` calls this process",
    ("docs/fleets.md", "agentd pi1"): "what `argosy run` calls this process",
    ("docs/fleets.md", "agentd pi2 was killed by SIGKILL"): "what `argosy run` says",
}
"""Code within sentences that begins with a program's name and is no command."""
