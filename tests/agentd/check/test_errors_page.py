"""docs/reference/errors.md tells the truth: each program on it gets the messages that stand below it."""

import re
from pathlib import Path

import pytest

from agentd.check.finding_kinds import Kind
from tests.agentd.check.conftest import Check

PAGE = (Path(__file__).parents[3] / "docs/reference/errors.md").read_text(encoding="utf-8")
SHOWN = re.findall(r"^\*\*(.*?)\*\*.*?^```asl\n(.*?)^```\n\n```text\n(.*?)^```\n", PAGE, re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize(("program", "output"), [shown[1:] for shown in SHOWN], ids=[shown[0] for shown in SHOWN])
def test_a_program_of_the_page_gets_the_messages_below_it(program: str, output: str, check: Check) -> None:
    told = check({"hello.asl": program})
    assert (told.code, told.err) == (1, output)


def test_the_page_lists_the_kinds_of_findings() -> None:
    rows = [f"| `{kind.label}` | {kind.meaning} |" for kind in Kind]
    assert (
        re.findall(r"^\| `[a-z-]+-?[a-z-]*` \| [a-z(].*\|$", PAGE.partition("`--json` prints")[0], re.MULTILINE) == rows
    )
