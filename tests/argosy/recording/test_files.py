"""Files of recordings: what is written is read, also from files that were cut off or damaged."""

from argparse import ArgumentTypeError
from pathlib import Path

import pytest
from mcap.writer import Writer
from msgspec.structs import replace

from argosy.recording import metadata, writer
from argosy.recording.metadata import End
from argosy.recording.reader import BadRecording, Recording
from argosy.recording.record_command import _size
from argosy.recording.recorder import NOTES, Limits, Recorder
from argosy.recording.records import RecorderNote, Unread
from argosy.recording.write_queue import Heard, WriteQueue
from schemas.wire import keys
from schemas.wire.mind_records import MindInputs
from schemas.wire.records import Perception
from tests.argosy.recording.files import BEGIN, FACTS, SECOND, altitude, heard, stretch, validated, write

END = End(why="ctrl-C", ended=BEGIN + 60 * SECOND)


@pytest.mark.parametrize("compression", ["none", "lz4", "zstd"])
@pytest.mark.parametrize("wire", ["json", "msgpack"])
def test_what_is_written_is_read(tmp_path: Path, compression: writer.Compression, wire: str) -> None:
    path = tmp_path / "a.mcap"
    write(path, [altitude(n, n / 2, wire) for n in range(20)], compression).close(END)  # type: ignore[arg-type]
    recording = Recording(path)
    messages = list(recording.messages())
    assert [message.record.parameters for message in messages] == [(n / 2,) for n in range(20)]  # type: ignore[union-attr]
    assert [message.seconds for message in messages] == list(range(20))
    assert [message.stamp for message in messages] == [BEGIN + n * SECOND - 5 for n in range(20)]
    assert messages[0].track.encoding == f"application/{wire};argosy.Perception/1"
    assert (recording.missing, recording.seconds, recording.fleets) == ("", 19.0, ["test"])
    assert (recording.end.why, recording.end.messages) == ("ctrl-C", 20)
    assert validated(path) == 20


def test_a_part_of_it_is_read_by_time_key_and_type(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    inputs = heard(keys.trace("test", "uav", "inputs"), stretch(0), 4)
    write(path, [*(altitude(n, n) for n in range(5)), inputs]).close(END)
    recording = Recording(path)
    assert [message.seconds for message in recording.messages(1, 3)] == [1, 2]
    assert len(list(recording.messages(only=("argosy/*/uav1/**",)))) == 5
    assert len(list(recording.messages(only=("argosy/test/uav/**", "argosy/*/*/percept/altitude")))) == 6
    assert [record for _, record in recording.typed(MindInputs)] == [stretch(0)]


def test_a_file_cut_off_anywhere_is_read_up_to_its_last_whole_chunk(tmp_path: Path) -> None:
    path, cut = tmp_path / "a.mcap", tmp_path / "cut.mcap"
    write(path, [altitude(n, n) for n in range(10)]).close(END)
    data = path.read_bytes()
    before = 0
    for size in range(400, len(data) + 1, 7):
        cut.write_bytes(data[:size])
        try:
            recording = Recording(cut)
        except BadRecording as bad:
            assert before == 0
            assert "cut off before its facts" in str(bad)
            continue
        values = [record.parameters[0] for _, record in recording.typed(Perception)]
        assert values == list(range(len(values)))
        assert len(values) >= before
        assert bool(recording.missing) == (size < len(data))
        before = len(values)
    assert before == 10


def test_what_a_cut_takes_away_is_told_in_a_line(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, [altitude(n, n) for n in range(10)]).abandon()
    size = path.stat().st_size
    with path.open("ab") as file:
        file.write(b"\x06rubbish")
    recording = Recording(path)
    assert recording.missing == (
        f"{path}: it was cut off, or is still being written: everything after its first 9.0 s is missing; "
        "8 bytes after that are unusable"
    )
    assert recording.end is None
    assert path.stat().st_size == size + 8


def test_damage_in_the_middle_is_told_and_what_stands_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, [altitude(n, n) for n in range(10)], "none").close(END)
    data = bytearray(path.read_bytes())
    at = data.index(b'"parameters":[6.0]') if b'"parameters":[6.0]' in data else data.index(b'"parameters":[6]')
    data[at + 14] ^= 1
    path.write_bytes(data)
    recording = Recording(path)
    assert [record.parameters[0] for _, record in recording.typed(Perception)] == list(range(6))
    assert "it is damaged (a chunk has a wrong checksum)" in recording.missing


@pytest.mark.parametrize(
    ("content", "told"),
    [(b"", "not an MCAP file: it is empty"), (b"mission: x\n", "not an MCAP file: it does not begin like one")],
)
def test_what_is_no_mcap_file_is_refused_in_a_line(tmp_path: Path, content: bytes, told: str) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    with pytest.raises(BadRecording, match=told):
        Recording(path)


def test_a_file_that_is_not_there_or_of_somebody_else_or_of_another_format_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(BadRecording, match="No such file"):
        Recording(tmp_path / "a.mcap")
    others = tmp_path / "b.mcap"
    made = Writer(str(others))
    made.start()
    made.finish()
    with pytest.raises(BadRecording, match="not a recording of Argosy: another program wrote it"):
        Recording(others)
    monkeypatch.setattr(metadata, "FORMAT", "3")
    write(tmp_path / "c.mcap", []).close(END)
    monkeypatch.undo()
    with pytest.raises(BadRecording, match="it has format 3, this version of Argosy reads format 2"):
        Recording(tmp_path / "c.mcap")


def test_what_is_no_object_is_kept_as_bytes_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    payloads = [b"\x00\xff", b"5", b"[1]", b"not json", b'{"a":1} x']
    messages = [Heard(BEGIN + n, "argosy/test/uav1/blob", payload, "zenoh/bytes") for n, payload in enumerate(payloads)]
    fine = Heard(BEGIN + 9, "argosy/test/uav1/blob", b'{"header": 5, "a": 1}', "zenoh/bytes")
    gone = Heard(BEGIN + 10, "argosy/test/uav1/blob", b"", "", "put", True)
    made = write(path, [*messages, fine, gone])
    made.close(END)
    recording = Recording(path)
    kept = [record for _, record in recording.typed(Unread)]
    assert [one.base64 for one in kept] == ["AP8=", "NQ==", "WzFd", "bm90IGpzb24=", "eyJhIjoxfSB4", ""]
    assert [one.deleted for one in kept] == [False] * 5 + [True]
    assert recording.end.unread == 5
    assert [message.data for message in recording.messages() if not message.name] == [fine.payload]
    assert validated(path) == 7


def test_a_payload_by_hand_without_encoding_is_the_record_of_its_key(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    payload = b'{"name": "wind", "parameters": [5]}'
    write(path, [Heard(BEGIN, keys.percept("test", "uav1", "wind"), payload, "zenoh/bytes")]).close(END)
    assert [record.parameters for _, record in Recording(path).typed(Perception)] == [(5,)]


def test_of_minds_it_tells_which_stretches_are_missing(tmp_path: Path) -> None:
    path, key = tmp_path / "a.mcap", keys.trace("test", "uav", "inputs")
    numbers = [3, 0, 1, 3, 6]
    others = [stretch(1, "b2"), stretch(0, "b3")]
    write(path, [heard(key, one) for one in [*map(stretch, numbers), *others]]).close(END)
    first, second, third = Recording(path).minds("uav")
    assert [batch.number for batch in first.batches] == [0, 1, 3, 6]
    assert (first.missing, first.whole) == ([range(2, 3), range(4, 6)], False)
    assert (second.missing, second.whole) == ([range(1)], False)
    assert (third.missing, third.whole) == ([], True)
    assert Recording(path).minds("other") == []


def recorded(path: Path, limits: Limits, messages: list[Heard], write_queue: WriteQueue | None = None) -> Recorder:
    """Record messages until a limit or the end."""
    taken = write_queue or WriteQueue()
    recorder = Recorder(path, replace(FACTS, started=taken.now()), limits, taken)
    for message in messages:
        taken.put(message)
    recorder.start(lambda: None)
    recorder.stop("ctrl-C")
    recorder._thread.join(90)
    assert not recorder._thread.is_alive()
    return recorder


def test_a_file_is_no_longer_than_its_limit_and_says_why_it_ended(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    blob = "x" * 1000
    messages = [
        heard(keys.percept("test", f"uav{n % 40}", "p"), Perception(name="p", parameters=(blob + str(n),)))
        for n in range(3000)
    ]
    recorder = recorded(path, Limits(size=1_000_000), messages)
    assert path.stat().st_size <= 1_000_000
    recording = Recording(path)
    assert recording.end.why == recorder.why == "the size limit of 1.0 MB is reached"
    assert 500 < sum(topic.messages for topic in recording.topics) < 3000


def test_a_recording_that_is_split_is_read_as_one(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    blob = "x" * 1000
    key = keys.percept("test", "uav1", "p")
    messages = [heard(key, Perception(name="p", parameters=(blob, n)), n) for n in range(3000)]
    recorder = recorded(path, Limits(size=1_000_000, split=True), messages)
    assert [file.name for file in recorder.files] == ["a.mcap", "a-0002.mcap", "a-0003.mcap", "a-0004.mcap"]
    assert all(file.stat().st_size <= 1_000_000 for file in recorder.files)
    recording = Recording(path)
    assert [record.parameters[1] for _, record in recording.typed(Perception)] == list(range(3000))
    assert recording.end.why == "ctrl-C"
    (tmp_path / "a-0003.mcap").unlink()
    assert Recording(path).missing.endswith("a-0003.mcap: is missing: the recording continues in it")


def test_what_does_not_fit_in_the_queue_is_counted_told_and_noted_in_the_file(tmp_path: Path) -> None:
    write_queue = WriteQueue(most=10)
    messages = [altitude(n, n) for n in range(25)]
    recorder = recorded(tmp_path / "a.mcap", Limits(), messages, write_queue)
    assert (recorder.messages, recorder.dropped) == (10 + 1, 15)
    recording = Recording(tmp_path / "a.mcap")
    assert recording.end.dropped == 15
    assert recording.missing.endswith("a.mcap: 15 messages did not fit when it was recorded")
    notes = [(message.key, record) for message, record in recording.typed(RecorderNote)]
    assert notes == [(NOTES, RecorderNote(kind="dropped", text="15 messages did not fit and are missing"))]


@pytest.mark.parametrize(
    ("text", "value"), [("2GB", 2_000_000_000), ("1.5 mb", 1_500_000), ("5000000", 5_000_000), ("64 MB", 64_000_000)]
)
def test_sizes_are_read_as_people_write_them(text: str, value: int) -> None:
    assert _size(text) == value


@pytest.mark.parametrize("text", ["", "big", "5 XB", "-1GB", "1kB"])
def test_other_sizes_are_refused_with_what_was_expected(text: str) -> None:
    with pytest.raises(ArgumentTypeError, match="expected"):
        _size(text)
