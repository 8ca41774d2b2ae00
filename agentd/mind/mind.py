"""A mind: the state of one agent and its reasoning cycle."""

from __future__ import annotations

import random
from collections import deque
from collections.abc import Callable, Iterable
from datetime import UTC, tzinfo
from typing import Any, Final

from agentd.language import syntax
from agentd.language.compile import CompiledProgram
from agentd.language.compile_plan import compile_formula
from agentd.language.compile_rule import compile_rule
from agentd.language.emit import Ref
from agentd.language.instantiate import Instantiation
from agentd.language.numbers import UndefinedNumber
from agentd.language.signatures import Signature
from agentd.language.sources import SELF
from agentd.language.terms import Literal
from agentd.mind import failure, percepts
from agentd.mind.annotations import with_source
from agentd.mind.beliefs import BeliefBase, Mode, RuleClause
from agentd.mind.effects import CancelAction, Effect, Log
from agentd.mind.failed import Failed
from agentd.mind.frames import ANNOTS, ARGS, MARK, PLAN, RELEVANT, STEP, Frame
from agentd.mind.inputs import (
    ActionDone,
    BeliefAdded,
    GoalAdded,
    Input,
    Mail,
    PerceptAdded,
    PerceptRemoved,
    PerceptReplaced,
    SignalRaised,
    TeamReply,
    TimeRead,
)
from agentd.mind.intentions import Intention
from agentd.mind.library import Library
from agentd.mind.messages import Question, receive
from agentd.mind.nested import check_goal_conditions, condition_holds, nested_frame
from agentd.mind.plans import Plan, PlanLibrary
from agentd.mind.resolving import detach, resolve_all
from agentd.mind.runtime import RUNTIME
from agentd.mind.snapshot import BeliefView, IntentionView, views_of_beliefs, views_of_intentions
from agentd.mind.team import Request
from agentd.mind.unifier import undo, unify
from agentd.mind.waiting import Timer, Timers, Wait, check_conditions, ended, forget

MOST_FOCUSES: Final = 100_000
"""So many events and intentions there may be; an agent that raises more floods itself, and the newest are dropped."""


MOST_MAIL: Final = 100_000
"""So many messages may wait to be taken."""

Event = tuple[Any, tuple[Any, ...], tuple[Any, ...], Intention | None]
"""The `Relevant` plans, arguments and annotations of an event, and the intention that waits for it (or None)."""


class Mind:
    """One agent's beliefs, plans, intentions and cycle, with nothing of the world but what is fed in.

    ``name`` is the agent's; ``seed`` starts its random numbers; ``start`` is the mission time in seconds at its birth.
    ``actions`` are the names of the external actions that somebody can perform, None for any. ``clock`` gives the
    mission time when the program asks for it within a cycle; each reading is an input (`TimeRead`). Without a clock
    time stands still within a call of `step`. ``on_input`` is told each input with the number of the cycle that took
    it: fed again in the same cycles they lead to the same effects. ``agents`` tells who can be sent to (None: nobody
    asks). ``has_team`` says that somebody answers each `TeamRequest`. ``ask_timeout`` in seconds bounds synchronous
    asks without a limit of their own. ``epoch`` is the Unix time of mission time 0, and ``zone`` where it is told, for
    ``.date`` and ``.time``.
    """

    def __init__(
        self,
        name: str,
        program: CompiledProgram,
        *,
        seed: int = 0,
        start: float = 0.0,
        actions: Iterable[str] | None = None,
        clock: Callable[[], float] | None = None,
        on_input: Callable[[int, Input], None] | None = None,
        agents: Callable[[], Iterable[str]] | None = None,
        has_team: bool = False,
        ask_timeout: float | None = None,
        epoch: float = 0.0,
        zone: tzinfo = UTC,
    ) -> None:
        self.name, self.program = name, program
        self.actions = None if actions is None else frozenset(actions)
        self.random = random.Random(seed)
        self.now = self.start = start
        self._clock, self._on_input = clock, on_input
        self.cycle = 0
        """How many cycles have been run."""
        self.beliefs = BeliefBase()
        self.compiler = Library()
        self.plans = PlanLibrary(self.compiler, RUNTIME, self._provide)
        self.events: deque[Event] = deque()
        self.dropped_events = 0
        """How many events were dropped because too many waited."""
        self.dropped_mail = 0
        """How many messages were dropped because too many waited."""
        self.running: deque[Intention] = deque()
        self.waiting: dict[int, tuple[Intention, Any]] = {}
        """Intentions that wait for something other than an event of theirs, with what must be taken back."""
        self.suspended: dict[int, Intention] = {}
        """Intentions that could run but are suspended."""
        self.current: Intention | None = None
        self.atomic: Intention | None = None
        self.inputs: deque[Input] = deque()
        self.mailbox: deque[Mail] = deque()
        self.effects: list[Effect] = []
        self.timers = Timers()
        self.goal_conditions: list[tuple[Intention, Frame]] = []
        """The frames whose goals end when a condition holds (``<:``)."""
        self.listeners: list[Wait] = []
        self.conditions: list[Wait] = []
        self.changes = 0
        """How often beliefs have changed: formulas that are waited for are asked again when it has grown."""
        self._checked = 0
        self.action_count = 0
        self.message_count = 0
        self.questions: dict[str, Any] = {}
        """Synchronous asks that wait for their answer, by message id."""
        self.percepts: dict[Signature, dict[tuple[Any, ...], None]] = {}
        self.namespaces: dict[str, dict[str, Any]] = {}
        """Properties of namespaces (``.namespace_set_prop``)."""
        self.future_events: list[Timer] = []
        """Events that ``.at`` raises when they are due."""
        self.agents, self.has_team = agents, has_team
        self.requests: dict[int, Request] = {}
        """What the team was asked for and has not answered."""
        self.ask_timeout = ask_timeout
        self.epoch, self.zone = epoch, zone
        self._warned: dict[str, None] = {}
        self._intention_count = 0
        self._queries: dict[int, tuple[Any, Any]] = {}
        self._load(program)

    # --- loading ---

    def _load(self, program: CompiledProgram) -> None:
        for name, arity, rule in program.functions:
            self._register_function(name, arity, rule)
        self.plans.extend(list(program.plans))
        functions = {key: self._function(key) for key in self._function_keys()}
        for item in reversed(program.beliefs):
            if isinstance(item, syntax.Rule):
                self.add_rule(item, {})
                continue
            literal = Instantiation({}, functions).term(item.literal)
            assert isinstance(literal, Literal)
            self.add_belief(literal)
        for goal in program.goals:
            literal = Instantiation({}, functions).term(goal.literal)
            self.add_goal(literal, goal.operator)
        for warning in program.warnings:
            self.effects.append(Log("warning", warning))

    def _function_keys(self) -> list[tuple[str, int]]:
        from agentd.stdlib.registry import FUNCTIONS

        return list(FUNCTIONS)

    def _function(self, key: tuple[str, int]) -> Callable[..., Any]:
        compute = self.compiler.function(*key)
        return lambda *args: compute(self, *args)

    def _register_function(self, name: str, arity: int, rule: str) -> None:
        from agentd.mind.functions import by_rule

        self.compiler.register_function(name, arity, by_rule(rule, arity))

    def _provide(self, ref: Ref) -> Any:
        if ref.kind == "predicate":
            return self.beliefs.predicate(ref.what)
        raise KeyError(ref.kind)

    def add_rule(self, rule: syntax.Rule, values: dict[str, Any], last: bool = False) -> None:
        """Believe a rule, before the other clauses of its predicate or after them."""
        from agentd.language.constants import signature_of

        clause = RuleClause(rule, self._compile_rule, values)
        self.beliefs.predicate(signature_of(rule.head)).add_rule(clause, last)
        self.changes += 1

    def remove_rule(self, rule: syntax.Rule) -> None:
        """Forget the first rule that is written so."""
        from agentd.language.constants import signature_of

        predicate = self.beliefs.predicate(signature_of(rule.head))
        for entry in list(predicate.entries):
            if type(entry) is RuleClause and entry.syntax == rule:
                predicate.remove_rule(entry)
                self.changes += 1
                return

    def _compile_rule(self, clause: RuleClause, mode: Mode) -> Any:
        unit = compile_rule(clause.syntax, mode, self.compiler, clause.values)
        return unit.load(RUNTIME, self.plans.provide)["answers"]

    def remove_plan(self, label: Any) -> None:
        """Take out the plans with a label, given as syntax."""
        for plan in list(self.plans):
            if plan.label.sig.functor == getattr(label, "functor", None):
                self.plans.remove(plan)

    def copy_from(self, other: Mind) -> None:
        """Take over another mind's beliefs, rules and plans, without their events (``.clone``)."""
        for predicate in other.beliefs.predicates():
            own = self.beliefs.predicate(predicate.sig)
            for entry in list(predicate.entries.values()):
                if type(entry) is RuleClause:
                    self.add_rule(entry.syntax, entry.values)
                else:
                    own.add(entry.args, entry.annots)
        known = {id(plan.syntax) for plan in self.plans}
        for plan in other.plans:
            if id(plan.syntax) not in known:
                self.plans.add(self.plans.make(plan.syntax, plan.values))

    # --- what others may ask and do ---

    def feed(self, item: Input) -> None:
        """Hand in an input; it is taken in the next cycle (mail: one message per cycle, at most `MOST_MAIL` wait)."""
        if isinstance(item, Mail):
            if len(self.mailbox) >= MOST_MAIL:
                self.dropped_mail += 1
                self.warn_once(f"more than {MOST_MAIL} messages wait; further ones are dropped")
                return
            self.mailbox.append(item)
        else:
            self.inputs.append(item)

    def step(self, now: float) -> list[Effect]:
        """Run one reasoning cycle at mission time ``now`` and return what it wants done, in order."""
        return self.run(now, 1)

    def run(self, now: float, cycles: int) -> list[Effect]:
        """Run up to so many cycles; stops early when there is an effect to hand out or nothing left to do."""
        self.now = max(self.now, now)
        try:
            self._cycles(cycles)
        except RecursionError:
            self._too_deep()
        effects, self.effects = self.effects, []
        return effects

    @property
    def ready(self) -> bool:
        """Whether there is something to do now."""
        if self.inputs or self.effects:
            return True
        if self.changes != self._checked and (self.conditions or self.goal_conditions):
            return True
        if self.atomic is not None:
            return self._atomic_can_run()
        return bool(self.events or self.running or self.mailbox)

    @property
    def wake_at(self) -> float | None:
        """The earliest mission time at which something is due that no input announces; None if there is none."""
        return self.timers.next_due()

    @property
    def idle(self) -> bool:
        """Nothing to do, nothing due and nothing waited for: only an input can wake this mind."""
        return not self.ready and self.wake_at is None and not self.waiting

    def query(self, formula: Any) -> bool:
        """Whether a parsed formula (`agentd.language.parser.parse_formula`) follows from the beliefs."""
        known = self._queries.get(id(formula))
        if known is None:
            holds = compile_formula(formula, self.compiler).load(RUNTIME, self.plans.provide)["holds"]
            known = self._queries[id(formula)] = (holds, formula)
        trail: list[Any] = []
        try:
            return bool(known[0](self, trail))
        except (Failed, UndefinedNumber, RecursionError):
            return False
        finally:
            undo(trail, 0)

    def intention_views(self) -> list[IntentionView]:
        """The intentions as they stand, for people."""
        return views_of_intentions(self)

    def belief_views(self) -> list[BeliefView]:
        """The beliefs as they stand, for people."""
        return views_of_beliefs(self)

    # --- events and intentions ---

    def post(self, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...]) -> None:
        """Queue an event that starts an intention of its own."""
        if len(self.events) + len(self.running) + len(self.waiting) >= MOST_FOCUSES:
            self.dropped_events += 1
            event = f"{relevant.text}{relevant.sig.indicator}"
            self.warn_once(f"more than {MOST_FOCUSES} events and intentions; events such as {event} are dropped")
            return
        if annots is not SELF:
            annots = resolve_all(annots)
        self.events.append((relevant, args, annots, None))

    def add_goal(self, literal: Literal, operator: str = "!") -> None:
        """A goal of its own, with its event."""
        relevant = self.plans.relevant("+", operator, literal.sig)
        annots = with_source(literal.annots)
        if self.plans.has_meta:
            self.meta(relevant, literal.args, annots, "pending")
        self.post(relevant, detach(literal.args), annots)

    def add_belief(self, literal: Literal, last: bool = False) -> None:
        """A belief with its event, as an intention of its own."""
        from agentd.mind.changes import believe

        predicate = self.beliefs.predicate(literal.sig)
        relevant = self.plans.relevant("+", "", literal.sig)
        believe(self, None, predicate, relevant, detach(resolve_all(literal.args)), with_source(literal.annots), last)

    def new_intention(self) -> Intention:
        self._intention_count += 1
        return Intention(self._intention_count)

    def all_intentions(self) -> list[Intention]:
        """Every intention once: the current one, running, in events, waiting, suspended; by id."""
        found: dict[int, Intention] = {}
        if self.current is not None and self.current.stack:
            found[self.current.id] = self.current
        for intention in self.running:
            found[intention.id] = intention
        for event in self.events:
            if event[3] is not None:
                found[event[3].id] = event[3]
        for intention, _ in self.waiting.values():
            found[intention.id] = intention
        found.update(self.suspended)
        return [found[number] for number in sorted(found)]

    def await_something(self, intention: Intention, reason: str, token: Any = None) -> None:
        """Take an intention out of the round until `resume_waiting`. ``token`` is what a drop must take back."""
        intention.waiting = reason
        self.waiting[intention.id] = (intention, token)

    def resume_waiting(self, intention: Intention) -> None:
        """What an intention waited for has come: it goes on, or stays suspended."""
        self.waiting.pop(intention.id, None)
        intention.waiting = None
        intention.action = None
        if intention.suspended is not None:
            self.suspended[intention.id] = intention
            return
        self._end_frames(intention)
        if intention.stack and intention.waiting is None:
            self.running.append(intention)

    def fail_waiting(self, intention: Intention, failed: Failed) -> None:
        """What an intention waited for will not come: the formula that it waits in fails."""
        self.waiting.pop(intention.id, None)
        intention.waiting = None
        intention.action = None
        frame = intention.stack[-1]
        assert intention.last is not None
        failure.step_failed(self, intention, intention.last, frame, failed)

    def fail_parent(self, intention: Intention, extra: tuple[Any, ...], where: str, failed: Failed) -> None:
        """A branch of a fork of this intention has failed."""
        self.waiting.pop(intention.id, None)
        intention.waiting = None
        failure.fail(self, intention, extra, where, failed)

    def fail_test(self, intention: Intention) -> bool:
        """The test that the intention is in has no solution."""
        raise Failed("test_goal_failed")

    def calling_line(self, intention: Intention) -> tuple[int, str]:
        """Line and file of the formula that raised the event which the intention waits for."""
        step = intention.last
        if step is None:
            return 0, ""
        return step.syntax.position.line, step.syntax.position.file

    def drop(self, intention: Intention) -> None:
        """End an intention without any event; its action is cancelled and its branches go with it."""
        token: Any = self.waiting.pop(intention.id, (None, None))[1]
        if isinstance(token, Wait):
            forget(self, token)
        elif isinstance(token, Timer):
            token.cancelled = True
        elif hasattr(token, "branches"):
            for branch in list(token.branches):
                self.drop(branch)
        elif isinstance(token, int):
            self.requests.pop(token, None)
        elif isinstance(token, Question):
            token.forget(self)
        if intention.action is not None:
            self.effects.append(CancelAction(intention.action))
            intention.action = None
        if intention in self.running:
            self.running.remove(intention)
        self.suspended.pop(intention.id, None)
        if any(e[3] is intention for e in self.events):
            kept = [e for e in self.events if e[3] is not intention]
            self.events.clear()
            self.events.extend(kept)
        intention.waiting = None
        self.gone(intention)
        intention.stack.clear()

    def gone(self, intention: Intention) -> None:
        """An intention has ended, whichever way."""
        if self.atomic is intention:
            self.atomic = None

    def left(self, intention: Intention, frame: Frame) -> None:
        """A frame of a special plan is gone from the stack."""
        if frame[PLAN].atomic and not any(f[PLAN].atomic for f in intention.stack) and self.atomic is intention:
            self.atomic = None

    def hear(self, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...]) -> None:
        """Tell those who wait for an event."""
        for wait in list(self.listeners):
            assert wait.pattern is not None
            operator, goal, literal = wait.pattern
            if operator != relevant.operator or goal != relevant.goal:
                continue
            trail = wait.intention.trail
            mark = len(trail)
            if unify(literal, Literal(relevant.sig, args, annots), trail):
                ended(self, wait)
            else:
                undo(trail, mark)

    def meta(self, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...], state: str) -> None:
        """The event ``^!g[state(S)]`` if there is a plan for it."""
        from agentd.language.order import sorted_annots
        from agentd.language.signatures import signature
        from agentd.language.terms import atom

        meta = self.plans.relevant("^", relevant.goal, relevant.sig)
        if meta.plans:
            told = Literal(signature("state", 1), (atom(state),))
            self.post(meta, resolve_all(args), sorted_annots((*resolve_all(annots), told)))

    def read_clock(self) -> float:
        """The mission time now; a reading within a cycle is an input."""
        if self._clock is not None:
            self.now = max(self.now, self._clock())
            if self._on_input is not None:
                self._on_input(self.cycle, TimeRead(self.now))
        return self.now

    def warn_once(self, text: str) -> None:
        """A warning that is told the first time only (of the last thousand)."""
        if text not in self._warned:
            if len(self._warned) > 1000:
                self._warned.clear()
            self._warned[text] = None
            self.effects.append(Log("warning", text))

    # --- the cycle ---

    def _cycles(self, cycles: int) -> None:
        events, running, timers = self.events, self.running, self.timers.heap
        while cycles:
            cycles -= 1
            self.cycle += 1
            if self.inputs:
                self._take_inputs()
            if timers and timers[0].due <= self.now:
                self.timers.run(self.now)
            if self.changes != self._checked:
                self._checked = self.changes
                if self.conditions:
                    check_conditions(self)
                if self.goal_conditions:
                    check_goal_conditions(self)
            if self.atomic is not None:
                if not self._atomic_cycle():
                    return
                if self.effects:
                    return
                continue
            if self.mailbox:
                mail = self.mailbox.popleft()
                if self._on_input is not None:
                    self._on_input(self.cycle, mail)
                receive(self, mail)
            while events:
                if self._take_event(events.popleft()):
                    break
            if self.atomic is None and running:
                self._run_intention(running.popleft())
            elif not events and not self.inputs and not self.mailbox:
                return
            if self.effects:
                return

    def _take_event(self, event: Event) -> bool:
        """Find the plan for an event and put it on its intention. False: nothing happened, take the next event."""
        relevant, args, annots, intention = event
        trail: list[Any] = [] if intention is None else intention.trail
        mark = len(trail)
        frame = None
        if self.listeners and relevant.goal:
            self.hear(relevant, args, annots)
        try:
            if self.plans.has_nested:
                frame = nested_frame(self, trail, relevant, args, annots, intention)
            for plan in relevant.plans if frame is None else ():
                frame = plan.select(self, trail, relevant, args, annots)
                if frame is not None:
                    break
                if len(trail) > mark:
                    undo(trail, mark)
        except Exception as error:  # an internal action may raise anything; it must not end the mind
            self._context_failed(relevant, error)
            undo(trail, mark)
            frame = None
        if frame is None:
            return self._no_plan(relevant, args, annots, intention)
        if trail:
            frame[MARK] = mark
        if intention is None:
            intention = self.new_intention()
            if trail:
                intention.trail = trail
        stack = intention.stack
        if stack:
            top = stack[-1]
            if top[STEP] is None and relevant.tail is not None and not top[PLAN].special:
                below = top[RELEVANT].tail
                if below is not None and below == relevant.tail:
                    stack.pop()
                    if len(trail) > top[MARK]:
                        intention.trim(top[MARK])
                        frame[MARK] = min(frame[MARK], len(trail))
        stack.append(frame)
        plan = frame[PLAN]
        if plan.special or self.plans.has_meta:
            self._entered(intention, frame)
            if not stack:
                return True
        if intention.suspended is not None:
            self.suspended[intention.id] = intention
        else:
            self.running.append(intention)
        return True

    def _entered(self, intention: Intention, frame: Frame) -> None:
        """A plan that needs more than a frame is about to begin."""
        plan: Plan = frame[PLAN]
        if self.plans.has_meta and frame[RELEVANT].operator == "+" and frame[RELEVANT].goal:
            self.meta(frame[RELEVANT], frame[ARGS], frame[ANNOTS], "executing")
        if plan.atomic:
            self.atomic = intention
        if plan.condition is not None:
            if condition_holds(self, intention, frame):
                frame[STEP] = None
                self._end_frames(intention)
            else:
                self.goal_conditions.append((intention, frame))

    def _context_failed(self, relevant: Any, error: Exception) -> None:
        what = "it is too deep" if isinstance(error, RecursionError) else str(error) or type(error).__name__
        plans = ", ".join(f"{plan.syntax.position}" for plan in relevant.plans[:3])
        self.effects.append(
            Log("warning", f"{plans}: the context of a plan for {relevant!r} cannot be computed: {what}")
        )

    def _no_plan(
        self, relevant: Any, args: tuple[Any, ...], annots: tuple[Any, ...], intention: Intention | None
    ) -> bool:
        """An event without an applicable plan."""
        if not relevant.goal or relevant.operator == "^":
            if intention is None:
                return False
            self.resume_waiting(intention)
            return True
        if relevant.operator == "+":
            failure.goal_failed(self, relevant, args, annots, intention)
            return True
        event = f"{relevant.text}{Literal(relevant.sig, resolve_all(args))}"
        self.effects.append(Log("error", f"no applicable plan handles the failure {event}; the intention ends"))
        if intention is not None:
            self.gone(intention)
            if intention.branch is not None:
                reason = Failed("no_applicable", f"no applicable plan handles {event}")
                intention.branch.failed(self, intention, annots, event, reason)
        return True

    def _run_intention(self, intention: Intention) -> None:
        """One formula of one intention."""
        frame = intention.stack[-1]
        step = frame[STEP]
        if step is not None:
            frame[STEP] = step.next
            intention.last = step
            self.current = intention
            try:
                if step.run(self, intention, frame):
                    return
            except Failed as failed:
                self._step_failed(intention, step, frame, failed)
                return
            except UndefinedNumber as undefined:
                self._step_failed(intention, step, frame, Failed("undefined_number", str(undefined)))
                return
            except RecursionError:
                message = "the computation is too deep"
                self._step_failed(intention, step, frame, Failed("recursion_too_deep", message))
                return
            except Exception as error:  # an internal action may raise anything; it must not end the mind
                self._step_failed(intention, step, frame, Failed("unknown", f"{type(error).__name__}: {error}"))
                return
        stack = intention.stack
        top = stack[-1]
        if top[STEP] is None:
            if len(stack) > 1 and stack[-2][STEP] is not None and not (top[PLAN].special or self.plans.has_meta):
                stack.pop()
                if len(intention.trail) > top[MARK]:
                    intention.trim(top[MARK])
            else:
                self._end_frames(intention)
                if not stack or intention.waiting is not None:
                    return
        self.running.append(intention)

    def _step_failed(self, intention: Intention, step: Any, frame: Frame, failed: Failed) -> None:
        if failed.error == "test_goal_failed" and not failed.args[0].startswith("Failed"):
            from agentd.language.term_text import text

            code = failure.code_of(step, frame)
            failed = Failed("test_goal_failed", f"Failed to test '{text(code)}'", code=code)
        failure.step_failed(self, intention, step, frame, failed)

    def _end_frames(self, intention: Intention) -> None:
        """Take away the plans that have ended; the ones below go on."""
        stack = intention.stack
        while stack:
            top = stack[-1]
            if top[STEP] is not None:
                return
            if top[PLAN].special or self.plans.has_meta:
                if top[PLAN].condition is not None and not condition_holds(self, intention, top):
                    self.await_something(intention, "goal condition")
                    return
                stack.pop()
                self.left(intention, top)
                if self.plans.has_meta and top[RELEVANT].operator == "+" and top[RELEVANT].goal:
                    self.meta(top[RELEVANT], top[ARGS], top[ANNOTS], "achieved")
                    self.meta(top[RELEVANT], top[ARGS], top[ANNOTS], "finished")
            else:
                stack.pop()
            if len(intention.trail) > top[MARK]:
                intention.trim(top[MARK])
        self.gone(intention)

    # --- atomic intentions ---

    def _atomic_can_run(self) -> bool:
        atomic = self.atomic
        return atomic in self.running or any(e[3] is atomic for e in self.events)

    def _atomic_cycle(self) -> bool:
        """A cycle while an atomic plan runs: only its own events and formulas. False when it has to wait."""
        atomic = self.atomic
        assert atomic is not None
        for place, event in enumerate(self.events):
            if event[3] is atomic:
                del self.events[place]
                self._take_event(event)
                break
        if atomic in self.running:
            self.running.remove(atomic)
            self._run_intention(atomic)
            return True
        return self.atomic is not atomic or self._atomic_can_run()

    # --- inputs ---

    def _take_inputs(self) -> None:
        """All percepts and results that have come in: deletions of percepts before additions."""
        batch = list(self.inputs)
        self.inputs.clear()
        added: list[Any] = []
        for item in batch:
            if self._on_input is not None:
                self._on_input(self.cycle, item)
            match item:
                case PerceptReplaced() | PerceptAdded() | PerceptRemoved():
                    added += percepts.update(self, item)
                case ActionDone():
                    self._action_done(item)
                case TeamReply():
                    request = self.requests.pop(item.id, None)
                    if request is not None:
                        request.answered(self, item)
                case GoalAdded(literal=literal):
                    self.add_goal(literal)
                case BeliefAdded(literal=literal):
                    self.add_belief(literal)
                case SignalRaised(literal=literal):
                    self.post(self.plans.relevant("+", "", literal.sig), literal.args, with_source(literal.annots))
                case _:
                    pass
        percepts.raise_additions(self, added)

    def _action_done(self, done: ActionDone) -> None:
        for intention, _ in list(self.waiting.values()):
            if intention.action != done.id:
                continue
            if done.ok:
                self.resume_waiting(intention)
                return
            from agentd.language.signatures import signature
            from agentd.language.terms import atom

            facts = [Literal(signature("reason", 1), (done.reason,))] if done.reason else []
            if done.state:
                facts.append(Literal(signature("state", 1), (atom(done.state),)))
            self.fail_waiting(intention, Failed("action_failed", done.reason, tuple(facts)))
            return

    def _too_deep(self) -> None:
        self.effects.append(Log("error", "a term or rule is too deep; what it was needed for is lost"))
