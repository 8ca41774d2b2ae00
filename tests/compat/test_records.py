"""Records of another major version: refused by the number in their encoding."""

from __future__ import annotations

import base64

import pytest

from schemas.wire.codec import BadRecord, codec
from schemas.wire.records import VERSION
from tests.compat.samples import all_records, recorded

SAMPLES = recorded()


@pytest.mark.parametrize("name", sorted(all_records()))
def test_a_record_of_the_next_major_version_is_refused_by_its_number(name: str) -> None:
    made, one = codec(all_records()[name]), SAMPLES[name][0]
    encoding = one["encoding"]
    packed = base64.b64decode(one["msgpack"]), encoding.replace("json", "msgpack")
    for payload, of in ((one["json"].encode(), encoding), packed):
        with pytest.raises(BadRecord) as refused:
            made.decode(payload, of.replace(f"/{VERSION}", f"/{VERSION + 1}"))
        assert str(refused.value) == f"{name}: version 2 of the record, this daemon speaks version 1"
