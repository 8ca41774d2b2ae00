"""The search and rescue: its programs by their own tests, and a short flight in which daemons are killed.

Twenty whole ones: `python -m tests.soak.rescue`, docs/measurements/soak.md.
"""

from __future__ import annotations

import asyncio
from pathlib import Path

from agentd.replay.replay import replay
from argosy.recording.reader import open_recording
from tests.soak.rescue import fly, told
from tests.support import forked

ROOT = Path(__file__).parents[3]
FOLDER = "missions/search_and_rescue"


def test_the_programs_of_the_search_and_rescue_pass_their_tests() -> None:
    command = ["agentd", "test", "--env", f"{FOLDER}/vehicle.py:Vehicle", FOLDER]
    run = forked.run(command, cwd=ROOT, timeout=120)
    assert run.returncode == 0, run.stdout


def test_each_victim_gets_one_buoy_although_daemons_are_killed_and_links_cut(tmp_path: Path) -> None:
    course = asyncio.run(fly(101, tmp_path, victims=2))
    assert course.good, f"{told(course)}\n{course.verdict}\n" + (tmp_path / "run.log").read_text()[-4000:]
    assert course.troubles.total(), "nothing was killed"
    told_again(tmp_path / "report" / "recording.mcap")


def told_again(file: Path) -> None:
    """Each life that was recorded from its birth decides and does the same when it is lived again."""
    recording = open_recording(file)
    whole = [life for life in recording.lives() if life.whole]
    assert {life.agent for life in whole} == {"scout", "rescuer1", "rescuer2"}
    for life in whole:
        result = replay(life.batches)
        assert result.agrees, result
        assert result.proven, result
