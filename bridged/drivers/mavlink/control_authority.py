"""Who controls the vehicle: agents and the bridge, or others (a pilot, a ground station, the vehicle's failsafe).

A mode that nobody here asked for is theirs, and any mode in which a failsafe of the vehicle acts. It ends motions of
agents, and lasts until an agent sets the mode, or until they hand the vehicle over: they leave their mode for GUIDED,
in which it obeys agents.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.api import Outcome, Reading
from bridged.drivers.mavlink.actions.context import TEXT_WINDOW, ProcedureContext, ProcedureRun
from bridged.drivers.mavlink.actions.flight import arm

RESTARTS_WITHIN = 1.8
"""Wall seconds without a HEARTBEAT in which a vehicle may have restarted; there is one each second."""
DOUBT = (1.0, 0.7)
"""Mission and wall seconds in which a vehicle reports its time since boot."""


@dataclass(frozen=True, slots=True)
class _Override:
    """A mode that others have set: when, and until when the vehicle's text is waited for."""

    mode: str
    at: float
    until: float


class ControlAuthority:
    """Judges each change of the mode. `runs` are those under way; `end` ends one of them."""

    def __init__(
        self, flight: ProcedureContext, runs: Collection[ProcedureRun], end: Callable[[ProcedureRun, Outcome], None]
    ) -> None:
        self.override = ""
        """The mode that others set last, once they took control from an agent or had an armed vehicle that was first
        heard; empty when an agent has set the mode again, or they have handed the vehicle over."""
        self._flight, self._vehicle, self._runs, self._end = flight, flight.vehicle, runs, end
        self._by_agent = False
        """Whether an agent set the mode last, for all the bridge knows, or was handed the vehicle over."""
        self.pending: _Override | None = None
        """A change of the mode for which the runs that moved the vehicle only wait for their end."""
        self._restarted = False
        """The mode of the next HEARTBEAT is one that the vehicle started with."""
        self._unreported = False
        """The agents do not perceive the override yet."""
        self._to_judge = False
        """A run that judges changes of the mode has not yet judged the last one."""
        self._failsafe_acted = False
        """Whether a failsafe of the vehicle acted at its last HEARTBEAT."""
        self._doubt_until = -math.inf
        """Until when a mode that the vehicle may have started with counts as nobody's."""

    @property
    def in_doubt(self) -> bool:
        """Whether others set the present mode, unless the vehicle has begun with it: its clock is being asked."""
        return self._vehicle.overridden and self._flight.now < self._doubt_until

    def heard(self, mode_before: int, was_armed: bool, *, again: bool) -> None:
        """Take in the mode of a HEARTBEAT; `again` = the vehicle could not be heard before it.

        `mode_before`: number of the mode before (custom_mode); -1 = there was no HEARTBEAT yet. `was_armed`: before it.
        """
        vehicle = self._vehicle
        acts, self._failsafe_acted = vehicle.failsafe_acts and not self._failsafe_acted, vehicle.failsafe_acts
        if mode_before < 0 or self._restarted:
            self._restarted = False
            self._vehicle.overridden = vehicle.mode not in vehicle.modes.ordered or acts
            if vehicle.armed and mode_before < 0:  # in use before this bridge, by a pilot or an agent as its mode says
                if self._vehicle.overridden:
                    self.override, self._unreported = vehicle.mode_name, True
                    self._report_override()
                else:
                    self._by_agent = True
        elif acts or (vehicle.mode != mode_before and not self._by_itself(mode_before, was_armed and not again)):
            asked = self._flight.expects(vehicle.mode) or (again and vehicle.mode == self._flight.asked_last)
            ours = asked and not acts
            self._to_judge = (
                not asked
                and not acts
                and vehicle.mode in vehicle.modes.resting
                and any(run.judges_mode for run in self._runs)
            )
            if self._to_judge:
                return
            handed_over = self._vehicle.overridden and vehicle.modes.hands_over and vehicle.mode == vehicle.modes.guided
            self._vehicle.overridden = not ours and not handed_over
            if ours:
                self._flight.entered(vehicle.mode)
            if self._vehicle.overridden:
                self._set_by_others(by_failsafe=acts)
            elif handed_over and self.override:
                self._by_agent = True
                self._end_override()

    def _by_itself(self, mode_before: int, was_armed: bool) -> bool:
        """Whether the vehicle entered its mode by itself, so that it is in the same hands as before.

        It does so when its motors stop, and at the end of a takeoff that nobody here began.
        """
        vehicle = self._vehicle
        by_mission = was_armed and vehicle.mode == vehicle.modes.auto  # a way home ends by the landing of the mission
        if by_mission and vehicle.modes.resting and not vehicle.armed:
            return True
        if vehicle.mode not in vehicle.modes.resting:
            return False
        took_off = mode_before == vehicle.modes.takeoff and not any(run.moves for run in self._runs)
        return not vehicle.armed or took_off

    def doubts(self, mode_before: int, was_armed: bool, silence: float) -> bool:
        """Whether a HEARTBEAT after `silence` mission seconds may be of a restarted vehicle, so its clock is queried.

        A pilot's switch changes the mode (number `mode_before`, -1: unknown) alone; a restart changes it
        after a silence, or stops the motors as well.
        """
        vehicle = self._vehicle
        changed = mode_before >= 0 and vehicle.mode != mode_before and not self._flight.expects(vehicle.mode)
        changed = changed and not self._by_itself(mode_before, was_armed and silence <= RESTARTS_WITHIN)
        doubts = changed and not self._restarted and ((was_armed and not vehicle.armed) or silence > RESTARTS_WITHIN)
        if doubts:
            self._doubt_until = self._flight.now + self._flight.wait(*DOUBT)
        return doubts

    def rebooted(self) -> None:
        """The vehicle was restarted: its mode is the one that it begins with, set by nobody."""
        self._restarted, self._by_agent, self.pending, self._doubt_until = True, False, None, -math.inf
        self._vehicle.overridden = False
        self._end_override()

    def look(self) -> None:
        """End the runs that moved the vehicle when others set the mode, as soon as the vehicle has reported why."""
        pending, now = self.pending, self._flight.now
        if self._unreported:
            self._report_override()
        if pending is None or now < self._doubt_until:
            return
        warnings = self._flight.texts.warnings(pending.at - self._flight.wait(*TEXT_WINDOW))
        moving = [run for run in self._runs if run.moves]
        if not warnings and now < pending.until and moving:
            return
        self.pending = None
        reason = f"the mode became {pending.mode}, which nobody here asked for ({self._flight.others})"
        for run in moving:
            self._end(run, Outcome("failed", f"{reason}: {warnings}" if warnings else reason, "pilot"))

    def begin(self, run: ProcedureRun) -> None:
        """Take in that a run begins: an agent that moves the vehicle has control of it.

        The vehicle's texts are waited for no longer.
        """
        if self.pending is not None:
            self.pending = replace(self.pending, until=self._flight.now)
            self.look()
        if run.procedure.make_steps is arm and not self._vehicle.armed:
            self._vehicle.overridden = False  # whoever starts the motors answers for the flight
        if run.by_agent and run.moves and not self._vehicle.overridden:
            self._by_agent = True

    def ended(self, run: ProcedureRun, outcome: Outcome) -> None:
        """Take in how a run ended: success of one that moves the vehicle or sets its mode proves our control."""
        if self._to_judge and run.judges_mode:
            self._to_judge, self._vehicle.overridden = False, outcome.state != "succeeded"
        elif run.judges_mode and outcome.cause == "pilot":  # others fly it, perhaps in the mode that the run has set
            self._vehicle.overridden = self._vehicle.armed
        if outcome.state == "succeeded":
            self._vehicle.overridden = self._vehicle.overridden and not (run.moves or run.procedure.sets_mode)
            if run.procedure.takes_control:
                self._by_agent, self._vehicle.held_by_failsafe_at = True, -math.inf
                self._end_override()
            elif run.by_agent and run.moves:
                self._by_agent = True
        elif self._vehicle.system_status == dialect.MAV_STATE_BOOT:
            pass  # nobody has set the mode that it begins with
        elif self._vehicle.overridden and (run.judges_mode or (run.procedure.sets_mode and self._vehicle.armed)):
            self._by_agent = self._by_agent or run.by_agent
            self._set_by_others()

    def _set_by_others(self, *, by_failsafe: bool = False) -> None:
        """A run that sets the mode, or knows which changes end it, judges for itself, unless it yields.

        An agent's yields to a failsafe that has just begun (`by_failsafe`), which may hold in the mode that it sets.

        What was sent before it, and may not have been heard, is not repeated: it would take the vehicle from them.
        """
        name, now = self._vehicle.mode_name, self._flight.now
        self._flight.expect_none()
        for run in [run for run in self._runs if self._vehicle.armed and (run.moves or run.by_agent)]:
            for command in run.commands:
                command.may_repeat = lambda: False
        for run in [
            run for run in self._runs if run.yields or (by_failsafe and run.by_agent and run.procedure.sets_mode)
        ]:
            self._end(run, Outcome("failed", f"the mode became {name}, which nobody here asked for", "pilot"))
        if any(run.procedure.sets_mode or run.judges_mode for run in self._runs):
            return
        self.pending = _Override(name, now, now + self._flight.wait(*TEXT_WINDOW))
        if self._by_agent or self.override:
            self._by_agent, self.override, self._unreported = False, name, True
        self._report_override()

    def _report_override(self) -> None:
        """Let the agents perceive that others have the vehicle, once it is not in doubt."""
        if self._unreported and self._flight.now >= self._doubt_until:
            self._unreported = False
            self._flight.report(Reading("OVERRIDE", {"mode": self.override}))

    def _end_override(self) -> None:
        reported, self.override, self._unreported = self.override and not self._unreported, "", False
        if reported:
            self._flight.report(Reading("OVERRIDE", None))
