"""`argosy status`: who of a fleet is there, from real daemons, and how it is shown."""

import json
import re
import signal
import subprocess
from argparse import Namespace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from argosy.__main__ import main
from argosy.fleet_model.fleet_status import MOST, FleetStatus
from argosy.status.command import _view, status_line, summary, to_json
from argosy.status.metrics_command import Fleet
from argosy.status.table import table
from schemas.humanize import span
from schemas.liveness import SILENT_AFTER
from schemas.mission.model import Mission, load_mission
from schemas.wire import keys
from schemas.wire.records import Health, Note
from tests.support import forked
from tests.support.processes import ROOT, Daemon

MISSION = """\
mission: trial
boards: {pi1: {}, pi2: {}}
agents:
  a: {program: a.asl, board: pi1}
  b: {program: a.asl, board: pi2, robot: uav}
robots:
  uav: {manifest: copter, link: "udpin:127.0.0.1:1", board: pi2}
clients:
  tool: {board: pi1}
"""


@pytest.fixture
def mission(tmp_path: Path) -> Mission:
    path = tmp_path / "trial.yaml"
    path.write_text(MISSION)
    (tmp_path / "a.asl").write_text("!start.\n+!start <- .log(info, ready).\n")
    return load_mission(path)


class Trial:
    """A roll whose clock the test moves."""

    def __init__(self, mission: Mission | None) -> None:
        self.at = 100.0
        self.fleet_status = FleetStatus(mission, lambda: self.at)

    def alive(self, name: str, daemon: str, boot: str = "x", *, there: bool = True) -> None:
        self.fleet_status.token(keys.alive("trial", name, daemon, boot), there)

    def tells(self, name: str, daemon: str, **facts: Any) -> None:
        self.fleet_status.heard(keys.health("trial", name, daemon), Health(daemon=daemon, **facts))

    def standings(self) -> dict[str, str]:
        return {f"{row.daemon} {row.name}": row.standing for row in self.fleet_status.rows()}


def test_who_should_be_there_is_known_from_the_mission_and_clients_may_be_away(mission: Mission) -> None:
    trial = Trial(mission)
    assert list(trial.standings()) == ["commd pi1", "agentd a", "commd pi2", "bridged uav", "agentd b"]
    assert set(trial.standings().values()) == {"missing"}
    assert summary("trial", trial.fleet_status.rows()) == (
        "fleet trial: 0 of 5 daemons are up; missing: commd pi1, agentd a, commd pi2, bridged uav, agentd b"
    )


def test_a_daemon_comes_tells_falls_silent_and_goes(mission: Mission) -> None:
    trial = Trial(mission)
    trial.alive("a", "agentd")
    assert trial.standings()["agentd a"] == "coming"
    trial.tells("a", "agentd")
    assert trial.standings()["agentd a"] == "up"
    trial.at += SILENT_AFTER + 0.1
    assert trial.standings()["agentd a"] == "silent"
    trial.alive("a", "agentd", "y")
    trial.tells("a", "agentd")
    assert trial.standings()["agentd a"] == "twice"
    trial.alive("a", "agentd", "x", there=False)
    assert trial.standings()["agentd a"] == "up"
    trial.alive("a", "agentd", "y", there=False)
    assert trial.standings()["agentd a"] == "missing", "what it told before it went holds no longer"
    trial.at += 1
    (gone,) = [row for row in trial.fleet_status.rows() if row.name == "a"]
    assert [(note.code, note.value) for note in gone.notes] == [("missing", 1.0)]
    trial.tells("a", "agentd")
    assert trial.standings()["agentd a"] == "unclaimed", "it tells, and has no token"
    trial.at += SILENT_AFTER + 0.1
    assert trial.standings()["agentd a"] == "missing"


def test_who_is_not_in_the_mission_is_shown_and_a_client_need_not_tell_how_it_is(mission: Mission) -> None:
    trial = Trial(mission)
    trial.alive("made", "agentd")
    trial.alive("tool", "client")
    trial.tells("made", "agentd")
    trial.at += SILENT_AFTER - 0.1
    rows = {row.name: row for row in trial.fleet_status.rows()}
    assert not rows["made"].in_mission
    assert status_line(rows["made"]).endswith(" in_mission=no")
    assert rows["tool"].standing == "up"
    trial.alive("made", "agentd", there=False)
    trial.at += 0.2
    assert "agentd made" not in trial.standings(), "who is gone and not in the mission is not missing"


def test_without_a_mission_all_that_is_there_is_shown() -> None:
    trial = Trial(None)
    assert summary("any", trial.fleet_status.rows()) == "all fleets: no daemon is running"
    trial.alive("pi1", "commd")
    trial.tells("pi1", "commd")
    (row,) = trial.fleet_status.rows()
    assert (row.board, row.in_mission, row.standing) == ("pi1", True, "up")
    told = "all fleets: 1 of 1 daemons are up; `argosy status MISSION` also shows which are missing"
    assert summary("any", [row]) == told


def test_names_without_end_are_not_all_followed() -> None:
    trial = Trial(None)
    for number in range(MOST + 10):
        trial.alive(f"n{number}", "agentd")
    assert (len(trial.fleet_status.rows()), trial.fleet_status.dropped) == (MOST, 10)
    assert not trial.fleet_status.settled


def test_names_that_come_and_go_without_end_are_forgotten_and_new_ones_followed() -> None:
    trial = Trial(None)
    for number in range(MOST + 10):
        trial.alive(f"n{number}", "agentd")
        trial.tells(f"n{number}", "agentd")
        trial.alive(f"n{number}", "agentd", there=False)
        trial.at += 1
    trial.at += SILENT_AFTER
    trial.alive("new", "agentd")
    assert trial.standings() == {"agentd new": "coming"}
    assert trial.fleet_status.dropped == 0


def test_of_several_fleets_one_name_is_not_taken_for_another() -> None:
    fleet_status = FleetStatus(None, lambda: 100.0, several=True)
    for fleet in ("alpha", "beta"):
        fleet_status.token(keys.alive(fleet, "uav1", "bridged", fleet), True)
        fleet_status.heard(keys.health(fleet, "uav1", "bridged"), Health(daemon="bridged", drops=len(fleet)))
    rows = fleet_status.rows()
    assert [(row.title, row.standing) for row in rows] == [("alpha/uav1", "up"), ("beta/uav1", "up")]
    assert [one["fleet"] for one in to_json("any", rows, True)["daemons"]] == ["alpha", "beta"]
    page = Fleet("", rows, True, dropped=3).page().decode()
    assert 'argosy_drops_total{board="",daemon="bridged",fleet="beta",name="uav1"} 4.0' in page
    assert 'argosy_not_followed_total{fleet=""} 3.0' in page


def test_a_line_tells_everything_in_keys_and_values_and_takes_no_line_breaks_from_anybody(mission: Mission) -> None:
    trial = Trial(mission)
    trial.alive("uav", "bridged")
    facts: dict[str, Any] = {"version": "0.1.0", "uptime": 75.4, "lag": 0.0123, "drops": 3, "bad_input": 1}
    words = {
        "last_error": 'the "link"\nbroke',
        "notes": (Note("failsafe_none", "no failsafe", value=1.0),),
        "errors": 2,
    }
    trial.tells("uav", "bridged", restarts=4, **facts, **words)
    (row,) = [row for row in trial.fleet_status.rows() if row.name == "uav"]
    assert status_line(row) == (
        "up bridged uav board=pi2 version=0.1.0 uptime=75 age=0.0 lag=0.012 drops=3 bad_input=1 restarts=4 errors=2 "
        'last_error="the \\"link\\" broke" note="no failsafe"'
    )
    told = to_json("trial", [row], True)["daemons"][0]
    assert (told["restarts"], told["standing"], told["board"]) == (4, "up", "pi2")
    assert told["notes"] == ({"code": "failsafe_none", "text": "no failsafe", "value": 1.0},)


def test_an_older_daemon_that_tells_neither_version_nor_restarts_is_shown_all_the_same(mission: Mission) -> None:
    trial = Trial(mission)
    trial.alive("a", "agentd")
    trial.tells("a", "agentd")
    rows = [row for row in trial.fleet_status.rows() if row.name == "a"]
    assert status_line(rows[0]) == "up agentd a board=pi1 uptime=0 age=0.0 lag=0.000 drops=0 bad_input=0 errors=0"
    assert " ?  " in shown(rows)


def shown(rows: list[Any], width: int = 80, **more: bool) -> str:
    console = Console(width=width, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(table(summary("trial", rows), rows, **more))
    return console.export_text()


def test_the_table_fits_a_terminal_and_tells_what_is_wrong_below_it(mission: Mission) -> None:
    trial = Trial(mission)
    trial.alive("a", "agentd")
    trial.tells("a", "agentd", version="0.1.0", restarts=2, lag=3.0, last_error="disk full", last_error_age=75.0)
    text = shown(trial.fleet_status.rows())
    assert max(map(len, text.splitlines())) <= 80
    assert "agentd a: last error 75 s ago: disk full" in text
    assert "commd pi1, pi2: it is in the mission and not on the bus" in text
    assert re.search(r"● up +0\.1\.0 +0\.0 s +3\.0 s +0 +2", text)
    assert text.startswith("fleet trial: 1 of 5 daemons are up; missing: commd pi1"), "what matters most stands first"
    assert text.count("not on the bus") == 3, "what several have in common is said once"
    assert "this is the last known state" in shown(trial.fleet_status.rows(), away=True)


@pytest.mark.parametrize(
    ("seconds", "told"), [(0.4, "0.4 s"), (59, "59 s"), (125, "2 min 5 s"), (7260, "2 h 1 min"), (200_000, "2 d 7 h")]
)
def test_spans_are_told_in_words(seconds: float, told: str) -> None:
    assert span(seconds) == told


def status(mission: Path, router: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return forked.run(["argosy", "status", mission, "--router", router, *arguments], cwd=ROOT)


@pytest.mark.parametrize(("columns", "first"), [("80", "\x1b[1;31mfleet "), ("79", "missing commd")])
def test_a_terminal_too_narrow_for_the_table_gets_lines(
    mission: Mission, columns: str, first: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdout.isatty", lambda: True)
    monkeypatch.setenv("COLUMNS", columns)
    status = FleetStatus(mission, lambda: 0.0)
    _view(mission.fleet, Namespace(json=False, plain=False))(status.rows())
    assert capsys.readouterr().out.startswith(first)


@pytest.mark.parametrize("wait", ["inf", "nan", "-1"])
def test_a_wait_without_end_is_refused(wait: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["status", f"--wait={wait}"])
    assert f"--wait: expected wall seconds, 0 or more, got `{wait}`" in capsys.readouterr().err


def test_real_daemons_that_are_up_dead_and_started_again(tmp_path: Path, endpoint: str) -> None:
    path = tmp_path / "trial.yaml"
    path.write_text("mission: trial\nagents: {a: {program: a.asl}}\n")
    (tmp_path / "a.asl").write_text("!start.\n+!start <- .print(ready).\n")
    where = (str(path), "--router", endpoint, "--state", str(tmp_path / "state"))
    commd, agentd = Daemon("commd", "serve", *where), Daemon("agentd", "serve", *where)
    again = None
    try:
        agentd.says("ready")
        well = status(path, endpoint, "--wait", "20")
        assert well.returncode == 0, well
        up, also, last = well.stdout.splitlines()
        assert re.match(r"up commd local board=local version=\S+ uptime=\d+ .* restarts=0 errors=0$", up)
        assert re.match(r"up agentd a board=local version=\S+ uptime=\d+ .* restarts=0 errors=0$", also)
        assert last == "fleet trial: 2 of 2 daemons are up"

        agentd.signal(signal.SIGKILL)
        agentd.ends()
        dead = status(path, endpoint, "--json", "--wait", "4")
        assert dead.returncode == 1
        told = json.loads(dead.stdout)
        assert not told["well"]
        assert {one["name"]: one["standing"] for one in told["daemons"]} == {"local": "up", "a": "missing"}

        again = Daemon("agentd", "serve", *where)
        again.says("restarted=1")
        back = status(path, endpoint, "--wait", "20")
        assert back.returncode == 0
        assert 'restarts=1 errors=0 last_error="the process before it ended without a message' in back.stdout
    finally:
        for one in (commd, agentd, again):
            if one is not None:
                one.kill()


def test_a_mission_and_a_fleet_at_once_are_refused(capsys: pytest.CaptureFixture[str], mission: Mission) -> None:
    assert main(["status", str(mission.path), "--fleet", "x"]) == 2
    assert "the mission names its fleet" in capsys.readouterr().err
