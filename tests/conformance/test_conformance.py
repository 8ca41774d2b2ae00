"""The corpus of programs with the output that Jason 3.3 printed for them: byte for byte, in virtual time."""

import re
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

from agentd.conversion.mind_view import decisions_of
from agentd.process import DEEPEST_CALLS
from agentd.runtime.program_paths import SourcePaths
from agentd.standalone.decision_printer import DecisionPrinter
from agentd.standalone.standalone_team import Team, VirtualClock

HERE = Path(__file__).parent


def _single(folder: str) -> list[str]:
    return [f"{folder}/{path.stem}" for path in sorted((HERE / folder).glob("*.asl"))]


CASES = [
    *_single("core"),
    *_single("stdlib"),
    *_single("own_stdlib"),
    *(f"{folder}/{d.parent.name}" for folder in ("mas", "own_mas") for d in sorted((HERE / folder).glob("*/mas.txt"))),
]

STARTED = {case.partition("/")[0]: case for case in CASES}.values()
"""One case of each folder, which the command runs too."""


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


def _comparable(output: str, source: str) -> object:
    return _by_agent(output) if "// order: per-agent" in source else output


@pytest.mark.parametrize("decisions", [0, 50], ids=["", "decisions are recorded"])
@pytest.mark.parametrize("case", CASES)
def test_a_program_prints_what_jason_printed(
    case: str, decisions: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    agents, expected, source = _arguments(case)
    paths, printed, told = SourcePaths(), list[str](), list[str]()
    programs = [(name, paths.compiled(path)) for name, path in (agent.split("=", 1) for agent in agents)]
    narrator = DecisionPrinter(write=told.append) if decisions else None
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(max(limit, DEEPEST_CALLS))
    try:
        team = Team(
            programs, out=printed.append, paths=paths, clock=VirtualClock(), decisions=decisions, narrator=narrator
        )
        assert team.run(60, True) == 0
    finally:
        sys.setrecursionlimit(limit)
    assert _comparable("".join(printed), source) == _comparable(expected.read_text(), source)
    if "expects: error" in source or "expects: warning" in source:
        assert capsys.readouterr().err.strip(), "the case expects a warning or an error to be told"
    if decisions:
        assert told
        for mind in team.minds.values():
            assert len(msgspec.json.encode(decisions_of(mind))) < 100_000


@pytest.mark.parametrize("case", STARTED)
def test_the_command_prints_what_jason_printed(case: str, tmp_path: Path) -> None:
    agents, expected, source = _arguments(case)
    command = [sys.executable, "-m", "agentd", "run", *agents, "--exit-when-idle", "--timeout", "60"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    assert _comparable(done.stdout, source) == _comparable(expected.read_text(), source)
