"""The faults that need no process of their own: a bridge, a copter and bad air in virtual time."""

from pathlib import Path

from pymavlink.dialects.v20 import ardupilotmega as dialect

from schemas.wire.terms import Atom
from tests.bridged.sky import Message
from tests.faults.air import GOAL, BadAir, resident
from tests.faults.rows import Maker, Row


def _row(fault: str, injected: str) -> Row:
    return Row(fault, f"virtual time, real packets: {injected}")


def _close(row: Row, sky: BadAir, before: float) -> Row:
    """Note what every row tells: what was counted, and what was held."""
    counters = sky.driver.counters()
    reported = {
        name: int(counters[name]) for name in ("commands_repeated", "streams_requested", "reboots") if counters[name]
    }
    row.seen.append(
        ", ".join(f"{name.replace('_', ' ')}: {value}" for name, value in reported.items()) or "nothing repeated"
    )
    slots, running = len(sky.bridge.percepts._slots), len(sky.bridge.action_server.running)
    row.bound = f"{slots} percepts, {running} actions left; process +{resident() - before:.1f} MB"
    row.expect(running == 0, "no action is left running")
    row.expect(slots < 50, "the percepts held are those of the manifest")
    sky.bridge.action_log.close()
    return row


def _air(row: Row, sky: BadAir) -> None:
    up, down = sky.air_up.counters, sky.air_down.counters
    total = up.passed + up.lost + down.passed + down.lost
    row.seen.append(
        f"of {total} packets {up.lost + down.lost} lost, {up.duplicated + down.duplicated} twice, "
        f"{up.reordered + down.reordered} late, noise {up.garbage + down.garbage} times"
    )


def _mission(state: Path, fault: str, injected: str, *faults: str) -> Row:
    """The whole mission through bad air: all of it must be done."""
    row, before = _row(fault, injected), resident()
    sky = BadAir(state, *faults)
    sky.fly(row, times=3)
    for wanted in ("set_mode", "arm_motors", "takeoff", "goto", "return_to_launch"):
        ends = [ended.finals[-1].state for ended in row.ended if ended.call.startswith(wanted)]
        row.expect(ends and ends[-1] == "succeeded", f"{wanted} is done in three tries at most")
    _air(row, sky)
    return _close(row, sky, before)


def packet_loss(state: Path) -> Row:
    """One packet in five is lost, both ways."""
    return _mission(state, "packet loss 20 % both ways", "`loss=0.2`", "loss=0.2")


def duplicates(state: Path) -> Row:
    """Datagrams come twice and out of order."""
    faults = "duplicate=0.3,reorder=0.3"
    return _mission(state, "duplicated and reordered datagrams", f"`{faults}`", faults)


def garbage(state: Path) -> Row:
    """Noise stands between packets, half of it with a packet's first byte."""
    return _mission(state, "garbage between packets", "`garbage=0.5`", "garbage=0.5")


def acts_in_silence(state: Path) -> Row:
    """The vehicle does what it is told, and never acknowledges."""
    row = _mission(state, "acts and never acknowledges", "`mute-acks`", "mute-acks")
    row.expect(len(row.ended) == 5, "each action is done at the first try")
    return row


def lies(state: Path) -> Row:
    """The vehicle acknowledges everything and does nothing."""
    row, before = _row("acknowledges and does nothing", "`lie`"), resident()
    sky = BadAir(state, "lie")
    for name, *parameters in (("set_mode", "GUIDED"), ("arm_motors", True), ("takeoff", 5)):
        ended = sky.perform(row, str(name), *parameters)
        row.expect(ended.finals[-1].state in ("failed", "refused", "timed_out"), f"{name} is not called done")
    return _close(row, sky, before)


def reboot(state: Path) -> Row:
    """The autopilot restarts on the way, and the copter falls."""
    row, before = _row("reboot in flight", "`reboot` 2 s into `goto`"), resident()
    sky = BadAir(state).flying(15)
    sky.faults(f"reboot={sky.vehicle.age + 2}")
    ended = sky.perform(row, "goto", *GOAL)
    row.expect(ended.finals[-1].state == "failed" and "reboot" in ended.finals[-1].reason, "the reason is the reboot")
    count, since = _positions(sky), sky.clock.time
    sky.wait(20)
    rate = (_positions(sky) - count) / (sky.clock.time - since)
    row.seen.append(f"positions again at {rate:.1f} Hz, without being asked by anybody else")
    row.expect(rate > 0.3, "the streams are asked for again")
    return _close(row, sky, before)


def two_stations(state: Path) -> Row:
    """Another ground station sets the streams to 1 Hz every 5 s."""
    row, before = _row("two ground stations fighting over stream rates", "REQUEST_DATA_STREAM of 255/230"), resident()
    sky = BadAir(state)
    asked = [0]

    def station(now: float) -> list[Message]:
        if now < 5 * asked[0]:
            return []
        asked[0] += 1
        slow = dialect.MAVLink_request_data_stream_message(1, 1, dialect.MAV_DATA_STREAM_ALL, 1, 1)
        slow._header.srcSystem, slow._header.srcComponent = 255, 230
        return [slow]

    sky.station = station
    sky.fly(row)
    row.expect(all(ended.finals[-1].state == "succeeded" for ended in row.ended), "the mission is done")
    row.seen.append(f"the other station asked {asked[0]} times")
    return _close(row, sky, before)


def link_cut(state: Path) -> Row:
    """Nothing passes for a minute, with an action under way."""
    row, before = _row("link cut for 60 s", "`cut` 2 s into `goto`, for 60 s"), resident()
    sky = BadAir(state).flying(15)
    cut = sky.clock.time + 2
    sky.faults(f"cut={cut}+60")
    ended = sky.perform(row, "goto", *GOAL)
    row.expect(ended.finals[-1].state == "failed" and "link lost" in ended.finals[-1].reason, "the reason is the link")
    sky.forward(lambda: sky.belief("link") == (Atom("down"),), "link(down)")
    row.seen.append(f"`link(down)` {sky.clock.time - cut:.1f} s after the cut")
    sky.forward(lambda: sky.belief("altitude") is None, "altitude aged")
    state_told = sky.belief("state")
    row.expect(state_told == ("", False, False), f"state says not connected, said {state_told}")
    sky.forward(lambda: sky.clock.time > cut + 60, "the end of the cut")
    back = sky.forward(lambda: sky.belief("altitude") is not None and sky.belief("link") == (Atom("up"),), "percepts")
    row.seen.append(f"percepts again {back:.1f} s after the link")
    sky.perform(row, "goto", *GOAL)
    sky.perform(row, "return_to_launch")
    row.expect([one.finals[-1].state for one in row.ended[1:]] == ["succeeded"] * 2, "it goes on after the cut")
    return _close(row, sky, before)


def _positions(sky: BadAir) -> int:
    return sky.driver.vehicle.positions


VIRTUAL: tuple[Maker, ...] = (packet_loss, duplicates, garbage, lies, acts_in_silence, reboot, two_stations, link_cut)
