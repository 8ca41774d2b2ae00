"""Messages of PX4 that only a simulated one sends; the checksum seeds are those of the recorded packets."""

from bridged.drivers.mavlink.transport.further_messages import add_message

AvailableModes = add_message(
    435,
    "AVAILABLE_MODES",
    134,
    ("custom_mode", "uint32_t", "I", 0),
    ("properties", "uint32_t", "I", 0),
    ("number_modes", "uint8_t", "B", 0),
    ("mode_index", "uint8_t", "B", 0),
    ("standard_mode", "uint8_t", "B", 0),
    ("mode_name", "char", "s", 35),
)
ProtocolVersion = add_message(
    300,
    "PROTOCOL_VERSION",
    217,
    ("version", "uint16_t", "H", 0),
    ("min_version", "uint16_t", "H", 0),
    ("max_version", "uint16_t", "H", 0),
    ("spec_version_hash", "uint8_t", "B", 8),
    ("library_version_hash", "uint8_t", "B", 8),
)
