"""Messages of PX4 that pymavlink's dialect `ardupilotmega` does not have, added to it when this module is imported.

CURRENT_MODE tells a failsafe from a mode that somebody set; EVENT carries reasons for which PX4 sends no text.
"""

from __future__ import annotations

import struct
from typing import ClassVar

from pymavlink.dialects.v20 import ardupilotmega as dialect


def add_message(
    number: int, name: str, checksum: int, *fields: tuple[str, str, str, int]
) -> type[dialect.MAVLink_message]:
    """Add a message: its fields in the order of the wire, each with its C type, struct code and array length (0: none).

    A text is one value, whatever its length. `checksum` is the seed that MAVLink derives from the names and types of
    the fields (CRC_EXTRA).
    """
    layout = struct.Struct("<" + "".join(f"{length or ''}{code}" for _, _, code, length in fields))

    class Message(dialect.MAVLink_message):  # type: ignore[misc]  # pymavlink is not typed
        id = number
        msgname = name
        fieldnames: ClassVar = [field for field, *_ in fields]
        ordered_fieldnames: ClassVar = fieldnames
        fieldtypes: ClassVar = [kind for _, kind, _, _ in fields]
        fielddisplays_by_name: ClassVar[dict[str, str]] = {}
        fieldenums_by_name: ClassVar[dict[str, str]] = {}
        fieldunits_by_name: ClassVar[dict[str, str]] = {}
        native_format = bytearray(("<" + "".join(code for _, _, code, _ in fields)).encode())
        orders: ClassVar = list(range(len(fields)))
        lengths: ClassVar = [1 if code == "s" else length or 1 for _, _, code, length in fields]
        array_lengths: ClassVar = [length for *_, length in fields]
        crc_extra = checksum
        unpacker = layout
        instance_field = None
        instance_offset = -1

        def __init__(self, *values: object) -> None:
            dialect.MAVLink_message.__init__(self, number, name)
            self._fieldnames, self._instance_field, self._instance_offset = self.fieldnames, None, -1
            for field, value in zip(self.fieldnames, values, strict=True):
                setattr(self, field, value)

        def pack(self, mav: dialect.MAVLink, force_mavlink1: bool = False) -> bytes:
            flat: list[object] = []
            for (field, *_), length in zip(fields, self.lengths, strict=True):
                value = getattr(self, field)
                flat += value if length > 1 else [value]
            packed: bytes = self._pack(mav, self.crc_extra, self.unpacker.pack(*flat), force_mavlink1=force_mavlink1)
            return packed

    dialect.mavlink_map[number] = Message
    setattr(dialect, f"MAVLINK_MSG_ID_{name}", number)
    return Message


CurrentMode = add_message(
    436,
    "CURRENT_MODE",
    193,
    ("custom_mode", "uint32_t", "I", 0),
    ("intended_custom_mode", "uint32_t", "I", 0),
    ("standard_mode", "uint8_t", "B", 0),
)
Event = add_message(
    410,
    "EVENT",
    160,
    ("id", "uint32_t", "I", 0),
    ("event_time_boot_ms", "uint32_t", "I", 0),
    ("sequence", "uint16_t", "H", 0),
    ("destination_component", "uint8_t", "B", 0),
    ("destination_system", "uint8_t", "B", 0),
    ("log_levels", "uint8_t", "B", 0),
    ("arguments", "uint8_t", "B", 40),
)
