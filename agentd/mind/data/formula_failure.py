"""How a formula fails."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NoReturn, TypeVar

from agentd.language.terms.format import TooManyCharacters
from agentd.language.terms.numbers import UndefinedNumber
from agentd.language.terms.terms import Literal, Term, deref


class Failed(Exception):
    """A formula of a plan failed. The handler ``-!g`` of the goal sees these facts as annotations.

    ``error`` is the name that ``error(E)`` shows, ``message`` the text of ``error_msg(M)``, empty if only the name is
    known, ``annots`` what the program itself added (``.fail(reason(wind))``).
    """

    def __init__(self, error: str, message: str = "", annots: tuple[Any, ...] = (), code: Any = None) -> None:
        super().__init__(message or error)
        self.error, self.message, self.annots, self.code = error, message, annots, code
        self.step: Any = None
        """The `agentd.mind.data.intention.Step` that failed, or that raised the goal that found no plan."""
        self.goal: Any = None
        """For a goal that found no plan: the `agentd.mind.plans.plan_library.Relevant` of its event. ``code`` is its
        literal."""
        self.tried: Sequence[Any] = ()
        """For a goal that found no applicable plan: the `agentd.mind.introspection.decision_views.RejectedView` of
        each."""


def as_failed(error: Exception) -> Failed:
    """Return the failure of a formula that raised an exception: an internal action may raise anything."""
    match error:
        case Failed():
            return error
        case UndefinedNumber():
            return Failed("undefined_number", str(error))
        case TooManyCharacters():
            return Failed("too_large", str(error))
        case RecursionError():
            return Failed("recursion_too_deep", "the computation is too deep")
    return Failed("unknown", f"{type(error).__name__}: {error}")


def wrong_arguments(message: str) -> NoReturn:
    """Fail an internal action that got arguments of a wrong number or kind."""
    raise Failed("wrong_arguments", message)


_Kind = TypeVar("_Kind", float, str, Literal)


def argument(kind: type[_Kind], term: Term, needed: str, error: str = "wrong_arguments") -> _Kind:
    """Return an argument of an internal action that must be a number, a string or a literal.

    Fails with ``error``, and with ``needed`` as its message, for a term of another kind or a free variable.
    """
    found: _Kind = deref(term)
    if type(found) is not kind:
        raise Failed(error, needed)
    return found


def action_said_no() -> NoReturn:
    """Fail an internal action that was a test and did not hold, or found nothing."""
    raise Failed("ia_failed")


def constraint_failed() -> NoReturn:
    """Fail a relation in a body, which does not hold."""
    raise Failed("constraint_failed")


def test_failed() -> NoReturn:
    """Fail a compound test without a solution; it raises no event."""
    raise Failed("test_goal_failed")
