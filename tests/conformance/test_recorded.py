"""The whole corpus once more with decisions recorded and told: that must not change what an agent does."""

from __future__ import annotations

import sys
from pathlib import Path

import msgspec
import pytest

from agentd.conversion.mind_view import decisions_of
from agentd.process import DEEPEST_CALLS
from agentd.runtime.program_paths import SourcePaths
from agentd.standalone.decision_printer import DecisionPrinter
from agentd.standalone.standalone_team import Team, VirtualClock
from tests.conformance.test_conformance import CASES, _arguments, _comparable


@pytest.mark.parametrize("case", CASES)
def test_a_program_prints_the_same_while_its_decisions_are_told(
    case: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    agents, expected, source = _arguments(case)
    paths = SourcePaths()
    programs = [(name, paths.compiled(path)) for name, path in (agent.split("=", 1) for agent in agents)]
    printed: list[str] = []
    told: list[str] = []
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(max(limit, DEEPEST_CALLS))
    try:
        team = Team(
            programs,
            out=printed.append,
            paths=paths,
            clock=VirtualClock(),
            decisions=50,
            narrator=DecisionPrinter(write=told.append),
        )
        assert team.run(60, True) == 0
    finally:
        sys.setrecursionlimit(limit)
    assert _comparable("".join(printed), source) == _comparable(expected.read_text(), source)
    assert told
    for mind in team.minds.values():
        assert len(msgspec.json.encode(decisions_of(mind))) < 100_000
