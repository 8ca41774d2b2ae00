"""`argosy trial` from its arguments to its report: real worker processes, a few seeds."""

import json
import os
import signal
import subprocess
import sys
import time
from html.parser import HTMLParser
from pathlib import Path

import psutil
import pytest

from argosy.__main__ import main
from argosy.cli.errors import BadInput
from argosy.trial.command import Progress, shrunk
from argosy.trial.faults import Fault, Kill
from argosy.trial.report import Comparison, Trial, page, text, write
from argosy.trial.single_run import Outcome, Request
from argosy.trial.workers import workers
from tests.argosy.recording.test_disks import files_no_larger_than
from tests.support.processes import poll

MISSIONS = Path(__file__).parents[3] / "missions"
SINGLE, RESCUE = str(MISSIONS / "single_uav.yaml"), str(MISSIONS / "search_and_rescue.yaml")


def test_runs_without_faults_all_succeed_and_are_reported(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "report"
    assert main(["trial", SINGLE, "--runs", "3", "--faults", "none", "--min-success", "1", "--out", str(out)]) == 0
    printed = capsys.readouterr()
    assert printed.out.startswith(f"{SINGLE}: 3 of 3 runs succeed: 1.000 (0.439 to 1.000), 95 % interval\n")
    assert "safety: 0 runs with a violation" in printed.out
    assert (out / "report.txt").read_text() == printed.out
    data = json.loads((out / "outcomes.json").read_text())
    assert (data["runs"], data["successes"], data["violations"], data["causes"]) == (3, 3, 0, [])
    assert [one["seed"] for one in data["outcomes"]] == [1, 2, 3]
    for one in data["outcomes"]:
        assert 60 < one["seconds"] < 120
        assert one["flown"] > 80
        assert 0.5 < one["battery"] < 1
        assert one["digest"]
        assert one["cpu"] > 0
        assert one["memory"] > 1e7
    page_is_whole((out / "report.html").read_text())


def test_a_folder_that_cannot_be_written_is_found_before_the_first_run(capsys: pytest.CaptureFixture[str]) -> None:
    for folder, why in (("/proc", "No such file or directory"), (SINGLE, "File exists")):
        assert main(["trial", SINGLE, "--runs", "1000000", "--out", folder]) == 2
        assert f"--out {folder}: {why}" in capsys.readouterr().err


def page_is_whole(html: str) -> None:
    """Hold that a page needs nothing outside of it, and closes what it opens."""
    opened: list[str] = []

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            assert not [name for name, _ in attrs if name in ("src", "href")], tag
            if tag not in ("meta", "br"):
                opened.append(tag)

        def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            assert not [name for name, _ in attrs if name in ("src", "href")], tag

        def handle_endtag(self, tag: str) -> None:
            assert opened.pop() == tag

    Reader().feed(html)
    assert opened == []
    assert "http" not in html


BAD = [Outcome(seed, False, f"<late> by {seed}.5 s", faults=[Kill(at=3.0, daemon="commd")]) for seed in (1, 2)]
GOOD = [Outcome(seed, True, seconds=80.0 + seed, flown=100.0, messages=100) for seed in (3, 4)]


def test_a_report_names_causes_with_their_seeds_and_the_faults_drawn() -> None:
    trial = Trial("m.yaml", "standard", 4, [*BAD, *GOOD])
    assert text(trial).splitlines() == [
        "m.yaml: 2 of 4 runs succeed: 0.500 (0.150 to 0.850), 95 % interval",
        "safety: 0 runs with a violation",
        "     2 x <late> by 1.5 s (seeds 1, 2)",
        "                    least  median   95 %   most",
        "duration (s)         83.0    83.0   84.0   84.0",
        "distance flown (m)  100.0   100.0  100.0  100.0",
        "messages            100.0   100.0  100.0  100.0",
        "faults drawn  faults  runs  failed",
        "kill               2     2       2",
    ]
    html = page(trial)
    page_is_whole(html)
    assert "&lt;late&gt; by 1.5 s" in html
    assert "3.0 s: commd is killed" in html
    assert "argosy trial m.yaml --faults standard --replay 1" in html


def test_a_report_that_has_no_room_leaves_the_one_before(tmp_path: Path) -> None:
    (tmp_path / "report.txt").write_text("before")
    with files_no_larger_than(100), pytest.raises(BadInput, match="File too large"):
        write(tmp_path, Trial("m.yaml", "standard", 4, [*BAD, *GOOD]))
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("report.txt", "before")]


def test_an_interrupted_trial_says_so() -> None:
    assert text(Trial("m.yaml", "none", 9, GOOD)).startswith("interrupted: 2 of 9 runs are done\nm.yaml: 2 of 2 runs")
    assert text(Trial("m.yaml", "none", 9, [])) == "m.yaml: none of 9 runs is done"
    page_is_whole(page(Trial("m.yaml", "none", 9, GOOD)))
    page_is_whole(page(Trial("m.yaml", "none", 9, [])))


def test_two_missions_are_compared_seed_by_seed() -> None:
    first = Trial("a.yaml", "none", 8, [Outcome(seed, True) for seed in range(8)])
    second = Trial("b.yaml", "none", 8, [Outcome(seed, seed < 2) for seed in range(8)])
    comparison = Comparison(first, second)
    assert (comparison.only_first, comparison.only_second) == ([2, 3, 4, 5, 6, 7], [])
    assert str(comparison) == (
        "a.yaml against b.yaml: 8 and 2 of 8 runs succeed; in 6 only the first, in 0 only the second: "
        "they differ (McNemar, p = 0.0312)"
    )
    page_is_whole(page(first, comparison))


def test_progress_says_what_has_failed_so_far() -> None:
    line = Progress(8).line([*BAD, *GOOD], 10.0)
    assert line == "4 of 8 runs, 10 s left, 2 failed: 2 x <late> by 1.5 s"


def test_a_trial_without_a_terminal_prints_a_line_from_time_to_time(capsys: pytest.CaptureFixture[str]) -> None:
    progress = Progress(5, begun=time.monotonic() - 130)
    progress.show([*BAD])
    progress.show([*BAD, *GOOD])
    assert [line.partition(",")[0] for line in capsys.readouterr().err.splitlines()] == ["2 of 5 runs"]


def test_shrinking_keeps_the_faults_that_a_failure_needs() -> None:
    faults: tuple[Fault, ...] = tuple(Kill(at=float(at), daemon="commd") for at in range(6))
    needed = {faults[1], faults[4]}
    assert shrunk(faults, lambda tried: needed <= set(tried)) == (faults[1], faults[4])
    assert shrunk(faults, lambda tried: False) == faults


@pytest.mark.parametrize(
    ("until", "code", "said"),
    [
        ("2", 0, "seed 1: stopped after 2 s, as wanted; digest "),
        (
            "80",
            1,
            'seed 1: failed: uav believes mission_failed("the vehicle refuses to arm until a person corrects this',
        ),
    ],
)
def test_a_replay_that_is_stopped_fails_only_by_what_was_wrong_until_then(
    until: str, code: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    faults = tmp_path / "faults.yaml"
    faults.write_text("- {kind: vehicle, robot: uav1, fault: prearm=Compass not calibrated}\n")
    assert main(["trial", SINGLE, "--faults", str(faults), "--replay", "1", "--until", until]) == code
    assert capsys.readouterr().out.splitlines()[-1].startswith(said)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (
            [SINGLE, "--faults", "nowhere.yaml"],
            "nowhere.yaml: no such file; expected `standard`, `none` or a YAML list",
        ),
        ([SINGLE, "--until", "3"], "--until: only with --replay SEED"),
        ([SINGLE, "--shrink"], "--shrink: only with --replay SEED"),
        ([SINGLE, "--replay", "1", "--compare", RESCUE], "--compare: not with --replay"),
        (["nothing"], "nothing: error: no such file, and no mission of that name ships"),
    ],
)
def test_what_cannot_be_tried_is_refused_before_anything_starts(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("argosy.trial.command.workers", None)
    assert main(["trial", *arguments]) == 2
    printed = capsys.readouterr()
    assert said in printed.err
    assert printed.out == ""


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("- {kind: kill, at: 3}", "needs the field `daemon`"),
        ("- {kind: explode}", "expected one of operator, kill"),
        ("- [}]", "error: "),
        ("kind: kill", "expected a list of faults such as"),
        ("- {kind: battery, robot: uav2, minutes: 3}", "expected uav1, got `uav2`"),
        ("- {kind: vehicle, robot: uav1, fault: loss=2}", "expected loss=SHARE"),
    ],
)
def test_a_bad_file_of_faults_is_refused_with_what_was_expected(
    file: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "faults.yaml"
    path.write_text(file)
    assert main(["trial", SINGLE, "--faults", str(path)]) == 2
    printed = capsys.readouterr().err
    assert printed.startswith(f"{path}:1:")
    assert said in printed


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("security: {}", "`security`: a trial has no TLS"),
        ("gateway: {listen: '127.0.0.1:5000', nodes: {n: '127.0.0.1:5001'}}", "`gateway`: a trial has no sockets"),
        ("router: {external: true}", "`external: true`: a trial has a network of its own"),
    ],
)
def test_missions_with_other_edges_are_refused_at_their_line(
    more: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = MISSIONS / "single_uav" / "uav.asl"
    mission = Path(SINGLE).read_text().replace("single_uav/uav.asl", str(program))
    path = tmp_path / "m.yaml"
    path.write_text(f"{mission}{more}\n")
    assert main(["trial", str(path)]) == 2
    printed = capsys.readouterr().err
    assert said in printed
    assert printed.startswith(f"{path}:{len(mission.splitlines()) + 1}:")


def test_simulated_vehicles_are_tried_without_a_link(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    robot = "{manifest: copter, simulate: {home: [-27.604033, -48.518363, 21.0]}}"
    path = tmp_path / "m.yaml"
    path.write_text(
        "mission: two\nagents: {a: {program: a.asl, robot: uav1}, b: {program: a.asl, robot: uav2}}\n"
        f"robots: {{uav1: {robot}, uav2: {robot}}}\ndone: ['a: back', 'b: back']\n"
    )
    (tmp_path / "a.asl").write_text(
        '!fly. +!fly <- .wait(state(_, true, _)); set_mode("GUIDED"); arm_motors(true); takeoff(5); land; +back.'
    )
    assert main(["trial", str(path), "--runs", "1", "--faults", "none"]) == 0
    assert capsys.readouterr().out.startswith(f"{path}: 1 of 1 runs succeed")


def test_too_few_successes_are_code_1_with_a_seed_to_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    faults = tmp_path / "faults.yaml"
    faults.write_text(
        "- {kind: vehicle, robot: uav1, fault: prearm=Compass not calibrated}\n- {kind: kill, at: 1, daemon: commd}\n"
    )
    common = [SINGLE, "--faults", str(faults)]
    assert main(["trial", *common, "--runs", "2", "--min-success", "0.9"]) == 1
    assert "0 of 2 runs succeed" in capsys.readouterr().out
    pytest.importorskip("mcap")
    assert main(["trial", *common, "--replay", "1", "--shrink", "--out", str(tmp_path)]) == 1
    printed = capsys.readouterr().out
    assert printed.startswith("faults:\n  uav1: prearm=Compass not calibrated\n")
    recording = str(tmp_path / "seed-1.mcap")
    assert f"recording: {recording}" in printed
    assert main(["replay", recording, "--info"]) == 0
    assert "mission single-uav" in capsys.readouterr().out
    assert main(["replay", recording, "--mind", "uav"]) == 0
    assert "uav: agrees" in capsys.readouterr().out
    assert main(["why", "uav", "--recording", recording]) == 0


def test_recording_a_run_does_not_change_it(tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    file = tmp_path / "seed-3.mcap"
    with workers(1) as run_all:
        (plain,) = run_all([Request(SINGLE, 3)])
        (recorded,) = run_all([Request(SINGLE, 3, record=str(file))])
    assert file.stat().st_size > 10_000
    assert (recorded.digest, recorded.messages) == (plain.digest, plain.messages)


def test_a_run_that_hangs_is_ended_and_counted(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["trial", SINGLE, "--runs", "1", "--seed", "7", "--run-timeout", "0.05"]) == 0
    assert "1 x hung: it was ended after 0.05 s (seed 7)" in capsys.readouterr().out


def test_a_worker_or_a_run_that_is_killed_fails_its_seed_alone() -> None:
    others = set(psutil.Process().children())
    with workers(1) as run_all:
        (worker,) = set(psutil.Process().children()) - others
        runs = run_all([Request(SINGLE, 1), Request(RESCUE, 2), Request(RESCUE, 3), Request(SINGLE, 4)])
        assert next(runs).success
        worker.kill()
        assert next(runs).why == "died: killed by SIGKILL"
        (worker,) = set(psutil.Process().children()) - others
        poll(worker.children, "the worker has begun a run")
        worker.children()[0].send_signal(signal.SIGSEGV)
        assert next(runs).why == "died: killed by SIGSEGV"
        assert next(runs).success


def test_ctrl_c_ends_all_processes_and_reports_what_is_done() -> None:
    command = [sys.executable, "-m", "argosy", "trial", SINGLE, "--runs", "500", "--faults", "none", "--jobs", "2"]
    trial = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        of = psutil.Process(trial.pid)
        poll(lambda: len(of.children(recursive=True)) >= 3, "two workers and a run have begun")
        started = of.children(recursive=True)
        os.killpg(trial.pid, signal.SIGINT)  # as a terminal does: to all of them
        printed, errors = trial.communicate(timeout=90)
    finally:
        trial.kill()
        trial.wait()
    assert trial.returncode == 130
    assert f"of {500} runs" in printed
    assert errors == ""
    assert psutil.wait_procs(started, timeout=90)[1] == []
