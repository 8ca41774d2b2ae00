"""Records and terms survive the wire; bad bytes are told apart, by field."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from commd.gateway.gateway import BadDatagram, read_message, write_message
from schemas.wire import mind_records, records
from schemas.wire.codec import MAX_BYTES, BadRecord, Wire, codec
from schemas.wire.records import Action, ActionStatus, Header, Health, Message, Perception
from schemas.wire.term_text import BadTerm, read, write
from schemas.wire.terms import Term
from tests.schemas.strategies import plain_terms, terms

WIRES: tuple[Wire, ...] = ("json", "msgpack")


@pytest.mark.parametrize("wire", WIRES)
@given(parameters=st.lists(terms, max_size=3).map(tuple))
def test_every_kind_of_term_survives_the_wire(wire: Wire, parameters: tuple[Term, ...]) -> None:
    made = codec(Perception)
    sent = Perception(header=Header(seq=1, stamp=2, source="uav1", boot="b"), name="p", parameters=parameters)
    back = made.decode(made.encode(sent, wire), made.encodings[wire])
    assert back == sent
    assert list(map(type, back.parameters)) == list(map(type, sent.parameters))


@given(term=plain_terms)
def test_every_plain_term_survives_its_text(term: Term) -> None:
    assert read(write(term)) == term


@given(content=plain_terms, reply=st.sampled_from(["", "mid3"]))
def test_messages_survive_the_papers_text_form(content: Term, reply: str) -> None:
    message = Message(
        id="mid7", sender="scout", performative="tell", receiver="rescuer1", content=content, in_reply_to=reply
    )
    assert read_message(write_message(message)) == message


def test_the_papers_text_form_reads_as_jason_writes_it() -> None:
    message = read_message("<mid1->mid0,scout,tell,rescuer1,victim(1,-27.6,-48.5)[source(scout)]>")
    assert (message.id, message.in_reply_to, message.sender) == ("mid1", "mid0", "scout")
    assert write(message.content) == "victim(1,-27.6,-48.5)[source(scout)]"


@pytest.mark.parametrize(
    ("text", "error"),
    [
        ("hello", "expected `<id,sender,itlforce,receiver,data>`"),
        ("<1,a,tell>", "expected five fields `<id,sender,itlforce,receiver,data>`, got 3"),
        ("<1,,tell,b,x>", "sender: expected a name, got ``"),
        ("<1,a,tell,b,f(>", "data: expected a term at character 3, got the end: f("),
        ("<1,a,tell,b," + "[" * 5000 + ">", "data: nested deeper than 200"),
    ],
)
def test_a_bad_datagram_says_which_part_is_wrong(text: str, error: str) -> None:
    with pytest.raises(BadDatagram) as caught:
        read_message(text)
    assert str(caught.value).startswith(error)


@given(text=st.text("abX_1.\"'()[]{}|,~:+- \n\\", max_size=30))
def test_reading_any_text_gives_a_term_or_says_why_not(text: str) -> None:
    try:
        read(text)
    except BadTerm as error:
        assert "expected" in str(error) or "nested" in str(error)


@pytest.mark.parametrize("value", [float("inf"), float("-inf"), float("nan"), 1e301])
def test_a_number_that_json_cannot_pass_on_is_refused_in_messagepack_too(value: float) -> None:
    made = codec(Health)
    for record in (Health(counters={"a": value}), Health(lag=value), Health(last_error_age=value)):
        with pytest.raises(BadRecord, match=r"Health: Expected `float` (<=|>=) "):
            made.decode(made.encode(record, "msgpack"), made.encodings["msgpack"])


def test_an_integer_that_fits_no_file_and_no_time_is_refused() -> None:
    for number in (2**63, -(2**63) - 1, 10**30):
        with pytest.raises(BadRecord, match="Perception: "):
            codec(Perception).decode(b'{"name":"a","header":{"stamp":%d}}' % number)


@pytest.mark.parametrize("place", ["%d", "[[%d]]", '{"kind":"structure","functor":"f","args":[%d]}'])
@pytest.mark.parametrize("number", [2**63, -(2**63) - 1, 10**400])
def test_an_integer_in_a_term_that_no_number_of_a_mind_holds_is_refused(place: str, number: int) -> None:
    with pytest.raises(BadRecord, match=r"Perception: .*got an integer of more than 64 bits"):
        codec(Perception).decode(f'{{"name":"a","parameters":[{place % number}]}}'.encode())


@pytest.mark.parametrize(
    ("payload", "error"),
    [
        (b"", "Perception: Input data was truncated"),
        (b"\xff", "Perception: JSON is malformed: invalid character (byte 0)"),
        (b'{"name":7}', "Perception: Expected `str`, got `int` - at `$.name`"),
        (b'{"name":"a","update":"set"}', "Perception: Invalid enum value 'set' - at `$.update`"),
        (
            b'{"name":"a","parameters":[{"kind":"atom","name":3}]}',
            "Perception: atom: Expected `str`, got `int` - at `$.name` - at `$.parameters[0]`",
        ),
        (b'{"name":"a","parameters":[null]}', "Perception: Expected a term, got `null` - at `$.parameters[0]`"),
        (b'{"name":"a","parameters":' + b"[" * 100_000 + b"]" * 100_000 + b"}", "Perception: nested too deeply"),
        (b" " * (MAX_BYTES + 1), f"Perception: {MAX_BYTES + 1} bytes, expected at most {MAX_BYTES}"),
    ],
)
def test_bad_bytes_give_an_error_that_names_the_field(payload: bytes, error: str) -> None:
    with pytest.raises(BadRecord) as caught:
        codec(Perception).decode(payload)
    assert str(caught.value) == error


def test_another_major_version_or_record_is_refused_by_name() -> None:
    with pytest.raises(BadRecord, match="version 2 of the record, this daemon speaks version 1"):
        codec(Perception).decode(b'{"name":"a"}', "application/json;argosy.Perception/2")
    with pytest.raises(BadRecord, match="ActionStatus: version 2 of the record"):
        codec(ActionStatus).decode(b'{"name":"a"}', "application/json;argosy.ActionDescription/2")
    with pytest.raises(BadRecord, match="expected a Perception, got a Action"):
        codec(Perception).decode(b'{"name":"a"}', "application/json;argosy.Action/1")


@pytest.mark.parametrize("wire", ["json", "msgpack"])
def test_each_record_of_the_next_major_version_is_refused_by_its_number(wire: Wire) -> None:
    own = [one for one in (*vars(records).values(), *vars(mind_records).values()) if isinstance(one, type)]
    for record in (one for one in own if issubclass(one, records.Record) and one is not records.Record):
        encoding = codec(record).encodings[wire].rpartition("/")[0]
        with pytest.raises(BadRecord, match="version 2 of the record, this daemon speaks version 1"):
            codec(record).decode(b"{}", f"{encoding}/2")


def test_unknown_fields_are_ignored_and_can_be_counted() -> None:
    payload = b'{"name":"a","colour":"red"}'
    assert codec(Perception).decode(payload).name == "a"
    assert codec(Perception).unknown_fields(payload) == ["colour"]


def test_an_action_by_hand_needs_only_its_parameters() -> None:
    assert codec(Action).decode(b'{"parameters":[5]}', "zenoh/bytes").parameters == (5,)


def test_a_field_that_must_be_there_is_named() -> None:
    with pytest.raises(BadRecord, match=r"^ActionStatus: Object missing required field `state`$"):
        codec(ActionStatus).decode(b'{"id":"uav:b:1"}')


def test_a_field_whose_name_is_not_utf_8_is_unknown() -> None:
    payload = b'{"name":"a","\x95":1}'
    assert codec(Perception).decode(payload).name == "a"
    assert codec(Perception).unknown_fields(payload) == ["\ufffd"]
