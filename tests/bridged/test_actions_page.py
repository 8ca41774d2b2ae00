"""The page about actions: its programs are right for a copter."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from agentd.__main__ import main

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/reference/actions.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("number", [0, 1])
def test_the_programs_of_the_page_are_right(number: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = tmp_path / "page.asl"
    program.write_text(re.findall(r"^```asl\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)[number])
    code = main(["check", "--manifest", "copter", str(program)])
    said = [line for line in capsys.readouterr().err.splitlines() if "is never" not in line and "no plan" not in line]
    assert (code, said) == (0, [])
