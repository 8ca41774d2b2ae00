"""docs/reference/records.md is what the modules of records in schemas/wire declare."""

from __future__ import annotations

import msgspec

from schemas.wire import mind_records, vehicle_records
from schemas.wire import records as declared
from tests.docs.records_page import PAGE, page, records


def test_the_page_is_what_the_declarations_say() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "make reference"


def test_every_record_stands_on_it_with_every_field() -> None:
    told = {one.name: [name for name, *_ in one.fields] for one in records()}
    everything = vars(declared) | vars(vehicle_records) | vars(mind_records)
    named = {
        name: one for name, one in everything.items() if isinstance(one, type) and issubclass(one, declared.Record)
    }
    assert set(told) == set(named) - {"Record"}
    for name, fields in told.items():
        assert fields == [one.name for one in msgspec.structs.fields(named[name])]
