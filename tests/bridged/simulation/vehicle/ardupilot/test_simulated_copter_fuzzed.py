"""The simulated copter and its map bear anything: any message, any bytes, any place."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.framing import Encoder, Framer, WireCounters
from bridged.simulation.vehicle.ardupilot import parameters
from bridged.simulation.vehicle.geodesy import FlatMap, Place
from bridged.simulation.vehicle.motion.dynamics import Vector
from bridged.simulation.vehicle.vehicle import Vehicle
from tests.bridged.sky import HOME
from tests.support.amount import some_of


@pytest.mark.parametrize(
    ("lat", "lon", "alt"), [(91.0, 0.0, 0.0), (0.0, 181.0, 0.0), (0.0, 0.0, math.inf), (math.nan, 0.0, 0.0)]
)
def test_a_place_must_be_on_the_earth(lat: float, lon: float, alt: float) -> None:
    with pytest.raises(ValueError, match="not a place on the earth"):
        Place(lat, lon, alt)


@given(st.floats(-89, 89), st.floats(-180, 180), st.floats(-500, 500), st.floats(-500, 500))
def test_the_map_goes_there_and_back_again(lat: float, lon: float, north: float, east: float) -> None:
    chart = FlatMap(Place(lat, lon, 10.0))
    back = chart.vector(chart.place(Vector(north, east, 5.0)))
    assert math.dist((back.north, back.east, back.up), (north, east, 5.0)) < 1e-3


UNDERSTOOD = [
    "HEARTBEAT", "COMMAND_LONG", "COMMAND_INT", "SET_MODE", "SET_POSITION_TARGET_GLOBAL_INT",
    "SET_POSITION_TARGET_LOCAL_NED", "REQUEST_DATA_STREAM", "TIMESYNC", "PARAM_REQUEST_READ", "PARAM_REQUEST_LIST",
    "PARAM_SET", "MISSION_REQUEST_LIST", "MISSION_REQUEST", "MISSION_REQUEST_INT", "MISSION_COUNT", "MISSION_ITEM",
    "MISSION_ITEM_INT", "MISSION_CLEAR_ALL", "MISSION_SET_CURRENT",
    "RC_CHANNELS_OVERRIDE", "SETUP_SIGNING", "MANUAL_CONTROL",
]  # fmt: skip
COMMANDS = [
    16, 17, 20, 21, 22, 34, 115, 176, 178, 179, 183, 184, 186, 189, 192, 207, 211, 224, 246, 300, 400, 401, 410, 510,
    511, 512, 520,
]  # fmt: skip
PARAMETERS = [name for name, _, _ in parameters.COPTER]
CLASSES = {kind: getattr(dialect, f"MAVLink_{kind.lower()}_message") for kind in UNDERSTOOD}
NUMBERS = st.floats(width=32) | st.sampled_from([0.0, 1.0, -1.0, 4.0, 21196.0]) | st.integers(-500, 500)


@st.composite
def messages(draw: st.DrawFn) -> dialect.MAVLink_message:
    """A message that the vehicle understands, with any payload, as it comes from the wire; often a known command."""
    kind = CLASSES[draw(st.sampled_from(UNDERSTOOD))]
    payload = bytearray(draw(st.binary(min_size=kind.unpacker.size, max_size=kind.unpacker.size)))
    body = bytes([len(payload), 0, 0, 0, 255, 190]) + kind.id.to_bytes(3, "little") + bytes(payload)
    crc = dialect.x25crc(bytearray(body) + bytes([kind.crc_extra])).crc.to_bytes(2, "little")
    (message,) = Framer(WireCounters()).feed(b"\xfd" + body + crc, datagram=True)
    if draw(st.booleans()):
        message.target_system = draw(st.sampled_from([0, 1]))
    if kind is CLASSES["PARAM_SET"] and draw(st.booleans()):
        message.param_id = draw(st.sampled_from(PARAMETERS))
    if kind.id in (75, 76) and draw(st.booleans()):
        message.command = draw(st.sampled_from(COMMANDS))
        for name in ("param1", "param2", "param3", "param4", "param5", "param6", "param7", "z"):
            setattr(message, name, float(draw(NUMBERS)))
    return message


@settings(max_examples=some_of(100, 2), deadline=None)
@given(st.lists(st.binary(max_size=300), max_size=10))
def test_no_bytes_break_the_vehicle(noise: list[bytes]) -> None:
    vehicle, framer, encoder = Vehicle(HOME), Framer(WireCounters()), Encoder(255, 190)
    for data in noise:
        for message in framer.feed(data, datagram=True):
            vehicle.receive(message)
        vehicle.advance(0.1)
    replies = [
        reply.get_type()
        for message in framer.feed(
            encoder.pack(dialect.MAVLink_param_request_read_message(1, 1, b"RTL_ALT", -1)), datagram=True
        )
        for reply in vehicle.receive(message)
    ]
    assert replies == ["PARAM_VALUE"]
