"""A daemon of the next major version of the records: `python -m tests.compat.next_major agentd serve ...`."""

import importlib
import sys

import schemas.wire.codec
import schemas.wire.records

NEXT = schemas.wire.records.VERSION + 1

if __name__ == "__main__":
    for module in (schemas.wire.records, schemas.wire.codec):
        module.VERSION = NEXT  # type: ignore[attr-defined]
    import commd.bus.queries

    assert commd.bus.queries.VERSION == NEXT
    sys.exit(importlib.import_module(f"{sys.argv[1]}.__main__").main(sys.argv[2:]))
