"""The life of actions (design section 5): asked for, checked, carried out, and answered with exactly one final status.

Pure: requests and the time (mission seconds) go in, statuses come out. The ledger alone touches the disk.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field

from msgspec.structs import replace

from bridged.arguments import BadArgument, read_arguments
from bridged.board import PerceptBoard
from bridged.drivers.robot import Driver, Execution, Order, Outcome
from bridged.lease import Lease
from bridged.ledger import Ledger
from bridged.progress import Progress
from schemas.built_in import ACTIONS
from schemas.manifest import ActionEntry, Argument, Manifest
from schemas.records import Action, ActionStatus, Header, State

FEEDBACK_EVERY = 1.0
"""Wall seconds between two `running` statuses of one action."""
MAX_RUNNING = 8
"""Actions that may run at once, counted over all agents."""
MAX_FOLLOWERS = 16
"""Queries that may wait for the end of one action; the newest: an asker whose link flaps has given up the others."""

Follower = Callable[[ActionStatus | None], None]
"""Called with each status of an action from now on; the last one is final, or None if a newer asker took the place."""
log = logging.getLogger("actions")


@dataclass(eq=False)
class _Job:
    """An action that runs."""

    action: Action
    entry: ActionEntry
    execution: Execution
    deadline_at: float
    deadline: float
    status: ActionStatus
    told_at: float
    progress: Progress
    followers: list[Follower] = field(default_factory=list)


class ActionDesk:
    """Takes the agents' requests and the operator's orders for one robot."""

    def __init__(
        self,
        manifest: Manifest,
        driver: Driver,
        board: PerceptBoard,
        ledger: Ledger,
        publish: Callable[[str, ActionStatus], None],
        lease: Lease,
        *,
        robot: str,
        boot: str,
        stamp: Callable[[], int],
        now: Callable[[], float],
        speed: float = 1.0,
    ) -> None:
        self.blocked = ""
        """Why no action is taken now (the operator, or the end of the bridge); empty = they are."""
        self.lease = lease
        """Which agent has the robot."""
        self._manifest, self._driver, self._board, self._ledger = manifest, driver, board, ledger
        self._publish = publish
        self.robot, self._boot, self._stamp, self._now = robot, boot, stamp, now
        self._feedback_every = FEEDBACK_EVERY * speed
        self._jobs: dict[str, _Job] = {}
        self._seq = 0
        self._by_hand = 0

    @property
    def arming(self) -> bool:
        """Whether an action is under way that may have armed the robot without its state showing it yet."""
        return any(job.entry.confirm == "armed" for job in self._jobs.values())

    @property
    def running(self) -> list[str]:
        """Names of the actions that run now."""
        return [job.action.name for job in self._jobs.values()]

    def ask(self, agent: str, name: str, request: Action, follower: Follower) -> None:
        """Answer a request: `follower` hears the present status of a known id, or the whole life of a new one."""
        if not request.id:
            self._by_hand += 1
            request = replace(request, id=f"{agent}:{self._boot}:hand{self._by_hand}")
        if self._known(request, follower):
            return
        action = replace(request, agent=agent, name=name)
        if request.attempt > 1:
            self._refuse(action, "bridge restarted", follower)
        elif request.name not in ("", name) or request.agent not in ("", agent):
            said = f"{request.agent or agent}/{request.name or name}"
            self._refuse(action, f"the key says {agent}/{name}, the action says {said}", follower)
        else:
            self._begin(action, follower)

    def adopt(self, manifest: Manifest) -> None:
        """Take actions by another manifest from now on; those that run go on by their old entry."""
        self._manifest = manifest

    def cancel(self, agent: str, action: str) -> ActionStatus:
        """End a running action of an agent. Returns its final status, also if it had ended already."""
        job = self._jobs.get(action)
        if job is not None and job.action.agent == agent:
            goes_on = "" if job.entry.cancel == "hold" or not job.entry.motion else "; the vehicle goes on"
            hold = job.entry.cancel == "hold"
            return self._end(job, Outcome("cancelled", f"cancelled by {agent}{goes_on}"), hold=hold)
        final = self._ledger.final(action)
        return final or ActionStatus(id=action, state="refused", result=False, reason=f"no action {action} of {agent}")

    def order(self, order: Order, reason: str, *, block: bool, insist: bool) -> Execution:
        """Begin an order from above: every action that runs fails with `reason`; `block` refuses new ones after it.

        It goes on against a pilot only if it `insist`s.
        """
        if block:
            self.blocked = reason
        execution = self._driver.order(order, reason, insist=insist)
        self.step()
        for job in list(self._jobs.values()):
            self._end(job, Outcome("failed", reason), hold=False)
        return execution

    def end_all(self, agent: str, outcome: Outcome) -> None:
        """End every action of an agent that is no more; an empty name is every agent."""
        for job in [job for job in self._jobs.values() if agent in ("", job.action.agent)]:
            self._end(job, outcome, hold=False)

    def step(self) -> None:
        """Pass on what executions have come to, feedback, and deadlines that are over."""
        now = self._now()
        for job in list(self._jobs.values()):
            if job.execution.outcome is not None:
                self._finish(job, job.execution.outcome)
            elif now >= job.deadline_at:
                waits = f"; it waited for {job.execution.waits_for}" if job.execution.waits_for else ""
                outcome = Outcome("timed_out", f"not done within {job.deadline:g} s{waits}")
                self._end(job, outcome, hold=job.entry.cancel == "hold")
            elif now - job.told_at >= self._feedback_every:
                job.told_at = now
                running = self._status(job.action, "running", job.execution.waits_for, job.execution.feedback)
                self._tell(job, replace(running, deadline=max(0.0, job.deadline_at - now)))
                job.progress.show(job.execution.feedback)
        self.lease.step(active=self._driver.active, heard=self._driver.heard, busy=bool(self._jobs), now=now)

    def _known(self, request: Action, follower: Follower) -> bool:
        """Answer a request for an id that was begun before."""
        job = self._jobs.get(request.id)
        if job is not None:
            follower(job.status)
            if len(job.followers) >= MAX_FOLLOWERS:
                job.followers.pop(0)(None)
            job.followers.append(follower)
            return True
        if not self._ledger.knows(request.id):
            return False
        final = self._ledger.final(request.id)
        if final is None:
            reason = "the bridge restarted while it ran; how it ended is not known"
            final = ActionStatus(id=request.id, state="failed", result=False, reason=reason)
        follower(final)
        return True

    def _begin(self, action: Action, follower: Follower) -> None:
        entry = ACTIONS.get(action.name) or self._manifest.actions.get(action.name)
        if entry is None:
            known = ", ".join(f"{name}/{one.arity}" for name, one in (self._manifest.actions | ACTIONS).items())
            self._refuse(action, f"{self.robot} has no action {action.name}; it has {known}", follower)
            return
        try:
            arguments = read_arguments(action.name, entry, action.parameters, self._manifest.robot.values)
        except BadArgument as error:
            self._refuse(action, str(error), follower)
            return
        now = self._now()
        held = self.lease.refuses(action.agent, ", ".join(self.running), now)
        if action.name in ACTIONS:
            self._answer_built_in(action, arguments, self.blocked or held, follower)
            return
        rival = self.lease.holder not in ("", action.agent)
        if reason := self.blocked or held or self._driver.refuses(entry) or self._busy(action, entry, rival):
            self._refuse(action, reason, follower)
            return
        try:
            self._ledger.begin(action.id)
        except OSError as error:
            if not entry.supersedes:
                self._refuse(action, f"its id cannot be kept on disk: {error.strerror}", follower)
                return
            log.error("the id of %s cannot be kept on disk: %s", action.id, error.strerror)  # a way down must stay
        taken = self._take(action, entry) if rival else []
        for other in self._superseded(entry):
            self._end(other, Outcome("cancelled", f"superseded by {action.name} of {action.agent}"), hold=False)
        self.lease.take(action.agent, now)
        deadline = float(entry.deadline) if action.deadline is None else action.deadline
        accepted = replace(self._status(action, "accepted"), deadline=deadline)
        log.info("action %s %s%s", action.id, action.name, list(arguments.values()))
        follower(accepted)
        self._publish(action.agent, accepted)
        execution = self._driver.perform(action.name, entry, arguments)
        progress = Progress(self._board, action.agent, action.name, entry)
        job = _Job(action, entry, execution, now + deadline, deadline, accepted, now, progress, [follower])
        self._jobs[action.id] = job
        if execution.outcome is not None and execution.outcome.state == "refused":
            self._hold_for(taken)
        self.step()

    def _answer_built_in(self, action: Action, arguments: dict[str, Argument], reason: str, follower: Follower) -> None:
        """`release` and `hand_over`: done at once, and never while an action of the holder runs."""
        if not reason and self.lease.holder == action.agent and self._jobs:
            reason = f"busy: {', '.join(self.running)} is running; cancel it first, or wait for its end"
        if not reason and action.name == "release":
            reason = self.lease.release(action.agent)
        elif not reason:
            reason = self.lease.give(action.agent, str(arguments["agent"]), self._now())
        if reason:
            self._refuse(action, reason, follower)
            return
        status = replace(self._status(action, "succeeded"), result=True)
        self._record(status)
        log.info("action %s %s succeeded", action.id, action.name)
        follower(status)
        self._publish(action.agent, status)

    def _take(self, action: Action, entry: ActionEntry) -> list[_Job]:
        """Take the robot from an agent of lower rank: what runs for it fails. Returns what moved the robot."""
        taken = list(self._jobs.values())
        for job in taken:
            self._end(job, Outcome("failed", f"lease taken by {action.agent}"), hold=False)
        moving = [job for job in taken if job.entry.motion]
        if not entry.motion and not entry.supersedes:
            self._hold_for(moving)
            return []
        return moving

    def _hold_for(self, taken: list[_Job]) -> None:
        """Let the robot stay where it is: whoever has taken it does not move it."""
        for job in taken:
            self._driver.stop(job.execution, Outcome("failed", job.status.reason), hold=True)

    def _busy(self, action: Action, entry: ActionEntry, rival: bool) -> str:
        """Why an action cannot begin beside those that run, empty if it can; what runs for a `rival` would end."""
        if rival:
            return ""
        ending = self._superseded(entry)
        for job in self._jobs.values():
            both_move = entry.motion and job.entry.motion
            if job not in ending and (both_move or job.action.name == action.name):
                return f"busy: {job.action.name} is running"
        return f"busy: {MAX_RUNNING} actions are running" if len(self._jobs) >= MAX_RUNNING else ""

    def _superseded(self, entry: ActionEntry) -> list[_Job]:
        return [job for job in self._jobs.values() if job.entry.motion] if entry.supersedes else []

    def _refuse(self, action: Action, reason: str, follower: Follower) -> None:
        status = self._status(action, "refused", reason)
        self._record(status)
        log.info("action %s %s refused: %s", action.id, action.name, reason)
        follower(status)
        self._publish(action.agent, status)

    def _end(self, job: _Job, outcome: Outcome, *, hold: bool) -> ActionStatus:
        self._driver.stop(job.execution, outcome, hold=hold)
        return self._finish(job, job.execution.outcome or outcome)

    def _finish(self, job: _Job, outcome: Outcome) -> ActionStatus:
        if job.action.id not in self._jobs:
            return job.status
        del self._jobs[job.action.id]
        job.progress.end()
        self._board.flush(self._now())
        status = self._status(job.action, outcome.state, outcome.reason, job.execution.feedback)
        self._record(status)
        log.info("action %s %s %s %s", job.action.id, job.action.name, status.state, status.reason)
        self._tell(job, status)
        return status

    def _tell(self, job: _Job, status: ActionStatus) -> None:
        job.status = status
        for follower in job.followers:
            follower(status)
        self._publish(job.action.agent, status)

    def _status(
        self, action: Action, state: State, reason: str = "", feedback: dict[str, float] | None = None
    ) -> ActionStatus:
        self._seq += 1
        made = ActionStatus(
            header=Header(seq=self._seq, stamp=self._stamp(), source=self.robot, boot=self._boot),
            id=action.id,
            state=state,
            reason=reason,
            feedback=dict(feedback or {}),
            after=self._board.last_seq(action.agent),
            name=action.name,
            parameters=action.parameters,
        )
        return replace(made, result=state == "succeeded") if made.final else made

    def _record(self, status: ActionStatus) -> None:
        try:
            self._ledger.finish(status)
        except OSError as error:
            log.error("how %s ended cannot be kept on disk: %s", status.id, error.strerror)
