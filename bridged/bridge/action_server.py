"""The action server of one robot (design section 5): each action is checked, carried out, and gets one final status.

Requests, the ends of executions and the time (mission seconds) go in, statuses come out; the action log is the only
I/O. An execution pushes its end; `step` is for what time alone brings: feedback, deadlines, the lease.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import math
from collections.abc import Callable
from functools import partial

from msgspec.structs import replace

from bridged.bridge.action_log import ActionLog
from bridged.bridge.composite_driver import CompositeDriver
from bridged.bridge.lease import Lease
from bridged.bridge.percepts import PerceptPublisher
from bridged.bridge.running_action import MAX_ID, MAX_REASON, Follower, Pause, RunningAction, Statuses, legible
from bridged.drivers.api import Execution, Order, Outcome, defers
from bridged.drivers.argument_check import BadArgument, read_arguments
from bridged.drivers.registry import OURS
from commd.common.clock import Clock
from schemas.liveness import STATUS_EVERY
from schemas.manifest.loader import ActionEntry, Argument, Manifest
from schemas.manifest.rules import BRIDGE_ACTIONS
from schemas.wire.records import Action, ActionStatus

CAUSE_AFTER = 1.5
"""Wall seconds after which what hinders an action is logged."""
MAX_RUNNING = 8
"""Actions that may run at a time, over all agents."""
WAITS = "paused by the operator"
"""Condition of an action that waits for the end of a pause, for people."""
BY_HAND = "asked by hand, which this mission does not allow; say `inject: true` in the mission file to allow it"
log = logging.getLogger("actions")


class ActionServer:
    """Carries out the agents' requests and the operator's orders for one robot."""

    def __init__(
        self,
        manifest: Manifest,
        driver: CompositeDriver,
        percepts: PerceptPublisher,
        action_log: ActionLog,
        publish: Callable[[str, ActionStatus], None],
        lease: Lease,
        *,
        robot: str,
        boot: str,
        clock: Clock,
        wake: asyncio.Event,
    ) -> None:
        """`wake` is set when an action begins: steps are due soon then."""
        self.blocked: Outcome | None = None
        """Why no action is accepted now (the operator, or the end of the bridge); None = they are."""
        self.lease = lease
        """Which agent has the robot."""
        self.on_control: Callable[[], None] = lambda: None
        """Called when an action that moves the robot or sets its mode is accepted, before it begins."""
        self.on_refused: Callable[[], None] = lambda: None
        """Called when the last such action was refused after that, by the driver or the robot."""
        self._in_control = ""
        """Id of the last such action; empty after a pause has interrupted it: a later refusal is no failed begin."""
        self.by_hand = False
        """Whether the last such action was requested by hand: somebody flies the robot in the name of an agent."""
        self._manifest, self._driver, self._percepts, self._action_log = manifest, driver, percepts, action_log
        self._statuses = Statuses(robot, boot, clock, percepts)
        self._publish, self._wake = publish, wake
        self.robot, self._boot, self._now = robot, boot, clock.now
        self._pause = Pause(action_log, percepts, robot, clock.now)
        self._holding: Execution | None = None
        """What holds the robot while it is paused."""
        self._feedback_every = STATUS_EVERY * clock.speed
        self._running: dict[str, RunningAction] = {}
        self._by_hand = 0
        """Requests without an id so far: those by hand may have none."""

    @property
    def arming(self) -> bool:
        """Whether an action is under way that may have armed the robot without its state showing it yet."""
        return any(action.entry.confirm == "armed" for action in self._running.values())

    @property
    def running(self) -> list[str]:
        """Names of the actions that run now."""
        return [action.request.name for action in self._running.values()]

    @property
    def paused(self) -> bool:
        """Whether the operator has paused the robot."""
        return self._pause.since is not None

    def ask(self, agent: str, name: str, given: Action, follower: Follower, *, inject: bool = True) -> None:
        """Answer a request: `follower` gets the present status of a known id, or all statuses of a new one.

        `inject`: requests by hand are allowed. One that is not does not use up its id.
        """
        by_hand = is_by_hand(agent, given)
        self._by_hand += not given.id
        identity = given.id or f"{agent}:{self._boot}:hand{self._by_hand}"
        request = replace(given, id=identity[:MAX_ID], agent=agent, name=name[:MAX_ID])
        if by_hand and not inject:
            self._deny(request, Outcome("refused", BY_HAND, "rights"), follower)
        elif len(identity) > MAX_ID:
            self._deny(request, _bad(f"an id has {MAX_ID} characters at most, got {len(identity)}"), follower)
        elif self._known(request, follower):
            pass
        elif given.attempt > 1:
            self._refuse(request, Outcome("refused", "bridge restarted", "restart"), follower)
        elif given.name not in ("", name) or given.agent not in ("", agent):
            said = f"{given.agent or agent}/{given.name or name}"
            self._refuse(request, _bad(f"the key says {agent}/{name}, the action says {said}"), follower)
        else:
            self._begin(request, follower, by_hand=by_hand)

    def adopt(self, manifest: Manifest) -> None:
        """Accept actions by another manifest; those that run keep their old entry."""
        self._manifest = manifest

    def cancel(self, agent: str, action_id: str, by: str | None = None, *, inject: bool = True) -> ActionStatus:
        """End a running action of an agent, on its own request or `by` somebody else's, if that is allowed (`inject`).

        An empty name is somebody's who gives none.
        Returns its final status, also if it had ended already.
        """
        if by not in (None, agent) and not inject:
            log.info("robot=%s cancel of %s refused: %s", self.robot, action_id[:MAX_ID], BY_HAND)
            unasked = Action(id=action_id[:MAX_ID], agent=agent)
            return self._statuses.ended(unasked, Outcome("refused", BY_HAND, "rights"))
        action = self._running.get(action_id)
        if action is not None and action.request.agent == agent:
            goes_on = "" if action.entry.cancel == "hold" or not action.entry.motion else "; the vehicle goes on"
            hold = action.entry.cancel == "hold"
            why = f"cancelled by {agent if by is None else by[:MAX_ID] or 'hand'}{goes_on}"
            return self._end(action, Outcome("cancelled", why, "cancelled"), hold=hold)
        known = self._action_log.entries.get(action_id)
        if known is not None and known.agent == agent and known.final is not None:
            return known.final
        unknown = Action(id=action_id[:MAX_ID], agent=agent)
        return self._statuses.ended(unknown, _bad(f"no action {unknown.id} of {agent}"))

    def order(self, order: Order, ending: Outcome, *, block: bool, insist: bool) -> Execution:
        """Begin an order above the agents: running actions end as `ending`; `block` refuses new ones after it.

        Only one that `insist`s overrides a pilot.
        """
        if block:
            self.block(ending)
        self._pause.end()
        execution = self._driver.order(order, ending, insist=insist)
        for action in list(self._running.values()):
            self._end(action, ending, hold=False)
        self.step()
        return execution

    def block(self, why: Outcome) -> None:
        """Accept no action from now on."""
        self.blocked = dataclasses.replace(why, state="refused")

    def end_pause(self) -> None:
        """End a pause without beginning the interrupted actions again."""
        self._pause.end()

    def pause(self) -> Execution:
        """Hold the robot until `resume`: what moves, arms or sets the mode is interrupted, and nothing begins.

        Returns the execution that holds it. Other actions continue.
        """
        self._pause.begin()
        interrupted = []
        if "hold" in self._driver.orders:
            for action in self._running.values():
                if not action.held and (action.entry.motion or action.entry.confirm in ("armed", "mode")):
                    interrupted.append(ran := action.execution)
                    action.execution = Execution(ran.name, feedback=dict(ran.feedback or {}), waits_for=WAITS)
                    action.held = True
                    if action.request.id == self._in_control:
                        self._in_control = ""
        self._holding = self._driver.pause(interrupted)
        self._tell_all()
        return self._holding

    def go_on(self) -> None:
        """End the pause: interrupted actions begin again by the same rules, and so do those that waited.

        The driver is to have resumed before.
        """
        self._pause.end()
        for action in [action for action in self._running.values() if action.held]:
            if refusal := self._driver.refuses(action.entry):
                self._end(action, refusal, hold=False)
            else:
                self._perform(action)
        self._tell_all()

    def _tell_all(self) -> None:
        """Publish the status of every action, however recent the last one is."""
        for action in self._running.values():
            action.told_at = -math.inf
        self.step()

    def end_all(self, agent: str, outcome: Outcome) -> None:
        """End every action of an agent, or of all if the name is empty."""
        for action in [action for action in self._running.values() if agent in ("", action.request.agent)]:
            self._end(action, outcome, hold=False)

    def step(self) -> float:
        """Let time pass: publish feedback, end what is over its deadline, look at the lease and the pause.

        Returns the mission seconds until more feedback is due or a deadline is over; infinite if no action runs.
        """
        now, elapsed = self._now(), self._pause.elapsed
        for action in list(self._running.values()):
            if elapsed >= action.deadline_at:
                waits = f"; it waited for {action.execution.waits_for}" if action.execution.waits_for else ""
                outcome = Outcome("timed_out", f"not done within {action.deadline:g} s{waits}", "deadline")
                holds = action.entry.cancel == "hold" and not defers("hold", self._driver.under_way)
                self._end(action, outcome, hold=holds)
            elif now - action.told_at >= self._feedback_every or action.execution.cause != action.cause:
                action.told_at, action.cause = now, action.execution.cause
                execution, left = action.execution, max(0.0, action.deadline_at - elapsed)
                running = self._statuses.make(action.request, "running", execution.waits_for, execution.feedback)
                self._tell(action, replace(running, deadline=left, paused=action.held))
                action.show(self._percepts, running.feedback, legible(action.cause, MAX_REASON))
                lasts = action.deadline - left >= CAUSE_AFTER * self._feedback_every  # not over in a moment
                if lasts and action.cause and action.cause != action.logged_cause:
                    action.logged_cause, request = action.cause, action.request
                    log.warning("robot=%s action %s %s waits: %s", self.robot, request.id, request.name, action.cause)
        self._look_at_lease()
        self._look_at_pause()
        dues = (
            min(one.told_at + self._feedback_every - now, one.deadline_at - elapsed) for one in self._running.values()
        )
        return min(dues, default=math.inf)

    def _look_at_lease(self) -> None:
        busy = bool(self._running) or self.paused
        own, others = self._driver.own, bool(self._driver.own.overridden)
        self.lease.step(active=self._driver.active, heard=own.heard, busy=busy, now=self._now(), others=others)

    def _known(self, request: Action, follower: Follower) -> bool:
        """Answer a request whose id was begun before; for another action than this one it is refused."""
        action, entry = self._running.get(request.id), self._action_log.entries.get(request.id)
        if action is not None:
            used_by, used_for = action.request.agent, action.request.name
        elif entry is not None:
            used_by, used_for = entry.agent, entry.name
        else:
            return False
        if (used_by, used_for) != (request.agent, request.name):
            self._deny(request, _bad(f"the id was used for {used_for} of {used_by}"), follower)
        elif action is not None:
            action.join(request.header.source, follower)
        elif entry is not None:
            unknown = Outcome("failed", "the bridge restarted while it ran; how it ended is not known", "restart")
            follower(entry.final or self._statuses.ended(request, unknown))
        return True

    def _begin(self, request: Action, follower: Follower, *, by_hand: bool) -> None:
        entry = BRIDGE_ACTIONS.get(request.name) or self._manifest.actions.get(request.name)
        if entry is None:
            known = ", ".join(f"{name}/{one.arity}" for name, one in (self._manifest.actions | BRIDGE_ACTIONS).items())
            self._refuse(request, _bad(f"{self.robot} has no action {request.name}; it has {known}"), follower)
            return
        try:
            arguments = read_arguments(request.name, entry, request.parameters, self._manifest.robot.values)
        except BadArgument as error:
            self._refuse(request, _bad(str(error)), follower)
            return
        if request.deadline is not None and not request.deadline > 0:
            self._refuse(request, _bad(f"deadline: expected more than 0 s, got {request.deadline:g}"), follower)
            return
        now = self._now()
        lent = self.lease.refuses(request.agent, ", ".join(self.running), now)
        refusal = self.blocked or (
            Outcome("refused", lent, "agent_lost" if self.lease.closed else "lease") if lent else None
        )
        if request.name in BRIDGE_ACTIONS:
            self._answer_built_in(request, arguments, refusal, follower)
            return
        rival = self.lease.holder not in ("", request.agent)
        superseded: list[RunningAction] = []
        if entry.supersedes and not rival:
            sets_mode = entry.confirm == "mode"  # another that does would be repeated, and replace this one
            running = self._running.values()
            superseded = [one for one in running if one.entry.motion or (one.entry.confirm == "mode" and not sets_mode)]
        busy = None if rival else self._busy(request, entry, superseded)  # a rival's actions end
        if refusal := refusal or self._driver.refuses(entry) or busy:
            self._refuse(request, refusal, follower)
            return
        try:
            self._action_log.begin(request)
        except OSError as error:
            if not entry.supersedes:
                unkept = Outcome("refused", f"its id cannot be kept on disk: {error.strerror}", "storage")
                self._refuse(request, unkept, follower)
                return
            log.error(
                "robot=%s the id of %s cannot be kept on disk: %s", self.robot, request.id, error.strerror
            )  # a way down must stay
        taken = self._take(request, entry) if rival else []
        for other in superseded:
            said = f"superseded by {request.name} of {request.agent}{', by hand' if by_hand else ''}"
            self._end(other, Outcome("cancelled", said, "superseded"), hold=False)
        self.lease.take(request.agent, now)
        if entry.motion or entry.supersedes or entry.confirm == "mode":
            self.by_hand, self._in_control = by_hand, request.id
            self.on_control()
        deadline = min(float(entry.deadline), request.deadline or math.inf)
        accepted = replace(self._statuses.make(request, "accepted"), deadline=deadline, paused=self.paused)
        until, held = self._pause.elapsed + deadline, Execution(request.name, waits_for=WAITS)
        action = RunningAction(request, entry, held, until, deadline, accepted, now, arguments, held=True)
        action.followers.append((request.header.source, follower))
        self._running[request.id] = action
        if not self.paused:
            self._perform(action)
        if request.id in self._running:  # one that is over has sent its last status
            self._tell(action, accepted)
        if action.execution.outcome is not None and action.execution.outcome.state != "succeeded":
            self._hold_for(taken)
        if request.id in self._running or self._driver.active:
            self._wake.set()
        self._note(action)
        self._action_log.keep()

    def _perform(self, action: RunningAction) -> None:
        """Let the driver carry an action out, when it is accepted or when a pause is over."""
        request, entry, action.held = action.request, action.entry, False
        if self._manifest.driver_of(entry) not in OURS:
            self._note(action)  # first: if its driver does not return, the log names the action
        action.execution = execution = self._driver.perform(request.name, entry, action.arguments)
        execution.on_end(partial(self._ended, action, execution))

    def _ended(self, action: RunningAction, execution: Execution) -> None:
        """Take in that an execution has ended, unless a pause has interrupted it."""
        if action.execution is not execution or execution.outcome is None:
            return
        try:
            self._finish(action, execution.outcome)
            self._look_at_lease()
        except Exception:  # the driver that pushes the end must not suffer for a defect here
            log.exception("robot=%s defect at the end of action %s", self.robot, action.request.id)

    def _look_at_pause(self) -> None:
        """End a pause when others fly the robot; the actions that waited have failed."""
        if not self.paused or not (mode := self._driver.own.overridden):
            return
        if self._holding is not None and not self._holding.over:
            return
        who = "(pilot, ground station or failsafe)"
        reason = f"the mode became {mode} while the operator had paused the robot; nobody here asked for it {who}"
        log.warning("robot=%s %s", self.robot, reason)
        self._pause.end()
        for action in [action for action in self._running.values() if action.held]:
            self._end(action, Outcome("failed", reason, "pilot"), hold=False)

    def _answer_built_in(
        self, request: Action, arguments: dict[str, Argument], refusal: Outcome | None, follower: Follower
    ) -> None:
        """Carry out `release` or `hand_over`, which end immediately; not while an action of the holder runs."""
        if refusal is None and self.lease.holder == request.agent and self._running:
            said = f"busy: {', '.join(self.running)} is running; cancel it first, or wait for its end"
            refusal = Outcome("refused", said, "busy")
        if refusal is None:
            if request.name == "release":
                held = self.lease.release(request.agent)
            else:
                held = self.lease.give(request.agent, str(arguments["agent"]), self._now())
            refusal = Outcome("refused", held, "lease") if held else None
        if refusal is not None:
            self._refuse(request, refusal, follower)
            return
        log.info("robot=%s action %s %s succeeded", self.robot, request.id, request.name)
        status = self._statuses.ended(request, Outcome("succeeded"))
        follower(status)
        self._publish(request.agent, status)
        self._action_log.finish(request.agent, status)

    def _take(self, request: Action, entry: ActionEntry) -> list[RunningAction]:
        """Take the robot from an agent of lower rank: its actions fail. Returns those that moved the robot."""
        taken = list(self._running.values())
        for action in taken:
            self._end(action, Outcome("failed", f"lease taken by {request.agent}", "lease"), hold=False)
        moving = [action for action in taken if action.entry.motion]
        if not entry.motion and not entry.supersedes:
            self._hold_for(moving)
            return []
        return moving

    def _hold_for(self, taken: list[RunningAction]) -> None:
        """Let the robot stay where it is: the agent that has taken it does not move it."""
        for action in taken:
            self._driver.hold(action.execution, Outcome("failed", action.status.reason, "lease"))

    def _busy(self, request: Action, entry: ActionEntry, ending: list[RunningAction]) -> Outcome | None:
        """Why an action cannot begin beside those that run and are not `ending`; None if it can."""
        for action in self._running.values():
            both_move = entry.motion and action.entry.motion
            if action not in ending and (both_move or action.request.name == request.name):
                return Outcome("refused", f"busy: {action.request.name} is running", "busy")
        if len(self._running) < MAX_RUNNING:
            return None
        return Outcome("refused", f"busy: {MAX_RUNNING} actions are running", "busy")

    def _refuse(self, request: Action, refusal: Outcome, follower: Follower) -> None:
        self._action_log.finish(request.agent, self._deny(request, refusal, follower))

    def _deny(self, request: Action, refusal: Outcome, follower: Follower) -> ActionStatus:
        """Refuse an action without recording its id."""
        status = self._statuses.ended(request, refusal)
        log.info("robot=%s action %s %s refused: %s", self.robot, request.id, request.name, status.reason)
        follower(status)
        self._publish(request.agent, status)
        return status

    def _end(self, action: RunningAction, outcome: Outcome, *, hold: bool) -> ActionStatus:
        action.execution.ended = None  # stopping may still add to the reason
        self._driver.stop(action.execution, outcome, hold=hold and not action.held)
        return self._finish(action, action.execution.outcome or outcome)

    def _finish(self, action: RunningAction, outcome: Outcome) -> ActionStatus:
        request = action.request
        if request.id not in self._running:
            return action.status
        del self._running[request.id]
        action.show(self._percepts, {})
        self._percepts.flush()
        status = self._statuses.ended(request, outcome, action.execution.feedback)
        self._tell(action, status)  # first: its agent waits for it
        self._action_log.finish(request.agent, status)
        self._note(action)
        log.info("robot=%s action %s %s %s %s", self.robot, request.id, request.name, status.state, status.reason)
        if outcome.state == "refused" and request.id == self._in_control:
            self.on_refused()
        return status

    def _note(self, action: RunningAction) -> None:
        """Log that an action has begun; if it ends immediately, after its agent got the status."""
        if not action.noted:
            action.noted = True
            request, values = action.request, list(action.arguments.values())
            log.info("robot=%s action %s %s%s", self.robot, request.id, request.name, values)

    def _tell(self, action: RunningAction, status: ActionStatus) -> None:
        """Send a status to the agent, then to observers; they get `accepted` also of one that has ended immediately."""
        first, action.status = action.status, status
        for _, follower in action.followers:
            follower(status)
        if not action.published and first is not status:
            self._publish(action.request.agent, first)
        action.published = True
        self._publish(action.request.agent, status)


def is_by_hand(agent: str, request: Action) -> bool:
    """Whether a request is not the agent's own: an agent gives its requests an id and its name as source."""
    return not (request.id and request.header.source == agent)


def _bad(reason: str) -> Outcome:
    """Return the refusal of a request for its content."""
    return Outcome("refused", reason, "request")
