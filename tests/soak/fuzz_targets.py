"""What reads what strangers can send: a table of fuzz targets, each with its corpus and the errors that it documents.

An input is made from a seed and a number alone. It is read, or refused by a documented error, within `HANG`.
"""

import gc
import math
import os
import random
import sqlite3
import struct
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import msgspec
from msgspec.structs import replace
from pymavlink.dialects.v20 import ardupilotmega as dialect

from agentd.conversion.term_conversion import BadTerm, from_wire
from agentd.jason_project.project_parser import parse_project
from agentd.language.syntax_tree.errors import SyntaxErrors
from argosy.mail.command import board_lines
from argosy.recording.metadata import End
from argosy.recording.reader import BadRecording, Recording
from argosy.recording.records import RECORDS, fleet_of, is_plain
from argosy.recording.write_queue import Heard
from argosy.recording.writer import COMPRESSIONS
from argosy.why.explain import explain_view
from argosy.why.from_recording import NotRecorded, recorded_view
from bridged.drivers.mavlink.session import VehicleSession
from bridged.drivers.mavlink.transport.framing import Framer, WireCounters
from bridged.drivers.mavlink.vehicle.commands import Identity
from bridged.drivers.registry import check_manifest
from bridged.paper_format.ini_manifests import load_ini_pair
from commd.gateway.gateway import MAX_SOURCES, Allowance, BadDatagram, Gateway, read_message
from commd.mail.inspection import mailboxes_of_file
from commd.mail.queries import MIGRATIONS
from commd.process.sqlite_file import migrate
from schemas.files.findings import Findings
from schemas.manifest.loader import load_manifest
from schemas.mission.model import load_mission
from schemas.wire import keys
from schemas.wire.codec import BadRecord, Wire, codec
from schemas.wire.mind_records import InitialMind, MindInput, MindInputs, MindStep
from schemas.wire.records import Action, Header, Mail, Message, Perception, Record
from schemas.wire.terms import Atom, Map, Source, Structure, Variable
from tests.agentd.trials import TooLong, at_most
from tests.argosy.recording.files import BEGIN, altitude, heard, stretch, write
from tests.bridged.recorded import packets
from tests.bridged.sky import VirtualClock

ROOT = Path(__file__).parents[2]
HANG = 1.0
"""Seconds of processor time that one input may take."""
GROWTH = 16_000_000
"""Bytes that may be held more than after a tenth of the inputs: caches are bounded, not empty."""
LONGEST = 5_000
"""Bytes of a mutant; what is as large as an edge takes is in `BOMBS`."""


@dataclass(frozen=True)
class Target:
    """One reader."""

    name: str
    corpus: Callable[[], tuple[bytes, ...]]
    read: Callable[[bytes, random.Random], object]
    refusals: tuple[type[Exception], ...] = ()
    """The errors that it documents; none: it takes whatever comes."""
    words: tuple[bytes, ...] = ()
    """What its format is made of."""
    longest: int = LONGEST
    """Bytes of a mutant."""


@dataclass
class Found:
    """What came of the inputs of one target."""

    target: str
    outcomes: Counter[str]
    failures: list[tuple[int, str]]
    slowest: float = 0.0
    """Processor seconds."""
    growth: int = 0
    """Bytes."""


def mutant(target: Target, seed: int, number: int) -> bytes:
    """Return the input of this number in the series of this seed."""
    rng = random.Random(f"{target.name}/{seed}/{number}")
    corpus = target.corpus()
    data = bytearray(rng.choice(corpus))
    for _ in range(rng.choice((0, 1, 1, 2, 3, 8))):
        at = rng.randint(0, len(data))
        to = min(len(data), at + rng.randint(0, 16))
        match rng.randrange(8):
            case 0 if data:
                data[at - 1] ^= 1 << rng.randrange(8)
            case 1:
                del data[at:to]
            case 2:
                data[at:at] = data[at:to] * rng.choice((1, 2, 30))
            case 3:
                data[at:at] = rng.randbytes(rng.randint(1, 8))
            case 4:
                other = rng.choice(corpus)
                begin = rng.randint(0, len(other))
                data[at:to] = other[begin : begin + rng.randint(1, 200)]
            case 5:
                data[at:to] = rng.choice((*_WORDS, *target.words))
            case 6 if rng.random() < 0.1:
                data[at:at] = rng.choice((*_WORDS, *target.words)) * rng.randint(10, 2000)
            case _:
                del data[rng.randint(at, len(data)) :]
                data += rng.choice(corpus)[at : at + 500]
    return bytes(data[: target.longest])


def read_one(target: Target, data: bytes, rng: random.Random) -> str:
    """Let a target read an input. Returns `read` or `refused`; raises what it should not have raised, or TooLong."""
    with at_most(HANG):
        try:
            target.read(data, rng)
        except target.refusals:
            return "refused"
    return "read"


def fuzz(target: Target, seed: int, inputs: int) -> Found:
    """Give a target so many inputs."""
    found = Found(target.name, Counter(), [])
    target.corpus()
    held = 0
    for number in range(inputs):
        if number == inputs // 10:
            held = _resident()
        data = mutant(target, seed, number)
        began = os.times().user
        try:
            found.outcomes[read_one(target, data, random.Random(number))] += 1
        except (Exception, TooLong) as error:
            found.failures.append((number, f"{type(error).__name__}: {error}"[:200]))
        found.slowest = max(found.slowest, os.times().user - began)
    found.growth = max(0, _resident() - held)
    return found


def _resident() -> int:
    """Bytes of memory of this process."""
    gc.collect()
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


_WORDS = (
    b"\0",
    b"\xff",
    b"\xc3\x28",
    b"NaN",
    b"-Infinity",
    b"1e999",
    b"9" * 400,
    b"-1",
    b'"',
    b"'",
    b"\\",
    b"\n",
    b" ",
)
_BRACKETS = (b"(", b")", b"[", b"]", b"{", b"}", b",", b":", b"=", b"#", b"<", b">", b"|", b"~", b"::")


def _files(*patterns: str) -> tuple[bytes, ...]:
    return tuple(path.read_bytes() for pattern in patterns for path in sorted(ROOT.glob(pattern)))


# --- records -----------------------------------------------------------------------------------------------------


def _records() -> tuple[Record, ...]:
    header = Header(seq=1, stamp=2, source="uav1", boot="b")
    term = Structure("victim", (1, -27.6, "x", [Atom("a"), Variable("X")]), (Structure("source", (Atom("b"),)),))
    plan = Source("plan", "{ @l +!g(X) : X > 1 <- .print(X); !h }")
    message = Message(id="m1", sender="a", performative="tell", receiver="b", content=term)
    made: list[Record] = [
        Perception(header=header, name="p", parameters=(term, plan, Map(((Atom("a"), 1),)))),
        Action(header=header, id="a:1:1", name="goto", parameters=(1.5, term)),
        Mail(messages=(message, Message(**{**_fields(message), "content": plan}))),
    ]
    for kind in RECORDS.values():
        try:
            made.append(kind())
        except TypeError:
            continue
    return tuple(made)


def _fields(record: Record) -> dict[str, object]:
    return {name: getattr(record, name) for name in record.__struct_fields__}


@cache
def _encoded(wire: Wire) -> tuple[bytes, ...]:
    return tuple(codec(type(record)).encode(record, wire) for record in _records())


def _read_record(wire: Wire, data: bytes, rng: random.Random) -> None:
    for kind in (Perception, Action, Mail, rng.choice(list(RECORDS.values()))):
        made = codec(kind)
        try:
            record = made.decode(data, made.encodings[wire])
        except BadRecord:
            continue
        made.unknown_fields(data, made.encodings[wire])
        _take_terms(record)


def _take_terms(record: Record) -> None:
    """What an agent makes of the terms of a record."""
    terms = [*getattr(record, "parameters", ()), *(one.content for one in getattr(record, "messages", ()))]
    for term in terms:
        try:
            from_wire(term)
        except BadTerm:
            continue


# --- datagrams, keys ---------------------------------------------------------------------------------------------


def _datagrams() -> tuple[bytes, ...]:
    return (
        b"<mid1->mid0,scout,tell,rescuer1,victim(1,-27.6,-48.5)[source(scout)]>",
        b'<2,a,achieve,null,go([1,2|T],"te\\"xt",{ +!g : c <- a },~n::p(X))>\0\0',
        b"<3,a,askOne,b,(X+1)>",
    )


def _read_datagram(data: bytes, _: random.Random) -> None:
    from_wire(read_message(data[:4096].rstrip(b"\0").decode()).content)


class _Gateway:
    """A gateway of two nodes, and a stranger that sends it datagrams from a node's host."""

    def __init__(self) -> None:
        self.now = 0.0
        self.gateway = Gateway({"mid0": "127.0.0.1:9", "scout": "127.0.0.1:10"}, lambda: self.now)
        self.gateway._hosts["127.0.0.1"] = Allowance()
        for node in self.gateway.nodes.values():
            node.at = ("127.0.0.1", 9)

    def read(self, data: bytes, rng: random.Random) -> None:
        gateway, before = self.gateway, self.gateway.counters.total()
        self.now += rng.choice((0.0, 0.01, 1.0))
        gateway.datagram_received(data, (rng.choice(("127.0.0.1", "127.0.0.1", "10.0.0.9")), 40_000))
        waiting = gateway._waiting.qsize()
        assert gateway.counters.total() - before + waiting == 2, "each datagram is counted once, or waits to be taken"
        assert len(gateway._strangers) <= MAX_SOURCES
        if waiting:
            from_wire(gateway._waiting.get_nowait().content)


@cache
def _gateway() -> _Gateway:
    return _Gateway()


def _keys() -> tuple[bytes, ...]:
    return tuple(f"argosy/fleet/{channel.key}".encode() for channel in keys.CHANNELS)


def _read_key(data: bytes, _: random.Random) -> None:
    key = data.decode(errors="replace")
    keys.parse(key)
    if is_plain(key):
        fleet_of(key)


# --- MAVLink -----------------------------------------------------------------------------------------------------


@cache
def _packets() -> tuple[bytes, ...]:
    return tuple(packet.raw for packet, _ in zip(packets("single_uav"), range(2000), strict=False))


_COUNTERS = WireCounters()
_STREAM = Framer(_COUNTERS)
"""One for all inputs: what a stranger leaves behind in it must not grow."""


def _read_packets(data: bytes, _: random.Random) -> None:
    _STREAM.feed(data)
    _STREAM.feed(data, datagram=True)
    assert len(_STREAM._pending) < 1000, f"{len(_STREAM._pending)} bytes wait"


@cache
def _kinds() -> tuple[type[dialect.MAVLink_message], ...]:
    heard = {packet.message.get_msgId() for packet in packets("single_uav")} | {0, 22, 77, 242, 253}
    return tuple(dialect.mavlink_map[number] for number in sorted(heard))


_ABSURD = (math.nan, math.inf, -math.inf, 3e38, -3e38, 1e-45, 0.0)


def _absurd_packet(data: bytes, rng: random.Random) -> bytes:
    """A packet of the vehicle with a right checksum: any payload, often of extreme numbers."""
    kind = rng.choice(_kinds())
    size = struct.calcsize(kind.unpacker.format)
    payload = bytearray((data + bytes(size))[:size])
    for at in range(0, size - 3, 4):
        if rng.random() < 0.3:
            payload[at : at + 4] = rng.choice(
                (struct.pack("<f", rng.choice(_ABSURD)), b"\xff" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x80")
            )
    number = kind.id
    covered = struct.pack("<BBBBBBB", size, 0, 0, rng.randrange(256), 1, 1, number & 255)
    covered += bytes((number >> 8 & 255, number >> 16 & 255)) + bytes(payload)
    return b"\xfd" + covered + struct.pack("<H", dialect.x25crc(covered + bytes((kind.crc_extra,))).crc)


class _Vehicle:
    """A conversation with whatever says that it is the vehicle."""

    def __init__(self) -> None:
        self.clock = VirtualClock()
        self.framer = Framer(WireCounters())
        self.vehicle_session = VehicleSession(
            load_manifest("copter"), Identity(255, 190, 1), lambda message: None, lambda reading: None, self.clock
        )

    def read(self, data: bytes, rng: random.Random) -> None:
        self.clock.time += rng.choice((0.0, 0.02, 0.5, 3.0))
        for message in self.framer.feed(_absurd_packet(data, rng)):
            self.vehicle_session.receive(message)
        self.vehicle_session.tick()
        self.vehicle_session.notes()


@cache
def _vehicle() -> _Vehicle:
    return _Vehicle()


# --- recordings --------------------------------------------------------------------------------------------------


@cache
def _folder() -> tempfile.TemporaryDirectory[str]:
    return tempfile.TemporaryDirectory(prefix="argosy-fuzz-", dir="/dev/shm" if Path("/dev/shm").is_dir() else None)


@cache
def _recordings() -> tuple[bytes, ...]:
    printed = (
        *(altitude(number, 1.5 * number) for number in range(5)),
        heard("argosy/test/uav/trace/inputs", stretch(0)),
    )
    path = Path(_folder().name, "whole.mcap")
    found = []
    for compression in COMPRESSIONS:
        writer = write(path, printed, compression)  # one without its end, and one with it
        found.append(path.read_bytes())
        writer.close(End("done", BEGIN))
        found.append(path.read_bytes())
    return tuple(found)


def _read_recording(data: bytes, _: random.Random) -> None:
    path = Path(_folder().name, "a.mcap")
    path.write_bytes(data)
    recording = Recording(path)
    for message in recording.messages():
        _ = message.record
    recording.minds()


_LIFE = MindInputs(
    header=Header(seq=0, stamp=1, boot="b1"),
    agent="uav",
    initial=InitialMind(program="a.asl", files={"a.asl": "+said(X) <- .print(X). +!go(X) <- +at(X). +?where(h)."}),
    last=1,
)


@cache
def _recorded_mail() -> tuple[bytes, ...]:
    """Stretches of a mind's inputs in which it gets mail."""
    contents = (("tell", Structure("said", (1, "x"))), ("achieve", Structure("go", (Atom("b"),))))
    contents += (("askOne", Structure("where", (Variable("X"),))), ("tellHow", Source("plan", "+!h <- .print(a).")))
    inputs = tuple(
        MindInput(
            cycle=2 + number,
            kind="Mail",
            fields={"sender": "b", "performative": performative, "content": content, "msg_id": f"b.{number}"},
        )
        for number, (performative, content) in enumerate(contents)
    )
    one = MindInputs(
        header=Header(seq=1, stamp=2, boot="b1"),
        agent="uav",
        number=1,
        last=8,
        steps=(MindStep(first=2, now=0.5),),
        inputs=inputs,
    )
    made = codec(MindInputs)
    return tuple(made.encode(replace(one, inputs=some), "json") for some in (inputs, inputs[:1], inputs[2:]))


def _read_recorded_mail(data: bytes, _: random.Random) -> None:
    made, path = codec(MindInputs), Path(_folder().name, "mail.mcap")
    first = heard("argosy/test/uav/trace/inputs", _LIFE)
    writer = write(path, (first, Heard(BEGIN, first.key, data, made.encodings["json"])), "none")
    writer.close(End("done", BEGIN))
    view, _notes = recorded_view(path, "uav")
    explain_view(view, "")


def _mail_file(message: bytes, text: str) -> Path:
    """Write a board's mail file that holds this message and text, in pages of 512 bytes."""
    path = Path(_folder().name, "whole.mail")
    path.unlink(missing_ok=True)
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("PRAGMA page_size = 512")
        migrate(db, MIGRATIONS)
        db.execute(
            "INSERT INTO mail(line, sender, receiver, numbering, number, posted, size, message)"
            " VALUES(?,?,?,?,?,?,?,?)",
            (text, text, "b", "n", 1, 0.0, len(message), message),
        )
        db.execute(
            "INSERT INTO dead(code, text, stamp, size, message) VALUES(?,?,?,?,?)",
            (text, text, 1, len(message), message),
        )
    return path


@cache
def _mail_files() -> tuple[bytes, ...]:
    message = Message(id="m1", sender="a", performative="tell", receiver="b", content=Structure("said", (1, "x")))
    encoded = codec(Message).encode(message, "msgpack")
    return (_mail_file(encoded, "a>b").read_bytes(), encoded)


def _read_mail_file(data: bytes, rng: random.Random) -> None:
    if not data.startswith(b"SQLite"):
        path = _mail_file(data, data[: rng.randint(0, 40)].decode(errors="replace"))
    else:
        path = _written(data, "a.mail")
    boxes = mailboxes_of_file(path)
    board_lines(boxes, True)
    msgspec.json.encode(msgspec.to_builtins(boxes))


# --- files -------------------------------------------------------------------------------------------------------


def _written(data: bytes, name: str) -> Path:
    path = Path(_folder().name, name)
    path.write_bytes(data)
    return path


def _read_manifest(data: bytes, _: random.Random) -> None:
    load_manifest(_written(data, "a.toml"), check=check_manifest)


def _read_ini(data: bytes, rng: random.Random) -> None:
    paper, path = ROOT / "missions" / "paper_uav", _written(data, "a.ini")
    if rng.random() < 0.5:
        load_ini_pair(path, paper / "perceptions_manifest")
    else:
        load_ini_pair(paper / "actions_manifest", path)


def _read_mission(data: bytes, _: random.Random) -> None:
    load_mission(_written(data, "a.yaml"))


def _read_project(data: bytes, _: random.Random) -> None:
    parse_project(data.decode(errors="replace"), "a.mas2j")


_YAML = (b"&a ", b"*a", b"- ", b"? ", b"!!python/object:os.system ", b"!!int ", b"<<: *a\n", b"|\n", b"---\n", b"1:2:3")
_TOML = (b"[[", b"]]", b'"""', b"'''", b"1979-13-99", b"0x", b"inf", b"nan", b".")

TARGETS = (
    Target("records, JSON", partial(_encoded, "json"), partial(_read_record, "json"), (), _BRACKETS),
    Target(
        "records, MessagePack",
        partial(_encoded, "msgpack"),
        partial(_read_record, "msgpack"),
        (),
        (b"\xdd\xff\xff\xff\xff", b"\xdf\x7f", b"\xc9"),
    ),
    Target("datagrams", _datagrams, _read_datagram, (BadDatagram, UnicodeDecodeError, BadTerm), _BRACKETS),
    Target("gateway", _datagrams, lambda data, rng: _gateway().read(data, rng), (BadTerm,), _BRACKETS),
    Target("keys", _keys, _read_key, (), (b"/", b"*", b"**", b"$*", b"?", b"#")),
    Target("MAVLink packets", _packets, _read_packets, (), (b"\xfd", b"\xfe", b"\xfd\xff\x01")),
    Target("MAVLink values", _packets, lambda data, rng: _vehicle().read(data, rng)),
    Target("MCAP", _recordings, _read_recording, (BadRecording,), (b"\x89MCAP0\r\n", b"\x06", b"\xff" * 8)),
    Target("recorded mail", _recorded_mail, _read_recorded_mail, (BadRecording, NotRecorded), _BRACKETS),
    Target("mail files", _mail_files, _read_mail_file, (Findings,), (b"SQLite format 3\0",), longest=20_000),
    Target("manifests", cache(partial(_files, "manifests/*.toml")), _read_manifest, (Findings,), (*_BRACKETS, *_TOML)),
    Target("INI", cache(partial(_files, "missions/paper_uav/*")), _read_ini, (Findings,), _BRACKETS),
    Target(
        "missions", cache(partial(_files, "missions/single_*.yaml")), _read_mission, (Findings,), (*_BRACKETS, *_YAML)
    ),
    Target(
        "projects",
        cache(partial(_files, "tests/data/check/*.mas2j", "docs/jason.md")),
        _read_project,
        (SyntaxErrors,),
        _BRACKETS,
    ),
)

_MOST = 140_000
"""Bytes: nearly as many as are read of a file."""
_LAUGHS = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{one}: &{one} [{','.join(['*' + before] * 9)}]\n" for before, one in zip("abcdefgh", "bcdefghi", strict=True)
)


def _lines(piece: str) -> str:
    return "".join(f"{piece.replace('N', str(n))}\n" for n in range(_MOST // (len(piece) + 5)))


BOMBS: dict[str, tuple[str, ...]] = {
    "records, JSON": ('{"name":"a","parameters":' + "[" * 3_000_000, '{"name":' + "9" * 3_000_000),
    "datagrams": ("<1,a,tell,b," + "[" * 4000 + ">", "<1,a,tell,b," + "(" * 4000 + ">", '<1,a,tell,b,"' + "\\" * 4000),
    "recorded mail": tuple(
        f'{{"agent":"uav","header":{{"boot":"b1"}},"number":{number},"last":{last}}}'
        for number, last in ((1, "9" * 30), ("9" * 30, 8), (-1, 8))
    ),
    "mail files": ("SQLite format 3\0" + "\xff" * 1000,),
    "manifests": (
        "a=" + "[" * 9_000,
        ("a." * 4_990 + "a=1\n") * 19,
        _lines("[percepts.aN]"),
        _lines("aN=1"),
        "[percepts.a]\nargs=[" + "1,\n" * (_MOST // 3) + "]",
        "a=" + "9" * 9_000,
    ),
    "INI": (
        ("[a]\nb" + " " * 9_990 + "c\n") * 18,
        "[a]\nx=1\n" + " a\n" * (_MOST // 3),
        _lines("[aN]"),
        "[a]\n" + _lines("xN=1"),
        "[a]\nname=/x\nmethod=topic\nparams_name=" + "[" * 9_000,
    ),
    "missions": (
        _LAUGHS,
        "a: &a [*a]",
        "[" * 9_990,
        "- a\n" * (_MOST // 4),
        "agents:\n" + _lines(" aN: 1"),
        "".join(" " * depth + "a:\n" for depth in range(500)),
        "mission: " + "9" * 9_000,
    ),
    "projects": ("MAS a { agents: " + "a; " * 10_000 + "}", "MAS a { environment: x(" + "[" * 10_000),
}
"""By target what is made to be slow or large."""
