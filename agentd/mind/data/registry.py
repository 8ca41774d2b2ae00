"""Internal actions and functions by decorator.

An internal action is a Python function ``f(mind, trail, *args)`` of run-time terms:

- a *test* returns whether it holds, after unifying its results with `agentd.mind.beliefs.unification.unify`;
- with ``backtracks=True`` it is a generator: one ``yield`` is one solution, and it undoes its bindings between them;
- with ``suspends=True`` it can only be a step of a plan: it returns true when the intention has to wait.

It raises `agentd.mind.data.formula_failure.Failed` with the error that the plan's handler shall see. A function
(``math.max(1,2)``) is called as ``f(mind, *args)`` and returns its value, or None when it cannot be computed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

from agentd.language.compiler.units import Form
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.errors import near
from agentd.language.terms.numbers import UndefinedNumber
from agentd.language.terms.terms import Term
from agentd.mind.beliefs.unification import Trail
from agentd.mind.beliefs.work_limit import PURE, Computing, TooMuchWork, work
from agentd.mind.data.formula_failure import Failed
from schemas.humanize import count


class InternalAction:
    """A registered internal action."""

    __slots__ = ("_guarded", "arities", "backtracks", "counts", "function", "name", "names", "suspends")

    def __init__(
        self,
        name: str,
        arities: range,
        function: Callable[..., Any],
        backtracks: bool = False,
        suspends: bool = False,
        names: int = 0,
        counts: bool = False,
    ) -> None:
        self.name, self.arities, self.function = name, arities, function
        self.backtracks, self.suspends = backtracks, suspends
        self.names = names
        """Leading arguments that are names: an atom in the program is passed as a str."""
        self.counts = counts
        """It counts its work itself (`agentd.mind.beliefs.work_limit`); of others each solution is a step."""
        self._guarded: Callable[..., Any] | None = None

    def guarded(self) -> Callable[..., Any]:
        """For contexts and rules, where an error only makes the condition false, and nothing can wait."""
        if self._guarded is None:
            function = self._refuse_to_wait if self.suspends else self.function
            generates = self.backtracks and not self.suspends
            self._guarded = _guard_generator(function, self.counts) if generates else _guard_test(function)
        return self._guarded

    def _refuse_to_wait(self, mind: Computing, trail: Trail, *args: Term) -> bool:
        mind.warn_once(f"{self.name} may have to wait, so it is false in a condition: use it as a step of a plan")
        return False


def _guard_test(function: Callable[..., Any]) -> Callable[..., bool]:
    def guarded(mind: Computing, trail: Trail, *args: Term) -> bool:
        try:
            return bool(function(mind, trail, *args))
        except (TooMuchWork, RecursionError):
            raise
        except (Failed, UndefinedNumber):
            return False
        except Exception as error:  # an action may raise anything; its error makes the condition false
            mind.warn_once(_went_wrong(error))
            return False

    return guarded


def _guard_generator(function: Callable[..., Any], counts: bool) -> Callable[..., Iterator[Any]]:
    def guarded(mind: Computing, trail: Trail, *args: Term) -> Iterator[Any]:
        try:
            if counts:
                yield from function(mind, trail, *args)
                return
            for _ in function(mind, trail, *args):
                work(mind, 1)
                yield
        except (TooMuchWork, RecursionError):
            raise
        except (Failed, UndefinedNumber):
            return
        except Exception as error:  # as above
            mind.warn_once(_went_wrong(error))

    return guarded


def _went_wrong(error: Exception) -> str:
    return f"an internal action in a condition went wrong: {type(error).__name__}: {error}"


ACTIONS: Final[dict[str, list[InternalAction]]] = {}
"""Internal actions by name; several of one name differ in their arities."""

FUNCTIONS: Final[dict[tuple[str, int], Callable[..., Any]]] = {}
"""Functions by name and number of arguments."""

_MANY: Final = 1 << 30


def missing_action(name: str, arity: int) -> str:
    """Return the message about an internal action that does not exist."""
    return f"there is no internal action {name}/{arity}{near(name, ACTIONS)}"


def internal_action(
    name: str,
    arities: int | tuple[int, int | None],
    *,
    backtracks: bool = False,
    suspends: bool = False,
    names: int = 0,
    counts: bool = False,
    pure: bool = False,
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register an internal action: ``arities`` is one number, or the least and the greatest (None: any number).

    The first ``names`` arguments are names: one that the program writes as an atom comes as a str. With ``counts`` it
    counts its work itself; of others that backtrack each solution is a step. With ``pure`` it has no effect and is
    quick: questions of other agents may name it, and a context that failed is evaluated again with it for the report.
    """
    if pure:
        PURE.add(name)
    if isinstance(arities, int):
        allowed = range(arities, arities + 1)
    else:
        least, most = arities
        allowed = range(least, _MANY if most is None else most + 1)

    def register(function: Callable[..., Any]) -> Callable[..., Any]:
        ACTIONS.setdefault(name, []).append(
            InternalAction(name, allowed, function, backtracks, suspends, names, counts)
        )
        return function

    return register


def find_function(name: str, arity: int) -> Callable[..., Any] | None:
    """Return the function of this name and arity."""
    found = FUNCTIONS.get((name, arity))
    if found is None and "." in name:
        unusable = _look_further(name)
        found = FUNCTIONS.get((name, arity)) or unusable
    return found


def function(name: str, *arities: int, pure: bool = False) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Register a function of these numbers of arguments, from 0 on.

    With ``pure`` it has no effect and is quick: questions of other agents may name it.
    """
    if pure:
        PURE.add(name)

    def register(compute: Callable[..., Any]) -> Callable[..., Any]:
        for arity in arities:
            FUNCTIONS[(name, arity)] = compute
        return compute

    return register


SOURCES: Final[list[Callable[[str], str | None]]] = []
"""Asked once for each package of which a program uses a name that is not registered (``mylib`` of ``mylib.do``).

A source may register what the package has; it returns why the package cannot be used, if it should have been found.
"""

ASKED: Final[dict[str, str | None]] = {}
"""The packages that the sources have been asked for, and why they cannot be used."""


class Unusable(RuntimeError):
    """A package of internal actions or functions cannot be used; the text names it and gives the reason."""


def _look_further(name: str) -> Callable[..., Any] | None:
    """Have the sources register the package of a name, once. Return a function that raises if it cannot be used."""
    package, dot, _ = name.partition(".")
    if not dot or not package or package.startswith("'"):
        return None
    if package not in ASKED:
        ASKED[package] = None
        for source in SOURCES:
            ASKED[package] = source(package) or ASKED[package]
    reason = ASKED[package]
    if reason is None:
        return None

    def refuse(*args: Term) -> Any:
        raise Unusable(reason)

    return refuse


def find_action(name: str, arity: int) -> InternalAction | None:
    """Return the internal action of this name and arity; for a wrong arity one that fails (``wrong_arguments``)."""
    found = ACTIONS.get(name)
    if found is None:
        unusable = _look_further(name)
        if unusable is not None:
            return InternalAction(name, range(arity, arity + 1), unusable, False, False)
        found = ACTIONS.get(name)
    if found is None:
        return None
    for action in found:
        if arity in action.arities:
            return action

    def wrong(mind: Computing, trail: Trail, *args: Term) -> bool:
        raise Failed("wrong_arguments", f"{name} does not take {count(arity, 'argument')}")

    return InternalAction(name, range(arity, arity + 1), wrong)


class Library:
    """The internal actions and functions that a program may use: the standard library and the program's own."""

    def __init__(self) -> None:
        self.has_meta = False
        """Whether the program has plans for the states of goals, ``^!g``."""
        self.form: Form = "select"
        """How plans are to be selected: plainly, with the reasons why they are not, or with all their options."""
        self.namespaced = False
        """Whether the program knows other namespaces: then plain variables must refuse their literals (rule 100)."""
        self._own: dict[tuple[str, int], Callable[..., Any]] = {}
        self.rules_of_functions: dict[tuple[str, int], str] = {}
        """The rules that compute the program's own functions, by name and number of arguments."""
        self.unknown: dict[tuple[str, int], nodes.Position] = {}
        """Unknown internal actions that the program uses, with the first place of each."""

    def register_function(self, name: str, arity: int, compute: Callable[..., Any]) -> None:
        """Register a function of the program's own (``{ register_function("my.f", 2, "rule") }``)."""
        self._own[(name, arity)] = compute

    def copy_functions(self, other: Library) -> None:
        """Take over the functions that another program has registered."""
        self._own.update(other._own)
        self.rules_of_functions.update(other.rules_of_functions)

    def is_function(self, name: str, arity: int) -> bool:
        """Return whether a function has this name and arity."""
        return self.find_function(name, arity) is not None

    def is_own_function(self, name: str, arity: int) -> bool:
        """Return whether the program has registered a function itself."""
        return (name, arity) in self._own

    def find_function(self, name: str, arity: int) -> Callable[..., Any] | None:
        """Return a function of the program's own, or a registered one."""
        return self._own.get((name, arity)) or find_function(name, arity)

    def function(self, name: str, arity: int) -> Callable[..., Any]:
        """Return the function of this name and arity."""
        found = self.find_function(name, arity)
        if found is None:
            raise KeyError(f"{name}/{arity}")
        return found

    def functions(self) -> set[tuple[str, int]]:
        """Return names and numbers of arguments of all functions that are known by now."""
        return FUNCTIONS.keys() | self._own.keys()

    def action(self, name: str, arity: int) -> InternalAction | None:
        """Return the internal action of this name and arity."""
        return find_action(name, arity)

    def unknown_action(self, node: nodes.InternalAction) -> None:
        """Note an internal action that does not exist."""
        self.unknown.setdefault((node.name, len(node.args)), node.position)
