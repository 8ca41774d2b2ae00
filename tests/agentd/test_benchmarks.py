"""The tool that measures the reasoner beside its peers: it runs, reads and reports; no figure is judged here."""

from __future__ import annotations

import importlib.util
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from subprocess import Popen

import pytest

from benchmarks.processes import BenchmarkFailed, Speeds, descendants, lines, memory, run, started, until_line
from benchmarks.reasoner.part import Figures, goals, measure_rows
from benchmarks.reasoner.report import Result, ahead, cold, comparison, in_short, picture, tables, warm
from benchmarks.reasoner.rows import ELSEWHERE, FOOTPRINTS, PROGRAMS, ROWS, Row, program_of_plans, row_called
from benchmarks.reasoner.subjects import Agentd, AgentSpeak, JasonCommand, Subject, subjects_here

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
    return Row("t", "tiny", "sub-goal", (("ag", str(program)),), 12)


def test_each_reasoner_runs_each_program_in_turn_and_its_rounds_are_read(tmp_path: Path) -> None:
    subjects: list[Subject] = [Agentd()]
    if importlib.util.find_spec("agentspeak") is not None:
        subjects.append(AgentSpeak())
    (result,) = measure_rows([_tiny(tmp_path)], subjects, 2)
    assert {key: [len(r.rounds) for r in runs] for key, runs in result.runs.items()} == {
        subject.key: [3, 3] for subject in subjects
    }
    assert all(speeds.rss > 5 for runs in result.runs.values() for speeds in runs)


def test_a_program_that_prints_no_round_is_reported_with_its_last_words(tmp_path: Path) -> None:
    silent = tmp_path / "silent.asl"
    silent.write_text('!a. +!a <- .print("nothing measured"); .stopMAS.', encoding="utf-8")
    with pytest.raises(BenchmarkFailed, match=r"no round of tiny; it printed last: \[ag\] nothing measured"):
        run(Agentd().command([("ag", silent)]), {"tiny"})


def test_ratios_are_taken_between_neighbours_and_verdicts_follow_them() -> None:
    ours = [Speeds((300.0, 1300.0), 20.0), Speeds((600.0, 2600.0), 20.0), Speeds((300.0, 1000.0), 20.0)]
    theirs = [Speeds((100.0, 100.0), 40.0), Speeds((200.0, 200.0), 40.0), Speeds((100.0, 100.0), 40.0)]
    result = Result("a", {"agentd": ours, "agentspeak": theirs})
    assert result.ratio("agentd", cold) == 3.0
    assert result.ratio("agentd", warm) == 8.0
    text = "\n".join(tables([result]))
    assert "| 3.0x | 8.0x | 12x **missed** | 20 | 40 |" in text
    assert "| 8.0x | 14.4x | **behind** | 3.0x |" in text
    assert "Ahead of Jason's warm JVM on 0 of 1 rows, of its first round on 1 of 1, within a quarter" in text


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


FAKE_JASON = f"""#!/bin/sh
# As the released command: a script that starts the real process.
{sys.executable} - "$@" <<'END'
import re, subprocess, sys
from pathlib import Path
if sys.argv[1:] == ["--version"]:
    print("Jason CLI 3.3-fake")
    raise SystemExit
assert sys.argv[1:5] == ["mas", "start", "--console", "--no-net"], sys.argv
project = Path(sys.argv[5].removeprefix("--mas2j=")).read_text()
found = re.fullmatch(r'MAS ([a-z]\\w*) {{ agents: (.+;) aslSourcePath: "."; }}\\n', project)
agents = [one.split() for one in found[2].split(";") if one]
command = [sys.executable, "-m", "agentd", "run", *(f"{{name}}={{file}}" for name, file in agents)]
raise SystemExit(subprocess.run(command).returncode)
END
"""


def _with_fake_jason(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "jason").write_text(FAKE_JASON, encoding="utf-8")
    (folder / "jason").chmod(0o755)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


def test_a_jason_command_on_the_path_is_found_and_runs_a_project_of_each_row(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not any(isinstance(subject, JasonCommand) for subject in subjects_here())
    _with_fake_jason(tmp_path, monkeypatch)
    (jason,) = [subject for subject in subjects_here() if isinstance(subject, JasonCommand)]
    assert jason.version() == "Jason CLI 3.3-fake"
    percepts = next(row for row in ROWS if row.environment)
    tiny, skipped = measure_rows([_tiny(tmp_path), percepts], [jason], 1)
    assert [len(speeds.rounds) for speeds in tiny.runs["jason"]] == [3]
    assert tiny.runs["jason"][0].rss > 20, "what the script has started is not counted"
    assert skipped.runs == {}
    assert "## Jason, run here" in "\n".join(tables([Result(ROWS[0].key, {"agentd": tiny.runs["jason"], **tiny.runs})]))


def test_what_a_killed_command_has_started_ends_with_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    _with_fake_jason(tmp_path, monkeypatch)
    with JasonCommand(str(tmp_path / "jason")).prepared([("ag", PROGRAMS / "i_idle.asl")]) as command:
        with started(command) as process:
            assert any("FIRST" in line for line in _until_first(process))
            below = descendants(process.pid)
            assert below
        until = time.monotonic() + 30
        while any(memory(pid, "VmRSS") for pid in below):
            assert time.monotonic() < until
            time.sleep(0.02)


def _until_first(process: Popen[bytes]) -> Iterator[str]:
    for line in lines(process, 30):
        yield line
        if "FIRST" in line:
            return


def _figures(warm_of_a: float) -> Figures:
    def runs(speed: float) -> list[Speeds]:
        return [Speeds((speed, speed), 20.0)]

    rows = [
        Result(row.key, {"agentd": runs(warm_of_a if row.key == "a" else 5000.0), "agentspeak": runs(10.0)})
        for row in ROWS
    ]
    return Figures(1, rows, {one.title: {"agentd": one.limit / 2, "agentspeak": 9.0} for one in FOOTPRINTS})


def test_targets_and_limits_are_goals_and_a_missed_one_is_reported_as_missed() -> None:
    assert all(goal.met for goal in goals(_figures(200.0)))
    assert [goal.title for goal in goals(_figures(110.0)) if not goal.met] == [
        "sub-goal: speed beside python-agentspeak, warm",
        "reasoner: rows ahead of Jason's warm JVM, by the ratio to python-agentspeak",
    ]
    assert all("tried" in goal.why.lower() for goal in goals(_figures(1.0))), "each could be missed"
    assert len(goals(_figures(1.0))) == len(ROWS) + len(FOOTPRINTS) + 2


def test_what_jason_did_elsewhere_comes_from_a_file_with_its_origin() -> None:
    assert ELSEWHERE.rows.keys() == {row.key for row in ROWS} - {"h'"}
    assert row_called("a").jason == ELSEWHERE.rows["a"]
    line = ELSEWHERE.origin.line()
    assert "Jason 3.3, JRE 21, python-agentspeak 0.2.2" in line
    assert "`benchmarks/results/jason-elsewhere.json`" in line
    assert line in "\n".join(tables(_figures(200.0).rows))


def test_other_pages_get_their_rows_from_the_same_figures() -> None:
    figures = _figures(110.0)
    results = figures.rows
    assert results[0].of is row_called("a")
    assert ahead(results) == (11, 12, "a 11.0x where Jason has 14.4x")
    text = comparison(results, figures.footprints)
    assert "| sub-goal | 11.0 | 14.4 | Jason is faster |" in text
    assert "These are 9 of 12 rows. Argosy is ahead of Jason's warmed-up JVM in 11 of the 12" in text
    assert "| resident when idle | 15.0 MB |" in text
    assert in_short(results, figures.footprints)[0].startswith(
        "| thinking, warm | 11 to 500 times python-agentspeak, look-ups and joins at least 500 times; ahead of Jason "
        "3.3's warm JVM on 11 of 12 rows, behind on 1 "
    )
    assert picture(results).count("sub-goal") == 1
