"""The mistakes of `tests/data/syntax`: below each text, as a JSON string, its place as line:column, and the message."""

import json
import re
from pathlib import Path

SYNTAX = Path(__file__).parents[1] / "data" / "syntax"


def mistakes(name: str) -> list[tuple[str, str, str]]:
    """Return text, place and message of each mistake of a file."""
    found = re.findall(r'^(".*")\n    (\S+) (.*)$', (SYNTAX / name).read_text(encoding="utf-8"), re.MULTILINE)
    return [(json.loads(text), place, message) for text, place, message in found]
