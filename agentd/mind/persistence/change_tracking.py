"""Keep a mind across restarts: report its changes since the last call, and restore it.

A `Keeper` is given to a mind when it is made. Noting a change costs as much as the change, there is no I/O, and minds
without a keeper pay nothing. Kept are beliefs in query order (`agentd.mind.persistence.belief_store`), rules and plans
that the run has added or removed, pending events (`agentd.mind.persistence.pending_events`), functions of included
files, properties of namespaces, and the counters of ids. Percepts are not kept: they are perceived again.

The program is the authority for its own plans and rules: a restored mind has those of its present program, except
those that the run had removed. Initial beliefs and goals are those of the first start only.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import takewhile
from typing import Any

from agentd.language.compiler.compile import CompiledProgram
from agentd.language.syntax_tree import nodes
from agentd.language.syntax_tree.printer import source_text
from agentd.language.terms.source_annotations import SOURCE_SELF
from agentd.language.terms.terms import Code, Literal, Term, make_list, proper
from agentd.mind.execution.program_loading import load_program, register_functions, warn
from agentd.mind.persistence.belief_store import KeptBeliefs, Tell
from agentd.mind.persistence.pending_events import Origin, Origins, Pending
from agentd.mind.persistence.rows import MindRows, PendingKey, Row
from agentd.mind.persistence.term_codec import BadBytes, CannotKeep, terms_from_bytes, terms_to_bytes
from agentd.mind.plans.plan_library import Plan, PlanLibrary
from agentd.mind.state import MindState


class Keeper:
    """Notes the changes of one mind: ``Mind(name, program, keeper=Keeper(stored))``.

    With ``stored`` the mind is restored instead of beginning with its initial beliefs and goals; no event is raised by
    that. `resume` is to be called once; until then what was pending stays kept as it is.
    """

    def __init__(self, stored: MindRows | None = None) -> None:
        self._stored = stored
        self.lives = 0
        """How often the mind has been restored: 0 after a first start."""
        self.pending_own: tuple[Pending, ...] = ()
        """Events of the mind's own that were pending when it was saved."""
        self.pending_others: tuple[Pending, ...] = ()
        """Pending events that others had caused."""
        self.left_out: list[str] = []
        """Descriptions of stored items that cannot be restored."""
        self.unkept = 0
        """How often something could not be kept."""
        self._told: list[str] = []
        self._refused: dict[tuple[str, str, int], Any] = {}
        """Properties of namespaces that cannot be kept and were reported."""
        self._pending: dict[PendingKey, tuple[Any, ...]] = {}
        """The pending events that are kept."""
        self._waiting: set[PendingKey] = set()
        """The restored events that were not raised again yet."""
        self._values: dict[str, bytes] = {}
        self._seen: tuple[int, ...] = ()

    # --- for the mind that is being made ---

    def belief_base(self, opened: Callable[[], None]) -> KeptBeliefs:
        """Return the belief base of the mind; ``opened`` as in `agentd.mind.beliefs.belief_base.BeliefBase`."""
        self._beliefs = KeptBeliefs(opened)
        return self._beliefs

    def begin(self, mind: MindState, program: CompiledProgram) -> None:
        """Give the mind its program, and its stored state if it is restored."""
        self._mind, self._plans = mind, KeptPlans(mind.plans)
        self._functions = set(program.functions)
        if self._stored is None:
            self._beliefs.begin(program)
            load_program(mind, program)
            self._plans.begin()
        else:
            self._restore(mind, program, self._stored)
            self._stored = None
        self.origins = Origins(mind, max((number for queued, number in self._waiting if queued), default=0))
        """Knows where the events and intentions of the mind come from."""
        mind.origins = self.origins
        for event in mind.events:
            self.origins.mark(event, Origin.NEVER)

    # --- for the runtime ---

    def resume(self, own: bool) -> int:
        """Raise the pending events of a restored mind: those of others, and its own if ``own``. Return their number."""
        mind, count = self._mind, 0
        self._waiting, self._seen = set(), ()
        for item in sorted((*self.pending_own, *self.pending_others), key=lambda item: item.place):
            if item.origin is Origin.OWN and not own:
                continue
            relevant = mind.plans.relevant(item.operator, item.goal, item.literal.sig)
            before = len(mind.events)
            mind.post(relevant, item.literal.args, item.literal.annots)
            if len(mind.events) > before:
                self.origins.mark(mind.events[-1], item.origin)
                count += 1
        return count

    @property
    def dirty(self) -> bool:
        """Whether anything may have changed since `changes` was asked last; it costs nothing to ask.

        Properties of namespaces change without a word, as maps in beliefs do: a mind with any is always looked at.
        """
        return self._seen != self._state() or self._beliefs.dirty or bool(self._mind.namespaces)

    def _state(self) -> tuple[int, ...]:
        """Figures that differ when anything but beliefs has changed. Changes of percepts alone do not count.

        They may end a wait, though, and with it an intention. None begins to wait in such a cycle, so the number of
        waiting intentions shows it.
        """
        mind = self._mind
        waiting, suspended = len(mind.waiting), len(mind.suspended)
        return mind.cycle - mind.still, len(mind.events), waiting, suspended, mind.plans.version, mind.message_count

    def changes(self) -> MindRows:
        """Return the changes since the last call. To be called between two calls of `Mind.run` only.

        The cost is that of the changes, and a look at each intention and queued event.
        """
        changes = MindRows()
        self._beliefs.change(changes, self._cannot)
        self._plans.change(changes, self._cannot)
        self._change_pending(changes)
        values = self._beliefs.values() | self._plans.values() | self._own_values()
        for name in self._values.keys() | values.keys():
            data = values.get(name, _NOTHING)
            if self._values.get(name) != data:
                self._values[name] = changes.values[name] = data
        changes.unkept, self._told = self._told, []
        self._seen = self._state()
        return changes

    def _cannot(self, what: str, why: Exception) -> None:
        self.unkept += 1
        self._told.append(f"{what} cannot be kept: {why}")

    def _change_pending(self, changes: MindRows) -> None:
        before = self._pending
        now: dict[PendingKey, tuple[Any, ...]] = {}
        for key, origin, event in self.origins.pending():
            relevant, args, annots = event
            known = before.get(key)
            if known is not None and known[0] is relevant and known[1] is args and known[2] is annots:
                now[key] = known
                continue
            now[key] = event
            literal = Literal(relevant.sig, args, annots)
            try:
                data = Pending(origin, relevant.operator, relevant.goal, literal, key).to_bytes()
            except CannotKeep as why:
                self._cannot(f"the event {relevant}", why)
                changes.pending_gone.append(key)
            else:
                changes.pending.append((key, origin, data))
        now.update((key, before[key]) for key in self._waiting)
        changes.pending_gone += [key for key in before if key not in now]
        self._pending = now

    def _own_values(self) -> dict[str, bytes]:
        """Return the values kept as a whole that are neither beliefs nor plans."""
        mind = self._mind
        counts = (self.lives, mind.message_count, mind.action_count)
        values = {"counts": terms_to_bytes(map(float, counts))}
        if mind.namespaces:
            values["namespaces"] = terms_to_bytes(self._properties())
        functions = [(name, arity, rule) for (name, arity), rule in mind.compiler.rules_of_functions.items()]
        if added := [function for function in functions if function not in self._functions]:
            values["functions"] = terms_to_bytes(part for name, n, rule in added for part in (name, float(n), rule))
        if mind.compiler.namespaced:
            values["namespaced"] = terms_to_bytes([1.0])
        return values

    def _properties(self) -> list[Term]:
        """Return the properties of namespaces: namespace, key and value of each."""
        found: list[Term] = []
        for namespace, properties in self._mind.namespaces.items():
            for key, value in properties.items():
                try:
                    terms_to_bytes([value])
                except CannotKeep as why:
                    if (namespace, key, id(value)) not in self._refused:
                        self._refused[(namespace, key, id(value))] = value
                        self._cannot(f"the property {key} of the namespace {namespace}", why)
                else:
                    found += [namespace, key, value]
        return found

    # --- restoring ---

    def _restore(self, mind: MindState, program: CompiledProgram, stored: MindRows) -> None:
        """Give a mind its program and all that was kept, without events."""
        values = self._read_values(stored)
        functions = values.get("functions", [])
        register_functions(mind, program.functions)
        register_functions(mind, zip(functions[::3], map(int, functions[1::3]), functions[2::3], strict=True))
        mind.compiler.namespaced |= program.namespaced or bool(values.get("namespaced"))
        self._beliefs.restore_order(stored, self._left)
        self._plans.restore(program, stored, values.get("program_plans", []), self._left)
        self._beliefs.restore(mind, program, stored, values.get("rules_removed", []), self._left)
        properties = values.get("namespaces", [])
        for namespace, key, value in zip(properties[::3], properties[1::3], properties[2::3], strict=True):
            mind.namespaces.setdefault(namespace, {})[key] = value
        lives, mind.message_count, mind.action_count = map(int, values.get("counts", (0, 0, 0)))
        self.lives = lives + 1
        mind.random.seed(f"{mind.random.getrandbits(64)} {self.lives}")
        pending = list(self._read_pending(stored))
        self.pending_own = tuple(item for item in pending if item.origin is Origin.OWN)
        self.pending_others = tuple(item for item in pending if item.origin is Origin.OTHERS)
        self._pending = {key: (None, None, None) for key, _, _ in stored.pending}
        self._waiting = set(self._pending)
        mind.intention_count = max((number for queued, number in self._waiting if not queued), default=0)
        self._values = dict(stored.values)
        warn(mind, program)

    def _read_values(self, stored: MindRows) -> dict[str, list[Any]]:
        found = {}
        for name, data in stored.values.items():
            try:
                found[name] = terms_from_bytes(data)
            except BadBytes as why:
                self._left(f"the {name} of the mind", why)
        return found

    def _read_pending(self, stored: MindRows) -> Iterable[Pending]:
        for key, origin, data in stored.pending:
            try:
                yield Pending.from_bytes(key, Origin(origin), data)
            except BadBytes as why:
                self._left(f"an event (row {key})", why)

    def _left(self, what: str, why: Exception) -> None:
        self.left_out.append(f"{what} cannot be restored: {why}")


_NOTHING = terms_to_bytes([])


_FROM_SELF = [SOURCE_SELF.args[0]]


class KeptPlans:
    """Notes the changes of a plan library. It compares only when the library's version has changed."""

    def __init__(self, library: PlanLibrary) -> None:
        self._library = library
        self._seen = self._valued = -1
        self._values: dict[str, bytes] = {}
        """What `values` returns at the version `_valued` of the library."""
        self._own: dict[Plan, None] = {}
        """The program's plans."""
        self._ranks: dict[Plan, int] = {}
        """The place of each other plan: below 0 before the program's plans, above 0 after them."""
        self._sources: dict[Plan, tuple[Term, ...]] = {}
        """The sources that each of them was kept with."""

    def begin(self) -> None:
        """Begin, with the plans of the program alone."""
        self._own = dict.fromkeys(self._library)
        self._seen = self._library.version

    def change(self, changes: MindRows, tell: Tell) -> None:
        """Add the changes since the last call."""
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
                kept = [Code(plan.syntax, plan.values), plan.label, make_list(plan.sources), plan.file]
                changes.plans.append((rank, terms_to_bytes(kept)))
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
        """Return the values kept as a whole: program plans that were removed or have sources besides the agent."""
        if self._library.version == self._valued:
            return self._values
        here = set(self._library)
        changed: list[Term] = []
        for plan in self._own:
            sources = list(plan.sources) if plan in here else []
            if sources != _FROM_SELF:
                changed += [source_text(plan.syntax), make_list(sources)]
        self._valued = self._library.version
        self._values = {"program_plans": terms_to_bytes(changed)} if changed else {}
        return self._values

    def restore(self, program: CompiledProgram, stored: MindRows, changed: list[Term], tell: Tell) -> None:
        """Give a mind the plans of its program, without those that were removed, and those that were added.

        ``changed`` is what `values` returned.
        """
        library = self._library
        library.extend(list(program.plans))
        self.begin()
        for written, sources in zip(changed[::2], map(proper, changed[1::2]), strict=True):
            own = (plan for plan in library if plan.sources == _FROM_SELF and source_text(plan.syntax) == written)
            plan = next(own, None)
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
            case [Code(syntax=nodes.Plan() as node, values=values), Literal() as label, sources, str() as file]:
                plan = library.make(node, values)
                if not any(other.label.sig is label.sig for other in library):
                    library.name(plan, label)
                plan.sources = proper(sources) or []
                plan.file = file
                library.add(plan, first=rank < 0)
                self._ranks[plan], self._sources[plan] = rank, tuple(plan.sources)
                return
        raise BadBytes("it is no plan")
