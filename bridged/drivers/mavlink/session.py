"""The session with one vehicle: heartbeats, streams, commands, actions, and whether it is heard.

Pure but for the clock: messages go in, messages and readings come out. The driver adds the link.
"""

from __future__ import annotations

import asyncio
import logging
import math
from collections.abc import Callable, Collection
from dataclasses import replace
from functools import partial

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Execution, OnReading, Order, Outcome, Reading
from bridged.drivers.mavlink.actions.confirmation import HOME_REPORTED
from bridged.drivers.mavlink.actions.context import (
    NOBODYS_FAILSAFE,
    BoundAction,
    Ended,
    ProcedureContext,
    ProcedureRun,
    Steps,
    mode_action,
)
from bridged.drivers.mavlink.actions.flight import HOLD, LEAVE_HOLD, SECURE, STAY
from bridged.drivers.mavlink.actions.parameters import spellings
from bridged.drivers.mavlink.autopilots.autopilot import Autopilot, VelocityStream
from bridged.drivers.mavlink.autopilots.px4 import Px4
from bridged.drivers.mavlink.control_authority import ControlAuthority
from bridged.drivers.mavlink.vehicle.commands import Commands, Identity, MavlinkCommand
from bridged.drivers.mavlink.vehicle.flight_modes import MODE_TABLES
from bridged.drivers.mavlink.vehicle.gcs_failsafe import FailsafeCheck
from bridged.drivers.mavlink.vehicle.px4_events import event_of
from bridged.drivers.mavlink.vehicle.readings import LinkState, derived, fields
from bridged.drivers.mavlink.vehicle.state import OFF_GROUND, Vehicle
from bridged.drivers.mavlink.vehicle.status_texts import REPEATS_WITHIN, SEVERITIES, StatusText, Texts, Warnings
from bridged.drivers.mavlink.vehicle.streams import Streams
from commd.common.clock import Clock
from schemas.files.units import Duration
from schemas.manifest.loader import Manifest, Retry
from schemas.mission.model import Failsafe, Limits
from schemas.wire.records import Note
from schemas.wire.terms import Atom

HEARTBEAT_EVERY, HEARTBEAT_EARLY = 1.0, 0.5
"""Mission seconds between our heartbeats, and how much earlier one may follow the vehicle's own."""
PATIENCE_AT_START = 3.0
"""Wall seconds after the start without a warning that the vehicle is not heard."""
HEARTBEAT_LATE = (1.5, 1.5)
"""Mission and wall seconds without a HEARTBEAT after which the link, not the rate of a message, is in doubt, and also
who has the vehicle."""
STALE = (5.0, 2.0)
"""Mission and wall seconds after which the vehicle's report of its position is stale."""
REBOOT_REPORTED_FOR = (60.0, 30.0)
"""Mission and wall seconds for which health reports a restart of the vehicle."""
PAYLOAD_MESSAGES = ("CAMERA_", "GIMBAL_", "VIDEO_", "STORAGE_")
"""Beginnings of the names of messages of cameras and gimbals that become percepts and confirm actions."""
TEXT = "VEHICLE_TEXT"
"""The source of the vehicle's own warnings."""
MAX_RUNS = 16
"""Executions under way at a time; the bridge allows fewer."""
NO_LIMITS = Limits()
AUTOPILOTS = {dialect.MAV_AUTOPILOT_ARDUPILOTMEGA: Autopilot(), dialect.MAV_AUTOPILOT_PX4: Px4()}
"""Those that are commanded, by MAV_AUTOPILOT; the first as long as a vehicle has not been heard."""
ARDUPILOT = AUTOPILOTS[dialect.MAV_AUTOPILOT_ARDUPILOTMEGA]
log = logging.getLogger("mavlink")


class VehicleSession:
    """The exchange with one vehicle. What an action ended by is reported as readings before the action ends."""

    def __init__(
        self,
        manifest: Manifest,
        identity: Identity,
        send: Callable[[dialect.MAVLink_message], None],
        on_reading: OnReading,
        clock: Clock,
        *,
        limits: Limits = NO_LIMITS,
        failsafe: Failsafe = NOBODYS_FAILSAFE,
    ) -> None:
        self.clock, speed = clock, clock.speed
        self.identity = identity
        """Our MAVLink ids, and the vehicle's."""
        self.asked = asyncio.Event()
        """Set when something is asked of the vehicle: `tick` is due then, and more often."""
        self.vehicle = Vehicle(MODE_TABLES[manifest.robot.vehicle])
        self.vehicle.stale_after = max(STALE[0], STALE[1] * speed)
        self.texts, self.warnings = Texts(), Warnings()
        self.commands = Commands(identity, speed, self._send_known)
        self.streams = Streams(manifest, ARDUPILOT, self.commands, speed)
        self.flight = ProcedureContext(
            self.vehicle, ARDUPILOT, self.commands, self.texts, self._send_known, speed, limits, on_reading, failsafe
        )
        self.failsafe = FailsafeCheck(failsafe, identity, self._send_known, speed)
        self.received = 0
        """Messages of the vehicle so far."""
        self._speaks_for_agent = True
        self._manifest = manifest
        self._read_for(manifest)
        self.link_loss = self.flight.wait(manifest.robot.link_loss, manifest.robot.link_loss)
        """Mission seconds of silence that are a link loss."""
        self._link_state = LinkState(on_reading)
        self._send = send
        self._on_reading = on_reading
        self._runs: list[ProcedureRun] = []
        self._heartbeat_at = 0.0
        self._listening_since = math.inf
        self._mode_before_pause: int | None = None
        self._commanded = False
        """Whether something was asked of the vehicle since the last pause: the mode `hold` is not that pause's."""
        self._rebooted_until = -math.inf
        self.control = ControlAuthority(self.flight, self._runs, self.stop)

    def receive(self, message: dialect.MAVLink_message) -> None:
        """Take in one message from the link: of the vehicle's autopilot, or of its cameras and gimbals."""
        if message.get_srcSystem() != self.identity.vehicle:
            return
        if message.get_srcComponent() != self.identity.autopilot:
            self._hear_payload(message)
            return
        self.flight.now = max(self.clock.now(), self.flight.now)
        vehicle, name = self.vehicle, message.get_type()
        if (translate := self.flight.autopilot.incoming.get(name)) is not None:
            translate(message)
        self.flight.message = message
        self.received += 1
        reboots, mode, was_armed, heard_at = vehicle.reboots, vehicle.mode, vehicle.armed, vehicle.heard_at
        autopilot, kind = vehicle.autopilot, vehicle.modes
        vehicle.receive(message, self.flight.now)
        if vehicle.autopilot != autopilot or vehicle.modes is not kind:
            self._autopilot_changed()
        self.streams.received[name] += 1
        again = name == "MISSION_ITEM_REACHED" and vehicle.reached_again and self.flight.autopilot.repeats_reached
        if name != "HEARTBEAT" and not again:  # that one is reported with its mode's name
            self._report(name, message)
        if vehicle.reboots != reboots:
            self._rebooted()
        match name:
            case "HEARTBEAT":
                silence = self.flight.to_wall(self.flight.now - heard_at)
                doubts = self.control.doubts(mode, was_armed, silence)
                self._heard(mode, was_armed, silence)
                if doubts:  # a vehicle that was restarted reports a short time
                    request = (float(dialect.MAVLINK_MSG_ID_SYSTEM_TIME), *(0.0,) * 6)
                    retry = Retry(times=2, every=Duration(0.2))
                    command = MavlinkCommand(dialect.MAV_CMD_REQUEST_MESSAGE, request, retry)
                    self.commands.submit(command, self.flight.now)
            case "COMMAND_ACK":
                self.commands.acknowledge(message, self.flight.now)
            case "STATUSTEXT":
                self._hear_texts(self.texts.receive(message, self.flight.now))
            case "EVENT" if (event := event_of(message)) is not None:
                self._hear_texts(self.texts.receive_event(event, self.flight.now))
            case "PARAM_VALUE":
                self.failsafe.receive(message)
                for asked in spellings(message.param_id):  # one that was requested once is reported when others set it
                    if self.flight.parameters.get(asked, message.param_value) != message.param_value:
                        self.flight.learn(asked, message.param_value)
            case "GLOBAL_POSITION_INT" if left := self.flight.left_limits():
                self._hold_outside(left)
        self._step()
        self.flight.message = None

    def _hear_payload(self, message: dialect.MAVLink_message) -> None:
        """Take in a message of a camera or gimbal: nothing of it is the vehicle's state."""
        component, name = message.get_srcComponent(), message.get_type()
        if component not in self.vehicle.payload_heard_at:
            return
        self.flight.now = max(self.clock.now(), self.flight.now)
        self.vehicle.payload_heard_at[component] = self.flight.now
        if name == "COMMAND_ACK":
            self.commands.acknowledge(message, self.flight.now, component)
        elif name.startswith(PAYLOAD_MESSAGES):
            self.streams.received[name] += 1
            self._report(name, message)
        else:
            return
        if self._runs:
            self.flight.message = message
            self._step()
            self.flight.message = None

    def tick(self) -> None:
        """Let time pass: heartbeats, repetitions, silence."""
        self.flight.now = now = max(self.clock.now(), self.flight.now)
        self._listening_since = min(self._listening_since, now)
        if now >= self._heartbeat_at:
            self._beat()
        if self.vehicle.connected and now - self.vehicle.heard_at > self.link_loss:
            self._lost()
        self._look_at_link()
        self.streams.pace(busy=self.vehicle.armed or bool(self._runs), now=now)
        self.commands.tick(now)
        self.streams.tick(now, lambda: self.vehicle.home is not None)
        if self.vehicle.connected:
            self.failsafe.tick(now)
        self._step()

    def carry(self, up: bool) -> None:
        """Take in that packets can pass over the link (`up`), or that they cannot."""
        self.flight.now = max(self.clock.now(), self.flight.now)
        self._link_state.carry(up, self.flight.now)
        self._look_at_link()

    def begin(self, run: ProcedureRun) -> ProcedureRun:
        """Start a procedure and take its first step."""
        self.asked.set()
        if run.by_agent and (run.moves or run.procedure.sets_mode):
            self._commanded = True
        if len(self._runs) >= MAX_RUNS:
            run.end(Outcome("refused", f"{MAX_RUNS} actions are under way already", "busy"))
            return run
        if run.moves or run.procedure.sets_mode:
            for other in [other for other in self._runs if other.procedure is STAY]:
                self.stop(other, Outcome("cancelled", f"{run.name} takes over", "superseded"))
        run.judges_mode = run.procedure.judges_mode
        self.control.begin(run)
        if self.flight.velocity is not None and (run.moves or run.procedure.sets_mode):
            self.flight.velocity.leaving = True
        run.steps = self._when_connected(run)
        self._runs.append(run)
        self.streams.pace(busy=True, now=self.flight.now)
        message, self.flight.message = self.flight.message, None  # an earlier message is not for it
        self._step()
        self.flight.message = message
        return run

    def speak_for_agent(self, present: bool) -> None:
        """Send heartbeats that claim to be the ground station only while an agent is `present`."""
        self._speaks_for_agent = present

    def adopt(self, manifest: Manifest) -> None:
        """Continue by another manifest: other sources, other rates."""
        self._manifest = manifest
        self._read_for(manifest)
        self.link_loss = self.flight.wait(manifest.robot.link_loss, manifest.robot.link_loss)
        self.streams.adopt(manifest, self.flight.autopilot, self.flight.now)

    def order(self, order: Order, ending: Outcome, *, insist: bool) -> ProcedureRun:
        """Start an order above the agents; every run ends as `ending`.

        One that does not `insist` ends when others set the mode: the pilot overrides it.
        """
        for other in list(self._runs):
            self.stop(other, ending)
        self._commanded = True
        return self.begin(
            ProcedureRun(
                order,
                procedure=SECURE,
                action=self._ordered(order),
                bind=partial(self._ordered, order),
                moves=False,
                yields=not insist,
            )
        )

    def _read_for(self, manifest: Manifest) -> None:
        """Report what the percepts of a manifest are made of."""
        self._sources = {percept.source for percept in manifest.percepts.values()}
        self._derived = derived(self._sources)

    def _report(self, name: str, message: dialect.MAVLink_message) -> None:
        if name in self._sources:
            self._on_reading(Reading(name, fields(message)))
        if name in self._derived:
            source, make = self._derived[name]
            self._on_reading(Reading(source, make(message)))

    def _ordered(self, order: Order) -> BoundAction:
        modes = self.vehicle.modes
        if order == "hold":
            return self.flight.autopilot.hold(modes)
        return mode_action(modes, modes.land if order == "land" else modes.rtl)

    def pause(self, interrupted: Collection[Execution]) -> ProcedureRun:
        """Hold the vehicle by its mode until `resume`; runs that are `interrupted`, move it or set its mode end."""
        for run in [run for run in self._runs if run in interrupted or run.moves or run.procedure.sets_mode]:
            self.stop(run, Outcome("cancelled", "paused by the operator", "operator"))
        hold = self.vehicle.modes.hold
        if self._commanded or self.vehicle.mode != hold:
            self._mode_before_pause = self.vehicle.mode
            self.flight.interrupted = [run.action for run in interrupted if isinstance(run, ProcedureRun)]
        self._commanded = False
        bind = partial(self._ordered, "hold")
        return self.begin(ProcedureRun("pause", procedure=HOLD, action=bind(), bind=bind, moves=False, yields=True))

    def resume(self) -> ProcedureRun:
        """Set the mode before `pause`; after a restart of the bridge the one that takes targets."""
        before = self._mode_before_pause

        def bind() -> BoundAction:
            modes = self.vehicle.modes
            by_a_target = before is None or before in modes.also_targets  # modes that only a target of ours began
            if before == modes.takeoff and self.vehicle.position is not None:  # in the air it would begin again there
                by_a_target = by_a_target or (self.vehicle.aloft and self.vehicle.position.altitude > OFF_GROUND)
            return mode_action(modes, modes.guided if before is None or by_a_target else before)

        for run in [run for run in self._runs if run.procedure.sets_mode]:  # a hold that is not confirmed yet
            self.stop(run, Outcome("cancelled", "the operator continues", "operator"))
        run = ProcedureRun("continue", procedure=LEAVE_HOLD, action=bind(), bind=bind, moves=False, yields=True)
        return self.begin(run)

    def stop(self, run: Execution, outcome: Outcome, *, hold: bool = False) -> None:
        """End a run from outside; `hold` makes a vehicle in flight stay where it is, unless others fly it."""
        if not isinstance(run, ProcedureRun):  # it was refused before it began
            return
        if run in self._runs:
            self._runs.remove(run)
            run.steps.close()
        if run.leaves:
            outcome = replace(outcome, reason=f"{outcome.reason}; {run.leaves}")
        run.end(outcome)
        for command in run.commands:
            self.commands.abandon(command)
        left_ground = self.vehicle.aloft or any(command.sent for command in run.commands)
        if hold and run.moves and self.vehicle.armed and left_ground and not self.vehicle.overridden:
            self._stay()

    @property
    def silence(self) -> float:
        """Wall seconds since the last HEARTBEAT; infinite before the first."""
        return self.flight.to_wall(max(self.clock.now(), self.flight.now) - self.vehicle.heard_at)

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
        own = (
            Note("other_vehicle_kind", self.vehicle.contradiction),
            Note("mission_broken", self.flight.plan.broken),
            Note("outside_limits", self.flight.outside),
            *(Note("hold_failed", run.trouble) for run in self._runs),
        )
        unsent = [] if self._late else self.streams.notes()
        return [*rebooted, *(note for note in own if note.text), *unsent, *self.failsafe.notes()]

    def _step(self) -> None:
        """Let every procedure take one step; one that others have overridden only waits for its end."""
        self.control.look()
        if self.flight.velocity is not None:
            self._keep_velocity(self.flight.velocity)
        for run in list(self._runs):
            if run not in self._runs or (run.moves and (self.control.pending or self.vehicle.failsafe_announced)):
                continue
            try:
                next(run.steps)
                continue
            except StopIteration as stop:
                outcome: Outcome = stop.value
                if run.procedure is LEAVE_HOLD:
                    self._commanded = outcome.state == "succeeded"
            except Ended as ended:
                outcome = ended.outcome
            except Exception as error:  # a defect must not take the link down, and with it the way home
                log.exception("defect in argosy: %s", run.name)
                outcome = Outcome("failed", f"defect in argosy: {type(error).__name__}: {error}")
            if run in self._runs:
                self._runs.remove(run)
            name = self.vehicle.mode_name
            self.control.ended(run, outcome)  # first: it may report that an override is over
            if self.vehicle.mode_name != name:
                self._report_state()
            run.end(outcome)

    def _keep_velocity(self, stream: VelocityStream) -> None:
        """Stream the velocity that is flown; at its end the vehicle holds, on purpose, before the stream ends.

        One that is lost is left to its failsafe, which the stream would keep off.
        """
        vehicle = self.vehicle
        asked = vehicle.mode == stream.mode or (self.flight.expects(stream.mode) and not stream.leaving)
        if not asked or not vehicle.armed or vehicle.overridden or not vehicle.connected:
            self.flight.velocity = None
            return
        stream.keep(self.flight.now)
        if self.flight.now >= stream.until and not stream.leaving:
            self._stay()

    def _when_connected(self, run: ProcedureRun) -> Steps:
        """Begin when the vehicle is heard; what an agent asked before it knew of others does not take it from them."""
        waited = False
        while what := self._awaited(run):
            waited = True
            run.waits_for = f"{what} from system {self.identity.vehicle}"
            yield
        if refusal := self.vehicle.not_commanded:
            return Outcome("refused", refusal)
        until = self.flight.connected_since + self.flight.wait(*HOME_REPORTED)
        while run.moves and self.vehicle.armed and not self.vehicle.located and self.flight.now <= until:
            waited, run.waits_for = True, "the vehicle to report whether and where it flies"
            yield
        if waited and run.bind is not None:
            try:
                run.action = run.bind()
            except ValueError as error:
                return Outcome("refused", str(error))
        if waited and run.by_agent and self.vehicle.overridden and self.vehicle.armed:
            reason = f"override: when the vehicle was heard, others had set {self.vehicle.mode_name}"
            return Outcome("failed", f"{reason} (pilot, ground station or failsafe)", "pilot")
        return (yield from run.procedure.make_steps(self.flight, run, run.action))

    def _awaited(self, run: ProcedureRun) -> str:
        """Return what the vehicle has to report before a run may begin; empty = nothing."""
        if not self.vehicle.connected:
            return "a heartbeat"
        if run.by_agent and self.control.in_doubt:
            return "the time since boot"
        insists = not (run.by_agent or run.yields or run.procedure is STAY)
        takes = not insists and (run.moves or run.procedure.sets_mode)
        unseen = self._late and run.procedure is not HOLD  # a pause cannot wait for a link that is bad
        return "a heartbeat" if takes and (self.vehicle.failsafe_announced or unseen) else ""

    @property
    def _late(self) -> bool:
        """Whether a HEARTBEAT is missing, so that others may have the vehicle, unseen."""
        return self.flight.now - self.vehicle.heard_at > self.flight.wait(*HEARTBEAT_LATE)

    def _send_known(self, message: dialect.MAVLink_message) -> None:
        """Send a command or request, only to a vehicle whose autopilot is known."""
        if not self.vehicle.not_commanded:
            if (translate := self.flight.autopilot.outgoing.get(message.get_type())) is not None:
                translate(message)
            self._send(message)

    def _beat(self) -> None:
        self._heartbeat_at = self.flight.now + HEARTBEAT_EVERY
        kind = self.failsafe.heartbeat_type
        if kind is not None and (self._speaks_for_agent or not self.failsafe.claims_ground_station):
            self._send(dialect.MAVLink_heartbeat_message(kind, *_HEARTBEAT))

    def _heard(self, mode_before: int, was_armed: bool, silence: float) -> None:
        if self.flight.now >= self._heartbeat_at - HEARTBEAT_EARLY:
            self._beat()
        connected, self.vehicle.connected = self.vehicle.connected, True
        if not connected:
            again = f"again after {silence:.1f} s" if math.isfinite(silence) else "now"
            log.info("system %d is heard %s: %s", self.identity.vehicle, again, self._mode_and_arming())
            self.flight.connected_since = self.flight.now
            self._ask_for_streams()
        self.control.heard(mode_before, was_armed, again=not connected)
        self._report_state()
        self._look_at_link()

    def _report_state(self) -> None:
        self._on_reading(Reading("HEARTBEAT", self.vehicle.state()))

    def _look_at_link(self) -> None:
        vehicle = self.vehicle
        self._link_state.look(vehicle.connected, vehicle.heard_at, self.flight.now, self.link_loss)

    def _mode_and_arming(self) -> str:
        return f"{self.vehicle.mode_name}, {'armed' if self.vehicle.armed else 'not armed'}"

    def _hold_outside(self, left: str) -> None:
        """Stop a vehicle that agents fly where it has left a limit of the mission; `left` says which, for people."""
        log.warning("system %d: %s; it is held", self.identity.vehicle, left)
        for run in [run for run in self._runs if run.moves]:
            self.stop(run, Outcome("failed", left, "limits"))
        self._stay()

    def _stay(self) -> None:
        self.begin(
            ProcedureRun("stay", procedure=STAY, action=mode_action(self.vehicle.modes, self.vehicle.modes.guided))
        )

    def _lost(self) -> None:
        self.vehicle.connected = False
        lost = f"no heartbeat for {self.silence:.1f} s"
        log.warning("system %d is lost: %s; it was in %s", self.identity.vehicle, lost, self._mode_and_arming())
        self.commands.clear()
        self.streams.stop()
        self._report_state()
        self._look_at_link()
        for run in list(self._runs):
            if run.procedure is not STAY:  # that one waits until the vehicle is heard again
                self.stop(run, Outcome("failed", f"link lost: {lost}", "link"))

    def _hear_texts(self, texts: list[StatusText]) -> None:
        """Pass on warnings and worse: new ones to the log, all to the agents.

        What hinders an arming that waits is logged as its cause instead.
        """
        for status in texts:
            news = self.warnings.take(status, self.flight.wait(*REPEATS_WITHIN))
            if news is None:
                continue
            severity = SEVERITIES[status.severity]
            if news and not (
                status.text.startswith(self.flight.autopilot.pre_arm) and any(run.cause for run in self._runs)
            ):
                log.warning("system %d says (%s): %s", self.identity.vehicle, severity, status.text)
            if TEXT in self._sources:
                self._on_reading(Reading(TEXT, {"severity": Atom(severity), "text": status.text}))

    def _rebooted(self) -> None:
        log.warning("system %d: the vehicle rebooted", self.identity.vehicle)
        self._rebooted_until = self.flight.now + self.flight.wait(*REBOOT_REPORTED_FOR)
        self.control.rebooted()
        self._report_state()
        for run in [run for run in self._runs if run.moves]:
            self.stop(run, Outcome("failed", "the vehicle rebooted"))
        self._ask_for_streams()

    def _autopilot_changed(self) -> None:
        """Speak to the autopilot that the vehicle turns out to have; end what was asked of another one."""
        self.flight.autopilot = AUTOPILOTS.get(self.vehicle.autopilot, ARDUPILOT)
        self.failsafe.begin(self.flight.now, self.flight.autopilot, self.vehicle.modes)
        self.streams.adopt(self._manifest, self.flight.autopilot, self.flight.now)
        if refusal := self.vehicle.not_commanded:
            log.error("system %d: %s", self.identity.vehicle, refusal)
            self.commands.clear()
            self.streams.stop()
            for run in list(self._runs):
                self.stop(run, Outcome("failed", refusal))
        elif self.vehicle.connected:
            self._ask_for_streams()

    def _ask_for_streams(self) -> None:
        """Request all streams of a vehicle that has appeared or restarted."""
        if not self.vehicle.not_commanded:
            self.streams.request(self.flight.now)
            self.failsafe.begin(self.flight.now, self.flight.autopilot, self.vehicle.modes)


_HEARTBEAT = (dialect.MAV_AUTOPILOT_INVALID, 0, 0, dialect.MAV_STATE_ACTIVE, 3)
"""What follows the type in ours."""
