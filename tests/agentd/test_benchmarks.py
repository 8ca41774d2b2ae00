"""The tool that measures the reasoner beside its peers: it runs, reads and reports; no figure is judged here."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from benchmarks.footprint import FOOTPRINTS, program_of_plans
from benchmarks.processes import BenchmarkFailed, Speeds, run, until_line
from benchmarks.reasoner import measure
from benchmarks.report import Result, cold, report, warm
from benchmarks.rows import PROGRAMS, ROWS, Jason, Row
from benchmarks.subjects import Agentd, AgentSpeak, Subject

TINY = """
!round(1).
+!round(R) : R <= 3 <-
    .nano_time(T0); !count(0); .nano_time(T1); .print("BENCH tiny round ", R, " ops ", 20, " ns ", T1-T0); !round(R+1).
+!round(R) <- .wait(500); .stopMAS.
+!count(N) : N < 20 <- !count(N+1).
+!count(N).
"""


def _tiny(folder: Path) -> Row:
    program = folder / "tiny.asl"
    program.write_text(TINY, encoding="utf-8")
    return Row("t", "tiny", "sub-goal", (("ag", str(program)),), 12, Jason(2000.0, 500.0, 100.0, 300.0))


def test_each_reasoner_runs_each_program_in_turn_and_its_rounds_are_read(tmp_path: Path) -> None:
    subjects: list[Subject] = [Agentd()]
    if importlib.util.find_spec("agentspeak") is not None:
        subjects.append(AgentSpeak())
    (result,) = measure([_tiny(tmp_path)], subjects, 2)
    assert {key: [len(r.rounds) for r in runs] for key, runs in result.runs.items()} == {
        subject.key: [3, 3] for subject in subjects
    }
    assert all(speeds.rss > 5 for runs in result.runs.values() for speeds in runs)


def test_a_program_that_prints_no_round_is_told_with_its_last_words(tmp_path: Path) -> None:
    silent = tmp_path / "silent.asl"
    silent.write_text('!a. +!a <- .print("nothing measured"); .stopMAS.', encoding="utf-8")
    with pytest.raises(BenchmarkFailed, match=r"no round of tiny; it printed last: \[ag\] nothing measured"):
        run(Agentd().command([("ag", silent)]), {"tiny"})


def test_ratios_are_taken_between_neighbours_and_verdicts_follow_them() -> None:
    row = Row("t", "x_tiny", "sub-goal", (), 12, Jason(2000.0, 500.0, 100.0, 300.0))
    ours = [Speeds((300.0, 1300.0), 20.0), Speeds((600.0, 2600.0), 20.0), Speeds((300.0, 1000.0), 20.0)]
    theirs = [Speeds((100.0, 100.0), 40.0), Speeds((200.0, 200.0), 40.0), Speeds((100.0, 100.0), 40.0)]
    result = Result(row, {"agentd": ours, "agentspeak": theirs})
    assert result.ratio("agentd", cold) == 3.0
    assert result.ratio("agentd", warm) == 8.0  # the median of two rounds is their mean
    text = report([result], {}, [], 3)
    assert "| 3.0x | 8.0x | 12x **missed** | 20 | 40 |" in text
    assert "| 8.0x | 20.0x | **behind** | 3.0x | 5.0x | **behind** | 7% | under a quarter |" in text
    assert "Ahead of Jason's warm JVM on 0 of 1 rows, of its first round on 0 of 1, within a quarter" in text


def test_every_row_has_its_programs_and_the_start_can_be_timed() -> None:
    assert all(path.is_file() for row in ROWS for _, path in row.paths())
    seconds, megabytes = until_line(Agentd().command([("ag", PROGRAMS / "s_first.asl")]), "FIRST")
    assert seconds > 0
    assert megabytes >= 0
    assert len({footprint.title for footprint in FOOTPRINTS}) == 4


def test_the_generated_program_of_plans_loads(tmp_path: Path) -> None:
    program = tmp_path / "plans.asl"
    program.write_text(program_of_plans(30), encoding="utf-8")
    assert until_line(Agentd().command([("ag", program)]), "FIRST")[0] > 0
