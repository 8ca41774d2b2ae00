"""Recordings on disks that are full, in files that are taken, and parts that cannot be begun."""

import asyncio
import resource
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from msgspec.structs import replace

from argosy.recording.metadata import End
from argosy.recording.reader import Recording
from argosy.recording.record_command import content, warnings
from argosy.recording.recorder import Limits, Recorder
from argosy.recording.run_recorder import RunRecording, record_command
from argosy.recording.write_queue import Heard, WriteQueue
from argosy.recording.writer import RecordingWriter
from schemas.wire import keys
from schemas.wire.records import Perception
from tests.argosy.recording.files import BEGIN, FACTS, altitude, heard, write
from tests.argosy.recording.recorders import Process, Studio, refused
from tests.support.buses import until

SMALL = 1024 * 1024
END = End(why="ctrl-C", ended=BEGIN)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of a megabyte."""
    folder = tmp_path / "disk"
    folder.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", f"size={SMALL}", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("only root may mount a small disk, and not everywhere")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@contextmanager
def files_no_larger_than(size: int) -> Iterator[None]:
    """Let this process write no larger files: the system says EFBIG then."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def blob(number: int, size: int = 4000) -> Heard:
    """A percept of some size."""
    return heard(keys.percept("test", "uav1", "p"), Perception(name="p", parameters=("x" * size, number)), number)


def recorder_of(path: Path, limits: Limits | None = None) -> Recorder:
    """A recorder that has not begun."""
    write_queue = WriteQueue()
    return Recorder(
        path, replace(FACTS, started=write_queue.now()), limits or Limits(), write_queue, compression="none"
    )


def until_it_ends(recorder: Recorder, count: int, at_once: int) -> None:
    """Let it record so many messages, and wait until it has ended."""
    recorder.start(lambda: None)
    for number in range(0, count, at_once):
        waiting = recorder.messages
        for one in range(number, number + at_once):
            recorder.write_queue.put(blob(one))
        recorder.write_queue.woken.set()
        for _ in range(200):
            if recorder.messages > waiting or not recorder._thread.is_alive():
                break
            recorder._thread.join(0.05)
    recorder.stop("ctrl-C")
    recorder._thread.join(90)
    assert not recorder._thread.is_alive()


def told_truly(recorder: Recorder, error: str) -> None:
    """The summary is what the file holds."""
    path = recorder.path
    found = Recording(path)
    read = [record.parameters[1] for _, record in found.typed(Perception)]
    assert recorder.problem == f"cannot write {path}: {error}"
    assert read[: recorder.messages] == list(range(recorder.messages))
    assert 0 < recorder.messages < 600
    assert recorder.size == path.stat().st_size
    assert "it was cut off" in found.missing
    assert warnings(recorder) == []
    line = content(recorder)
    assert line.startswith(f"{path}: {recorder.messages} messages in ")
    assert line.endswith(" MB")
    assert recorder.why == recorder.problem


def test_a_disk_that_fills_up_ends_the_recording_and_the_summary_tells_what_is_there(small_disk: Path) -> None:
    recorder = recorder_of(small_disk / "a.mcap")
    until_it_ends(recorder, 600, 50)
    told_truly(recorder, "No space left on device")


def test_a_file_that_may_grow_no_more_ends_the_recording_and_the_summary_tells_what_is_there(tmp_path: Path) -> None:
    with files_no_larger_than(SMALL):
        recorder = recorder_of(tmp_path / "a.mcap")
        until_it_ends(recorder, 600, 50)
    told_truly(recorder, "File too large")


async def test_a_recorder_whose_disk_is_full_ends_with_1_and_says_so(studio: Studio, small_disk: Path) -> None:
    studio.path = small_disk / "a.mcap"
    bus = await studio.connect("uav1", "bridged")
    async with studio.recording("--compression", "none") as recorder:
        rounds = iter(range(100))

        def ended() -> bool:
            if next(rounds, None) is not None:
                for number in range(50):
                    bus.put(keys.percept("test", "uav1", "p"), Perception(name="p", parameters=("x" * 4000, number)))
            return recorder.handle.returncode is not None

        await until(ended, "the disk is full")
        code, out, err = await recorder.end(None)
    told = f"cannot write {studio.path}: No space left on device"
    assert (code, err) == (1, f"error: {told}; the file can be read up to there\n")
    assert out.splitlines()[-1].endswith(f"; ended: {told}")
    assert f"{studio.path}: {sum(topic.messages for topic in Recording(studio.path).topics)} messages in " in out


HANGS = """
import sys, time
from argosy.__main__ import main
from argosy.recording.recorder import Recorder
from argosy.recording.writer import RecordingWriter
stop = Recorder.stop
def stopping(recorder, why):
    stop(recorder, why)
    print("stopping", flush=True)
Recorder.stop = stopping
flush, flushed = RecordingWriter.flush, []
def hang(writer):
    flushed.append(1)
    flush(writer) if len(flushed) == 1 else time.sleep(1000)
RecordingWriter.flush = hang
sys.exit(main(sys.argv[1:]))
"""


async def test_a_second_ctrl_c_leaves_a_disk_that_hangs(studio: Studio) -> None:
    command = [sys.executable, "-c", HANGS, "record", "--router", studio.endpoint, "-o", str(studio.path)]
    pipe = asyncio.subprocess.PIPE
    handle = await asyncio.create_subprocess_exec(*command, stdout=pipe, stderr=pipe)
    recorder = Process(handle)
    try:
        await recorder.until("recording ")
        handle.send_signal(signal.SIGINT)
        await recorder.until("stopping")
        assert handle.returncode is None
        code, _, err = await recorder.end(signal.SIGINT)
    finally:
        if handle.returncode is None:
            handle.kill()
            await handle.wait()
    told = f"error: {studio.folder} does not accept writes: the last messages are lost"
    assert (code, err) == (1, f"{told}; the file can be read up to there\n")


def test_a_disk_that_is_full_from_the_beginning_is_told(small_disk: Path) -> None:
    (small_disk / "other").write_bytes(bytes(SMALL))
    with pytest.raises(OSError, match="No space left"):
        RecordingWriter(small_disk / "a.mcap", FACTS)


async def test_two_recorders_never_write_one_file(studio: Studio, capsys: pytest.CaptureFixture[str]) -> None:
    writer = write(studio.path, [altitude(1, 1)])
    with pytest.raises(BlockingIOError, match="another recorder is writing it"):
        RecordingWriter(studio.path, FACTS, overwrite=True)
    told = f"error: {studio.path}: another recorder is writing it\n"
    assert await refused(capsys, "--router", studio.endpoint, "-o", studio.path, "--force") == told
    writer.add(altitude(2, 2))
    writer.close(END)
    assert [record.parameters for _, record in Recording(studio.path).typed(Perception)] == [(1,), (2,)]
    RecordingWriter(studio.path, FACTS, overwrite=True).close(END)


def test_only_a_report_is_recorded_over(tmp_path: Path) -> None:
    asked, report = (record_command(RunRecording(tmp_path, one), "m.yaml", "tcp/x:1", 1) for one in (True, False))
    assert ("--force" in asked, "--force" in report) == (False, True)


async def test_a_file_in_the_way_of_a_later_part_is_told_before_anything_is_recorded(
    studio: Studio, capsys: pytest.CaptureFixture[str]
) -> None:
    (studio.folder / "a-0003.mcap").write_text("mine")
    told = f"error: {studio.path}: a-0003.mcap exists, and would be its next part\n"
    assert await refused(capsys, "--router", studio.endpoint, "-o", studio.path, "--split") == told
    assert not studio.path.exists()


def test_a_part_that_cannot_be_begun_leaves_the_one_before_it_ended_as_it_should_be(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    recorder = recorder_of(path, Limits(size=SMALL, split=True))
    (tmp_path / "a-0002.mcap").write_text("mine")
    until_it_ends(recorder, 600, 600)
    found = Recording(path)
    assert recorder.problem == f"cannot continue in {tmp_path}/a-0002.mcap: File exists"
    assert (found.missing, found.end and found.end.why) == ("", recorder.problem)
    assert sum(topic.messages for topic in found.topics) == recorder.messages > 200
    assert (tmp_path / "a-0002.mcap").read_text() == "mine"
