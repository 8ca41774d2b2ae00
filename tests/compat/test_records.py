"""Records of two versions within a major one: the newer reads the older, and the older what it knows of the newer."""

from __future__ import annotations

import base64
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from schemas.codec import BadRecord, codec
from schemas.records import VERSION
from tests.compat.older import DATA, unpack
from tests.compat.samples import all_records, recorded

OLDER = json.loads((DATA / "records-0.1.0.json").read_text())
NEWER = recorded()
CHOICES_OF_NEWER: dict[str, set[str]] = {"StopOrder": {"pause", "continue"}}
"""Choices of a field that the older version has not, and refuses, by record; each stands in docs/versions.md."""
MISSED_BY_OLDER = {"Perception": {"name"}}
"""Fields that only the older version must have, by record; who leaves them out stands in docs/versions.md."""


def test_the_recorded_version_has_the_same_major_version() -> None:
    assert {one["encoding"].rpartition("/")[2] for samples in OLDER.values() for one in samples} == {str(VERSION)}


@pytest.mark.parametrize("name", sorted(OLDER))
def test_newer_reads_each_record_of_older_to_the_last_field(name: str) -> None:
    made = codec(all_records()[name])
    for one in OLDER[name]:
        said = json.loads(one["json"])
        for payload, encoding in ((one["json"].encode(), one["encoding"]), _packed(one)):
            assert made.unknown_fields(payload, encoding) == []
            assert json.loads(made.encode(made.decode(payload, encoding))) == said, "no field or default has changed"


@pytest.fixture(scope="module")
def read_by_older(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Return what the older version makes of all samples of the present one, JSON and MessagePack in turn."""
    asked = {
        name: [
            [encoding, base64.b64encode(payload).decode()]
            for one in NEWER[name]
            for payload, encoding in ((one["json"].encode(), one["encoding"]), _packed(one))
        ]
        for name in OLDER
    }
    done = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("read.py"))],
        env={**os.environ, "PYTHONPATH": str(unpack(tmp_path_factory.mktemp("older")))},
        input=json.dumps(asked),
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


@pytest.mark.parametrize("name", sorted(OLDER))
def test_older_reads_what_it_knows_of_each_record_of_newer(name: str, read_by_older: dict[str, Any]) -> None:
    known, read = read_by_older[name]["fields"], read_by_older[name]["read"]
    assert set(known) <= set(all_records()[name].__struct_fields__), "no field is gone"
    said = [json.loads(one["json"]) for one in NEWER[name] for _ in range(2)]
    for sent, understood in zip(said, read, strict=True):
        if isinstance(understood, str):
            left_out = MISSED_BY_OLDER.get(name, set()) - sent.keys()
            assert left_out or any(choice in CHOICES_OF_NEWER.get(name, ()) for choice in sent.values()), understood
            continue
        assert _within(understood, sent)
        assert set(understood) == set(sent) & set(known)


def test_the_older_version_does_know_less(read_by_older: dict[str, Any]) -> None:
    assert "version" not in read_by_older["Health"]["fields"]
    assert any("version" in json.loads(one["json"]) for one in NEWER["Health"])


def _packed(one: dict[str, str]) -> tuple[bytes, str]:
    return base64.b64decode(one["msgpack"]), one["encoding"].replace("json", "msgpack")


def _within(part: Any, whole: Any) -> bool:
    """Whether all of `part` stands in `whole` too: what is understood was said."""
    if isinstance(part, dict):
        return isinstance(whole, dict) and all(key in whole and _within(part[key], whole[key]) for key in part)
    if isinstance(part, list):
        return (
            isinstance(whole, list)
            and len(part) == len(whole)
            and all(_within(*pair) for pair in zip(part, whole, strict=True))
        )
    return bool(part == whole)


@pytest.mark.parametrize("name", sorted(all_records()))
def test_a_record_of_the_next_major_version_is_refused_by_its_number(name: str) -> None:
    made, one = codec(all_records()[name]), NEWER[name][0]
    for payload, encoding in ((one["json"].encode(), one["encoding"]), _packed(one)):
        with pytest.raises(BadRecord) as refused:
            made.decode(payload, encoding.replace(f"/{VERSION}", f"/{VERSION + 1}"))
        assert str(refused.value) == f"{name}: version 2 of the record, this daemon speaks version 1"
