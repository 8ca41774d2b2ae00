"""A copter that asks for signatures is flown by a bridge with its passphrase; any other bridge is told why not."""

import asyncio
from pathlib import Path

import pytest

from bridged.drivers.mavlink.transport.signing import MINUTE, Signing, Timestamps, key_of, now_10us
from tests.bridged.drivers.mavlink.test_ground_stations import copter
from tests.bridged.radio import BEAT, COPTER, Speaker, riding
from tests.support.buses import until
from tests.support.notes import identities
from tests.support.ports import free_port


def phrase(folder: Path, text: str) -> Path:
    file = folder / text
    file.write_text(f"{text}\n")
    file.chmod(0o600)
    return file


@pytest.mark.timeout(60)
def test_a_signed_copter_is_armed_by_who_has_the_passphrase_and_by_nobody_else(tmp_path: Path) -> None:
    right, wrong = phrase(tmp_path, "argo"), phrase(tmp_path, "gold")

    async def body(port: int) -> None:
        link = f"link: 'udpin:127.0.0.1:{port}', signing: {{passphrase_file: '%s'}}"
        async with riding(link % wrong, state=tmp_path / "wrong") as [ride]:
            await until(lambda: any(note.code == "packets_refused" for note in ride.driver.notes()), "the note")
            assert not ride.driver.heard
        for life in ("first", "second"):  # the second one goes on above the timestamps of the first
            async with riding(link % right, state=tmp_path / "right") as [ride]:
                for name, arguments in (("set_mode", {"mode": "GUIDED"}), ("arm_motors", {"arm": life == "first"})):
                    execution = ride.driver.perform(name, COPTER.actions[name], arguments)
                    await until(lambda: execution.over, f"the end of {name}")  # noqa: B023
                    assert execution.outcome.state == "succeeded", execution.outcome.reason
                assert ride.driver.counters()["refused_packets"] == 0
        async with riding(f"link: 'udpin:127.0.0.1:{port}'") as [ride]:
            await until(lambda: ("signing_missing", "") in identities(ride.driver.notes()), "the note")

    port = free_port()
    with copter(f"udpout:127.0.0.1:{port}", "--speed", "5", "--signing-passphrase-file", str(right)):
        asyncio.run(asyncio.wait_for(body(port), 240))


async def test_a_vehicle_whose_clock_is_an_hour_behind_learns_the_time_by_a_signature_and_comes(tmp_path: Path) -> None:
    """It has no GPS yet. Nobody else on the link would tell it: the bridge listens, and had nothing to answer to."""
    late = now_10us() - 60 * MINUTE
    its = Signing(key_of(b"argo"), Timestamps(clock=lambda: late))
    port = free_port()
    fields = f"link: 'udpin:127.0.0.1:{port}', signing: {{passphrase_file: '{phrase(tmp_path, 'argo')}'}}"
    async with riding(fields, state=tmp_path) as [ride]:
        vehicle = Speaker(port, signing=its)
        for _ in range(5):
            vehicle.say(BEAT)
        await until(lambda: bool(vehicle.listen()), "we answer what is rightly signed")
        said = ("packets_refused", f"outdated udp:127.0.0.1:{vehicle.port}")
        assert said in identities(ride.driver.notes())
        assert vehicle.kinds() == {"TIMESYNC"}, "no heartbeat, which would keep a failsafe from acting"
        assert len(vehicle.raw) == 1, "once a second at most"
        assert not its.objection(vehicle.raw[0]), "by which it takes our time over"
        vehicle.say(BEAT)
        await until(lambda: ride.driver.heard, "it is taken")
        vehicle.close()
