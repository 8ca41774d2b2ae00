"""The log protocol of a simulated vehicle (LOG_REQUEST_LIST, LOG_REQUEST_DATA), and the small logs that it serves."""

import struct
from collections.abc import Iterable, Sequence

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.messages import Messages

LOG_MESSAGES = frozenset(("LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_REQUEST_END", "LOG_ERASE"))
PIECE = 90
"""Bytes of one LOG_DATA."""
MAX_PIECES = 512
"""Pieces sent for one request."""


class LogTransfer:
    """Serves logs by their ids, which count from `first` (1 at ArduPilot, 0 at PX4). Silent while armed."""

    def __init__(self, logs: Sequence[bytes], first: int = 1) -> None:
        self._logs, self._first = logs, first

    def receive(self, message: dialect.MAVLink_message, *, armed: bool) -> Messages:
        """Answer one message of the log protocol."""
        if armed:
            return []
        match message.get_type():
            case "LOG_REQUEST_LIST":
                return [self._entry(index) for index in range(len(self._logs))] or [_NO_LOGS]
            case "LOG_REQUEST_DATA" if 0 <= message.id - self._first < len(self._logs):
                return list(self._data(message))
        return []

    def _entry(self, index: int) -> dialect.MAVLink_message:
        count = len(self._logs)
        last = self._first + count - 1
        return dialect.MAVLink_log_entry_message(self._first + index, count, last, 0, len(self._logs[index]))

    def _data(self, asked: dialect.MAVLink_message) -> Iterable[dialect.MAVLink_message]:
        log = self._logs[asked.id - self._first]
        end = min(len(log), asked.ofs + asked.count, asked.ofs + MAX_PIECES * PIECE)
        for at in range(asked.ofs, end, PIECE):
            piece = log[at : min(at + PIECE, end)]
            yield dialect.MAVLink_log_data_message(asked.id, at, len(piece), list(piece.ljust(PIECE, b"\0")))


_NO_LOGS = dialect.MAVLink_log_entry_message(0, 0, 0, 0, 0)
_HEAD, _FMT, _PARM, _MSG = b"\xa3\x95", 128, 129, 130
"""Begin of a record of a DataFlash log, and its types."""


def dataflash_log(parameters: Iterable[tuple[str, float]]) -> bytes:
    """Return a log of ArduPilot's format with a line of text and the parameters, each as it is now."""
    records = [
        _format(_FMT, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"),
        _format(_PARM, 31, "PARM", "QNf", "TimeUS,Name,Value"),
        _format(_MSG, 75, "MSG", "QZ", "TimeUS,Message"),
        _HEAD + struct.pack("<BQ64s", _MSG, 0, b"simulated vehicle of Argosy"),
        *(_HEAD + struct.pack("<BQ16sf", _PARM, 0, name.encode(), value) for name, value in parameters),
    ]
    return b"".join(records)


def _format(kind: int, length: int, name: str, types: str, columns: str) -> bytes:
    texts = (name.encode(), types.encode(), columns.encode())
    return _HEAD + struct.pack("<BBB4s16s64s", _FMT, kind, length, *texts)


def ulog(parameters: Iterable[tuple[str, float, bool]]) -> bytes:
    """Return a log of PX4's format with the parameters: name, value, and whether it is an integer."""
    version = 1
    head = b"ULog\x01\x12\x35" + struct.pack("<BQ", version, 0)
    records = [_ulog_record(b"B", bytes(40)), _ulog_value(b"I", "char[9] sys_name", b"simulated")]
    for name, value, whole in parameters:
        kind, content = ("int32_t", struct.pack("<i", int(value))) if whole else ("float", struct.pack("<f", value))
        records.append(_ulog_value(b"P", f"{kind} {name}", content))
    return head + b"".join(records)


def _ulog_value(kind: bytes, key: str, value: bytes) -> bytes:
    return _ulog_record(kind, bytes([len(key)]) + key.encode() + value)


def _ulog_record(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<Hc", len(content), kind) + content
