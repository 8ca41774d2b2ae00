"""The whole corpus once more, each mind lived again from what went into it: it decides and does the same."""

import sys
from pathlib import Path
from typing import Any

import pytest

from agentd.conversion.term_conversion import BadTerm, from_wire, to_wire
from agentd.language.compiler.compile import CompiledProgram
from agentd.mind.data.inputs import Input, Mail
from agentd.process import DEEPEST_CALLS
from agentd.replay import replayed_mind
from agentd.replay.replayed_mind import ReplayedMind, digest_of
from agentd.runtime.program_paths import SourcePaths
from agentd.standalone import standalone_team
from agentd.standalone.standalone_team import Team, VirtualClock
from agentd.trace.initial_state import Sources
from agentd.trace.input_records import UNWRITTEN
from tests.agentd.traced import Traced
from tests.conformance.test_conformance import CASES, _arguments


def crossed(content: Any) -> Any:
    """What a receiver gets; what cannot be sent stays as it is."""
    try:
        return from_wire(to_wire(content))
    except BadTerm:
        return content


@pytest.mark.parametrize("decisions", [50, 0], ids=["", "without decisions"])
@pytest.mark.parametrize("case", CASES)
def test_a_mind_again_does_the_same(case: str, decisions: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    lives: list[Traced] = []
    clones: set[int] = set()

    def made(name: str, program: CompiledProgram, **arguments: Any) -> Any:
        for known in ("on_decision", "has_team", "zone"):
            arguments.pop(known, None)
        traced = Traced(
            name, program, Sources(main=name), **{**arguments, "agents": arguments["agents"](), "decisions": decisions}
        )
        lives.append(traced)
        plain = traced.mind.copy_from

        def copy_from(other: Any) -> None:
            clones.add(id(traced))
            plain(other)

        feed = traced.mind.feed

        def sent(item: Input) -> None:
            """Mail comes over the wire."""
            if type(item) is Mail:
                item = Mail(item.sender, item.performative, crossed(item.content), item.msg_id, item.in_reply_to)
            feed(item)

        monkeypatch.setattr(traced.mind, "copy_from", copy_from)
        monkeypatch.setattr(traced.mind, "feed", sent)
        return traced.mind

    monkeypatch.setattr(standalone_team, "Mind", made)
    agents, _, _ = _arguments(case)
    paths = SourcePaths()
    programs = [(name, paths.compiled(path)) for name, path in (agent.split("=", 1) for agent in agents)]
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(max(limit, DEEPEST_CALLS))
    try:
        team = Team(programs, out=lambda text: None, paths=paths, clock=VirtualClock())
        assert team.run(60, True) == 0
        for traced in lives:
            batches = traced.batches
            included = any(item.kind == UNWRITTEN for batch in batches for item in batch.inputs)
            if id(traced) in clones or included or not batches:
                continue
            program = traced.mind.program
            monkeypatch.setattr(replayed_mind, "program_of", lambda initial, texts, program=program: (program, None))
            life = ReplayedMind(batches[0])
            life.mind.post_office = None
            for batch in batches:
                done = life.feed(batch)
                assert digest_of(done, decisions > 0) == (batch.decided, batch.digest), [one.line for one in done]
    finally:
        sys.setrecursionlimit(limit)
