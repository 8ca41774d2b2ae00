"""Flight modes of the simulated copter (ArduCopter's numbers)."""

from enum import IntEnum


class Mode(IntEnum):
    """custom_mode of HEARTBEAT and parameter 2 of MAV_CMD_DO_SET_MODE."""

    STABILIZE = 0
    ACRO = 1
    ALT_HOLD = 2
    AUTO = 3
    GUIDED = 4
    LOITER = 5
    RTL = 6
    CIRCLE = 7
    LAND = 9
    DRIFT = 11
    SPORT = 13
    FLIP = 14
    AUTOTUNE = 15
    POSHOLD = 16
    BRAKE = 17
    THROW = 18
    AVOID_ADSB = 19
    GUIDED_NOGPS = 20
    SMART_RTL = 21
    FLOWHOLD = 22
    FOLLOW = 23
    ZIGZAG = 24
    SYSTEMID = 25
    AUTOROTATE = 26
    AUTO_RTL = 27
    TURTLE = 28

    @property
    def simulated(self) -> bool:
        """Whether the simulation can fly the mode."""
        return self in _SIMULATED

    @property
    def needs_position(self) -> bool:
        """Whether the mode needs a position estimate."""
        return self not in (Mode.STABILIZE, Mode.ACRO, Mode.ALT_HOLD, Mode.LAND)

    @property
    def armable(self) -> bool:
        """Whether the motors can be armed in the mode."""
        return self in _ARMABLE

    @property
    def piloted(self) -> bool:
        """Whether the pilot's sticks move the vehicle."""
        return self in (Mode.STABILIZE, Mode.ALT_HOLD, Mode.LOITER, Mode.POSHOLD)

    @property
    def autonomous(self) -> bool:
        """Whether no pilot steers: the guided bit of HEARTBEAT's base_mode."""
        return self in (Mode.AUTO, Mode.GUIDED, Mode.RTL, Mode.LAND, Mode.BRAKE, Mode.LOITER, Mode.POSHOLD)


_ARMABLE = frozenset((Mode.STABILIZE, Mode.ALT_HOLD, Mode.GUIDED, Mode.LOITER, Mode.POSHOLD))
_SIMULATED = _ARMABLE | {Mode.AUTO, Mode.RTL, Mode.LAND, Mode.BRAKE}


class PlaneMode(IntEnum):
    """The same of an ArduPlane."""

    MANUAL = 0
    CIRCLE = 1
    STABILIZE = 2
    TRAINING = 3
    ACRO = 4
    FBWA = 5
    FBWB = 6
    CRUISE = 7
    AUTOTUNE = 8
    AUTO = 10
    RTL = 11
    LOITER = 12
    TAKEOFF = 13
    AVOID_ADSB = 14
    GUIDED = 15
    INITIALISING = 16
    QSTABILIZE = 17
    QHOVER = 18
    QLOITER = 19
    QLAND = 20
    QRTL = 21
    QAUTOTUNE = 22
    QACRO = 23
    THERMAL = 24
    LOITERALTQLAND = 25
    AUTOLAND = 26

    @property
    def vertical(self) -> bool:
        """Whether only a plane with vertical takeoff has it."""
        return self in _VERTICAL

    @property
    def piloted(self) -> bool:
        """No mode obeys overridden sticks here."""
        return False

    @property
    def autonomous(self) -> bool:
        """Whether no pilot steers: the guided bit of HEARTBEAT's base_mode."""
        return self in _PLANE_AUTONOMOUS


_VERTICAL = frozenset((*range(17, 24), PlaneMode.LOITERALTQLAND))
_PLANE_AUTONOMOUS = frozenset((
    PlaneMode.CIRCLE, PlaneMode.AUTO, PlaneMode.RTL, PlaneMode.LOITER, PlaneMode.TAKEOFF, PlaneMode.GUIDED,
    PlaneMode.THERMAL, PlaneMode.AUTOLAND,
))  # fmt: skip


class RoverMode(IntEnum):
    """The same of a Rover."""

    MANUAL = 0
    ACRO = 1
    STEERING = 3
    HOLD = 4
    LOITER = 5
    FOLLOW = 6
    SIMPLE = 7
    DOCK = 8
    CIRCLE = 9
    AUTO = 10
    RTL = 11
    SMART_RTL = 12
    GUIDED = 15
    INITIALISING = 16

    @property
    def piloted(self) -> bool:
        """No mode obeys overridden sticks here."""
        return False

    @property
    def autonomous(self) -> bool:
        """Whether no pilot steers: the guided bit of HEARTBEAT's base_mode."""
        return self in _ROVER_AUTONOMOUS


_ROVER_AUTONOMOUS = frozenset((
    RoverMode.LOITER, RoverMode.FOLLOW, RoverMode.DOCK, RoverMode.CIRCLE, RoverMode.AUTO, RoverMode.RTL,
    RoverMode.SMART_RTL, RoverMode.GUIDED,
))  # fmt: skip
