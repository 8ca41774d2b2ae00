"""Limits on the work of one formula or question: a mind that computes for ever loses its robot.

Work is counted in steps, not in time, so that a mind decides the same on a fast board, on a slow one and in a replay:
a fact looked at in a loop within a loop, a solution of an internal action, a rule that is asked. `MindState.steps_left`
is what the formula has left; it is full again for each formula of a body, each event and each condition waited for.

A formula in a question is somebody else's code. While it is solved, `MindState.asked` is set: what is solved from a
term (`agentd.mind.beliefs.dynamic_formulas`) may name only what is known to have no effect, and each of its steps is
counted. What the asked program has written itself, in its rules, is compiled and runs as always.
"""

from __future__ import annotations

import re
import signal
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, Final, NoReturn, Protocol

from agentd.language.terms import order
from agentd.language.terms.terms import MOST_CHARACTERS, Term, deref, parts_of
from agentd.mind.data.formula_failure import Failed

PURE: Final[set[str]] = set()
"""Names of the internal actions and functions that are registered as pure: they have no effect, they only look."""
_CLOCKS: Final = frozenset((".date", ".nano_time", ".time", "system.time"))
"""They have no effect either, but each reading of the clock is an input."""


MOST_STEPS: Final = 2_000_000
"""Steps of one formula: about a second on a desktop, some seconds on a small board."""
AFTERWARDS: Final = MOST_STEPS // 100
"""Steps left to the other plans of an event after the context of one took too many."""
QUESTION_STEPS: Final = 200_000
"""Steps that a question may take: formulas tried, solutions found, parts of terms and characters that are looked at."""
_SQUARE: Final = frozenset((".prefix", ".sublist", ".substring", ".suffix"))
"""Internal actions whose work may grow with the square of their arguments' size."""
LONGEST: Final = 1.0
"""Seconds of processor time for work that counts no steps: regular expressions, and the order of terms."""
MOST_MEMBERS: Final = 1_000_000
"""Members of a list or queue that an internal action makes of others."""
PARSING: Final = 20
"""Steps that it takes to parse a character of source text."""


class TooMuchWork(Failed):
    """A formula takes more than `MOST_STEPS`. Unlike other failures it does not just make a condition false."""


class Computing(Protocol):
    """Counts the work of a formula and logs warnings: a mind."""

    steps_left: int

    def warn_once(self, text: str) -> None:
        """Log a warning, once."""


def too_much_work(mind: Computing) -> NoReturn:
    """Fail the formula that has no steps left."""
    mind.steps_left = AFTERWARDS
    raise TooMuchWork("too_much_work", f"it takes more than {MOST_STEPS} steps")


def work(mind: Computing, steps: int) -> None:
    """Count ``steps``, from 0 on, as work of the formula. Raises TooMuchWork when `MOST_STEPS` are used up."""
    mind.steps_left -= steps
    if mind.steps_left < 0:
        too_much_work(mind)


def bounded(action: str, size: int, most: int, what: str) -> None:
    """Fail with ``too_large`` if an ``action`` makes more than ``most`` of ``what`` (characters or members)."""
    if size > most:
        raise Failed("too_large", f"{action} makes {size} {what}, expected at most {most}")


def joined(action: str, pieces: Iterable[str], between: str = "") -> str:
    """Return the text that an ``action`` makes of pieces; fails with ``too_large`` beyond `MOST_CHARACTERS`."""
    taken: list[str] = []
    size = 0
    for piece in pieces:
        taken.append(piece)
        size += len(piece) + len(between)
        bounded(action, size, MOST_CHARACTERS, "characters")
    return between.join(taken)


def substituted(action: str, pattern: re.Pattern[str], new: Callable[[re.Match[str]], str], whole: str) -> str:
    """Return ``whole`` with what ``new`` makes of each match; fails with ``too_large`` beyond `MOST_CHARACTERS`."""
    size = len(whole)

    def inserted(match: re.Match[str]) -> str:
        nonlocal size
        made = new(match)
        size += len(made) - (match.end() - match.start())
        bounded(action, size, MOST_CHARACTERS, "characters")
        return made

    return pattern.sub(inserted, whole)


_limiting = False


@contextmanager
def limited(what: str) -> Iterator[None]:
    """Fail what cannot count its steps and may take for ever when it takes `LONGEST` of processor time.

    It may be compared on another machine, or in a replay, with another result: a search or an order that takes so long
    is a mistake or an attack. It is ended by a signal, so that only what has no effect yet may run in it. Only the main
    thread, in which minds run, gets signals; in others nothing is limited.
    """
    global _limiting
    if _limiting:
        yield
        return

    def end(*_: object) -> None:
        if _limiting:
            raise TooMuchWork("too_much_work", f"{what} takes more than {LONGEST:g} s")

    try:
        before = signal.signal(signal.SIGVTALRM, end)
    except ValueError:
        yield
        return
    _limiting = True
    try:
        signal.setitimer(signal.ITIMER_VIRTUAL, LONGEST)
        yield
    finally:
        _limiting = False
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def ordered(terms: list[Any]) -> list[Any]:
    """Return terms in standard order, duplicates kept. Raises TooMuchWork."""
    with limited("putting terms in order"):
        return order.ordered(terms)


def distinct(terms: Iterable[Any]) -> list[Any]:
    """Return terms in standard order without duplicates. Raises TooMuchWork."""
    with limited("putting terms in order"):
        return order.distinct(terms)


class QueryRefused(Failed):
    """A question is refused: it names an action that may have an effect, or takes too many steps."""


class Asked:
    """Counts the steps of a question. Once refused, each further step fails too: a refusal cannot be caught."""

    __slots__ = ("_left", "_refused")

    def __init__(self) -> None:
        self._left = QUESTION_STEPS
        self._refused = ""

    def work(self, steps: int = 1) -> None:
        """Count ``steps``, from 0 on. Raises QueryRefused when there were more than `QUESTION_STEPS`."""
        self._left -= steps
        if self._left < 0:
            self._refuse(f"it takes more than {QUESTION_STEPS} steps")
        self.check()

    def action(self, name: str, args: tuple[Term, ...]) -> None:
        """Allow an internal action that has no effect. Raises QueryRefused for any other."""
        if not _in_questions(name) or (name == ".delete" and args and type(deref(args[0])) is str):
            self._refuse(f"it names {name}, which is not known to be free of effects and quick")
        size = _size(*args)
        self.work(size * size if name in _SQUARE else size)

    def copies(self, term: Term) -> None:
        """Count that all of a term is copied or compared."""
        self.work(_size(term))

    def function(self, name: str, known: bool, own: bool) -> bool:
        """Return whether a name is a function to compute. Raises QueryRefused for one that may have an effect."""
        if known and not own and not _in_questions(name):
            self._refuse(f"it names the function {name}, which is not known to be free of effects")
        return known

    def check(self) -> None:
        """Raises QueryRefused if the question has been refused."""
        if self._refused:
            raise QueryRefused("refused", self._refused)

    def _refuse(self, why: str) -> None:
        self._refused = self._refused or why
        self.check()


def _in_questions(name: str) -> bool:
    """Return whether a question of another agent may name an internal action or function.

    It must also be quick: a regular expression can take for ever (of ``.delete``, where a text is its first argument).
    """
    return name in _CLOCKS or (name in PURE and name != ".replace")


def _size(*terms: Term) -> int:
    """Return the number of parts of terms, and of the characters of its texts; not many more than `QUESTION_STEPS`."""
    count, pending = 0, list[Any](terms)
    while pending and count <= QUESTION_STEPS:
        part = pending.pop()
        count += 1 + (len(part) if type(part) is str else 0)
        pending += parts_of(part)
    return count
