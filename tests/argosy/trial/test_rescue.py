"""The search and rescue: its programs by their own tests, and flights in virtual time that the referee judges.

With boards of their own, real kills and real cuts: tests/boards/test_rescue.py.
"""

import re
import shutil
from pathlib import Path

import pytest

from agentd.replay.replay import replay
from argosy.recording.reader import Recording
from argosy.simulate.referee import judge_recording
from argosy.trial.faults import Fault, Kill, LinkCut
from argosy.trial.single_run import Outcome, Request
from argosy.trial.workers import workers
from schemas.mission.model import load_mission
from tests.argosy.trial.conftest import MISSIONS
from tests.support import forked

FOLDER = MISSIONS / "search_and_rescue"
NORTH, HALF_WAY = "-27.602955", "-27.603404"
"""Of the mission's area, and of its southern half."""


class Search:
    """A search of half the area for two victims, its flight without faults, and where flights are recorded."""

    def __init__(self, folder: Path) -> None:
        text = (MISSIONS / "search_and_rescue.yaml").read_text().replace(NORTH, HALF_WAY)
        self.path = folder / "search_and_rescue.yaml"
        self.path.write_text(re.sub(r"victims: \d+", "victims: 2", text))
        (folder / "search_and_rescue").symlink_to(FOLDER)
        self.recording = folder / "recording.mcap"
        still = self.fly()
        assert still.success, still.why
        first = next(re.match(r" *(\S+) s  rescuer(\d): drop_buoy$", line) for line in still.journal if "drop_" in line)
        self.drop, self.board = float(first[1]), f"pi{int(first[2]) + 1}"

    def fly(self, *faults: Fault) -> Outcome:
        """Fly it and record it."""
        self.recording.unlink(missing_ok=True)
        request = Request(str(self.path), 1, faults, journal=True, record=str(self.recording))
        with workers(1) as run_all:
            return next(iter(run_all([request])))


@pytest.fixture(scope="module")
def search(tmp_path_factory: pytest.TempPathFactory) -> Search:
    return Search(tmp_path_factory.mktemp("search"))


def test_the_programs_pass_their_tests() -> None:
    command = ["agentd", "test", "--env", str(FOLDER / "vehicle.py:Vehicle"), str(FOLDER)]
    run = forked.run(command, timeout=120)
    assert run.returncode == 0, run.stdout


@pytest.mark.parametrize(
    ("daemons", "cut"),
    [(("agentd",), False), (("commd",), True), (("agentd", "bridged", "commd"), False)],
    ids=["agentd", "commd, and its link is cut", "all"],
)
def test_each_victim_gets_one_buoy_although_daemons_are_killed_at_a_drop_and_links_are_cut(
    search: Search, daemons: tuple[str, ...], cut: bool
) -> None:
    faults: list[Fault] = [
        Kill(at=search.drop + 0.02 + number * 0.2, daemon=f"{daemon}:{search.board}")
        for number, daemon in enumerate(daemons)
    ]
    if cut:
        faults.append(LinkCut(at=search.drop - 5, sender="pi1", receiver=search.board, seconds=20))
    outcome = search.fly(*faults)
    assert outcome.success, outcome.why
    verdict = judge_recording(load_mission(search.path), search.recording)
    assert verdict.good, str(verdict)
    killed = [line for line in outcome.journal if "killed by SIGKILL" in line]
    assert len(killed) == len(daemons), killed
    decided_the_same_again(search.recording)


def test_a_mission_that_is_done_with_buoys_astray_is_no_success(tmp_path: Path) -> None:
    programs = tmp_path / "search_and_rescue"
    shutil.copytree(FOLDER, programs)
    rescuer = programs / "rescuer.asl"
    text = rescuer.read_text()
    beside = text.replace("!at(Lat, Lon, H)", "!at(Lat + 0.0001, Lon, H)").replace("& Off < 3.", "& Off < 30.")
    assert beside.count("0.0001") == beside.count("Off < 30.") == 1
    rescuer.write_text(beside)
    mission = tmp_path / "search_and_rescue.yaml"
    text = (MISSIONS / "search_and_rescue.yaml").read_text().replace(NORTH, HALF_WAY)
    mission.write_text(re.sub(r"victims: \d+", "victims: 2", text))
    with workers(1) as run_all:
        outcome = next(iter(run_all([Request(str(mission), 1)])))
    assert not outcome.success
    assert outcome.why == "the mission is done, but 0 of 2 victims got exactly one buoy, 2 none, 2 buoys fell astray"


def decided_the_same_again(recording: Path) -> None:
    """Each mind that was recorded from its start decides and does the same when it is replayed."""
    minds = [mind for mind in Recording(recording).minds() if mind.whole]
    assert {mind.agent for mind in minds} == {"scout", "rescuer1", "rescuer2"}
    for mind in minds:
        result = replay(mind.batches)
        assert result.agrees, result
        assert result.unheard < result.batches, result
