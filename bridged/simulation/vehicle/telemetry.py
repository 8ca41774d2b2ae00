"""Messages that all simulated autopilots build alike, from the state of a vehicle."""

import math

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.simulation.vehicle.autopilot import Autopilot

SATELLITES = 10
UNKNOWN_16, INT16 = 65535, 32767


def boot_ms(vehicle: Autopilot) -> int:
    """Return time_boot_ms."""
    return round(vehicle.now * 1000) % 2**32


def boot_us(vehicle: Autopilot) -> int:
    """Return time_usec."""
    return round(vehicle.now * 1e6)


def centi(value: float) -> int:
    """Return hundredths within 16 bits."""
    return max(-INT16, min(INT16, round(value * 100)))


def system_time(vehicle: Autopilot) -> dialect.MAVLink_message:
    """SYSTEM_TIME of a vehicle that knows no date."""
    return dialect.MAVLink_system_time_message(0, boot_ms(vehicle))


def attitude(vehicle: Autopilot) -> dialect.MAVLink_message:
    """ATTITUDE"""
    roll, pitch = vehicle.motion.tilt
    yaw = math.remainder(vehicle.motion.heading, 2 * math.pi)
    return dialect.MAVLink_attitude_message(boot_ms(vehicle), roll, pitch, yaw, 0, 0, vehicle.motion.turn_rate)


def local_position_ned(vehicle: Autopilot) -> dialect.MAVLink_message:
    """LOCAL_POSITION_NED"""
    at, velocity = vehicle.motion.position, vehicle.motion.velocity
    return dialect.MAVLink_local_position_ned_message(
        boot_ms(vehicle), at.north, at.east, -at.up, velocity.north, velocity.east, -velocity.up
    )


def global_position_int(vehicle: Autopilot, *, known: bool = True) -> dialect.MAVLink_message:
    """GLOBAL_POSITION_INT; zeros while the position is not `known`."""
    place, velocity = vehicle.place, vehicle.motion.velocity
    relative = round((vehicle.motion.up.position - vehicle.home_on_chart.up) * 1000)
    position = (place.lat_e7, place.lon_e7, place.alt_mm, relative) if known else (0, 0, 0, 0)
    return dialect.MAVLink_global_position_int_message(
        boot_ms(vehicle), *position, centi(velocity.north), centi(velocity.east), centi(-velocity.up),
        round(vehicle.motion.bearing * 100) % 36000,
    )  # fmt: skip


def vfr_hud(vehicle: Autopilot, *, throttle: int, has_airspeed: bool = True) -> dialect.MAVLink_message:
    """VFR_HUD; `throttle` in per cent of a vehicle under way."""
    speed, climb = vehicle.motion.velocity.flat(), vehicle.motion.up.velocity
    throttle = throttle if vehicle.armed and vehicle.flight.airborne else 0
    heading = round(vehicle.motion.bearing) % 360
    airspeed = speed if has_airspeed else math.nan
    return dialect.MAVLink_vfr_hud_message(airspeed, speed, heading, throttle, vehicle.place.alt, climb)


def gps_raw_int(
    vehicle: Autopilot, fix_type: int, dilution: tuple[int, int], accuracy: tuple[int, int, int]
) -> dialect.MAVLink_message | None:
    """GPS_RAW_INT of a vehicle with a fix, with `dilution` (eph, epv) and `accuracy` (h, v, velocity) as recorded."""
    place, velocity = vehicle.gps_place, vehicle.motion.velocity
    if place is None:
        return None
    course = math.degrees(math.atan2(velocity.east, velocity.north)) % 360.0
    return dialect.MAVLink_gps_raw_int_message(
        boot_us(vehicle), fix_type, place.lat_e7, place.lon_e7, place.alt_mm, *dilution,
        min(UNKNOWN_16, centi(velocity.flat())), round(course * 100) % 36000, SATELLITES,
        place.alt_mm, *accuracy, 0, 0,
    )  # fmt: skip


def home_position(vehicle: Autopilot, attitude: float = math.nan) -> dialect.MAVLink_message | None:
    """HOME_POSITION, once home is set; `attitude`: the first number of the quaternion, NaN: it is not known."""
    home, at = vehicle.home, vehicle.home_on_chart
    if home is None:
        return None
    q = [attitude, 0, 0, 0] if math.isfinite(attitude) else [attitude] * 4
    return dialect.MAVLink_home_position_message(
        home.lat_e7, home.lon_e7, home.alt_mm, at.north, at.east, -at.up, q, 0, 0, 0, boot_us(vehicle)
    )


def gps_global_origin(vehicle: Autopilot) -> dialect.MAVLink_message:
    """GPS_GLOBAL_ORIGIN"""
    origin = vehicle.chart.origin
    return dialect.MAVLink_gps_global_origin_message(origin.lat_e7, origin.lon_e7, origin.alt_mm, boot_us(vehicle))


def vibration(vehicle: Autopilot) -> dialect.MAVLink_message:
    """VIBRATION: none."""
    return dialect.MAVLink_vibration_message(boot_us(vehicle), 0.0, 0.0, 0.0, 0, 0, 0)
