"""Cameras and gimbals that are MAVLink components of a vehicle's system, with packets of their own."""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Encoder
from bridged.simulation.vehicle.geodesy import Place
from bridged.simulation.vehicle.notifications import Result
from bridged.simulation.vehicle.payload import Gimbal

Message = dialect.MAVLink_message
CAMERA, GIMBAL = dialect.MAV_COMP_ID_CAMERA, dialect.MAV_COMP_ID_GIMBAL


class Component:
    """A component that beats once a second, and acknowledges the commands that are for it."""

    kind: int
    """MAV_TYPE"""

    def __init__(self, number: int, system: int = 1) -> None:
        self.number, self.now = number, 0.0
        self.outbox: list[Message] = []
        self.commands: list[Message] = []
        """Those that were for it, but for requests of messages."""
        self.acknowledges = True
        self._encoder = Encoder(system, number)
        self._beats_at = 0.0

    def takes(self, message: Message) -> bool:
        """Take in a message of the bridge if it is for this component; return whether it is."""
        if message.get_type() not in ("COMMAND_LONG", "COMMAND_INT") or message.target_component != self.number:
            return False
        if message.command == dialect.MAV_CMD_REQUEST_MESSAGE:
            found = self.build(int(message.param1))
            self.outbox += [self._ack(message, Result.DENIED if found is None else Result.ACCEPTED)]
            self.outbox += [] if found is None else [found]
            return True
        self.commands.append(message)
        after: list[Message] = []
        result = self.carry_out(message, after)
        self.outbox += [self._ack(message, result)] if self.acknowledges else []
        self.outbox += after
        return True

    def step(self, now: float) -> list[bytes]:
        """Return the packets that are sent at a time."""
        self.now = now
        if now >= self._beats_at:
            self._beats_at = now + 1.0
            self.outbox.append(
                dialect.MAVLink_heartbeat_message(self.kind, dialect.MAV_AUTOPILOT_INVALID, 128, 77, 4, 3)
            )
        sent, self.outbox = [self._encoder.pack(message) for message in self.outbox], []
        return sent

    def carry_out(self, command: Message, after: list[Message]) -> Result:
        """Carry out a command; what it sends after the acknowledgement is appended."""
        raise NotImplementedError

    def build(self, number: int) -> Message | None:
        """Return a message that is requested; None if it has no such."""
        raise NotImplementedError

    def _ack(self, command: Message, result: Result) -> Message:
        sender = (command.get_srcSystem(), command.get_srcComponent())
        return dialect.MAVLink_command_ack_message(command.command, int(result), 0, 0, *sender)


class CameraComponent(Component):
    """A camera with pictures, video, modes and zoom."""

    kind = dialect.MAV_TYPE_CAMERA

    def __init__(self, number: int = CAMERA) -> None:
        super().__init__(number)
        self.pictures, self.mode, self.zoom, self.video = 3, 0, 0.0, False
        self.works, self.announces, self.counts, self.obeys = True, True, True, True
        self._last = -1.0
        """The number of the last command that took a picture: a repetition takes none."""

    def carry_out(self, command: Message, after: list[Message]) -> Result:
        match command.command:
            case dialect.MAV_CMD_IMAGE_START_CAPTURE:
                if self.obeys and command.param4 != self._last:
                    self._last = command.param4
                    self.pictures += self.works
                    after += [self._captured()] if self.announces else []
            case dialect.MAV_CMD_VIDEO_START_CAPTURE | dialect.MAV_CMD_VIDEO_STOP_CAPTURE:
                self.video = command.command == dialect.MAV_CMD_VIDEO_START_CAPTURE and self.obeys
            case dialect.MAV_CMD_SET_CAMERA_MODE:
                self.mode = int(command.param2)
            case dialect.MAV_CMD_SET_CAMERA_ZOOM:
                self.zoom = command.param2
            case _:
                return Result.UNSUPPORTED
        return Result.ACCEPTED

    def build(self, number: int) -> Message | None:
        if number == dialect.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS and self.counts:
            return dialect.MAVLink_camera_capture_status_message(0, 0, int(self.video), 0, 0, 1000.0, self.pictures)
        if number == dialect.MAVLINK_MSG_ID_CAMERA_SETTINGS:
            return dialect.MAVLink_camera_settings_message(0, self.mode, self.zoom)
        return None

    def _captured(self) -> Message:
        return dialect.MAVLink_camera_image_captured_message(
            0, 0, 0, 0, 0, 0, 0, [1.0, 0.0, 0.0, 0.0], self.pictures - 1, int(self.works), b"mavlinkftp://picture.jpg"
        )


class GimbalComponent(Component):
    """A gimbal that is its own manager, and obeys who is in control alone."""

    kind = dialect.MAV_TYPE_GIMBAL

    def __init__(self, number: int = GIMBAL) -> None:
        super().__init__(number)
        self.gimbal = Gimbal(device=number)
        self.gives_control = True

    def carry_out(self, command: Message, after: list[Message]) -> Result:
        match command.command:
            case dialect.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE:
                return self.gimbal.configure(command.param1, command.param2) if self.gives_control else Result.DENIED
            case dialect.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW:
                if self.gimbal.by != (command.get_srcSystem(), command.get_srcComponent()):
                    return Result.DENIED
                return self.gimbal.point(command.param1, command.param2, command.param5, self.now)
        return Result.UNSUPPORTED

    def build(self, number: int) -> Message | None:
        if number == dialect.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS:
            return self.gimbal.status(0)
        if number == dialect.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS:
            return self.gimbal.attitude(Place(0.0, 0.0, 0.0), 0.0, self.now)
        return None
