"""A run of a trial depends on its seed alone."""

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest
from msgspec.structs import replace

from argosy.trial.faults import draw
from argosy.trial.single_run import Outcome, Request
from argosy.trial.workers import Worker
from schemas.mission.model import load_mission
from tests.support.forked import ROOT

MISSION = ROOT / "missions" / "single_uav.yaml"
SEED = 3
"""One with kills of each daemon and of the board."""
WORKER = ("-P", "-m", "argosy.trial.worker")


def outcomes(
    folder: Path, command: Sequence[str], hash_seed: str, seeds: Sequence[int], python: str = sys.executable
) -> list[Outcome]:
    """Return what becomes of runs in one worker of its own."""
    mission = load_mission(str(MISSION))
    process = subprocess.Popen(
        [python, *command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        cwd=ROOT,
        env={**os.environ, "PYTHONHASHSEED": hash_seed},
    )
    try:
        found = []
        for number, seed in enumerate(seeds):
            (own := folder / f"{hash_seed} {number}").mkdir(parents=True)
            request = Request(str(MISSION), seed, tuple(draw(mission, seed)), folder=str(own), journal=True)
            found.append(replace(Worker(process).run(request), cpu=0.0, memory=0))  # those are of this machine
        return found
    finally:
        process.kill()
        process.communicate()


def test_the_same_seed_gives_the_same_run_in_another_process_and_with_another_hash_seed(tmp_path: Path) -> None:
    first, again = outcomes(tmp_path, WORKER, "0", [SEED, SEED])
    (elsewhere,) = outcomes(tmp_path, WORKER, "4242", [SEED])
    assert first.digest
    assert first.messages > 500
    assert again == first
    assert elsewhere == first


def test_the_same_seed_gives_the_same_run_in_another_version_of_python(tmp_path: Path) -> None:
    python = another_python()
    seeds = [SEED, SEED + 2]
    assert outcomes(tmp_path / "other", WORKER, "0", seeds, python) == outcomes(tmp_path, WORKER, "0", seeds)


def another_python() -> str:
    """Return an interpreter of another version that has Argosy, from `.venv*`; skip the test without one."""
    asked = ("-c", "import sys, argosy.trial.single_run; print(*sys.version_info[:2])")
    own = "{} {}".format(*sys.version_info[:2])
    for found in sorted(map(str, ROOT.glob(".venv*/bin/python"))):
        version = subprocess.run([found, *asked], capture_output=True, text=True, cwd=ROOT, check=False).stdout.strip()
        if version not in ("", own):
            return found
    pytest.skip(f"no second version of Python with Argosy in {ROOT}/.venv*: make one as `python3.13 -m venv .venv313`")
