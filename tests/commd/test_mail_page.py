"""What docs/guides/mail.md shows works as it says."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys

from commd.gateway.gateway import read_message
from tests.support.processes import ROOT, running

PAGE = (ROOT / "docs/guides/mail.md").read_text()
PROGRAM = ROOT / "examples" / "client" / "planner.py"


def commands() -> list[list[str]]:
    section = PAGE.partition("\n## Programs in Python\n")[2].partition("\n## ")[0]
    return [shlex.split(line) for line in re.findall(r"^((?:argosy|python) .*)$", section, re.MULTILINE)]


def test_the_program_of_the_page_is_the_example() -> None:
    shown = re.findall(r"^```python\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    assert shown == [PROGRAM.read_text()]


def test_the_example_of_the_page_plans_a_mission_as_printed(endpoint: str) -> None:
    (run, *mission), (_, *program) = commands()
    with running(run, *mission, "--router", endpoint) as argosy:
        planner = subprocess.run(
            [sys.executable, *program, endpoint], cwd=ROOT, capture_output=True, text=True, timeout=60
        )
        assert sorted(planner.stdout.splitlines()) == [
            "scout says surveyed(east,2)",
            "scout says surveyed(north,0)",
            "scout says surveyed(south,1)",
            "scout says unknown(atlantis)",
        ], planner.stderr + argosy.text
        assert planner.returncode == 0
        assert argosy.ends() == 0, argosy.text


def test_the_datagrams_of_the_page_are_ones() -> None:
    shown = [text for text in re.findall(r"`(<[a-z]+[^`]*>)`", PAGE) if "itlforce" not in text]
    assert [read_message(text).performative for text in shown] == ["tell", "signal"]
