"""The plans of a mind whose state is kept: which the run has added, and which of the program's it has removed."""

from __future__ import annotations

from itertools import takewhile
from typing import Any

from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.source_annotations import SOURCE_SELF
from agentd.language.terms.terms import Code, Literal, make_list, proper
from agentd.mind.persistence.belief_store import Tell
from agentd.mind.persistence.rows import MindChanges, Row, StoredMind
from agentd.mind.persistence.term_codec import BadBytes, CannotKeep, terms_from_bytes, terms_to_bytes
from agentd.mind.plans.plan_library import Plan, PlanLibrary

_FROM_SELF = [SOURCE_SELF.args[0]]


class KeptPlans:
    """Notes what changes in a plan library. It looks only when the library says that something has changed."""

    def __init__(self, library: PlanLibrary) -> None:
        self._library = library
        self._seen = -1
        self._own: dict[Plan, str] = {}
        """The program's plans, as text."""
        self._ranks: dict[Plan, int] = {}
        """The place of each other plan: below 0 before the program's plans, above 0 after them."""
        self._sources: dict[Plan, tuple[Any, ...]] = {}
        """The sources that each of them was kept with."""

    def begin(self) -> None:
        """All plans that are there are the program's."""
        self._own = {plan: source_text(plan.syntax) for plan in self._library}
        self._seen = self._library.version

    def change(self, changes: MindChanges, tell: Tell) -> None:
        """Add what has changed since this was asked last."""
        library = self._library
        if library.version == self._seen:
            return
        self._seen = library.version
        self._rank()
        here = set(library)
        for plan in [plan for plan in self._ranks if plan not in here]:
            changes.plans_gone.append(self._ranks.pop(plan))
            self._sources.pop(plan, None)
        for plan, rank in self._ranks.items():
            if self._sources.get(plan) == tuple(plan.sources):
                continue
            self._sources[plan] = tuple(plan.sources)
            try:
                changes.plans.append((rank, _plan_bytes(plan)))
            except CannotKeep as why:
                tell(f"the plan {plan.head}", why)

    def _rank(self) -> None:
        """Give new plans their places: those before all others were put there, the others at the end."""
        known = self._own.keys() | self._ranks.keys()
        first = list(takewhile(lambda plan: plan not in known, self._library)) if known else []
        lowest = min(self._ranks.values(), default=0)
        highest = max(self._ranks.values(), default=0)
        for number, plan in enumerate(reversed(first), 1):
            self._ranks[plan] = min(lowest, 0) - number
        for plan in self._library:
            if plan not in self._own and plan not in self._ranks:
                highest = max(highest, 0) + 1
                self._ranks[plan] = highest

    def values(self) -> dict[str, bytes]:
        """What is kept as a whole: the program's plans that are gone or have other sources than the agent itself."""
        here = set(self._library)
        changed: list[Any] = []
        for plan, written in self._own.items():
            sources = list(plan.sources) if plan in here else []
            if sources != _FROM_SELF:
                changed += [written, make_list(sources)]
        return {"program_plans": terms_to_bytes(changed)} if changed else {}

    def restore(self, program: Any, stored: StoredMind, changed: list[Any], tell: Tell) -> None:
        """Give a mind the plans of its program, without those that were removed, and those that were added.

        ``changed`` is what `values` has told about the program's.
        """
        library = self._library
        library.extend(list(program.plans))
        self.begin()
        for written, sources in zip(changed[::2], map(proper, changed[1::2]), strict=True):
            plan = next((p for p in library if self._own[p] == written and p.sources == _FROM_SELF), None)
            if plan is None:
                continue  # the program has this plan no longer
            plan.sources = sources or []
            if not sources:
                library.remove(plan)
        after = [row for row in stored.plans if row[0] > 0]
        for rank, data in [*reversed(stored.plans[: len(stored.plans) - len(after)]), *after]:
            try:
                self._put((rank, data))
            except BadBytes as why:
                tell(f"a plan (row {rank})", why)
        self._seen = library.version

    def _put(self, row: Row) -> None:
        rank, data = row
        library = self._library
        match terms_from_bytes(data):
            case [Code(syntax=nodes.Plan() as node, values=values), Literal() as label, sources, *file]:
                plan = library.make(node, values)
                if not any(other.label.sig is label.sig for other in library):
                    library.name(plan, label)
                plan.sources = proper(sources) or []
                plan.file = str(file[0]) if file else ""  # checkpoints of older releases have none
                library.add(plan, first=rank < 0)
                self._ranks[plan], self._sources[plan] = rank, tuple(plan.sources)
                return
        raise BadBytes("it is no plan")


def _plan_bytes(plan: Plan) -> bytes:
    return terms_to_bytes([Code(plan.syntax, plan.values), plan.label, make_list(plan.sources), plan.file])
