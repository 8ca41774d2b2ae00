"""A manifest written as TOML is the same manifest, and its JSON Schema agrees with what reading it finds."""

import json
import tomllib
from typing import Any

import jsonschema
import pytest
from hypothesis import given
from hypothesis import strategies as st

from schemas.files.findings import Findings
from schemas.files.shipped_files import shipped, shipped_names
from schemas.files.units import Duration
from schemas.manifest.document import document, write_toml
from schemas.manifest.json_schema import FILE, schema, schema_text
from schemas.manifest.loader import load_manifest, read_document, read_manifest
from schemas.manifest.model import ActionEntry, Field, FieldValue, Manifest, Parameter, PerceptEntry, Retry, RobotEntry
from schemas.manifest.rules import RESERVED

names = st.from_regex(r"[a-z][A-Za-z0-9_]{0,5}", fullmatch=True)
paths = st.one_of(names, st.sampled_from(["voltages.0", "a.b.c"]))
texts = st.text(st.characters(codec="utf-8", exclude_characters="\r"), max_size=8)
words = texts.filter(str.strip)
figures = st.floats(-1e12, 1e12)
durations = st.one_of(st.floats(1e-9, 1e6), st.sampled_from([0.5, 60, 90, 3600])).map(Duration)
factors = st.floats(-1e9, 1e9)
fields = st.recursive(
    st.builds(Field, field=paths, scale=factors, offset=factors, absent=st.none() | factors),
    lambda inner: st.builds(Field, field=paths, each=st.lists(inner | paths, max_size=3).map(tuple)),
    max_leaves=5,
)
percepts = st.builds(
    PerceptEntry,
    source=words,
    args=st.lists(fields | paths, max_size=3).map(tuple),
    rate=st.none() | st.floats(1e-3, 1e6),
    ttl=st.none() | durations,
    deadband=st.floats(0, 1e6),
)
types = st.sampled_from(["float", "int", "boolean", "string", "list"])
parameters = st.builds(
    Parameter, name=names, type=types | st.lists(types, min_size=1, max_size=2).map(tuple), unit=texts, each=st.just(())
) | st.builds(
    Parameter,
    name=names,
    type=st.just("list"),
    each=st.builds(lambda low, more: (Parameter(name="a", min=low, max=low + more),), figures, st.floats(0, 10)),
)
values = st.one_of(st.booleans(), st.integers(-(2**53), 2**53), figures, texts)
actions = st.builds(
    ActionEntry,
    topic=words,
    params=st.lists(parameters, max_size=3, unique_by=lambda one: one.name).map(tuple),
    fields=st.dictionaries(
        st.one_of(names, words),
        st.one_of(st.booleans(), figures, st.builds(FieldValue, value=values, scale=factors)),
        max_size=3,
    ),
    feedback=st.none() | st.lists(names, max_size=2, unique=True).map(tuple),
    latch=st.booleans(),
    deadline=durations,
    retry=st.builds(Retry, times=st.integers(0, 20), every=durations),
    cancel=st.sampled_from(["hold", "none"]),
    motion=st.booleans(),
)
manifests = st.builds(
    Manifest,
    robot=st.builds(RobotEntry, driver=words, vehicle=texts, link_loss=durations),
    percepts=st.dictionaries(names.filter(lambda name: name not in RESERVED["percepts"]), percepts, max_size=3),
    actions=st.dictionaries(names.filter(lambda name: name not in RESERVED["actions"]), actions, max_size=3),
    orders=st.dictionaries(st.sampled_from(["hold", "land", "rtl"]), words, max_size=2),
)


@given(manifests)
def test_any_manifest_written_as_toml_reads_as_an_equal_one(manifest: Manifest) -> None:
    read = read_manifest(write_toml(manifest), "m.toml")
    assert (read.robot, read.percepts, read.actions) == (manifest.robot, manifest.percepts, manifest.actions)
    assert read.orders == manifest.orders
    assert document(read_document(document(read), "")) == document(read)
    VALIDATOR.validate(json.loads(json.dumps(document(read))))


@pytest.mark.parametrize("name", shipped_names("manifests", ".toml"))
def test_a_shipped_manifest_says_where_its_schema_is_fits_it_and_survives_writing(name: str) -> None:
    path = shipped("manifests", f"{name}.toml")
    text = path.read_text(encoding="utf-8")
    assert text.startswith(f"#:schema ./{FILE}\n")
    VALIDATOR.validate(tomllib.loads(text))
    manifest = load_manifest(name)
    assert document(read_manifest(write_toml(manifest), "m.toml")) == document(manifest)


def test_the_shipped_schema_is_current() -> None:
    path = shipped("manifests", FILE)
    assert path.read_text(encoding="utf-8") == schema_text(), "write it anew: argosy manifest schema"


def test_the_schema_tells_what_every_field_means() -> None:
    for name, definition in schema()["$defs"].items():
        for field, said in definition["properties"].items():
            assert said.get("description") or "$ref" in said, f"{name}.{field}"


ROBOT = {"robot": {"driver": "zenoh"}}


@pytest.mark.parametrize(
    ("table", "name", "entry"),
    [
        ("percepts", "pose", {}),
        ("percepts", "pose", {"source": "p", "arg": []}),
        ("percepts", "pose", {"source": "p", "rate": 0}),
        ("percepts", "pose", {"source": "p", "buf": "append"}),
        ("percepts", "pose", {"source": "p", "ttl": "3 parsecs"}),
        ("percepts", "pose", {"source": "p", "key": [-1]}),
        ("percepts", "pose", {"source": "p", "args": [{"field": "x", "scle": 1}]}),
        ("percepts", "pose", {"source": "p", "args": [{"field": "x", "each": [3]}]}),
        ("percepts", "Pose", {"source": "p"}),
        ("percepts", "feedback", {"source": "p"}),
        ("actions", "go", {}),
        ("actions", "go", {"topic": "t", "service": "t"}),
        ("actions", "go", {"topic": 3}),
        ("actions", "go", {"topic": "t", "params": [{"type": "int"}]}),
        ("actions", "go", {"topic": "t", "params": [{"name": "x", "type": "metres"}]}),
        ("actions", "go", {"topic": "t", "params": [{"name": "x", "each": [{}]}]}),
        ("actions", "go", {"topic": "t", "fields": {"x": []}}),
        ("actions", "go", {"topic": "t", "retry": {"times": 99}}),
        ("actions", "go", {"topic": "t", "cancel": "stop"}),
        ("actions", "release", {"topic": "t"}),
        ("orders", "halt", "go"),
        ("orders", "hold", 3),
        ("percept", "pose", {"source": "p"}),
    ],
)
def test_the_schema_refuses_what_reading_refuses(table: str, name: str, entry: Any) -> None:
    told = ROBOT | {table: {name: entry}}
    assert not VALIDATOR.is_valid(told)
    with pytest.raises(Findings):
        read_document(told, "")


VALIDATOR = jsonschema.Draft202012Validator(schema())
