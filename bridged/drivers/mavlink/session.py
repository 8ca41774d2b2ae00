"""The session with one vehicle: heartbeats, streams, commands, actions, and whether it is heard.

Pure: messages and the time (mission seconds) go in, messages and readings come out. The driver adds the link.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import OnReading, Order, Outcome, Reading
from bridged.drivers.mavlink.action_binding import Offer
from bridged.drivers.mavlink.actions.confirmation import PRE_ARM
from bridged.drivers.mavlink.actions.context import (
    NOBODYS_FAILSAFE,
    Call,
    LimitWatch,
    Procedure,
    ProcedureContext,
    Steps,
    Task,
)
from bridged.drivers.mavlink.actions.flight import arm, hold_by_mode, leave_hold, mode_call, secure, stay
from bridged.drivers.mavlink.actions.parameters import spellings
from bridged.drivers.mavlink.control_authority import ControlAuthority
from bridged.drivers.mavlink.vehicle.commands import Command, Commands, Identity
from bridged.drivers.mavlink.vehicle.flight_modes import MODE_TABLES, ModeTable
from bridged.drivers.mavlink.vehicle.gcs_failsafe import FailsafeCheck
from bridged.drivers.mavlink.vehicle.state import Vehicle
from bridged.drivers.mavlink.vehicle.status_texts import REPEATS_WITHIN, SEVERITIES, Texts, Warnings
from bridged.drivers.mavlink.vehicle.streams import MessageFields, Streams
from schemas.files.units import Duration
from schemas.manifest.loader import Manifest, Retry
from schemas.mission.model import Failsafe, Limits
from schemas.wire.records import Note
from schemas.wire.terms import Atom

HEARTBEAT_EVERY, HEARTBEAT_EARLY = 1.0, 0.5
"""Mission seconds between our heartbeats, and how much earlier one may follow the vehicle's own."""
IDLE_AFTER = (3.0, 1.0)
"""Mission and wall seconds for which the streams stay full after the last action, disarmed."""
PATIENCE_AT_START = 3.0
"""Wall seconds after the start without a warning that the vehicle is not heard."""
HEARTBEAT_LATE = (1.5, 1.5)
"""Mission and wall seconds without a HEARTBEAT after which the link, not the rate of a message, is in doubt."""
STALE = (5.0, 2.0)
"""Mission and wall seconds after which the vehicle's report of its position is stale."""
REBOOT_TOLD = (60.0, 30.0)
"""Mission and wall seconds for which health reports a restart of the vehicle."""
TEXT = "VEHICLE_TEXT"
"""The source of the vehicle's own warnings."""
MAX_TASKS = 16
"""Executions under way at a time; the bridge allows fewer."""
NO_LIMITS = Limits()
_ATOMS = {True: Atom("up"), False: Atom("down")}
log = logging.getLogger("mavlink")


class VehicleSession:
    """The exchange with one vehicle. What an action ended by is reported as readings before the action ends."""

    def __init__(
        self,
        manifest: Manifest,
        identity: Identity,
        send: Callable[[dialect.MAVLink_message], None],
        on_reading: OnReading,
        *,
        speed: float = 1.0,
        limits: Limits = NO_LIMITS,
        failsafe: Failsafe = NOBODYS_FAILSAFE,
    ) -> None:
        self.identity = identity
        self.vehicle = Vehicle(MODE_TABLES[manifest.robot.vehicle])
        self.vehicle.stale_after = max(STALE[0], STALE[1] * speed)
        self.texts, self.warnings = Texts(), Warnings()
        self.commands = Commands(identity, speed, self._send_known)
        self.streams = Streams(manifest, self.commands, speed)
        self.flight = ProcedureContext(
            self.vehicle, self.commands, self.texts, self._send_known, speed, limits, on_reading, failsafe
        )
        self.failsafe = FailsafeCheck(failsafe, identity, self._send_known, speed)
        self._limits = LimitWatch(self.flight)
        self.received = 0
        """Messages of the vehicle so far."""
        self.speaks_for_agent = True
        self._sources = {percept.source for percept in manifest.percepts.values()}
        self.link_loss = self.flight.wait(manifest.robot.link_loss, manifest.robot.link_loss)
        """Mission seconds of silence that are a link loss."""
        self._link_state = LinkState(on_reading)
        self._send = send
        self._on_reading = on_reading
        self._tasks: dict[Task, Steps] = {}
        self._heartbeat_at = 0.0
        self._listening_since = math.inf
        self._idle_at = 0.0
        self._mode_before_pause: int | None = None
        self._commanded = False
        """Whether something was asked of the vehicle since the last pause: the mode `hold` is not that pause's."""
        self._rebooted_until = -math.inf
        self.control = ControlAuthority(self.flight, self._tasks, self.end)

    def receive(self, message: dialect.MAVLink_message, now: float) -> None:
        """Take in one message from the link; only the vehicle's autopilot counts."""
        if (message.get_srcSystem(), message.get_srcComponent()) != (self.identity.vehicle, self.identity.autopilot):
            return
        self.flight.now, self.flight.message = max(now, self.flight.now), message
        self.received += 1
        vehicle, name = self.vehicle, message.get_type()
        reboots, mode, was_armed, heard_at = vehicle.reboots, vehicle.mode, vehicle.armed, vehicle.heard_at
        unknown = vehicle.unknown_autopilot if name == "HEARTBEAT" else ""
        vehicle.receive(message, self.flight.now)
        if name == "HEARTBEAT" and vehicle.unknown_autopilot != unknown:
            self._autopilot_changed()
        self.streams.count(name)
        if name in self._sources and name != "HEARTBEAT":  # that one is reported with its mode's name
            self._on_reading(Reading(name, MessageFields(message)))
        if vehicle.reboots != reboots:
            self._rebooted()
        match name:
            case "HEARTBEAT":
                silence = self.flight.to_wall(self.flight.now - heard_at)
                if self.control.doubts(mode, was_armed, silence):
                    self._ask_for_time()
                self._heard(mode, silence)
            case "COMMAND_ACK":
                self.commands.acknowledge(message, self.flight.now)
            case "STATUSTEXT":
                self._hear_texts(message)
            case "PARAM_VALUE":
                self.failsafe.receive(message)
                self._parameter_told(message.param_id, message.param_value)
            case "GLOBAL_POSITION_INT":
                self._keep_limits()
        self._step()
        self.flight.message = None

    def tick(self, now: float) -> None:
        """Let time pass: heartbeats, repetitions, silence."""
        self.flight.now = now = max(now, self.flight.now)
        self._listening_since = min(self._listening_since, now)
        if now >= self._heartbeat_at:
            self._beat()
        if self.vehicle.connected and now - self.vehicle.heard_at > self.link_loss:
            self._lost()
        self._look_at_link()
        self._pace()
        self.commands.tick(now)
        self.streams.tick(now, lambda: self.vehicle.home is not None)
        if self.vehicle.connected:
            self.failsafe.tick(now)
        self._step()

    def carry(self, up: bool, now: float) -> None:
        """Take in that packets can pass over the link (`up`), or that they cannot."""
        self.flight.now = max(now, self.flight.now)
        self._link_state.carry(up, self.flight.now)
        self._look_at_link()

    def begin(self, task: Task, procedure: Procedure, call: Call) -> Task:
        """Start a procedure and take its first step."""
        if len(self._tasks) >= MAX_TASKS:
            task.end(Outcome("refused", f"{MAX_TASKS} actions are under way already", "busy"))
            return task
        if task.moves:
            for other in [other for other in self._tasks if other.name == stay.__name__]:
                self.end(other, Outcome("cancelled", f"{task.name} takes over", "superseded"))
        self.control.settle()
        if procedure is arm and not self.vehicle.armed:  # whoever starts the motors answers for the flight
            self.control.overridden = False
        self.control.begun(task)
        self._tasks[task] = self._when_connected(task, procedure, call)
        self._pace()
        message, self.flight.message = self.flight.message, None  # an earlier message is not for it
        self._step()
        self.flight.message = message
        return task

    def perform(self, task: Task, offer: Offer, call: Call) -> Task:
        """Start what the driver offers for an action."""
        task.by_agent, task.call = True, call
        self._commanded = self._commanded or task.moves or offer.sets_mode
        task.sets_mode, task.takes_control, task.judges_mode = offer.sets_mode, offer.takes_control, offer.judges_mode
        return self.begin(task, offer.procedure, call)

    def adopt(self, manifest: Manifest) -> None:
        """Continue by another manifest: other sources, other rates."""
        self._sources = {percept.source for percept in manifest.percepts.values()}
        self.link_loss = self.flight.wait(manifest.robot.link_loss, manifest.robot.link_loss)
        self.streams.adopt(manifest, self.flight.now)

    def order(self, order: Order, ending: Outcome, *, insist: bool) -> Task:
        """Start an order above the agents; every running task ends as `ending`.

        One that does not `insist` ends when others set the mode: the pilot overrides it.
        """
        mode = {"hold": self.modes.hold, "land": self.modes.land, "rtl": self.modes.rtl}[order]
        for other in list(self._tasks):
            self.end(other, ending)
        self._commanded = True
        return self.begin(Task(order, moves=False, sets_mode=True, yields=not insist), secure, mode_call(mode))

    def pause(self, interrupted: list[Task]) -> Task:
        """Hold the vehicle by its mode until `resume`; tasks that are `interrupted`, move it or set its mode end."""
        for task in [task for task in self._tasks if task in interrupted or task.moves or task.sets_mode]:
            self.end(task, Outcome("cancelled", "paused by the operator", "operator"))
        hold = self.modes.hold
        if self._commanded or self.vehicle.mode != hold:
            self._mode_before_pause = self.vehicle.mode
            self.flight.interrupted = [task.call for task in interrupted if task.call is not None]
        self._commanded = False
        return self.begin(Task("pause", moves=False, sets_mode=True), hold_by_mode, mode_call(hold))

    def resume(self) -> Task:
        """Set the mode before `pause`; after a restart of the bridge the one that takes targets."""
        before = self._mode_before_pause
        mode = self.modes.guided if before is None else before
        for task in [task for task in self._tasks if task.sets_mode]:  # a hold that is not confirmed yet
            self.end(task, Outcome("cancelled", "the operator continues", "operator"))
        return self.begin(Task("continue", moves=False, sets_mode=True), self._leave_hold, mode_call(mode))

    def _leave_hold(self, flight: ProcedureContext, task: Task, call: Call) -> Steps:
        outcome = yield from leave_hold(flight, task, call)
        self._commanded = outcome.state == "succeeded"
        return outcome

    def end(self, task: Task, outcome: Outcome, *, hold: bool = False) -> None:
        """End a procedure from outside; `hold` makes a vehicle in flight stay where it is, unless others fly it."""
        steps = self._tasks.pop(task, None)
        if steps is not None:
            steps.close()
        if task.leaves:
            outcome = replace(outcome, reason=f"{outcome.reason}; {task.leaves}")
        task.end(outcome)
        for command in task.commands:
            self.commands.abandon(command)
        left_ground = self.vehicle.aloft or any(command.sent for command in task.commands)
        if hold and task.moves and self.vehicle.armed and left_ground and not self.control.overridden:
            self._hold()

    @property
    def modes(self) -> ModeTable:
        """The modes of the vehicle as it is."""
        return self.vehicle.modes

    @property
    def moving(self) -> list[Task]:
        """The tasks that move the vehicle."""
        return [task for task in self._tasks if task.moves]

    @property
    def silence(self) -> float:
        """Wall seconds since the last HEARTBEAT; infinite before the first."""
        return self.flight.to_wall(self.flight.now - self.vehicle.heard_at)

    def notes(self) -> list[Note]:
        """Return the warnings that hold now."""
        now = self.flight.now
        if not self.vehicle.heartbeats and self.flight.to_wall(now - self._listening_since) < PATIENCE_AT_START:
            return self.failsafe.notes()
        rebooted = [Note("vehicle_rebooted", "the vehicle rebooted")] if now < self._rebooted_until else []
        system = str(self.identity.vehicle)
        silent = [] if self.vehicle.connected else [Note("no_heartbeat", f"no heartbeat from system {system}", system)]
        if refusal := self.vehicle.not_commanded:
            return [Note("autopilot_unknown", refusal), *silent]
        if silent:
            return [*rebooted, *silent, *self.failsafe.notes()]
        late = now - self.vehicle.heard_at > self.flight.wait(*HEARTBEAT_LATE)
        own = (
            Note("other_vehicle_kind", self.vehicle.contradiction),
            Note("mission_broken", self.flight.plan.broken),
            Note("outside_limits", self._limits.outside),
            *(Note("hold_failed", task.trouble) for task in self._tasks),
        )
        unsent = [] if late else self.streams.notes()
        return [*rebooted, *(note for note in own if note.text), *unsent, *self.failsafe.notes()]

    def _step(self) -> None:
        """Let every procedure take one step; one that others have overridden only waits for its end."""
        self.control.look()
        for task, steps in list(self._tasks.items()):
            if task not in self._tasks or (task.moves and self.control.pending):
                continue
            try:
                next(steps)
                continue
            except StopIteration as stop:
                outcome: Outcome = stop.value
            except Exception as error:  # a defect must not take the link down, and with it the way home
                log.exception("defect in argosy: %s", task.name)
                outcome = Outcome("failed", f"defect in argosy: {type(error).__name__}: {error}")
            self._tasks.pop(task, None)
            self.control.ended(task, outcome)  # first: it may report that an override is over
            task.end(outcome)

    def _pace(self) -> None:
        """Request full streams while the vehicle is armed or a task runs, and a little longer."""
        now = self.flight.now
        if self.vehicle.armed or self._tasks:
            self._idle_at = now + self.flight.wait(*IDLE_AFTER)
        self.streams.pace(now < self._idle_at, now)

    def _when_connected(self, task: Task, procedure: Procedure, call: Call) -> Steps:
        while not self.vehicle.connected:
            task.waits_for = f"a heartbeat from system {self.identity.vehicle}"
            yield
        if refusal := self.vehicle.not_commanded:
            return Outcome("refused", refusal)
        return (yield from procedure(self.flight, task, call))

    def _send_known(self, message: dialect.MAVLink_message) -> None:
        """Send a command or request, only to a vehicle whose autopilot is known."""
        if not self.vehicle.not_commanded:
            self._send(message)

    def _beat(self) -> None:
        self._heartbeat_at = self.flight.now + HEARTBEAT_EVERY
        if self.speaks_for_agent or not self.failsafe.claims_ground_station:
            self._send(_HEARTBEAT)

    def _heard(self, mode_before: int, silence: float) -> None:
        if self.flight.now >= self._heartbeat_at - HEARTBEAT_EARLY:
            self._beat()
        connected, self.vehicle.connected = self.vehicle.connected, True
        if not connected:
            again = f"again after {silence:.1f} s" if math.isfinite(silence) else "now"
            log.info("system %d is heard %s: %s", self.identity.vehicle, again, self._mode_and_arming())
            self._ask_for_streams()
        self.control.heard(mode_before, again=not connected)
        self._tell_state()
        self._look_at_link()

    def _tell_state(self) -> None:
        self._on_reading(Reading("HEARTBEAT", self.vehicle.state()))

    def _look_at_link(self) -> None:
        vehicle = self.vehicle
        self._link_state.look(vehicle.connected, vehicle.heard_at, self.flight.now, self.link_loss)

    def _mode_and_arming(self) -> str:
        return f"{self.vehicle.mode_name}, {'armed' if self.vehicle.armed else 'not armed'}"

    def _keep_limits(self) -> None:
        """Stop a vehicle that agents fly where it leaves the mission's limits."""
        if self.control.overridden or not (left := self._limits.look()):
            return
        log.warning("system %d: %s; it is held", self.identity.vehicle, left)
        for task in self.moving:
            self.end(task, Outcome("failed", left, "limits"))
        self._hold()

    def _hold(self) -> None:
        self.begin(Task(stay.__name__), stay, mode_call(self.modes.guided))

    def _parameter_told(self, name: str, value: float) -> None:
        """Report a parameter that was requested once whenever the vehicle sends it, as when others set it."""
        for asked in spellings(name):
            if self.flight.parameters.get(asked, value) != value:
                self.flight.learn(asked, value)

    def _lost(self) -> None:
        self.vehicle.connected = False
        lost = f"no heartbeat for {self.silence:.1f} s"
        log.warning("system %d is lost: %s; it was in %s", self.identity.vehicle, lost, self._mode_and_arming())
        self.commands.clear()
        self.streams.stop()
        self._tell_state()
        self._look_at_link()
        for task in list(self._tasks):
            if task.name != stay.__name__:  # that one waits until the vehicle is heard again
                self.end(task, Outcome("failed", f"link lost: {lost}"))

    def _hear_texts(self, message: dialect.MAVLink_message) -> None:
        """Pass on warnings and worse: new ones to the log, all to the agents.

        What hinders an arming that waits is logged as its cause instead.
        """
        for said in self.texts.receive(message, self.flight.now):
            news = self.warnings.take(said, self.flight.wait(*REPEATS_WITHIN))
            if news is None:
                continue
            severity = SEVERITIES[said.severity]
            if news and not (said.text.startswith(PRE_ARM) and any(task.cause for task in self._tasks)):
                log.warning("system %d says (%s): %s", self.identity.vehicle, severity, said.text)
            if TEXT in self._sources:
                self._on_reading(Reading(TEXT, {"severity": Atom(severity), "text": said.text}))

    def _ask_for_time(self) -> None:
        """Request the time since boot: a mode that the vehicle started with was set by nobody."""
        number = float(dialect.MAVLINK_MSG_ID_SYSTEM_TIME)
        request = Command(dialect.MAV_CMD_REQUEST_MESSAGE, (number, *(0.0,) * 6), Retry(times=2, every=Duration(0.2)))
        self.commands.submit(request, self.flight.now)

    def _rebooted(self) -> None:
        log.warning("system %d: the vehicle rebooted", self.identity.vehicle)
        self._rebooted_until = self.flight.now + self.flight.wait(*REBOOT_TOLD)
        self.control.rebooted()
        self._tell_state()
        for task in self.moving:
            self.end(task, Outcome("failed", "the vehicle rebooted"))
        self._ask_for_streams()

    def _autopilot_changed(self) -> None:
        """End what was asked of another autopilot."""
        if refusal := self.vehicle.not_commanded:
            log.error("system %d: %s", self.identity.vehicle, refusal)
            self.commands.clear()
            self.streams.stop()
            for task in list(self._tasks):
                self.end(task, Outcome("failed", refusal))
        elif self.vehicle.connected:
            self._ask_for_streams()

    def _ask_for_streams(self) -> None:
        """Request all streams of a vehicle that has appeared or restarted."""
        if not self.vehicle.not_commanded:
            self.streams.request(self.flight.now)
            self.failsafe.begin(self.flight.now)


_HEARTBEAT = dialect.MAVLink_heartbeat_message(
    dialect.MAV_TYPE_ONBOARD_CONTROLLER, dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3
)


class LinkState:
    """The percept of the link: `up` while the vehicle is heard over a transport that carries, `down` otherwise.

    Each change is reported once. A vehicle that was not heard yet is neither up nor down until it has been silent for
    the time of a link loss: a program need not distinguish the start of a flight from a loss. Times: mission seconds.
    """

    def __init__(self, on_reading: OnReading) -> None:
        self._on_reading = on_reading
        self._told: bool | None = None
        self._begun = math.inf
        self._carries = True
        self._carries_since = -math.inf

    def carry(self, up: bool, now: float) -> None:
        """The transport (a socket, a device) came up or went down."""
        if up and not self._carries:
            self._carries_since = now
        self._carries = up

    def look(self, connected: bool, heard_at: float, now: float, patience: float) -> None:
        """Report a change, by whether the vehicle is heard and when it was heard last.

        After the transport was down the link is up when the vehicle is heard again, not before.
        """
        self._begun = min(self._begun, now)
        up = self._carries and connected and heard_at >= self._carries_since
        if up is self._told or (not up and self._told is None and now - self._begun <= patience):
            return
        self._told = up
        self._on_reading(Reading("LINK", {"state": _ATOMS[up]}))
