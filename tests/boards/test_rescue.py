"""The search and rescue on three boards for real, with the copters simulated on the ground."""

import re
from collections.abc import Callable
from pathlib import Path

from argosy.simulate.referee import judge_run
from tests.boards.fleet import Fleet
from tests.boards.network import Network
from tests.support.processes import ROOT

SHIPPED = ROOT / "missions" / "search_and_rescue.yaml"


def on_the_ground(text: str) -> str:
    """Return the mission with its boards' addresses to be filled in, and its simulators on the ground."""
    text = re.sub(r"boards:\n(  pi\d: .*\n)+", "boards: BOARDS\n", text)
    text = re.sub(r"udpin:127.0.0.1:", "udpin:0.0.0.0:", text)
    text = re.sub(r"simulate:\n", "simulate:\n      board: ground\n", text)
    return re.sub(r"victims: \d+", "victims: 2", text)


def test_a_victim_is_rescued_once_though_its_rescuer_dies_and_is_cut_off_on_the_way(
    fleet: Callable[..., Fleet], network: Network, tmp_path: Path
) -> None:
    (tmp_path / "search_and_rescue").symlink_to(SHIPPED.with_suffix(""))
    team = fleet(on_the_ground(SHIPPED.read_text(encoding="utf-8")))
    report = tmp_path / "report"
    simulators = team.ground("argosy", "simulate", str(team.path), "--board", "ground", "--report", str(report))
    simulators.until(lambda text: text.count("simulated copter") == 3, "three copters are simulated")
    team.up()
    look = team.look("pi1")
    look.until(lambda look: _held(look.mind("scout")), "a rescuer goes", 120)
    rescuer = _held(look.mind("scout"))
    board = f"pi{int(rescuer[-1]) + 1}"
    network.part("pi1", board)
    team.kill(board, "agentd")
    team.start(board, "agentd")
    team.ready(board, "agentd")
    look.until(lambda look: _held(look.mind("scout")) != rescuer, f"{rescuer} is given up")
    network.join("pi1", board)
    look.believes("scout", "mission_done", 200)
    verdict = judge_run(team.mission, report)
    assert verdict.good, f"{verdict}\n{team.transcript()[-8000:]}"


def _held(beliefs: list[str] | None) -> str:
    """Return who is to rescue somebody, by the scout's beliefs; empty if nobody is."""
    found = next((re.match(r"held\(\d+,(\w+)\)", one) for one in beliefs or () if one.startswith("held(")), None)
    return found[1] if found else ""
