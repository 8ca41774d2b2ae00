"""MAVLink 2 signing of a simulated vehicle: the key that it keeps, and what it takes without a signature."""

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Gate
from bridged.drivers.mavlink.transport.signed_streams import LATEST
from bridged.drivers.mavlink.transport.signing import Signing
from bridged.simulation.copter.copter import Copter
from bridged.simulation.copter.protocol.notifications import Severity

UNSIGNED_TAKEN = frozenset((dialect.MAVLINK_MSG_ID_RADIO_STATUS, dialect.MAVLINK_MSG_ID_RADIO))
"""What telemetry radios put on a link by themselves; they have no key (ArduPilot takes it everywhere)."""

OPEN_CHANNEL = 0
"""The first link of an autopilot, its USB plug: whoever has hands on it needs no signature (ArduPilot), unless the
vehicle was started with a key."""


class Seal:
    """The key of one vehicle, if it has one. It survives a reboot."""

    def __init__(self, key: bytes | None = None) -> None:
        self.everywhere = key is not None
        """Whether signatures are asked for on the first link too."""
        self.signing = Signing(key) if key is not None else None

    def set_up(self, message: dialect.MAVLink_message, copter: Copter) -> None:
        """SETUP_SIGNING: from now on the vehicle signs; a key of zeros ends it. Refused with motors on (ArduPilot)."""
        if copter.armed:
            copter.say("ERROR: Won't setup signing when armed", Severity.CRITICAL)
            return
        key = bytes(message.secret_key)
        if not any(key) and message.initial_timestamp == 0:
            self.signing = None
            return
        if message.initial_timestamp > LATEST:
            copter.say("ERROR: signing timestamp beyond 48 bits", Severity.CRITICAL)
            return
        self.signing = Signing(key)
        self.signing.timestamps.heard(message.initial_timestamp)

    def gate(self, channel: int) -> Gate:
        """What a link asks about the packets that come in."""
        return _SealedGate(self, channel)


class _SealedGate(Gate):
    def __init__(self, seal: Seal, channel: int) -> None:
        self._seal = seal
        self._open = channel == OPEN_CHANNEL
        self._message = 0

    def wants(self, system: int, message_id: int) -> bool:
        self._message = message_id  # of the packet about which `signing` is asked next
        return True

    def signing(self, system: int) -> Signing | None:
        if self._message in UNSIGNED_TAKEN or (self._open and not self._seal.everywhere):
            return None
        return self._seal.signing
