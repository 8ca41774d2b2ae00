"""The belief base: facts and rules by predicate, in query order, with an index on every argument used in queries.

Query order is newest first (initial beliefs come in file order because they are added in reverse). A predicate keeps
one dict whose *last* entry is the first answer: adding, finding and deleting a fact by its arguments cost the same
whatever their number.

Beliefs with free variables that are added at run time (rule 53): the variable of such a belief is not renamed where it
is queried. Once it has matched a value it keeps it for the rest of that plan, and for the rest of a rule's body. So
each plan, context and rule has a *scope*, which maps variables of beliefs to its own. The first such belief installs
this in a mind; other minds do not pay for it. Initial beliefs of this kind are rules, which rename their variables at
each use (`agentd.mind.execution.program_loading`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, Protocol

from agentd.language.syntax_tree.signatures import Signature
from agentd.language.terms.order import sorted_annots
from agentd.language.terms.source_annotations import is_source
from agentd.language.terms.terms import Expression, List, Literal, Open, Term, Var, deref
from agentd.mind.beliefs.term_copy import Copier, detach, is_ground, resolve_all
from agentd.mind.beliefs.unification import Trail, undo, unify
from agentd.mind.beliefs.work_limit import Computing, work

Mode = tuple[bool, ...]
"""Which arguments of a query are given (True), which are only asked for."""

_SMALL = 8
"""Up to this number of facts, a scan is as fast as an index."""


class Asking(Computing, Protocol):
    """Asks predicates: a mind."""

    def scope(self, trail: Trail) -> dict[Var, Var]:
        """Return which variable stands for which one of a belief, in what is being evaluated
        (`agentd.mind.beliefs.belief_base`)."""


class RuleClause:
    """A rule as the belief base holds it: its syntax and, per `Mode`, a generator of answers made when first used."""

    __slots__ = ("compile", "modes", "syntax", "values")

    def __init__(self, syntax: Any, compile_mode: Callable[[RuleClause, Mode], Any], values: dict[str, Any]) -> None:
        self.syntax, self.compile, self.values = syntax, compile_mode, values
        self.modes: dict[Mode, Callable[..., Iterator[tuple[Term, ...]]]] = {}
        """Called with mind, trail and the arguments; those not given are None."""

    def answers(self, mode: Mode) -> Callable[..., Iterator[tuple[Term, ...]]]:
        """Return the generator of a rule's answers, compiled on the first call."""
        found = self.modes.get(mode)
        if found is None:
            found = self.modes[mode] = self.compile(self, mode)
        return found


def _index_key(term: Any) -> Any:
    """Return the key that two ground terms must share to unify; None if the term may unify with anything."""
    kind = type(term)
    if kind is float or kind is str:
        return term
    if kind is Literal:
        return term.sig
    if kind is List:
        return List
    if kind is Var and term.ref is not None:
        return _index_key(deref(term))
    return None if kind is Var or kind is Open or kind is Expression else kind


class Predicate:
    """The facts and rules of one signature."""

    __slots__ = ("_indexes", "entries", "open", "opened", "plain", "rules", "sig")

    def __init__(self, sig: Signature, opened: Callable[[], None]) -> None:
        self.sig, self.opened = sig, opened
        self.entries: dict[Any, Any] = {}
        """Arguments to `Literal`, and each `RuleClause` to itself; the last entry is the first answer."""
        self.rules = 0
        self.open = 0
        """How many facts hold a free variable."""
        self.plain = True
        """Whether there are only ground facts: then a query is a loop over argument tuples."""
        self._indexes: dict[int, tuple[dict[Any, dict[Any, Any]], dict[Any, Any]]] = {}

    def rows(self, position: int, key: Term) -> Any:
        """Return the arguments of the facts that may have ``key`` at ``position``. For `plain` predicates only."""
        entries = self.entries
        if len(entries) <= _SMALL:
            return reversed(entries)
        return reversed(self._bucket(position, key))

    def counted_rows(self, position: int, key: Term, mind: Asking) -> Any:
        """`rows` of ``position``, from 0 on, for a loop within a loop: many of them are counted as work of the mind."""
        entries = self.entries
        if len(entries) > _SMALL:
            entries = self._bucket(position, key)
            if len(entries) > _SMALL:
                work(mind, len(entries))
        return reversed(entries)

    def _bucket(self, position: int, key: Any) -> dict[Any, Any]:
        """Return the entries that may match ``key`` at ``position``, in order."""
        kind = type(key)
        if kind is not float and kind is not str:
            key = key.sig if kind is Literal else _index_key(key)
            if key is None:
                return self.entries
        index = self._indexes.get(position)
        if index is None:
            index = self._indexes[position] = self._build_index(position)
        return index[0].get(key, index[1])

    def _build_index(self, position: int) -> tuple[dict[Any, dict[Any, Any]], dict[Any, Any]]:
        index: tuple[dict[Any, dict[Any, Any]], dict[Any, Any]] = ({}, {})
        for args, entry in self.entries.items():
            _index_entry(index, position, args, entry)
        return index

    def solve(self, mode: Mode, args: tuple[Term | None, ...], mind: Asking, trail: Trail) -> Any:
        """Return the arguments of each answer to a query, facts and rules in order. Unify them with what was asked.

        ``args`` holds None where ``mode`` is False.
        """
        entries = self.entries
        if len(entries) > 1:
            for position, given in enumerate(mode):
                if given:
                    entries = self._bucket(position, args[position])
                    break
        if not entries:
            return ()
        if self.plain:
            return reversed(entries)
        if len(entries) == 1:
            for entry in entries.values():
                if type(entry) is RuleClause:
                    return (entry.modes.get(mode) or entry.answers(mode))(mind, trail, *args)
        return self._solve_mixed(entries, mode, args, mind, trail)

    def _solve_mixed(
        self, entries: dict[Any, Any], mode: Mode, args: tuple[Term | None, ...], mind: Asking, trail: Trail
    ) -> Iterator[tuple[Term, ...]]:
        if len(entries) > _SMALL:
            work(mind, len(entries))
        for entry in reversed(entries.values()):
            if type(entry) is RuleClause:
                yield from (entry.modes.get(mode) or entry.answers(mode))(mind, trail, *args)
            elif self.open and not entry.ground:
                copier = Copier(fresh=True, known=mind.scope(trail))
                yield tuple([copier.copy(a) for a in entry.args])
            else:
                yield entry.args

    def literals(self, mode: Mode, args: tuple[Term, ...], mind: Asking, trail: Trail) -> Iterator[tuple[Any, Any]]:
        """As `solve`, with the annotations of each answer. A rule's answer has those written in its head."""
        entries = self.entries
        for position, given in enumerate(mode):
            if given:
                entries = self._bucket(position, args[position])
                break
        work(mind, len(entries))
        for entry in reversed(entries.values()):
            if type(entry) is RuleClause:
                for answer in entry.answers((*mode, True))(mind, trail, *args):
                    yield answer[:-1], answer[-1]
            elif self.open and not entry.ground:
                copy = Copier(fresh=True, known=mind.scope(trail)).copy(entry)
                yield copy.args, copy.annots
            else:
                yield entry.args, entry.annots

    def facts(self) -> Iterator[Literal]:
        """Return the facts in query order, as they are now."""
        return iter([e for e in reversed(self.entries.values()) if type(e) is Literal])

    def add(self, args: tuple[Any, ...], annots: tuple[Any, ...], last: bool = False) -> tuple[Any, ...] | None:
        """Believe a fact with resolved arguments. Returns the annotations that are new; None if nothing is."""
        for arg in args:
            kind = type(arg)
            if kind is float or kind is str or ((kind is Literal or kind is List) and arg.ground):
                continue
            if not is_ground(arg):
                return self._add_open(args, annots, last)
        return self.add_ground(args, annots, last)

    def add_ground(self, args: tuple[Any, ...], annots: tuple[Any, ...], last: bool = False) -> tuple[Any, ...] | None:
        """`add` for arguments that are known to hold no variable."""
        literal = Literal(self.sig, args, annots, True)
        if last or self._indexes:
            known = self.entries.get(args)
            if known is None:
                self._insert(args, literal, last)
                return annots
        else:
            known = self.entries.setdefault(args, literal)  # the arguments are hashed only once
        return annots if known is literal else self._merge(args, known, annots)

    def _add_open(self, args: tuple[Any, ...], annots: tuple[Any, ...], last: bool) -> tuple[Any, ...] | None:
        """`add` for a fact with a free variable."""
        known = self.entries.get(args)
        if known is not None:
            return self._merge(args, known, annots)
        self.open += 1
        self.plain = False
        self.opened()
        args = detach(args)
        self._insert(args, Literal(self.sig, args, annots), last)
        return annots

    def _merge(self, args: tuple[Term, ...], known: Literal, annots: tuple[Term, ...]) -> tuple[Term, ...] | None:
        if annots is known.annots or all(a in known.annots for a in annots):
            return None
        new = tuple(a for a in annots if a not in known.annots)
        self._replace(args, known.with_annots(sorted_annots(known.annots + new)), known.ground)
        return new

    def _replace(self, args: tuple[Term, ...], literal: Literal, ground: bool) -> None:
        literal.ground = ground
        self.entries[args] = literal
        for position, (buckets, wild) in self._indexes.items():
            bucket = buckets.get(_index_key(args[position]))
            if bucket is None or args in wild:
                self._indexes.clear()
                return
            bucket[args] = literal

    def _insert(self, key: Any, entry: Any, last: bool) -> None:
        if last:
            self.entries = {key: entry, **self.entries}
            self._indexes.clear()
            return
        self.entries[key] = entry
        for position, index in self._indexes.items():
            _index_entry(index, position, key, entry)

    def add_rule(self, rule: RuleClause, last: bool = False) -> None:
        """Add a rule, in front of the others or `last`."""
        self.rules += 1
        self.plain = False
        self._insert(rule, rule, last)

    def remove(self, literal: Literal) -> None:
        """Forget a fact that is in here."""
        args = literal.args
        del self.entries[args]
        if not literal.ground:
            self.open -= 1
            self.plain = not self.rules and not self.open
            self._indexes.clear()
            return
        if self._indexes:
            self._unindex(args)

    def _unindex(self, args: tuple[Any, ...]) -> None:
        for position, (buckets, _) in self._indexes.items():
            key = _index_key(args[position])
            bucket = buckets.get(key)
            if bucket is not None:
                bucket.pop(args, None)
                if not bucket:
                    del buckets[key]

    def forget_code(self) -> None:
        """Have the rules compiled again when they are queried next."""
        for entry in self.entries.values() if self.rules else ():
            if type(entry) is RuleClause:
                entry.modes.clear()

    def remove_rule(self, rule: RuleClause) -> None:
        """Remove a rule."""
        del self.entries[rule]
        self._indexes.clear()
        self.rules -= 1
        self.plain = not self.rules and not self.open

    def candidates(self, args: tuple[Term, ...]) -> list[Literal]:
        """Return the facts that may unify with these arguments, in query order."""
        entries = self.entries
        try:
            exact = entries.get(args)
        except RecursionError:
            exact = None
        if exact is not None and not self.open:
            return [exact]
        for position, arg in enumerate(args):
            if type(arg) is not Var:
                entries = self._bucket(position, arg) if len(entries) > _SMALL else entries
                break
        return [e for e in reversed(entries.values()) if type(e) is Literal]

    def find(self, args: tuple[Term, ...], annots: tuple[Term, ...], trail: Trail) -> Literal | None:
        """Return the fact that ``-b`` with these arguments and annotations removes; its bindings are kept.

        It is the first that unifies. A fact with variables counts only if they are still free, as in Jason; otherwise
        the fact equal to the unified one is removed, if there is one.
        """
        if not self.open:
            exact = self.entries.get(args)
            if exact is not None and exact.annots == annots:
                return exact  # type: ignore[no-any-return]
        pattern = Literal(self.sig, args, annots)
        for fact in self.candidates(args):
            mark = len(trail)
            if fact.ground:
                if unify(pattern, fact, trail):
                    return fact
            else:
                used = use_open(pattern, fact, trail)
                if used is not None:
                    use, free = used
                    return fact if free else self.entries.get(resolve_all(use.args))
            undo(trail, mark)
        return None

    def take_annots(self, fact: Literal, annots: tuple[Term, ...]) -> None:
        """Remove annotations from a fact, and the fact with its last source."""
        if fact.annots is annots:
            self.remove(fact)
            return
        left = tuple(a for a in fact.annots if a not in annots)
        if any(is_source(a) for a in left):
            self._replace(fact.args, fact.with_annots(left), fact.ground)
        else:
            self.remove(fact)


def use_open(pattern: Literal, fact: Literal, trail: Trail) -> tuple[Literal, bool] | None:
    """Unify a fact with variables with a pattern; return the result, and whether its variables are still free."""
    fresh: dict[Var, Var] = {}
    use = Copier(fresh=True, known=fresh).copy(fact)
    if not unify(pattern, use, trail):
        return None
    return use, len({cell for v in fresh.values() if type(cell := deref(v)) is Var}) == len(fresh)


def _index_entry(
    index: tuple[dict[Any, dict[Any, Any]], dict[Any, Any]], position: int, args: tuple[Term, ...], entry: Any
) -> None:
    buckets, wild = index
    key = None if type(entry) is RuleClause else _index_key(args[position])
    if key is None:
        wild[args] = entry
        for bucket in buckets.values():
            bucket[args] = entry
        return
    found = buckets.get(key)
    if found is None:
        found = buckets[key] = dict(wild)
    found[args] = entry


class BeliefBase:
    """All predicates of a mind."""

    dated = False
    """Whether it records since when each fact is believed."""

    def __init__(self, opened: Callable[[], None] = lambda: None) -> None:
        """``opened`` is called whenever a belief with a free variable is added."""
        self._predicates: dict[Signature, Predicate] = {}
        self._opened = opened

    def predicate(self, sig: Signature) -> Predicate:
        """Return the predicate of a signature, made empty if it is missing."""
        found = self._predicates.get(sig)
        if found is None:
            found = self._predicates[sig] = Predicate(sig, self._opened)
        return found

    def known(self, sig: Signature) -> Predicate | None:
        """Return the predicate of a signature, None if nothing has mentioned it."""
        return self._predicates.get(sig)

    def predicates(self) -> list[Predicate]:
        """Return all predicates, in the order in which they were first mentioned."""
        return list(self._predicates.values())

    def mark(self, now: float) -> None:
        """Date the facts added since the last mark with ``now``, in mission seconds, if the base is `dated`."""

    def since(self, fact: Literal) -> tuple[float | None, bool]:
        """Since when a fact is believed, in mission seconds (None: unknown), and whether this answer is final."""
        return None, True

    def facts(self) -> Iterator[Literal]:
        """Yield every fact, predicate by predicate in the order in which they were first mentioned."""
        for predicate in self.predicates():
            yield from predicate.facts()


# --- beliefs with free variables ---


Scope = dict[Var, Var]
Frame = list[Any]

_MOST_FRAMES: Final = 1000


class OpenBeliefs:
    """The scopes of one mind."""

    def __init__(self, running: Callable[[], Iterable[Frame]]) -> None:
        """``running`` gives the frames of all plans that run."""
        self._running = running
        self.installed = False
        self._scope: Scope | None = None
        """The scope of the context or rule that is being evaluated; None while a formula of a body runs."""
        self._frames: dict[int, tuple[Frame, Scope]] = {}
        """The scopes of plans that run, by the identity of their frames."""

    def here(self, frame: Frame | None) -> Scope:
        """Return the scope of the current evaluation; ``frame`` is that of the running plan, None outside of plans."""
        if self._scope is not None:
            return self._scope
        if frame is None:
            return {}
        known = self._frames.get(id(frame))
        if known is None or known[0] is not frame:
            known = self._note(frame, {})
        return known[1]

    def rule(self, answers: Callable[..., Iterator[Any]]) -> Callable[..., Iterator[Any]]:
        """Yield a rule's generator of answers, run in a scope of its own."""

        def in_scope(*args: Any) -> Iterator[Any]:
            scope: Scope = {}
            found = answers(*args)
            while True:
                outer, self._scope = self._scope, scope
                try:
                    answer = next(found)
                except StopIteration:
                    return
                finally:
                    self._scope = outer
                yield answer

        return in_scope

    def select_in_scope(self, select: Callable[..., Frame | None], *asked: Any) -> Frame | None:
        """Select a plan (`agentd.mind.plans.plan_library.Select`) in a scope that its frame keeps."""
        scope: Scope = {}
        self._scope = scope
        try:
            frame = select(*asked)
        finally:
            self._scope = None
        if frame is not None and scope:
            self._note(frame, scope)
        return frame

    def _note(self, frame: Frame, scope: Scope) -> tuple[Frame, Scope]:
        if len(self._frames) >= _MOST_FRAMES:
            running = {id(other) for other in self._running()}
            self._frames = {key: known for key, known in self._frames.items() if key in running}
        noted = self._frames[id(frame)] = (frame, scope)
        return noted
