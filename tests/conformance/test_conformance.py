"""The corpus of programs with the output that Jason 3.3 printed for them: byte for byte."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

from tests.support.forked import run

HERE = Path(__file__).parent
IN_REAL_TIME = re.compile(r"\.(wait|stopMAS|kill_agent)\([^)]*\d\d|\.at\(|\.send\([^;]*, *\d\d+\)|hard_deadline")
"""What makes the order of prints a matter of some hundred milliseconds: a machine that stands still may change it."""


def _single(folder: str) -> list[str]:
    return [f"{folder}/{path.stem}" for path in sorted((HERE / folder).glob("*.asl"))]


CASES = [
    *_single("core"),
    *_single("stdlib"),
    *_single("own_stdlib"),
    *(f"{folder}/{d.parent.name}" for folder in ("mas", "own_mas") for d in sorted((HERE / folder).glob("*/mas.txt"))),
]

STARTED = {case.partition("/")[0]: case for case in CASES}.values()
"""Cases that run in a Python of their own, one of each folder; the others are forked."""


def _arguments(case: str) -> tuple[list[str], Path, str]:
    """The agents of a case, the file with the expected output, and the source texts."""
    path = HERE / case
    if path.is_dir():
        lines = (path / "mas.txt").read_text().splitlines()
        agents = [f"{name}={path / file}" for name, file in (line.split() for line in lines if line.strip())]
        return agents, path / "expected.out", "".join(p.read_text() for p in sorted(path.glob("*.asl")))
    program = path.with_suffix(".asl")
    return [f"bob={program}"], path.with_suffix(".out"), program.read_text()


def _by_agent(output: str) -> dict[str, list[str]]:
    """The lines of each agent apart; a line without a prefix goes on with the one before."""
    found: dict[str, list[str]] = {}
    agent = ""
    for line in output.splitlines():
        match = re.match(r"\[(\w+)\] ", line)
        agent = match.group(1) if match else agent
        found.setdefault(agent, []).append(line)
    return found


def _run(case: str, folder: Path) -> tuple[str, str, str]:
    agents, expected, source = _arguments(case)
    command = ["agentd", "run", *agents, "--exit-when-idle", "--timeout", "60"]
    if case in STARTED:
        command = [sys.executable, "-m", *command]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, cwd=folder)
    else:
        done = run(command, timeout=120, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    if "expects: error" in source or "expects: warning" in source:
        assert done.stderr.strip(), "the case expects a warning or an error to be told"
    return done.stdout, expected.read_text(), source


def _comparable(output: str, source: str) -> object:
    return _by_agent(output) if "// order: per-agent" in source else output


@pytest.mark.parametrize("case", CASES)
def test_a_program_prints_what_jason_printed(case: str, tmp_path: Path) -> None:
    output, expected, source = _run(case, tmp_path)
    if _comparable(output, source) != _comparable(expected, source) and IN_REAL_TIME.search(source):
        warnings.warn(f"{case} counts in milliseconds; at its first attempt it printed {output!r}", stacklevel=1)
        output, expected, source = _run(case, tmp_path)
    assert _comparable(output, source) == _comparable(expected, source)
