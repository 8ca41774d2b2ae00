"""Attacks on the link of a vehicle: real MAVLink packets at the port of a bridge in this process."""

import shutil
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.transport.signing import Signing, key_of
from schemas.wire.records import Note
from tests.attacks.world import Attack, Row, World, attack
from tests.bridged.radio import COPTER, Ride, Speaker, place, riding
from tests.support.buses import until
from tests.support.ports import free_port

GUIDED = dialect.MAVLink_heartbeat_message(2, 3, 129 | 8, 4, 4, 3)
"""Of an armed copter that takes targets."""
CAMERA = dialect.MAVLink_heartbeat_message(30, 8, 0, 0, 4, 3)


@attack(
    "telemetry in the vehicle's name from a second port",
    "positions at the goal, acknowledgements and HEARTBEATs of 1/1 at the bridge's `udpin` port, from another port "
    "than the vehicle's, during a `goto`; no signing",
    "the bridge: a vehicle is a system id and the address that its HEARTBEATs come from",
)
async def telemetry_from_elsewhere(row: Row, world: World) -> None:
    """Somebody on the network of a vehicle says in its name where it is, and that it obeys."""
    port = free_port()
    async with riding(f"link: 'udpin:127.0.0.1:{port}'") as [ride]:
        vehicle, forger = Speaker(port), Speaker(port)
        vehicle.say(GUIDED, place(5.0))
        state = ride.driver.vehicle
        await until(lambda: state.positions == 1, "the vehicle is heard")
        goal_of_agent = {"latitude": -27.61, "longitude": -48.52, "altitude": 20.0}
        action = ride.driver.perform("goto", COPTER.actions["goto"], goal_of_agent)
        goal = dialect.MAVLink_global_position_int_message(0, -276100000, -485200000, 20000, 20000, 0, 0, 0, 0)
        target = dialect.MAVLink_position_target_global_int_message(
            0, 6, 3576, -276100000, -485200000, 20.0, 0, 0, 0, 0, 0, 0, 0, 0
        )
        for _ in range(20):
            forger.say(goal, target, dialect.MAVLink_command_ack_message(192, 0))
        await until(lambda: ride.driver.counters()["foreign_packets"] == 60, "what is forged is counted")
        vehicle.say(GUIDED)
        await until(lambda: state.heartbeats == 2, "the vehicle is heard again")
        row.expect(state.positions == 1, "the vehicle is where it says itself")
        row.expect(not action.over, f"`goto` is not called done: {action.outcome}")
        reported = _reported(ride, "foreign_packets")
        row.expect(
            reported is not None and f"udp:127.0.0.1:{forger.port}" in reported.text,
            f"health names the forger: {reported}",
        )
        forger.say(GUIDED)
        vehicle.say(GUIDED, place(6.0))
        await until(lambda: state.positions == 2, "its own position is taken")
        two = _reported(ride, "two_vehicles")
        row.expect(two is not None, "a second HEARTBEAT is a second vehicle")
        row.expect(not forger.listen(), "no order of ours goes to the forger")
        vehicle.close()
        forger.close()
    row.seen.append(
        f"60 packets not taken, `goto` goes on; health, `foreign_packets`: `{reported.text if reported else ''}`"
    )
    row.seen.append(f"with HEARTBEATs as well: `{two.text if two else ''}`; neither is armed or moved meanwhile")


@attack(
    "messages in a camera's name from a second port",
    "HEARTBEATs, an acknowledgement and CAMERA_IMAGE_CAPTURED of 1/100 at the bridge's `udpin` port, from another port "
    "than the camera's, during a `take_picture`; no signing",
    "the bridge: a part of a vehicle is at one address at a time",
)
async def pictures_from_elsewhere(row: Row, world: World) -> None:
    """Somebody on the network of a vehicle says in its camera's name that a picture was taken."""
    port = free_port()
    async with riding(f"link: 'udpin:127.0.0.1:{port}'") as [ride]:
        vehicle = Speaker(port)
        camera, forger = Speaker(port, component=100), Speaker(port, component=100)
        vehicle.say(GUIDED, place(5.0))
        camera.say(CAMERA)
        await until(lambda: ride.driver.flight.present([100]), "the camera is heard")
        action = ride.driver.perform("take_picture", COPTER.actions["take_picture"], {"camera": 0})
        await until(lambda: _asked(camera), "the camera is asked")
        shot = dialect.MAVLink_camera_image_captured_message(0, 0, 1, 0, 0, 0, 0, [0, 0, 0, 1], 7, 1, b"forged")
        forged = (CAMERA, dialect.MAVLink_command_ack_message(dialect.MAV_CMD_IMAGE_START_CAPTURE, 0), shot)
        forger.say(*forged)
        await until(lambda: ride.driver.counters()["foreign_packets"] == len(forged), "what is forged is counted")
        row.expect(not action.over, f"no picture is called taken: {action.outcome}")
        row.expect(not forger.listen(), "nothing that is for the camera goes to the forger")
        reported = _reported(ride, "foreign_packets")
        before = ride.driver.counters()["messages"]
        camera.say(CAMERA)
        await until(lambda: ride.driver.counters()["messages"] == before, "the camera itself is heard")
    row.seen.append(f"`take_picture` goes on; health, `foreign_packets`: `{reported.text if reported else ''}`")


@attack(
    "signed packets of before a restart of the bridge",
    "5 HEARTBEATs of an armed vehicle, rightly signed, are taken; then sent again, from another port, to a bridge "
    "with the state folder that was left in order, and to one with that of the middle of the work, as of kill -9",
    "the bridge: the last timestamps of the vehicle's streams are kept, written ahead",
)
async def signed_packets_again(row: Row, world: World) -> None:
    """Somebody records what a signed vehicle sends, and sends it to the bridge once it was restarted."""
    with TemporaryDirectory() as folder:
        kept, crashed = Path(folder) / "kept", Path(folder) / "crashed"
        phrase = Path(folder) / "phrase"
        phrase.write_text("argo\n")
        phrase.chmod(0o600)
        port, signing = free_port(), Signing(key_of(b"argo"))
        fields = f"link: 'udpin:127.0.0.1:{port}', signing: {{passphrase_file: '{phrase}'}}"
        async with riding(fields, state=kept) as [ride]:
            vehicle = Speaker(port, signing=signing)
            packets = [vehicle.say(GUIDED) for _ in range(5)]
            await until(lambda: ride.driver.counters()["messages"] == 5, "the vehicle is heard")
            shutil.copytree(kept, crashed)
        for state, how in ((kept, "in order"), (crashed, "by kill -9")):
            async with riding(fields, state=state) as [ride]:
                replayer = Speaker(port)
                for packet in packets:
                    replayer.send(packet)
                await until(lambda: ride.driver.counters()["refused_packets"] == 5, "what came before is refused")
                row.expect(not ride.driver.heard, f"ended {how}: the vehicle is not heard by what it said before")
                row.expect(not ride.driver.active, "nor does it count as armed")
                again, began = Speaker(port, signing=signing), time.monotonic()

                def back(vehicle: Speaker = again) -> bool:
                    vehicle.say(GUIDED)
                    return ride.driver.heard

                await until(back, "the vehicle itself is heard")
                row.seen.append(
                    f"ended {how}: 5 of 5 refused; the vehicle itself is heard {time.monotonic() - began:.1f} s after"
                )


def _reported(ride: Ride, code: str) -> Note | None:
    return next((note for note in ride.driver.notes() if note.code == code), None)


def _asked(camera: Speaker) -> bool:
    return any(getattr(one, "target_component", 0) == 100 for one in camera.listen())


VEHICLE: tuple[Attack, ...] = (telemetry_from_elsewhere, pictures_from_elsewhere, signed_packets_again)
