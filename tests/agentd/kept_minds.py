"""Minds that are kept, in tests: their state as plain values, and their next lives."""

from __future__ import annotations

from typing import Any

from agentd.language.compiler.compile import compile_program
from agentd.language.parse import parse_program
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.format import text
from agentd.language.terms.source_annotations import SOURCE_PERCEPT, is_source
from agentd.language.terms.terms import Literal
from agentd.mind import Mind
from agentd.mind.beliefs.belief_base import RuleClause
from agentd.mind.persistence.change_tracking import Keeper
from agentd.mind.persistence.rows import MindRows, Row
from tests.agentd.minds import World


class Life(World):
    """One life of an agent, with what has been kept of it."""

    def __init__(self, source: str, stored: MindRows | None = None, **arguments: Any) -> None:
        self.keeper = Keeper(stored)
        program = compile_program(parse_program(source, "test.asl"))
        super().__init__(Mind("bob", program, keeper=self.keeper, **arguments))
        self.source = source
        self.stored = stored or MindRows()

    def save(self) -> MindRows:
        """Keep what has changed; returns that. Where nothing was said to have changed, nothing has."""
        clean = not self.keeper.dirty
        changes = self.keeper.changes()
        assert not (clean and changes), changes
        self.stored = _changed(self.stored, changes)
        return changes

    def next(self, own: bool = True, source: str | None = None) -> Life:
        """The life after this one: it knows what was saved."""
        life = Life(source or self.source, self.stored)
        life.keeper.resume(own)
        return life


def _changed(stored: MindRows, changes: MindRows) -> MindRows:
    """The mind after changes, as a database applies them."""
    pending = {key: (key, origin, data) for key, origin, data in stored.pending}
    for gone in changes.pending_gone:
        pending.pop(gone, None)
    pending.update({row[0]: row for row in changes.pending})
    return MindRows(
        beliefs=_merged(stored.beliefs, changes.beliefs, changes.beliefs_gone),
        predicates=_merged(stored.predicates, changes.predicates, []),
        plans=_merged(stored.plans, changes.plans, changes.plans_gone),
        pending=[pending[key] for key in sorted(pending)],
        values={**stored.values, **changes.values},
    )


def _merged(rows: list[Row], new: list[Row], gone: list[int]) -> list[Row]:
    return sorted({**{rank: data for rank, data in rows if rank not in gone}, **dict(new)}.items())


def begun(source: str, **arguments: Any) -> Life:
    """A first life that has come to rest and is saved."""
    life = Life(source, **arguments)
    life.settle()
    life.save()
    return life


def state_of(mind: Mind) -> dict[str, Any]:
    """All that is kept of a mind but what is pending, as plain values."""
    beliefs = [(p.sig.indicator, [_entry(e) for e in reversed(p.entries.values())]) for p in mind.beliefs.predicates()]
    return {
        "beliefs": [(name, [e for e in entries if e]) for name, entries in beliefs if any(entries)],
        "plans": [(text(p.label), _plan(p), [text(s) for s in p.sources]) for p in mind.plans],
        "properties": {(n, k): text(v) for n, found in mind.namespaces.items() for k, v in found.items()},
        "messages": mind.message_count,
        "actions": mind.action_count,
    }


def _plan(plan: Any) -> tuple[str, dict[str, str]]:
    return source_text(plan.syntax), {name: text(value) for name, value in plan.values.items()}


def _entry(entry: Any) -> Any:
    if type(entry) is RuleClause:
        return source_text(entry.syntax), {name: text(value) for name, value in entry.values.items()}
    sources = [a for a in entry.annots if is_source(a)]
    if sources and all(a == SOURCE_PERCEPT for a in sources):
        return None
    annots = tuple(a for a in entry.annots if a != SOURCE_PERCEPT)
    return text(Literal(entry.sig, entry.args, annots))
