"""The autopilot's estimate of its position: what it makes of a GPS that is lost or wrong (EKF3 of ArduPilot).

A GPS position that is too far from the estimate is rejected; after `TIMEOUT_S` the estimator gives in and takes it.
Without any GPS it goes on by its inertial sensors for as long, and then has no position: a copter that needs one lands
(FS_EKF_ACTION), and drifts with the wind meanwhile.
"""

from dataclasses import dataclass, field

from bridged.simulation.vehicle.motion.dynamics import Vector

GATE = 5.0
"""Metres between GPS and estimate that are accepted (EK3_POS_I_GATE)."""
TIMEOUT_S = 7.0
"""Seconds without an accepted GPS position after which the estimator gives in (EKF3: gpsRetryTimeNoTAS_ms)."""
NOTICED_S = 1.0
"""Seconds for which the GPS is rejected, or the position lost, before the autopilot reports it and acts."""
FOUND_S = 10.0
"""Seconds of a good GPS until an estimator without a position uses it."""


@dataclass(slots=True)
class PositionEstimate:
    """Horizontal errors in metres; times are vehicle seconds. Position = truth without GPS faults."""

    gps: Vector | None = field(default_factory=Vector)
    """GPS position minus the true one; None: no fix."""
    error: Vector = field(default_factory=Vector)
    """Estimated position minus the true one."""
    lost: bool = False
    """Whether there is no estimate."""
    glitching: bool = False
    """Whether the GPS is rejected."""
    failed: bool = False
    """Whether the position has been lost for long enough to act."""
    reported: tuple[bool, bool] = (False, False)
    """`glitching` and `failed`, as the autopilot has reported them."""
    _since: float | None = None
    """Since when another state than the present one is due."""
    _lost_at: float = 0.0

    def step(self, now: float) -> Vector:
        """Advance to `now`; return the shift of the estimate in metres: it jumps where it is reset to the GPS."""
        gps = self.gps
        if self.lost:
            changes, wait = gps is not None, FOUND_S
        else:
            changes, wait = gps is None or gps.distance(self.error) > GATE, TIMEOUT_S
        self._since = None if not changes else now if self._since is None else self._since
        if self._since is not None and now - self._since >= wait:
            self._since, self.lost, self._lost_at = None, gps is None, now
        self.failed = self.lost and now - self._lost_at >= NOTICED_S
        rejects = gps is not None and not self.lost and self._since is not None
        self.glitching = rejects and self._since is not None and now - self._since >= NOTICED_S
        if gps is None or self.lost or self._since is not None:
            return Vector()
        shift = Vector(gps.north - self.error.north, gps.east - self.error.east)
        self.error = Vector(gps.north, gps.east)
        return shift

    def drift(self, air: Vector, dt: float) -> None:
        """Let a copter that does not know where it is be carried away by the air for `dt` seconds."""
        self.error = Vector(self.error.north - air.north * dt, self.error.east - air.east * dt)
