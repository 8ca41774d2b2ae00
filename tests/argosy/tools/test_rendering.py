"""Each record in one line, found out by its Encoding, or by its key and its fields, JSON or MessagePack."""

import json

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from argosy.tools import echo
from argosy.tools.bus_tap import Heard
from argosy.tools.record_text import candidates, line_of, read_record, record_text
from argosy.zenoh_cli_codec import decode, encode
from schemas.humanize import LONGEST
from schemas.manifest.loader import ActionDescription
from schemas.wire import keys
from schemas.wire.codec import Wire, codec
from schemas.wire.mind_records import (
    ActivityEvent,
    BeliefView,
    DecisionView,
    IntentionView,
    MindActivity,
    MindDecisions,
    MindInputs,
    MindOrder,
    MindView,
    PlanView,
)
from schemas.wire.records import (
    Action,
    ActionStatus,
    BoardReport,
    BoardServices,
    Cancel,
    Checkup,
    Header,
    Health,
    LinkReport,
    LiveManifest,
    Mail,
    Mailboxes,
    ManifestChange,
    Message,
    Note,
    Outcome,
    Perception,
    Perceptions,
    Queue,
    Receipt,
    Record,
    Refusal,
    RunningMission,
    RunState,
    ServiceRequest,
    StopOrder,
)
from schemas.wire.terms import Atom
from schemas.wire.vehicle_records import ParameterRequest, StoredPlan, VehicleParameters

HEADER = Header(seq=3, stamp=5, source="uav1", boot="b")
RECORDS: list[tuple[str, Record, str]] = [
    ("uav/percept/altitude", Perception(header=HEADER, name="altitude", parameters=(4.9,)), "altitude(4.9)"),
    ("uav/percept/hit", Perception(header=HEADER, name="hit", update="add"), "+hit"),
    ("uav/percept/link", Perception(name="link", parameters=(Atom("up"),), update="remove", key=(0,)), "-link(up)"),
    ("uav/percept/victim", Perception(parameters=(1, 2, 3)), "victim(1,2,3)"),
    (
        "uav/percepts",
        Perceptions(changes=(Perception(name="gps", parameters=(3,)), Perception(name="hit", update="add"))),
        "gps(3); +hit",
    ),
    (
        "uav/status/takeoff",
        ActionStatus(
            id="i", state="running", name="takeoff", parameters=(5,), feedback={"altitude": 3.2, "to_go": 1.8}
        ),
        "takeoff(5) running, altitude 3.2, to_go 1.8",
    ),
    (
        "uav/action/takeoff",
        ActionStatus(id="i", state="timed_out", result=False, name="takeoff", parameters=(5,), reason="not done"),
        "takeoff(5) timed out: not done",
    ),
    (
        "uav/action/takeoff",
        Action(id="i", agent="uav", name="takeoff", parameters=(5,), attempt=2),
        "takeoff(5), attempt 2",
    ),
    (
        "uav/action/takeoff",
        ActionDescription(
            name="takeoff", signature="takeoff(altitude: float 1..120 m)", confirm="altitude", deadline=60
        ),
        "takeoff(altitude: float 1..120 m) by altitude within 60 s",
    ),
    ("uav/cancel", Cancel(id="i"), "cancel i"),
    (
        "uav1/health/bridged",
        Health(
            header=HEADER,
            daemon="bridged",
            uptime=61.2,
            cpu=1.25,
            drops=2,
            lag=0.7,
            notes=(Note("a", "low disk"), Note("b", "no GPS")),
        ),
        "bridged up 61 s, cpu 1.2 s, dropped 2, behind 0.7 s; low disk; no GPS",
    ),
    (
        "b/mail/a",
        Mail(messages=(Message(id="1", sender="a", performative="tell", receiver="b", content=[1, Atom("x")]),)),
        "a > b tell [1,x]",
    ),
    (
        "b/inbox",
        Receipt(taken=2, refused={1: Refusal(code="mailbox_full")}),
        "taken 2, refused or later: 1: mailbox_full",
    ),
    (
        "pi1/services",
        BoardServices(header=HEADER, board="pi1", agents={"a": ("scan", "fly"), "b": ()}, found=("c",)),
        "pi1: a (scan, fly), b; found c",
    ),
    ("pi1/services/a", ServiceRequest(agent="a", do="search", service="scan"), "a search scan"),
    (
        "pi1/mailboxes",
        Mailboxes(
            board="pi1", store="x", queues=(Queue(box="outbox", sender="a", receiver="b", messages=3),), dead_count=1
        ),
        "pi1: a > b 3; 1 given up",
    ),
    (
        "pi1/checkup",
        BoardReport(
            board="pi1", state="/s", disk_free=2_000_000_000, links=(LinkReport(board="pi2", asked=5, answered=4),)
        ),
        "pi1: /s, 2.0 GB free; links pi2 4/5",
    ),
    ("pi1/checkup", Checkup(links=True), 'Checkup {"links":true}'),
    ("uav1/stop", StopOrder(order="hold"), "hold"),
    ("uav1/parameters", ParameterRequest(name="RTL_ALT", value=3000), "RTL_ALT = 3000"),
    ("uav1/parameters", VehicleParameters(values={"RTL_ALT": 3000}, came=1, of=1), "1 of 1 parameters: RTL_ALT = 3000"),
    ("uav1/stored_plan", StoredPlan(came=2, of=9, problem="silence"), "2 of 9 items; silence"),
    ("pi1/mission", RunningMission(file="sar.yaml", text="mission: sar\n"), "sar.yaml, 13 characters"),
    (
        "operator/run",
        RunState(phase="bringing_home", why="failed: it is dark", mission_time=61.04),
        "bringing home: failed: it is dark (61.0 s)",
    ),
    ("uav1/stop", Outcome(ok=False, reason="not heard"), "NOT done: not heard"),
    (
        "uav1/manifest",
        LiveManifest(robot="uav1", version=2, file="m.toml", problems=("bad",)),
        "uav1 version 2 of m.toml; refused: bad",
    ),
    (
        "uav1/manifest",
        ManifestChange(set={"percepts.a.rate": 5}, remove=("percepts.b",)),
        "percepts.a.rate = 5, without percepts.b",
    ),
    (
        "uav/mind",
        MindView(
            agent="uav",
            cycle=7,
            state="reasoning",
            beliefs=(BeliefView(text="a"),),
            beliefs_left_out=2,
            intentions=(IntentionView(id=1, state="waiting", stack=("+!b", "+!a")),),
        ),
        "uav: cycle 7 reasoning, 3 beliefs; +!a waiting",
    ),
    ("uav/control", MindOrder(do="goal", text="go(3,4)"), "goal go(3,4)"),
    ("uav/trace/inputs", MindInputs(agent="uav", number=3, last=40), "uav: batch 3 to cycle 40, 0 inputs"),
    (
        "uav/trace/decisions",
        MindDecisions(
            agent="uav",
            decisions=(
                DecisionView(
                    cycle=1,
                    time=1,
                    event="+!go",
                    kind="+!",
                    name="go/0",
                    chosen=PlanView(trigger="+!go", position="a.asl:3"),
                ),
                DecisionView(cycle=1, time=1, event="+x", kind="+", name="x/0"),
            ),
            left_out=4,
        ),
        "+!go: +!go (a.asl:3); +x: no plan; 4 left out",
    ),
    (
        "uav/trace/activity",
        MindActivity(
            agent="uav",
            events=(
                ActivityEvent(kind="print", text="hello"),
                ActivityEvent(kind="sent", other="b", performative="tell", text="p(1)"),
                ActivityEvent(kind="outcome", text="takeoff(5)", state="failed", reason="no"),
            ),
        ),
        "print hello; sent b tell p(1); outcome takeoff(5) failed: no",
    ),
]


@pytest.mark.parametrize("wire", ["json", "msgpack"])
@pytest.mark.parametrize("named", [True, False], ids=["with its Encoding", "by key and fields"])
@pytest.mark.parametrize(("key", "record", "line"), RECORDS, ids=lambda one: type(one).__name__)
def test_a_record_is_shown_in_one_line(key: str, record: Record, line: str, wire: Wire, named: bool) -> None:
    made = codec(type(record))
    assert line_of(f"argosy/f/{key}", made.encode(record, wire), made.encodings[wire] if named else "") == line


def test_every_record_of_the_table_is_shown_in_words() -> None:
    shown = {type(record) for _, record, _ in RECORDS}
    assert {kind for channel in keys.CHANNELS for kind in (channel.carries, channel.answers) if kind} <= shown
    for _, record, _ in RECORDS:
        assert isinstance(record, Checkup) or not record_text(record).startswith(f"{type(record).__name__} {{")


def test_a_key_says_which_records_may_be_on_it() -> None:
    assert candidates("argosy/f/uav/percept/altitude") == (Perception,)
    assert set(candidates("argosy/f/uav/action/go?_time=[..]")) == {Action, ActionStatus, ActionDescription}
    assert candidates("turtle1/pose") == candidates("argosy/f") == candidates("argosy/f/uav/nonsense") == ()


@pytest.mark.parametrize(
    ("key", "payload", "line"),
    [
        ("turtle1/pose", b'{"x": 1, "y": [2]}', '{"x":1,"y":[2]}'),
        ("turtle1/pose", msgspec.msgpack.encode({"x": 1}), '{"x":1}'),
        ("turtle1/name", b"Leonardo\n\x1b[2J", "Leonardo  [2J"),
        ("turtle1/picture", b"\xff\xfe\xfd", "(3 bytes)"),
        ("turtle1/nothing", b"", "(empty)"),
        (
            "argosy/f/uav/percept/a",
            b'{"name":"a","parameters":[null]}',
            "(Perception: Expected a term, got `null` - at `$.parameters[0]`)",
        ),
        ("argosy/f/uav/percept/a", b'{"name":"a","colour":"red"}', "a"),  # of a newer sender
        ("argosy/f/uav/percept/a", b"[" * 5000, "[" * (LONGEST - 1) + "…"),
    ],
)
def test_what_is_no_record_is_shown_as_it_is(key: str, payload: bytes, line: str) -> None:
    assert line_of(key, payload) == line
    assert decode(key, payload) == line


def test_another_version_and_another_record_are_said() -> None:
    assert line_of("argosy/f/uav/percept/a", b"{}", "application/json;argosy.Perception/2") == (
        "(Perception: version 2 of the record, this daemon speaks version 1)"
    )
    assert line_of("argosy/f/uav/percept/a", b'{"x":1}', "application/json;argosy.Novelty/1") == '{"x":1}'


PAYLOADS = st.one_of(
    st.binary(max_size=60),
    st.recursive(
        st.one_of(st.none(), st.integers(-(2**63), 2**64 - 1), st.floats(), st.text(max_size=5), st.binary(max_size=5)),
        lambda inner: st.one_of(
            st.lists(inner, max_size=3),
            st.dictionaries(
                st.one_of(st.integers(0, 9), st.binary(max_size=3), st.text(max_size=3)), inner, max_size=3
            ),
        ),
        max_leaves=8,
    ).map(msgspec.msgpack.encode),
)
KEYS = st.one_of(st.sampled_from([f"argosy/f/{key}" for key, _, _ in RECORDS]), st.text(min_size=1, max_size=12))
ENCODINGS = st.sampled_from(["", "application/json", "application/msgpack", "application/msgpack;argosy.Perception/1"])
TYPED = st.text(alphabet='+-()[]", abX_1.~|\\', max_size=12)


@given(KEYS, PAYLOADS, ENCODINGS)
def test_echo_shows_whatever_is_said_in_a_line_that_no_terminal_takes_for_a_command(
    key: str, payload: bytes, encoding: str
) -> None:
    heard = Heard(key, payload, encoding, 1.5, 1.5)
    for line in (echo._line(heard), echo._json(heard), echo._raw_on_a_terminal(heard)):
        assert line.isprintable()
    said = json.loads(echo._json(heard), parse_constant=pytest.fail)
    assert said["key"] == key


def test_what_json_cannot_say_is_shown_all_the_same() -> None:
    heard = Heard("x/\x1b[31m", b"\x81\xc4\x01a\x01", "", 1.5, 1.5)
    assert json.loads(echo._json(heard))["record"] == {"YQ==": 1}
    assert echo._json(Heard("x", b'{"a":"\xc2\x9b2J"}', "", 1.5, 1.5)) == (
        '{"key":"x","encoding":"","at":1.5,"record":{"a":"\\u009b2J"}}'
    )
    assert echo._raw_on_a_terminal(heard).startswith("x/\\u001b[31m ")
    assert echo._raw(heard).startswith("x/\x1b[31m ")


@given(st.sampled_from([key for key, _, _ in RECORDS]), st.binary(max_size=60))
def test_no_bytes_are_a_defect(key: str, payload: bytes) -> None:
    line = line_of(f"argosy/f/{key}", payload)
    assert len(line) <= LONGEST
    assert line.isprintable()


@pytest.mark.parametrize(
    ("key", "text", "record"),
    [
        ("uav/action/takeoff", "takeoff(5)", Action(name="takeoff", parameters=(5,))),
        ("uav/action/takeoff", "takeoff 5", Action(name="takeoff", parameters=(5,))),
        ("uav/action/land", "land", Action(name="land")),
        ("uav/action/land?_time=[..]", "land()", Action(name="land")),
        ("uav/percept_by_hand/victim", "victim(1,2)", Perception(name="victim", parameters=(1, 2))),
        ("uav/percept_by_hand/victim", "+victim(1,2)", Perception(name="victim", parameters=(1, 2), update="add")),
        ("uav/percept_by_hand/victim", "-victim", Perception(name="victim", update="remove")),
        ("uav/cancel", "uav:b:1", Cancel(id="uav:b:1")),
        ("uav1/stop", "hold", StopOrder(order="hold")),
        ("uav/control", "goal go(3, 4)", MindOrder(do="goal", text="go(3, 4)")),
        ("uav/control", "pause", MindOrder(do="pause")),
    ],
)
def test_text_becomes_the_record_that_it_means_on_its_key(key: str, text: str, record: Record) -> None:
    made = encode(f"argosy/f/{key}", text)
    assert codec(type(record)).decode(made) == record
    assert read_record(f"argosy/f/{key}", made) is not None


@pytest.mark.parametrize("text", ["+", "--", "+-", "( )", '"', "(", "+("])
def test_text_without_a_name_ends_in_words(text: str) -> None:
    with pytest.raises(SystemExit, match=r"error: \S"):
        encode("argosy/f/uav/percept/x", text)


def test_a_text_with_brackets_is_an_argument_as_any() -> None:
    made = codec(Action).decode(encode("argosy/f/uav/action/set_mode", 'set_mode "a (b)" [1,2]'))
    assert made == Action(name="set_mode", parameters=("a (b)", [1, 2]))


@given(st.sampled_from([key for key, _, _ in RECORDS]), st.one_of(st.text(max_size=30), TYPED))
def test_no_text_is_a_defect_of_encode(key: str, text: str) -> None:
    try:
        made = encode(f"argosy/f/{key}", text)
    except SystemExit as ended:
        assert str(ended).startswith("error: ")
    else:
        assert isinstance(made, bytes)


def test_json_is_sent_as_it_is_and_what_means_nothing_ends_in_words() -> None:
    assert json.loads(encode("argosy/f/uav/action/land", ' {"parameters": []}')) == {"parameters": []}
    with pytest.raises(SystemExit) as ended:
        encode("argosy/f/uav1/stop", "halt")
    assert str(ended.value).startswith("error: `halt` means nothing on argosy/f/uav1/stop: expected JSON, an action")
    with pytest.raises(SystemExit, match=r"error: expected a term at character 4"):
        encode("argosy/f/uav/action/go", "go(")
