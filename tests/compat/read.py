"""Reads records by the code of whichever version it is run with, and says what it understood; for older code.

JSON on stdin and stdout: `{record: [[encoding, payload in base64], ...]}` becomes
`{record: {"fields": the names that the record has, "read": [what was understood as JSON, or the error]}}`.
"""

from __future__ import annotations

import base64
import json
import sys

from schemas import records
from schemas.codec import BadRecord, codec

answer = {}
for name, payloads in json.load(sys.stdin).items():
    made, read = codec(getattr(records, name)), []
    for encoding, payload in payloads:
        try:
            read.append(json.loads(made.encode(made.decode(base64.b64decode(payload), encoding))))
        except BadRecord as error:
            read.append(str(error))
    answer[name] = {"fields": list(made.record.__struct_fields__), "read": read}
json.dump(answer, sys.stdout)
