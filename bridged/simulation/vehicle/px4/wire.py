"""Messages of PX4 that pymavlink's dialect `ardupilotmega` does not have: each is packed by its own layout.

Their fields are in the order of the wire; the checksum seeds are those of the recorded packets.
"""

import struct

from pymavlink.dialects.v20 import ardupilotmega as dialect


class Px4Message(dialect.MAVLink_message):  # type: ignore[misc]  # pymavlink is not typed
    """A message with fields that are numbers, texts or bytes."""

    id: int
    msgname: str
    fieldnames: tuple[str, ...]
    layout: struct.Struct
    crc_extra: int

    def __init__(self, *values: object) -> None:
        dialect.MAVLink_message.__init__(self, self.id, self.msgname)
        self._fieldnames, self._instance_field, self._instance_offset = list(self.fieldnames), None, -1
        for name, value in zip(self.fieldnames, values, strict=True):
            setattr(self, name, value)

    def pack(self, mav: dialect.MAVLink, force_mavlink1: bool = False) -> bytes:
        """Return the bytes of the packet."""
        payload = self.layout.pack(*(getattr(self, name) for name in self.fieldnames))
        packed: bytes = self._pack(mav, self.crc_extra, payload, force_mavlink1=force_mavlink1)
        return packed


class CurrentMode(Px4Message):
    """CURRENT_MODE: what it does, and what was wanted."""

    id, msgname, crc_extra, layout = 436, "CURRENT_MODE", 193, struct.Struct("<IIB")
    fieldnames = ("custom_mode", "intended_custom_mode", "standard_mode")


class AvailableModes(Px4Message):
    """AVAILABLE_MODES: one of its modes."""

    id, msgname, crc_extra, layout = 435, "AVAILABLE_MODES", 134, struct.Struct("<IIBBB35s")
    fieldnames = ("custom_mode", "properties", "number_modes", "mode_index", "standard_mode", "mode_name")


class Event(Px4Message):
    """EVENT: news by a number; its words are in the component's metadata."""

    id, msgname, crc_extra, layout = 410, "EVENT", 160, struct.Struct("<IIHBBB40s")
    fieldnames = (
        "id", "event_time_boot_ms", "sequence", "destination_component", "destination_system", "log_levels",
        "arguments",
    )  # fmt: skip


class ProtocolVersion(Px4Message):
    """PROTOCOL_VERSION"""

    id, msgname, crc_extra, layout = 300, "PROTOCOL_VERSION", 217, struct.Struct("<HHH8s8s")
    fieldnames = ("version", "min_version", "max_version", "spec_version_hash", "library_version_hash")
