"""What docs/guides/mail.md shows works as it says."""

import re

from commd.gateway.gateway import read_message
from tests.support.processes import ROOT

PAGE = (ROOT / "docs/guides/mail.md").read_text()
PROGRAM = ROOT / "examples" / "client" / "planner.py"


def test_the_program_of_the_page_is_the_example() -> None:
    shown = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert shown == [PROGRAM.read_text()]


def test_the_datagrams_of_the_page_are_ones() -> None:
    shown = [text for text in re.findall(r"`(<[a-z]+[^`]*>)`", PAGE) if "itlforce" not in text]
    assert [read_message(text).performative for text in shown] == ["tell", "signal"]
