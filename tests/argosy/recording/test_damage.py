"""Files that are not what they say: damaged, out of order, made to harm. They are told in a line, within bounds."""

import resource
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import lz4.frame
import pytest
import zstandard
from mcap.opcode import Opcode
from msgspec.structs import replace

from argosy.recording.mcap_records import LARGEST, McapFile
from argosy.recording.metadata import End
from argosy.recording.reader import Recording
from argosy.recording.writer import RecordingWriter
from schemas.wire.records import Perception
from tests.argosy.recording.files import BEGIN, FACTS, altitude, heard, write
from tests.argosy.watch.hostile import BAD, IN_KEY, RAW

HEAD = struct.Struct("<BQ")


def end(following: str = "") -> End:
    """How a file ends."""
    return End(why="ctrl-C", ended=BEGIN, following=following)


def part(path: Path, number: int, following: str = "", recording: str = "abc") -> Path:
    """Write a part of a recording that holds its number."""
    writer = RecordingWriter(path, replace(FACTS, part=number, recording=recording), overwrite=True)
    writer.add(altitude(number, number))
    writer.close(end(following))
    return path


def read(path: Path) -> tuple[list[float], str]:
    """Return the altitudes that are read, and what is missing."""
    recording = Recording(path)
    return [record.parameters[0] for _, record in recording.typed(Perception)], recording.missing  # type: ignore[misc]


def chunks(data: bytes) -> list[tuple[int, int]]:
    """Return where the chunks of a file begin and end."""
    found: list[tuple[int, int]] = []
    at = 8
    while True:
        opcode, length = HEAD.unpack_from(data, at)
        if opcode == Opcode.DATA_END:
            return found
        if opcode == Opcode.CHUNK:
            found.append((at, at + HEAD.size + length))
        at += HEAD.size + length


def chunk(said: int, compression: bytes, data: bytes) -> bytes:
    """Return a chunk that says to hold so many bytes."""
    body = struct.pack("<QQQI", 0, 1, said, 0) + struct.pack("<I", len(compression)) + compression
    body += struct.pack("<Q", len(data)) + data
    return HEAD.pack(Opcode.CHUNK, len(body)) + body


@contextmanager
def memory(more: int) -> Iterator[None]:
    """Let this process have only so much more."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (now + more, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, before)


@pytest.mark.timeout(60)
def test_a_file_that_goes_on_in_itself_is_read_once(tmp_path: Path) -> None:
    path = part(tmp_path / "a.mcap", 1, "a.mcap")
    told = f"{path}: belongs to another recording, but has the name of the next part"
    assert read(path) == ([1], told)
    one, two = part(tmp_path / "b.mcap", 1, "c.mcap"), part(tmp_path / "c.mcap", 2, "b.mcap")
    assert read(one) == ([1, 2], f"{one}: belongs to another recording, but has the name of the next part")
    assert read(two)[0] == [2]


def test_a_file_of_another_recording_in_the_place_of_the_next_is_not_read_and_told(tmp_path: Path) -> None:
    path, other = part(tmp_path / "a.mcap", 1, "b.mcap"), tmp_path / "b.mcap"
    told = f"{other}: belongs to another recording, but has the name of the next part"
    part(other, 2, recording="another")
    assert read(path) == ([1], told)
    assert sum(topic.messages for topic in Recording(path).topics) == 1
    other.write_text("mine")
    assert read(path) == ([1], told)


def test_a_later_part_that_is_opened_alone_says_so(tmp_path: Path) -> None:
    path, last = part(tmp_path / "b.mcap", 2, "c.mcap"), part(tmp_path / "c.mcap", 3)
    told = f"{path}: is part 2 of a recording: the earlier parts are other files"
    assert read(path) == ([2, 3], told)
    last.unlink()
    assert read(path) == ([2], f"{told}; {last}: is missing: the recording continues in it")


def test_a_hole_of_zeros_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, [altitude(n, n) for n in range(40)]).close(end())
    whole = path.read_bytes()
    for first in range(3, 30):
        data, (begin, until) = bytearray(whole), chunks(whole)[first]
        data[begin:until] = bytes(until - begin)
        path.write_bytes(data)
        values, missing = read(path)
        assert values == list(range(first))
        assert "it is damaged (it contains zeros): everything after its first" in missing


def test_messages_that_are_not_there_although_the_end_counts_them_are_told(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    write(path, [altitude(n, n) for n in range(10)]).close(end())
    data = path.read_bytes()
    begin, until = chunks(data)[4]
    path.write_bytes(data[:begin] + data[until:])
    told = f"{path}: 1 of its 10 messages are missing: it is damaged, or was changed"
    assert read(path) == ([0, 1, 2, 3, 5, 6, 7, 8, 9], told)


def test_damage_in_what_a_file_says_of_itself_is_told(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    writer = RecordingWriter(path, replace(FACTS, speed=10.0, mission="rescue"))
    writer.add(altitude(1, 1))
    writer.close(end())
    whole = path.read_bytes()
    for old, new, name in ((b"rescue", b"rescuf", "argosy"), (b"ctrl-C", b"ctrl-D", "argosy.end")):
        path.write_bytes(whole.replace(old, new, 1))
        assert read(path) == ([1], f"{path}: its metadata `{name}` are damaged")
    path.write_bytes(whole)
    assert read(path) == ([1], "")


MANY = 1_000_000_000


@pytest.mark.parametrize("said", [MANY, LARGEST, 100])
@pytest.mark.parametrize("compression", ["lz4", "zstd"])
@pytest.mark.timeout(60)
def test_what_unpacks_to_more_than_a_chunk_holds_is_refused_before_it_takes_memory(
    tmp_path: Path, compression: str, said: int
) -> None:
    path = tmp_path / "a.mcap"
    write(path, [altitude(n, n) for n in range(3)]).close(end())
    data = path.read_bytes()
    begin, until = chunks(data)[2]
    if compression == "lz4":
        packer = lz4.frame.LZ4FrameCompressor()
        packed = packer.begin(0) + b"".join(packer.compress(bytes(MANY // 100)) for _ in range(100)) + packer.flush()
    else:
        packing = zstandard.ZstdCompressor().compressobj(size=MANY)
        packed = b"".join(packing.compress(bytes(MANY // 100)) for _ in range(100)) + packing.flush()
    path.write_bytes(data[:begin] + chunk(said, compression.encode(), packed) + data[until:])
    with memory(3 * LARGEST):
        file = McapFile(path)
        assert sum(1 for _ in file.records()) > 2
    assert file.damage is not None
    told = f"a chunk of {MANY} bytes" if said == MANY else "a chunk does not have its declared size"
    assert file.damage.why == f"it is damaged ({told})"
    assert read(path)[0] == [0, 1]


@pytest.mark.parametrize("data", [bytes(1000), HEAD.pack(Opcode.MESSAGE, 1 << 40), HEAD.pack(Opcode.MESSAGE, 1 << 63)])
def test_a_chunk_of_zeros_or_with_lengths_beyond_it_is_damage(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "a.mcap"
    write(path, [altitude(n, n) for n in range(3)]).close(end())
    whole = path.read_bytes()
    begin, until = chunks(whole)[2]
    path.write_bytes(whole[:begin] + chunk(len(data), b"", data) + whole[until:])
    values, missing = read(path)
    assert values == [0, 1]
    assert "it is damaged (a chunk contains an invalid record)" in missing


def test_the_name_of_a_missing_part_commands_no_terminal(tmp_path: Path) -> None:
    _, missing = read(part(tmp_path / "a.mcap", 1, following=f"{BAD}.mcap"))
    assert "PWNED" in missing
    assert [one for one in RAW if one in missing.encode()] == []


@pytest.mark.parametrize(
    ("following", "missing"), [(".", ""), ("/", ""), ("x" * 300, "is missing"), ("\0", "is missing")]
)
def test_what_is_no_name_of_a_file_is_no_next_part(following: str, missing: str, tmp_path: Path) -> None:
    values, found = read(part(tmp_path / "a.mcap", 1, following=following))
    assert values == [1]
    assert missing in found
    assert bool(missing) == bool(found)


def test_what_is_no_name_of_a_fleet_is_none(tmp_path: Path) -> None:
    messages = [altitude(1, 1.0), heard(f"argosy/{IN_KEY}/uav/percept/x", Perception(name="x"))]
    write(path := tmp_path / "a.mcap", messages).close(end())
    assert Recording(path).fleets == ["test"]
