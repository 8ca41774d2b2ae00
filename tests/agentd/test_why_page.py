"""docs/guides/why.md tells the truth: each program on it says what stands below it."""

import re
from pathlib import Path

import pytest

from agentd.runtime.program_paths import SourcePaths
from agentd.standalone.decision_printer import DecisionPrinter
from agentd.standalone.standalone_team import Team, VirtualClock

PAGE = (Path(__file__).parents[2] / "docs/guides/why.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^\*\*(.*?)\*\*.*?^```asl\n(.*?)^```\n\n```text\n(.*?)^```\n", PAGE, re.MULTILINE | re.DOTALL)
SHOWN = [block for block in BLOCKS if not block[2].startswith("$ argosy why")]  # those: tests/argosy/why


@pytest.mark.parametrize(("program", "output"), [shown[1:] for shown in SHOWN], ids=[shown[0] for shown in SHOWN])
def test_a_program_of_the_page_says_what_stands_below_it(
    program: str, output: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("fly.asl").write_text(program, encoding="utf-8")
    programs = [("bob", SourcePaths().compiled("fly.asl"))]
    narrator = DecisionPrinter() if "why:" in output else None
    Team(programs, clock=VirtualClock(), narrator=narrator).run(60, True)
    assert capsys.readouterr().err == output
