"""How a command ended."""

from enum import IntEnum


class Result(IntEnum):
    """result of COMMAND_ACK (MAV_RESULT)."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
