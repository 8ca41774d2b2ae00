"""The action server of one robot (design section 5): each action is checked, carried out, and gets one final status.

Requests, the ends of executions and the time (mission seconds) go in, statuses come out; the action log is the only
I/O. An execution pushes its end; `step` is for what time alone brings: feedback, deadlines, the lease.
"""

from __future__ import annotations

import asyncio
import dataclasses
import logging
import math
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from msgspec.structs import replace

from bridged.bridge.action_log import ActionLog
from bridged.bridge.composite_driver import CompositeDriver
from bridged.bridge.lease import Lease
from bridged.bridge.pause import Pause
from bridged.bridge.percepts import PerceptPublisher
from bridged.bridge.running_action import MAX_ID, MAX_REASON, Follower, RunningAction, Statuses, legible
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
        self._jobs: dict[str, RunningAction] = {}
        self._by_hand = 0

    @property
    def arming(self) -> bool:
        """Whether an action is under way that may have armed the robot without its state showing it yet."""
        return any(job.entry.confirm == "armed" for job in self._jobs.values())

    @property
    def running(self) -> list[str]:
        """Names of the actions that run now."""
        return [job.action.name for job in self._jobs.values()]

    @property
    def paused(self) -> bool:
        """Whether the operator has paused the robot."""
        return self._pause.lasts

    def ask(self, agent: str, name: str, request: Action, follower: Follower) -> None:
        """Answer a request: `follower` gets the present status of a known id, or all statuses of a new one."""
        request = self._identified(agent, request)
        action = replace(request, agent=agent, name=name[:MAX_ID])
        if len(action.id) > MAX_ID:
            action = replace(action, id=action.id[:MAX_ID])
            self._deny(action, _bad(f"an id has {MAX_ID} characters at most, got {len(request.id)}"), follower)
        elif self._known(action, follower):
            pass
        elif request.attempt > 1:
            self._refuse(action, Outcome("refused", "bridge restarted", "restart"), follower)
        elif request.name not in ("", name) or request.agent not in ("", agent):
            said = f"{request.agent or agent}/{request.name or name}"
            self._refuse(action, _bad(f"the key says {agent}/{name}, the action says {said}"), follower)
        else:
            self._begin(action, follower)

    def turn_away(self, agent: str, name: str, request: Action, reason: str, follower: Follower) -> None:
        """Refuse a request without the right to it; its id is not used up by that."""
        action = replace(self._identified(agent, request), agent=agent, name=name[:MAX_ID])
        self._deny(replace(action, id=action.id[:MAX_ID]), Outcome("refused", reason, "rights"), follower)

    def adopt(self, manifest: Manifest) -> None:
        """Accept actions by another manifest; those that run keep their old entry."""
        self._manifest = manifest

    def cancel(self, agent: str, action: str, by: str = "") -> ActionStatus:
        """End a running action of an agent, on its own request or `by` somebody else's.

        Returns its final status, also if it had ended already.
        """
        job = self._jobs.get(action)
        if job is not None and job.action.agent == agent:
            goes_on = "" if job.entry.cancel == "hold" or not job.entry.motion else "; the vehicle goes on"
            hold = job.entry.cancel == "hold"
            said = f"cancelled by {(by or agent)[:MAX_ID]}{goes_on}"
            return self._end(job, Outcome("cancelled", said, "cancelled"), hold=hold)
        known = self._action_log.find(action)
        if known is not None and known.agent == agent and known.final is not None:
            return known.final
        unknown = Action(id=action[:MAX_ID], agent=agent)
        return self._statuses.ended(unknown, _bad(f"no action {unknown.id} of {agent}"))

    def leave(self, agent: str, action: str, reason: str) -> ActionStatus:
        """Refuse a cancel without the right to it."""
        log.info("robot=%s cancel of %s refused: %s", self.robot, action[:MAX_ID], reason)
        unasked = Action(id=action[:MAX_ID], agent=agent)
        return self._statuses.ended(unasked, Outcome("refused", reason, "rights"))

    def order(self, order: Order, ending: Outcome, *, block: bool, insist: bool) -> Execution:
        """Begin an order above the agents: running actions end as `ending`; `block` refuses new ones after it.

        Only one that `insist`s overrides a pilot.
        """
        if block:
            self.block(ending)
        self._pause.end()
        execution = self._driver.order(order, ending, insist=insist)
        for job in list(self._jobs.values()):
            self._end(job, ending, hold=False)
        self.step()
        return execution

    def block(self, why: Outcome) -> None:
        """Accept no action from now on."""
        self.blocked = dataclasses.replace(why, state="refused")

    @property
    def ordered(self) -> Order | None:
        """The operator's order until `release`, of this run of the bridge or one before."""
        return self._action_log.ordered

    def stand(self, order: Order | None) -> None:
        """Keep the operator's order (None = none) on disk: it outlives a bridge that is killed."""
        try:
            self._action_log.order(order)
        except OSError as error:
            log.error("robot=%s the operator's order cannot be kept on disk: %s", self.robot, error.strerror)

    def end_pause(self) -> None:
        """End a pause without beginning the interrupted actions again."""
        self._pause.end()

    @property
    def of_before_boot(self) -> bool:
        """Whether the operator ordered or paused before the machine was started."""
        return self._action_log.before_boot

    def pause(self) -> Execution:
        """Hold the robot until `resume`: what moves, arms or sets the mode is interrupted, and nothing begins.

        Returns the execution that holds it. Other actions continue.
        """
        self._pause.begin()
        interrupted = []
        if "hold" in self._driver.orders:
            for job in self._jobs.values():
                if not job.held and (job.entry.motion or job.entry.confirm in ("armed", "mode")):
                    interrupted.append(job.execution)
                    job.execution = _held(job.action.name, job.execution.feedback)
                    job.held = True
        self._holding = self._driver.pause(interrupted)
        self._tell_all()
        return self._holding

    def resume(self) -> Execution:
        """Bring the robot back into the state before the pause; call `go_on` when it is."""
        return self._driver.resume()

    def go_on(self) -> None:
        """End the pause: interrupted actions begin again by the same rules, and so do those that waited."""
        self._pause.end()
        for job in [job for job in self._jobs.values() if job.held]:
            if refusal := self._driver.refuses(job.entry):
                self._end(job, refusal, hold=False)
            else:
                self._perform(job)
        self._tell_all()

    def _tell_all(self) -> None:
        """Publish the status of every action, however recent the last one is."""
        for job in self._jobs.values():
            job.told_at = -math.inf
        self.step()

    def end_all(self, agent: str, outcome: Outcome) -> None:
        """End every action of an agent, or of all if the name is empty."""
        for job in [job for job in self._jobs.values() if agent in ("", job.action.agent)]:
            self._end(job, outcome, hold=False)

    def step(self) -> None:
        """Let time pass: publish feedback, end what is over its deadline, look at the lease and the pause."""
        now, elapsed = self._now(), self._pause.elapsed
        for job in list(self._jobs.values()):
            if elapsed >= job.deadline_at:
                waits = f"; it waited for {job.execution.waits_for}" if job.execution.waits_for else ""
                outcome = Outcome("timed_out", f"not done within {job.deadline:g} s{waits}", "deadline")
                holds = job.entry.cancel == "hold" and not defers("hold", self._driver.under_way)
                self._end(job, outcome, hold=holds)
            elif now - job.told_at >= self._feedback_every or job.execution.cause != job.cause:
                job.told_at, job.cause = now, job.execution.cause
                running = self._statuses.make(job.action, "running", job.execution.waits_for, job.execution.feedback)
                self._tell(job, replace(running, deadline=max(0.0, job.deadline_at - elapsed), paused=job.held))
                job.show(self._percepts, running.feedback, legible(job.cause, MAX_REASON))
                self._log_cause(job, elapsed)
        self._look_at_lease()
        self._look_at_pause()

    def _look_at_lease(self) -> None:
        busy = bool(self._jobs) or self.paused
        self.lease.step(active=self._driver.active, heard=self._driver.heard, busy=busy, now=self._now())

    def _identified(self, agent: str, request: Action) -> Action:
        """Return the request with an id: requests by hand may have none."""
        if request.id:
            return request
        self._by_hand += 1
        return replace(request, id=f"{agent}:{self._boot}:hand{self._by_hand}")

    def _is_by_hand(self, action: Action) -> bool:
        unsigned = action.id.startswith(f"{action.agent}:{self._boot}:hand")
        return unsigned or action.header.source not in ("", action.agent)

    def _known(self, action: Action, follower: Follower) -> bool:
        """Answer a request whose id was begun before; for another action than this one it is refused."""
        job, entry = self._jobs.get(action.id), self._action_log.find(action.id)
        if job is not None:
            used_by, used_for = job.action.agent, job.action.name
        elif entry is not None:
            used_by, used_for = entry.agent, entry.name
        else:
            return False
        if (used_by, used_for) != (action.agent, action.name):
            self._deny(action, _bad(f"the id was used for {used_for} of {used_by}"), follower)
        elif job is not None:
            job.join(action.header.source, follower)
        elif entry is not None:
            unknown = Outcome("failed", "the bridge restarted while it ran; how it ended is not known", "restart")
            follower(entry.final or self._statuses.ended(action, unknown))
        return True

    def _begin(self, action: Action, follower: Follower) -> None:
        entry = BRIDGE_ACTIONS.get(action.name) or self._manifest.actions.get(action.name)
        if entry is None:
            known = ", ".join(f"{name}/{one.arity}" for name, one in (self._manifest.actions | BRIDGE_ACTIONS).items())
            self._refuse(action, _bad(f"{self.robot} has no action {action.name}; it has {known}"), follower)
            return
        try:
            arguments = read_arguments(action.name, entry, action.parameters, self._manifest.robot.values)
        except BadArgument as error:
            self._refuse(action, _bad(str(error)), follower)
            return
        if action.deadline is not None and not action.deadline > 0:
            self._refuse(action, _bad(f"deadline: expected more than 0 s, got {action.deadline:g}"), follower)
            return
        now = self._now()
        lent = self.lease.refuses(action.agent, ", ".join(self.running), now)
        refusal = self.blocked or (
            Outcome("refused", lent, "agent_lost" if self.lease.closed else "lease") if lent else None
        )
        if action.name in BRIDGE_ACTIONS:
            self._answer_built_in(action, arguments, refusal, follower)
            return
        rival = self.lease.holder not in ("", action.agent)
        if refusal := refusal or self._driver.refuses(entry) or self._busy(action, entry, rival):
            self._refuse(action, refusal, follower)
            return
        try:
            self._action_log.begin(action)
        except OSError as error:
            if not entry.supersedes:
                unkept = Outcome("refused", f"its id cannot be kept on disk: {error.strerror}", "storage")
                self._refuse(action, unkept, follower)
                return
            log.error(
                "robot=%s the id of %s cannot be kept on disk: %s", self.robot, action.id, error.strerror
            )  # a way down must stay
        taken = self._take(action, entry) if rival else []
        for other in self._superseded(entry):
            by_hand = ", by hand" if self._is_by_hand(action) else ""
            said = f"superseded by {action.name} of {action.agent}{by_hand}"
            self._end(other, Outcome("cancelled", said, "superseded"), hold=False)
        self.lease.take(action.agent, now)
        if entry.motion or entry.supersedes or entry.confirm == "mode":
            self.by_hand = self._is_by_hand(action)
            self.on_control()
        deadline = min(float(entry.deadline), action.deadline or math.inf)
        accepted = replace(self._statuses.make(action, "accepted"), deadline=deadline, paused=self.paused)
        follower(accepted)
        self._publish(action.agent, accepted)
        until, held = self._pause.elapsed + deadline, _held(action.name)
        job = RunningAction(action, entry, held, until, deadline, accepted, now, arguments, held=True)
        job.followers.append((action.header.source, follower))
        self._jobs[action.id] = job
        self._wake.set()
        if not self.paused:
            self._perform(job)
        if job.execution.outcome is not None and job.execution.outcome.state != "succeeded":
            self._hold_for(taken)
        self.step()
        self._note(job)
        try:
            self._action_log.keep()
        except OSError as error:
            log.error("robot=%s the id of %s may not outlive a power loss: %s", self.robot, action.id, error.strerror)

    def _perform(self, job: RunningAction) -> None:
        """Let the driver carry an action out, when it is accepted or when a pause is over."""
        action, entry, job.held = job.action, job.entry, False
        if self._manifest.driver_of(entry) not in OURS:
            self._note(job)  # first: if its driver does not return, the log names the action
        job.execution = execution = self._driver.perform(action.name, entry, job.arguments)
        execution.on_end(partial(self._ended, job, execution))

    def _ended(self, job: RunningAction, execution: Execution) -> None:
        """Take in that an execution has ended, unless a pause has interrupted it."""
        if job.execution is not execution or execution.outcome is None:
            return
        try:
            self._finish(job, execution.outcome)
            self._look_at_lease()
        except Exception:  # the driver that pushes the end must not suffer for a defect here
            log.exception("robot=%s defect at the end of action %s", self.robot, job.action.id)

    def _look_at_pause(self) -> None:
        """End a pause when others fly the robot; the actions that waited have failed."""
        if not self.paused or not (mode := self._driver.overridden):
            return
        if self._holding is not None and not self._holding.over:
            return
        who = "(pilot, ground station or failsafe)"
        reason = f"the mode became {mode} while the operator had paused the robot; nobody here asked for it {who}"
        log.warning("robot=%s %s", self.robot, reason)
        self._pause.end()
        for job in [job for job in self._jobs.values() if job.held]:
            self._end(job, Outcome("failed", reason, "pilot"), hold=False)

    def _answer_built_in(
        self, action: Action, arguments: dict[str, Argument], refusal: Outcome | None, follower: Follower
    ) -> None:
        """Carry out `release` or `hand_over`, which end immediately; not while an action of the holder runs."""
        if refusal is None and self.lease.holder == action.agent and self._jobs:
            said = f"busy: {', '.join(self.running)} is running; cancel it first, or wait for its end"
            refusal = Outcome("refused", said, "busy")
        if refusal is None:
            if action.name == "release":
                held = self.lease.release(action.agent)
            else:
                held = self.lease.give(action.agent, str(arguments["agent"]), self._now())
            refusal = Outcome("refused", held, "lease") if held else None
        if refusal is not None:
            self._refuse(action, refusal, follower)
            return
        log.info("robot=%s action %s %s succeeded", self.robot, action.id, action.name)
        status = self._statuses.ended(action, Outcome("succeeded"))
        follower(status)
        self._publish(action.agent, status)
        self._record(action, status)

    def _take(self, action: Action, entry: ActionEntry) -> list[RunningAction]:
        """Take the robot from an agent of lower rank: its actions fail. Returns those that moved the robot."""
        taken = list(self._jobs.values())
        for job in taken:
            self._end(job, Outcome("failed", f"lease taken by {action.agent}", "lease"), hold=False)
        moving = [job for job in taken if job.entry.motion]
        if not entry.motion and not entry.supersedes:
            self._hold_for(moving)
            return []
        return moving

    def _hold_for(self, taken: list[RunningAction]) -> None:
        """Let the robot stay where it is: the agent that has taken it does not move it."""
        for job in taken:
            self._driver.hold(job.execution, Outcome("failed", job.status.reason, "lease"))

    def _busy(self, action: Action, entry: ActionEntry, rival: bool) -> Outcome | None:
        """Why an action cannot begin beside those that run; None if it can. Actions of a `rival` would end."""
        if rival:
            return None
        ending = self._superseded(entry)
        for job in self._jobs.values():
            both_move = entry.motion and job.entry.motion
            if job not in ending and (both_move or job.action.name == action.name):
                return Outcome("refused", f"busy: {job.action.name} is running", "busy")
        if len(self._jobs) < MAX_RUNNING:
            return None
        return Outcome("refused", f"busy: {MAX_RUNNING} actions are running", "busy")

    def _superseded(self, entry: ActionEntry) -> list[RunningAction]:
        return [job for job in self._jobs.values() if job.entry.motion] if entry.supersedes else []

    def _refuse(self, action: Action, refusal: Outcome, follower: Follower) -> None:
        self._record(action, self._deny(action, refusal, follower))

    def _deny(self, action: Action, refusal: Outcome, follower: Follower) -> ActionStatus:
        """Refuse an action without recording its id."""
        status = self._statuses.ended(action, refusal)
        log.info("robot=%s action %s %s refused: %s", self.robot, action.id, action.name, status.reason)
        follower(status)
        self._publish(action.agent, status)
        return status

    def _end(self, job: RunningAction, outcome: Outcome, *, hold: bool) -> ActionStatus:
        job.execution.ended = None  # stopping may still add to the reason
        self._driver.stop(job.execution, outcome, hold=hold and not job.held)
        return self._finish(job, job.execution.outcome or outcome)

    def _finish(self, job: RunningAction, outcome: Outcome) -> ActionStatus:
        if job.action.id not in self._jobs:
            return job.status
        del self._jobs[job.action.id]
        job.show(self._percepts, {})
        self._percepts.flush()
        status = self._statuses.ended(job.action, outcome, job.execution.feedback)
        self._tell(job, status)  # first: its agent waits for it
        self._record(job.action, status)
        self._note(job)
        log.info("robot=%s action %s %s %s %s", self.robot, job.action.id, job.action.name, status.state, status.reason)
        return status

    def _log_cause(self, job: RunningAction, elapsed: float) -> None:
        """Log what hinders an action, and each change of it, but no cause that is over in a moment."""
        begun = job.deadline_at - job.deadline
        if job.cause and job.cause != job.logged_cause and elapsed - begun >= CAUSE_AFTER * self._feedback_every:
            job.logged_cause = job.cause
            log.warning("robot=%s action %s %s waits: %s", self.robot, job.action.id, job.action.name, job.cause)

    def _note(self, job: RunningAction) -> None:
        """Log that an action has begun; if it ends immediately, after its agent got the status."""
        if not job.noted:
            job.noted = True
            action, values = job.action, list(job.arguments.values())
            log.info("robot=%s action %s %s%s", self.robot, action.id, action.name, values)

    def _tell(self, job: RunningAction, status: ActionStatus) -> None:
        job.tell(status)
        self._publish(job.action.agent, status)

    def _record(self, action: Action, status: ActionStatus) -> None:
        try:
            self._action_log.finish(action.agent, status)
        except OSError as error:
            log.error("robot=%s how %s ended cannot be kept on disk: %s", self.robot, status.id, error.strerror)


def _bad(reason: str) -> Outcome:
    """Return the refusal of a request for its content."""
    return Outcome("refused", reason, "request")


def _held(name: str, feedback: Mapping[str, float] = MappingProxyType({})) -> Execution:
    """Return the execution of an action that waits for the end of a pause."""
    return Execution(name, feedback=dict(feedback), waits_for="paused by the operator")
