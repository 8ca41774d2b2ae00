"""The JSON Schemas of records: Foxglove takes them, and what is sent fulfils them."""

import json
from typing import Any

import jsonschema
import pytest

from argosy.recording.json_schema import json_schema
from argosy.recording.records import RECORDS, record_of_encoding, record_put_on
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.mind_records import (
    DecisionView,
    FailureView,
    MindDecisions,
    MindInput,
    MindInputs,
    MindStep,
    PlanView,
    RejectedView,
)
from schemas.wire.records import ActionStatus, Health, Mail, Message, Perception, Record
from schemas.wire.terms import Atom, Number, Structure

PLAIN = ("boolean", "integer", "number", "string")


def taken_by_foxglove(schema: dict[str, Any], where: str = "$") -> None:
    """Hold a schema to what Foxglove's parser of JSON Schemas asks for."""
    assert schema["type"] == "object", where
    for name, field in schema["properties"].items():  # it wants properties in each object
        at = f"{where}.{name}"
        assert "oneOf" not in field, at
        match field["type"]:
            case "object":
                taken_by_foxglove(field, at)
            case "array" if field["items"]["type"] == "object":
                taken_by_foxglove(field["items"], at)
            case "array":
                assert field["items"]["type"] in PLAIN, at
            case kind:
                assert kind in PLAIN, at
                assert field.get("contentEncoding") in (None, "base64"), at


@pytest.mark.parametrize("record", RECORDS.values(), ids=RECORDS)
def test_foxglove_takes_the_schema_of_each_record(record: type[Record]) -> None:
    schema = json.loads(json_schema(record))
    jsonschema.Draft202012Validator.check_schema(schema)
    taken_by_foxglove(schema)


@pytest.mark.parametrize(
    "record",
    [
        Perception(name="at", parameters=(1, 2.5, "text", True, [1, [Atom("a")]], Structure("f", (Number("NaN"),)))),
        ActionStatus(id="1", state="running", feedback={"distance": 12.5}, parameters=(1,), after=3, deadline=2.0),
        Health(daemon="agentd", counters={"a": 1.0}, percepts={"uav": "digest"}, restarts=None),
        Mail(messages=(Message(id="1", sender="a", performative="tell", receiver="b", content=Structure("p")),)),
        MindInputs(
            steps=(MindStep(first=1, now=0.5),),
            inputs=(MindInput(cycle=1, kind="BeliefAdded", fields={"text": "a", "list": [1, 2]}),),
        ),
        MindDecisions(
            decisions=(
                DecisionView(
                    cycle=1,
                    time=0.0,
                    event="+!go",
                    kind="+!",
                    name="go/0",
                    rejected=(RejectedView(plan=PlanView(trigger="+!go"), why="context"),),
                    chosen=PlanView(trigger="+!go", bindings={"X": "1"}),
                    failure=FailureView(cycle=1, time=0.0, formula="f", error="e", given_up=("!go",)),
                ),
            )
        ),
    ],
    ids=lambda record: type(record).__name__,
)
def test_what_is_sent_fulfils_its_schema(record: Record) -> None:
    schema = json.loads(json_schema(type(record)))
    jsonschema.Draft202012Validator(schema).validate(json.loads(codec(type(record)).encode(record)))


@pytest.mark.parametrize(
    "text",
    ['{"name": 5}', '{"name": "a", "parameters": 5}', '{"update": "other"}', '{"name": "a", "header": {"seq": "1"}}'],
)
def test_what_is_no_such_record_does_not(text: str) -> None:
    schema = json.loads(json_schema(Perception))
    assert not jsonschema.Draft202012Validator(schema).is_valid(json.loads(text))


def test_the_record_on_a_key_is_known_by_the_table_of_channels() -> None:
    assert record_put_on(keys.percept("f", "uav", "altitude")) == "Perception"
    assert record_put_on(keys.trace("f", "uav", "inputs")) == "MindInputs"
    assert record_put_on(keys.services("f", "pi1")) == "BoardServices"
    assert record_put_on(keys.mind("f", "uav")) == ""  # nobody puts it
    assert record_put_on("sea/turtle1/pose") == ""
    assert record_of_encoding("application/json;argosy.Perception/1") == "Perception"
    assert record_of_encoding("application/json;other.Thing") == ""
    assert record_of_encoding("zenoh/bytes") == ""
