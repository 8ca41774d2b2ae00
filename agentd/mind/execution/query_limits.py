"""The questions of others: what they may name, and how much work and how many answers they get.

A formula in a question is somebody else's code. While it is solved, `Asked` stands in the mind: what is solved from a
term (`agentd.mind.beliefs.dynamic_formulas`) may name only what is known to have no effect, and each of its steps is
counted. What the asked program has written out itself, in its rules, is compiled and does as it always does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from agentd.language.terms.terms import EMPTY, List, Literal, Var, deref
from agentd.mind.beliefs import work_limit as work
from agentd.mind.beliefs.dynamic_formulas import solve
from agentd.mind.beliefs.term_copy import Copier, resolve
from agentd.mind.beliefs.unification import undo, unify
from agentd.mind.data.formula_failure import Failed
from agentd.mind.plans.effect_free import FUNCTIONS_IN_QUESTIONS, IN_QUESTIONS

if TYPE_CHECKING:
    from agentd.mind.beliefs.belief_base import Predicate
    from agentd.mind.data.inputs import Mail
    from agentd.mind.mind import Mind

MOST_STEPS: Final = 100_000
"""Steps that a question may take: formulas tried, solutions found, list elements and characters handed to actions."""
MOST_ANSWERS: Final = 10_000
"""Answers that a question solved by formulas or rules gets."""
_SQUARE: Final = frozenset((".prefix", ".sublist", ".substring", ".suffix"))
"""Internal actions whose work may grow as the square of what they are given."""


class QueryRefused(Failed):
    """A question that is not answered: it names what may have an effect, or takes too many steps."""


class Asked:
    """What a question has used so far. Once refused, each further step fails too: nothing can catch a refusal."""

    __slots__ = ("_left", "_refused")

    def __init__(self) -> None:
        self._left = MOST_STEPS
        self._refused = ""

    def work(self, steps: int = 1) -> None:
        """Count steps. Raises QueryRefused when there were too many."""
        self._left -= steps
        if self._left < 0:
            self._refuse(f"it takes more than {MOST_STEPS} steps")
        self.check()

    def action(self, name: str, args: tuple[Any, ...]) -> None:
        """Allow an internal action that has no effect. Raises QueryRefused for any other."""
        if name not in IN_QUESTIONS:
            self._refuse(f"it names {name}, which is not known to be free of effects and quick")
        size = sum(map(_size, args))
        self.work(size * size if name in _SQUARE else size)

    def function(self, name: str, known: bool, own: bool) -> bool:
        """Whether a name is that of a function to compute. Raises QueryRefused for one that may have an effect."""
        if known and not own and name not in FUNCTIONS_IN_QUESTIONS:
            self._refuse(f"it names the function {name}, which is not known to be free of effects")
        return known

    def check(self) -> None:
        """Raises QueryRefused if the question has been refused."""
        if self._refused:
            raise QueryRefused("refused", self._refused)

    def _refuse(self, why: str) -> None:
        self._refused = self._refused or why
        self.check()


def _size(term: Any) -> int:
    """How much there is in a text or list; 1 for anything else."""
    term = deref(term)
    if type(term) is str:
        return len(term) + 1
    count = 1
    while type(term) is List and term is not EMPTY and count <= MOST_STEPS:
        count += len(term.items) - term.at
        term = deref(term.tail)
    return count


def answers(mind: Mind, mail: Mail, most: int = MOST_ANSWERS) -> list[Any] | None:
    """The instances of a question that hold, with the annotations of the beliefs, ``most`` of them if rules are used.

    None if the question is refused, which is told.
    """
    question = Copier(fresh=True).copy(mail.content)
    predicate = None
    if type(question) is Literal:
        predicate = mind.beliefs.known(question.sig)
        if predicate is None:
            return []
        if not predicate.rules:
            return _believed(mind, predicate, question, None)
    enough = 1 if most == 1 else most + 1  # one more tells that some are left out
    trail: list[Var] = []
    mind.asked = asked = Asked()
    mind.steps_left = work.MOST_STEPS
    try:
        if predicate is not None:
            found = _believed(mind, predicate, question, enough)
        else:
            found = []
            for _ in solve(mind, question, trail):
                found.append(resolve(question))
                if len(found) == enough:
                    break
        asked.check()
    except (QueryRefused, work.TooMuchWork) as refused:
        mind.warn_once(f"the question of {mail.sender} is refused: {refused}")
        return None
    except RecursionError:
        if predicate is not None:
            raise  # a rule of the program's own is at fault
        mind.warn_once(f"the question of {mail.sender} is refused: its computation is too deep")
        return None
    finally:
        mind.asked = None
        undo(trail, 0)
    if len(found) > most:
        mind.warn_once(f"a question of {mail.sender} has more answers than {most}: the others are left out")
    return found[:most]


def _believed(mind: Mind, predicate: Predicate, question: Literal, most: int | None) -> list[Any]:
    """What a predicate answers to a literal."""
    found: list[Any] = []
    trail: list[Var] = []
    for args, annots in predicate.literals((True,) * question.sig.arity, question.args, mind, trail):
        mark = len(trail)
        if unify(question, Literal(question.sig, args, annots), trail):
            found.append(resolve(Literal(question.sig, args, annots)))
        undo(trail, mark)
        if len(found) == most:
            break
    undo(trail, 0)
    return found
