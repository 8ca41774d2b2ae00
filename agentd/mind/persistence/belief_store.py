"""A belief base that notes what changes in it, for a mind whose state is kept: see
`agentd.mind.persistence.change_tracking`.

Each entry of a predicate has a *rank*, a number that grows in the order in which entries came (and falls for those put
last): the entries of a predicate in falling order of their ranks are in query order. A change costs the same however
many beliefs there are. Percepts are not kept, and hardly anything is noted for them.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable
from itertools import islice
from operator import itemgetter
from typing import Any, Final

from agentd.language.compiler.compile import CompiledProgram
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.printer import source_text
from agentd.language.syntax_tree.signatures import Signature, signature
from agentd.language.terms.source_annotations import PERCEPT, SOURCE_PERCEPT, is_source
from agentd.language.terms.terms import Code, Literal, Term
from agentd.mind.beliefs.belief_base import BeliefBase, Predicate, RuleClause
from agentd.mind.execution.belief_updates import add_rule
from agentd.mind.persistence.rows import MindRows
from agentd.mind.persistence.term_codec import (
    BadBytes,
    CannotKeep,
    read_terms,
    terms_from_bytes,
    terms_to_bytes,
    write_terms,
)
from agentd.mind.state import MindState

Tell = Callable[[str, Exception], None]
"""Called with a description of what cannot be kept, and the reason."""
MOST_MARKS: Final = 4096
"""Times of additions that are remembered; beyond, every second of the older half is forgotten."""


class _Book:
    """The changes of a belief base since the last `turn`."""

    def __init__(self) -> None:
        self.changed: dict[int, tuple[KeptPredicate, Any]] = {}
        """The predicate and key of each entry that is new or different, by its rank."""
        self.gone: list[int] = []
        """The ranks of removed entries that were saved before."""
        self.rules_gone: list[RuleClause] = []
        self.restoring: int | None = None
        """The rank of the entry that is being put back."""
        self._newest = self._oldest = self._seen_newest = self._seen_oldest = 0
        self._marks: list[tuple[int, float]] = [(0, 0.0)]
        """The rank of the newest entry at moments in mission seconds; the first is that of a former life."""

    def begin(self) -> None:
        """Treat all present entries as restored: since when they are believed is unknown."""
        self._marks = [(self._newest, 0.0)]

    def mark(self, now: float) -> None:
        """Date the entries added since the last mark with ``now``, in mission seconds."""
        marks = self._marks
        if marks[-1][0] == self._newest:
            return
        if len(marks) >= MOST_MARKS:
            half = MOST_MARKS // 2
            self._marks = marks = [marks[0], *marks[2:half:2], *marks[half:]]
        marks.append((self._newest, now))

    def since(self, rank: int) -> tuple[float | None, bool]:
        """Return by when (mission seconds) an entry was added, None if it was restored or is not marked yet; and
        whether that is final."""
        marks = self._marks
        final = rank <= marks[-1][0]
        if not final or rank <= marks[0][0]:
            return None, final
        return marks[bisect_left(marks, rank, key=itemgetter(0))][1], True

    def rank(self, last: bool) -> int:
        """Return the rank of a new entry."""
        if self.restoring is not None:
            rank = self.restoring
            self._newest, self._oldest = max(rank, self._newest), min(rank, self._oldest)
            return rank
        if last:
            self._oldest -= 1
            return self._oldest
        self._newest += 1
        return self._newest

    def forget(self, rank: int, percept: bool) -> None:
        """Note that an entry was removed; ``percept``: its only source ever was percept."""
        self.changed.pop(rank, None)
        if self._seen_oldest <= rank <= self._seen_newest and not percept:
            self.gone.append(rank)

    def turn(self) -> None:
        """Begin a new set of changes."""
        self.changed, self.gone = {}, []
        self._seen_newest, self._seen_oldest = self._newest, self._oldest


class KeptPredicate(Predicate):
    """A predicate that notes its changes in a book."""

    __slots__ = ("_book", "ranks")

    def __init__(self, sig: Signature, opened: Callable[[], None], book: _Book) -> None:
        super().__init__(sig, opened)
        self._book = book
        self.ranks: dict[Any, int] = {}
        """The rank of each entry, by the same keys."""

    def add_ground(
        self, args: tuple[Term, ...], annots: tuple[Term, ...], last: bool = False
    ) -> tuple[Term, ...] | None:
        """Add a ground fact and note the change."""
        before = len(self.entries)
        new = super().add_ground(args, annots, last)
        if len(self.entries) != before:
            self._note(args, annots, last)
        return new

    def _add_open(self, args: tuple[Term, ...], annots: tuple[Term, ...], last: bool) -> tuple[Term, ...] | None:
        before = len(self.entries)
        new = super()._add_open(args, annots, last)
        if len(self.entries) != before:
            self._note(next(iter(self.entries)) if last else next(reversed(self.entries)), annots, last)
        return new

    def _note(self, key: tuple[Term, ...], annots: tuple[Term, ...], last: bool) -> None:
        rank = self.ranks[key] = self._book.rank(last)
        if annots is not PERCEPT:
            self._book.changed[rank] = (self, key)

    def _replace(self, args: tuple[Term, ...], literal: Literal, ground: bool) -> None:
        super()._replace(args, literal, ground)
        self._book.changed[self.ranks[args]] = (self, args)

    def remove(self, literal: Literal) -> None:
        """Remove a fact and note the change."""
        super().remove(literal)
        self._book.forget(self.ranks.pop(literal.args), literal.annots is PERCEPT)

    def add_rule(self, rule: RuleClause, last: bool = False) -> None:
        """Add a rule and note the change."""
        super().add_rule(rule, last)
        rank = self.ranks[rule] = self._book.rank(last)
        self._book.changed[rank] = (self, rule)

    def remove_rule(self, rule: RuleClause) -> None:
        """Remove a rule and note the change."""
        super().remove_rule(rule)
        self._book.rules_gone.append(rule)
        self._book.forget(self.ranks.pop(rule), percept=False)


class KeptBeliefs(BeliefBase):
    """The beliefs of a mind whose state is kept.

    A fact is kept as a literal without source(percept), a rule of the program as its text, another rule as code.
    """

    dated = True

    def __init__(self, opened: Callable[[], None]) -> None:
        super().__init__(opened)
        self._book = _Book()
        self._own_rules: dict[int, str] = {}
        """The program's rules as text, by the identity of their syntax."""
        self._rules_removed: list[str] = []
        """Those that the run has taken out."""
        self._changeable: dict[int, tuple[KeptPredicate, Any, bytes]] = {}
        """The entries with maps, sets or queues, which change unnoticed, and the bytes kept of them."""
        self._mentioned = 0

    def predicate(self, sig: Signature) -> Predicate:
        """Return the predicate of a signature, made if it is missing."""
        found = self._predicates.get(sig)
        if found is None:
            found = self._predicates[sig] = KeptPredicate(sig, self._opened, self._book)
        return found

    def begin(self, program: CompiledProgram) -> None:
        """Note which rules are the program's own."""
        self._own_rules = {id(item): source_text(item) for item in program.beliefs if isinstance(item, nodes.Rule)}

    # --- since when ---

    def mark(self, now: float) -> None:
        """Date the facts added since the last mark with ``now``, in mission seconds; called after each run."""
        self._book.mark(now)

    def since(self, fact: Literal) -> tuple[float | None, bool]:
        """Since when a fact is believed, in mission seconds, to within a run of the mind and later within a few.

        None if unknown, as for a restored fact. A source added later changes nothing. Also return whether this is
        final: a fact newer than the last mark is dated by the next one.
        """
        predicate = self._predicates[fact.sig]
        rank = predicate.ranks.get(fact.args) if isinstance(predicate, KeptPredicate) else None
        return (None, True) if rank is None else self._book.since(rank)

    # --- keeping ---

    @property
    def dirty(self) -> bool:
        """Whether beliefs may have changed since `change` was asked last."""
        book = self._book
        return bool(
            book.changed or book.gone or book.rules_gone or self._changeable or len(self._predicates) > self._mentioned
        )

    def change(self, changes: MindRows, tell: Tell) -> None:
        """Add the changes since the last call."""
        book = self._book
        for clause in book.rules_gone:
            written = self._own_rules.pop(id(clause.syntax), None)
            if written is not None:
                self._rules_removed.append(written)
        book.rules_gone.clear()
        for rank in book.gone:
            self._changeable.pop(rank, None)
        changes.beliefs_gone = book.gone
        again = {rank: entry for rank, entry in self._changeable.items() if rank not in book.changed}
        for rank, (predicate, key) in book.changed.items():
            self._change(changes, tell, rank, predicate, key, None)
        for rank, (predicate, key, before) in again.items():
            self._change(changes, tell, rank, predicate, key, before)
        book.turn()
        if len(self._predicates) > self._mentioned:
            new = enumerate(islice(self._predicates, self._mentioned, None), self._mentioned)
            for number, sig in new:
                named = [sig.functor, float(sig.arity), "~" if sig.negated else "", sig.namespace]
                changes.predicates.append((number, terms_to_bytes(named)))
            self._mentioned = len(self._predicates)

    def _change(
        self, changes: MindRows, tell: Tell, rank: int, predicate: KeptPredicate, key: Any, before: bytes | None
    ) -> None:
        """Add an entry as it is, unless it is as before."""
        self._changeable.pop(rank, None)
        terms = self._terms(predicate.entries[key])
        if terms is None:
            changes.beliefs_gone.append(rank)
            return
        try:
            data, changeable = write_terms(terms)
        except CannotKeep as why:
            tell(f"{'a rule' if type(key) is RuleClause else 'a belief'} {predicate.sig.indicator}", why)
            changes.beliefs_gone.append(rank)
            return
        if changeable:
            self._changeable[rank] = (predicate, key, data)
        if data != before:
            changes.beliefs.append((rank, data))

    def _terms(self, entry: Any) -> list[Term] | None:
        """Return the terms to keep of an entry; None for a percept."""
        if type(entry) is RuleClause:
            own = self._own_rules.get(id(entry.syntax))
            return [Code(entry.syntax, entry.values)] if own is None else [own]
        annots = entry.annots
        if SOURCE_PERCEPT in annots:
            annots = tuple(a for a in annots if a != SOURCE_PERCEPT)
            return [entry.with_annots(annots)] if any(map(is_source, annots)) else None
        return [entry]

    def values(self) -> dict[str, bytes]:
        """Return the values kept as a whole."""
        return {"rules_removed": terms_to_bytes(self._rules_removed)} if self._rules_removed else {}

    # --- restoring ---

    def restore_order(self, stored: MindRows, tell: Tell) -> None:
        """Mention the predicates in the order in which they were mentioned: before anything else does."""
        for number, data in stored.predicates:
            try:
                functor, arity, sign, namespace = terms_from_bytes(data)
            except BadBytes as why:
                tell(f"the place of a predicate (row {number})", why)
            else:
                self.predicate(signature(functor, int(arity), sign == "~", namespace))
        self._mentioned = len(self._predicates)

    def restore(self, mind: MindState, program: Any, stored: MindRows, removed: list[str], tell: Tell) -> None:
        """Restore the beliefs, without events. Rules that are new in the program come last.

        ``removed`` are the rules of the program that the run removed, from `values`.
        """
        self.begin(program)
        self._rules_removed = removed
        own: dict[str, list[nodes.Rule]] = {}
        for item in program.beliefs:
            if isinstance(item, nodes.Rule):
                own.setdefault(self._own_rules[id(item)], []).append(item)
        book = self._book
        for rank, data in stored.beliefs:
            book.restoring = rank
            try:
                self._put(mind, rank, data, own)
            except BadBytes as why:
                tell(f"a belief (row {rank})", why)
        book.restoring = None
        book.begin()
        missing = book.gone
        book.turn()
        book.gone = missing
        for written in self._rules_removed:
            if own.get(written):
                del self._own_rules[id(own[written].pop(0))]
        left = {id(item) for items in own.values() for item in items}
        for item in program.beliefs:
            if id(item) in left:
                add_rule(mind, item, {}, last=True)

    def _put(self, mind: MindState, rank: int, data: bytes, own: dict[str, list[nodes.Rule]]) -> None:
        (entry,), changeable = read_terms(data)
        if type(entry) is str:
            if own.get(entry):
                add_rule(mind, own[entry].pop(0), {})
            else:
                self._book.gone.append(rank)  # the program has this rule no longer
            return
        if type(entry) is Code and isinstance(entry.syntax, nodes.Rule):
            add_rule(mind, entry.syntax, entry.values)
        elif type(entry) is Literal:
            self.predicate(entry.sig).add(entry.args, entry.annots)
        else:
            raise BadBytes("it is neither fact nor rule")
        if rank not in self._book.changed:
            self._book.gone.append(rank)  # equal to another by now: maps change
        elif changeable:
            self._changeable[rank] = (*self._book.changed[rank], data)
