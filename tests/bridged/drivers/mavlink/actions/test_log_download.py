"""Logs of a vehicle: downloaded as a whole or not at all, over any link, under names of ours."""

import os
import random
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import pytest
from pymavlink import DFReader
from pymavlink.dialects.v20 import ardupilotmega as dialect

from bridged.drivers.mavlink.actions.log_download import WINDOW, file_name
from bridged.simulation.vehicle.log_transfer import LogTransfer
from tests.bridged.drivers.mavlink.actions.test_mission_actions import every
from tests.bridged.sky import Message, Sky, end_of

Entry = dialect.MAVLink_log_entry_message


def logs(folder: Path) -> list[Path]:
    """Return the files that downloads have left, of any kind."""
    return sorted((folder / "logs").iterdir()) if (folder / "logs").exists() else []


def serve(sky: Sky, content: Sequence[bytes], first: int = 1, times: Sequence[int] = ()) -> None:
    """Let the vehicle have other logs than its own."""
    transfer = LogTransfer(content, first)

    def hears(message: Message) -> bool:
        if not message.get_type().startswith("LOG_"):
            return True
        for answer in transfer.receive(message, armed=False):
            if times and isinstance(answer, Entry):
                answer.time_utc = times[answer.id - first]
            sky.downlink.append(answer)
        return False

    sky.hears_us = hears


def ends(sky: Sky) -> int:
    """Return how often the vehicle was let log again."""
    sky.wait(0.1)  # what was sent arrives
    return sum(message.get_type() == "LOG_REQUEST_END" for message in sky.sent)


def test_the_latest_log_is_written_below_the_bridges_state_and_pymavlink_reads_it(sky: Sky, tmp_path: Path) -> None:
    status = sky.do("download_log")
    (path,) = logs(tmp_path)
    assert (status.state, path.stat().st_mode & 0o777) == ("succeeded", 0o600)
    assert re.fullmatch(r"uav1-log00001-downloaded-\d{8}T\d{6}Z\.bin", path.name)
    assert str(path) in status.reason
    reader = DFReader.DFReader_binary(str(path))
    assert reader.recv_match(type="MSG").Message == "simulated vehicle of Argosy"
    read = {row.Name: row.Value for row in iter(lambda: reader.recv_match(type="PARM"), None)}
    assert read["RTL_ALT"] == 1500
    assert len(read) == len(sky.vehicle.autopilot.parameters)
    assert ends(sky) == 1


@pytest.mark.parametrize("n", [3, 7])
def test_what_a_bad_link_loses_is_asked_for_again_until_every_byte_is_there(sky: Sky, tmp_path: Path, n: int) -> None:
    content = random.Random(n).randbytes(2 * WINDOW + 1234)
    serve(sky, [b"older", content])
    sky.we_hear = every(n, "LOG_DATA")
    status = sky.do("download_log", within=3000)
    assert status.state == "succeeded", status.reason
    assert status.feedback == {"bytes": len(content), "of": len(content)}
    assert logs(tmp_path)[0].read_bytes() == content


def test_the_latest_is_that_of_the_latest_time_and_any_other_is_had_by_its_number(sky: Sky, tmp_path: Path) -> None:
    serve(
        sky,
        [b"first" * 40, b"newest" * 40, b"third" * 40],
        first=0,
        times=[1_790_000_000, 1_800_000_000, 1_795_000_000],
    )
    sky.done("download_log")
    sky.done("download_log", 2)
    assert {path.name: path.read_bytes()[:6] for path in logs(tmp_path)} == {
        "uav1-log00001-20270115T080000Z.bin": b"newest",
        "uav1-log00002-20261118T110640Z.bin": b"thirdt",
    }
    assert end_of(sky.do("download_log", 9)) == ("failed", "the vehicle has no log 9; it has 0 to 2")


def test_a_list_that_loses_entries_is_asked_for_again_until_all_of_it_is_there(sky: Sky, tmp_path: Path) -> None:
    serve(sky, [b"a log" * 40] * 20, times=[*range(1_790_000_000, 1_790_000_019), 1_780_000_000])
    sky.we_hear = every(3, "LOG_ENTRY")
    sky.done("download_log")
    assert [path.name[:13] for path in logs(tmp_path)] == ["uav1-log00019"]
    assert sum(message.get_type() == "LOG_REQUEST_LIST" for message in sky.sent) > 1


def test_without_known_times_the_latest_is_the_last_of_the_list(sky: Sky, tmp_path: Path) -> None:
    serve(sky, [b"first" * 40, b"second" * 40], times=[1_790_000_000, 0])
    sky.done("download_log")
    assert [path.name[:24] for path in logs(tmp_path)] == ["uav1-log00002-downloaded"]


def test_a_name_has_nothing_of_the_vehicles_text_and_its_end_is_that_of_the_autopilot() -> None:
    entry = dialect.MAVLink_log_entry_message(7, 9, 9, 0, 100)
    now = datetime(2026, 11, 28, 10, 15, 0, tzinfo=UTC)
    assert file_name("uav1", entry, dialect.MAV_AUTOPILOT_PX4, now) == "uav1-log00007-downloaded-20261128T101500Z.ulg"
    entry.time_utc = 1_790_000_000
    assert file_name("uav1", entry, dialect.MAV_AUTOPILOT_GENERIC, now) == "uav1-log00007-20260921T141320Z.log"


def test_an_armed_vehicle_is_left_alone_and_one_armed_meanwhile_ends_the_download(sky: Sky, tmp_path: Path) -> None:
    serve(sky, [random.Random(1).randbytes(50 * WINDOW)])
    sky.armed()
    refused = sky.do("download_log")
    assert (refused.state, ends(sky), logs(tmp_path)) == ("refused", 0, [])
    sky.done("arm_motors", False)
    sky.we_hear = every(50, "LOG_DATA")  # so that it takes its time
    heard = sky.begin("download_log")
    sky.forward(lambda: logs(tmp_path), "the download")
    sky.begin("arm_motors", True)
    sky.end(heard)
    assert (heard[-1].state, heard[-1].reason[:29]) == ("failed", "a log is downloaded disarmed:")
    assert (ends(sky), logs(tmp_path)) == (1, [])


def test_a_download_that_is_cancelled_or_runs_dry_leaves_no_file(sky: Sky, tmp_path: Path) -> None:
    serve(sky, [b"x" * 10 * WINDOW])
    sky.we_hear = lambda message: not (message.get_type() == "LOG_DATA" and message.ofs >= WINDOW)
    heard = sky.begin("download_log")
    sky.forward(lambda: heard[-1].feedback.get("bytes", 0) >= WINDOW, "the first window")
    assert sky.bridge.action_server.cancel("uav", heard[0].id).state == "cancelled"
    sky.wait(1)
    assert (ends(sky), logs(tmp_path)) == (1, [])
    dry = sky.do("download_log")
    said = f"the vehicle sends no more of log 1 at byte {WINDOW} of {10 * WINDOW}, asked 8 times"
    assert (dry.state, dry.reason, logs(tmp_path)) == ("failed", said, [])


@pytest.mark.parametrize(
    ("content", "said"),
    [([], "the vehicle has no logs"), ([b""], "log 1 of the vehicle is empty")],
)
def test_there_may_be_nothing_to_download(sky: Sky, tmp_path: Path, content: list[bytes], said: str) -> None:
    serve(sky, content)
    status = sky.do("download_log")
    assert (status.state, status.reason, logs(tmp_path)) == ("failed", said, [])


def test_a_vehicle_that_does_not_list_its_logs_is_asked_eight_times(sky: Sky) -> None:
    sky.wait(3)
    sky.hears_us = lambda message: not message.get_type().startswith("LOG_")
    status = sky.do("download_log")
    assert (status.state, status.reason) == (
        "failed",
        "the vehicle did not send the list of its logs, asked 8 times",
    )
    assert sum(message.get_type() == "LOG_REQUEST_LIST" for message in sky.sent) == 8


def test_a_disk_that_is_nearly_full_keeps_its_room(sky: Sky, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = os.statvfs_result((4096, 4096, 2**24, 0, 64 * 2**20 // 4096, 0, 0, 0, 0, 255))
    monkeypatch.setattr(os, "statvfs", lambda path: full)
    status = sky.do("download_log")
    assert (status.state, status.cause, logs(tmp_path)) == ("refused", "storage", [])


def test_a_disk_that_fails_is_no_success(sky: Sky, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "logs").mkdir()
    (tmp_path / "logs" / ".uav1-log00009.bin.part").write_text("of a bridge that was killed")
    synced = os.fsync

    def fails(number: int) -> None:
        if os.readlink(f"/proc/self/fd/{number}").endswith(".part"):
            raise OSError(28, "No space left on device")
        synced(number)

    monkeypatch.setattr(os, "fsync", fails)
    status = sky.do("download_log")
    assert (status.state, status.cause, logs(tmp_path)) == ("failed", "storage", [])
