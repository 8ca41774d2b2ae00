"""The paper's mission by manifests and an agent in the paper's own vocabulary, flown by the real daemons."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

from tests.argosy.conftest import MISSIONS, Start, copied


def test_the_paper_flies(start: Start, tmp_path: Path, free_port: Callable[[], int]) -> None:
    (tmp_path / "paper_uav").symlink_to(MISSIONS / "paper_uav")
    running = start(copied("paper_uav", tmp_path, free_port()), "--speed", "20", real_daemons=True)
    running.until("agentd uav: up")
    code = running.wait(120)
    out = running.stdout
    assert running.left_running() == []
    assert code == 0, out + running.stderr
    for action in ('set_mode("GUIDED")', "arm_motors(True)", "takeoff(5)", "setpoint(-27.603683,-48.518052,61)"):
        assert re.search(rf"uav: {re.escape(action)} succeeded after", out), action
    assert "uav: mission done" in out
    left = re.search(r"uav1 +RTL, disarmed, (-?[\d.]+) m above home; flew (\d+) m, ([\d.]+) m high", out)
    assert left is not None, out
    assert abs(float(left[1])) < 0.5
    assert 38 < float(left[3]) < 42, "61 m above the sea are 40 m above a home at 21 m"


def test_a_program_that_never_says_that_it_is_done_ends_by_what_its_robot_tells(
    start: Start, tmp_path: Path, free_port: Callable[[], int]
) -> None:
    (tmp_path / "paper_uav").symlink_to(MISSIONS / "paper_uav")
    mission = copied("paper_uav", tmp_path, free_port())
    (tmp_path / "silent.asl").write_text("""\
!start.
+!start : takeoff_altitude(Alt)
  <- .wait(state(_,"True",_)); set_mode("GUIDED"); arm_motors(True); takeoff(Alt);
     .wait(altitude(A) & A > Alt - 0.5); set_mode("RTL").
""")
    text = re.sub(r"program: \S+", "program: silent.asl", mission.read_text())
    text = text.replace('"uav: mission_done"', """'uav: state("RTL", _, "False")'""")
    mission.write_text(text.replace('failed: "uav: mission_failed(_)"\n', ""))
    running = start(mission, "--speed", "20", real_daemons=True)
    running.until("agentd uav: up")
    assert running.wait(120) == 0, running.stdout + running.stderr
    assert re.search(r"uav1 +RTL, disarmed, -?0\.\d+ m above home", running.stdout), running.stdout
