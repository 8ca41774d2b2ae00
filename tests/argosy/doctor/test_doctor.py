"""`argosy doctor`: what it says of facts, and of real boards."""

import json
import subprocess
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from argosy.doctor.command import CHECKS, show
from argosy.doctor.findings import Diagnosis, Facts, RobotFacts
from argosy.doctor.fleet_checks import clocks, daemons, disks, failsafes, links, mail, percepts, vehicles, versions
from argosy.fleet_model.fleet_status import Row
from schemas.mission.model import load_mission
from schemas.version import RELEASE
from schemas.wire.records import (
    BoardReport,
    DeadLetter,
    Header,
    Health,
    LinkReport,
    Mailboxes,
    Message,
    Note,
    Queue,
    Refusal,
)
from tests.support import forked
from tests.support.ports import free_port
from tests.support.processes import ROOT, Daemon

MISSION = """\
mission: trial
boards: {pi1: {}, pi2: {}}
agents:
  a: {program: a.asl, board: pi1}
  b: {program: a.asl, board: pi2, robot: uav}
robots:
  uav: {manifest: copter, link: "udpin:127.0.0.1:1", board: pi2}
"""
WELL = Health(version=RELEASE, restarts=0, uptime=100.0, header=Header(boot="x"))


@pytest.fixture
def facts(tmp_path: Path) -> Facts:
    path = tmp_path / "trial.yaml"
    path.write_text(MISSION)
    (tmp_path / "a.asl").write_text("!start.\n+!start <- .print(ready).\n")
    return Facts(load_mission(path))


def row(name: str = "a", daemon: str = "agentd", board: str = "pi1", **more: Any) -> Row:
    standing = more.pop("standing", "up")
    in_mission = more.pop("in_mission", True)
    health = None if standing == "missing" else replace_health(more)
    return Row(name, daemon, board, standing, health, 0.2, in_mission)


def replace_health(more: Mapping[str, Any]) -> Health:
    from msgspec.structs import replace as renewed

    return renewed(WELL, **more)


def only(said: list[Diagnosis], level: str) -> Diagnosis:
    (found,) = [one for one in said if one.level == level]
    assert found.do or level == "ok", "a finding says what to do"
    return found


def test_daemons_that_are_not_well_are_errors_with_where_to_look(facts: Facts) -> None:
    assert only(daemons(replace(facts, rows=[row()])), "ok").text == "all 1 are up, heard within 0.2 s"
    found = only(daemons(replace(facts, rows=[row(), row("b", board="pi2", standing="missing")])), "error")
    assert found.text == "agentd b on pi2 is missing: it is in the mission and not on the bus"
    assert "on pi2: `systemctl status agentd@trial`" in found.do
    assert "(of one process: `board@trial`)" in found.do
    both = [row("pi2", "commd", "pi2", standing="missing"), row("b", board="pi2", standing="missing"), row()]
    dark = only(daemons(replace(facts, rows=both)), "error")
    assert dark.text == "all daemons of pi2 are missing: commd pi2, agentd b"
    assert "`systemctl status argosy-trial.target`" in dark.do
    for standing in ("silent", "twice", "unclaimed"):
        assert only(daemons(replace(facts, rows=[row(standing=standing)])), "error").text.startswith("agentd a on pi1")


@pytest.mark.parametrize(
    ("more", "told"),
    [
        ({"notes": (Note("slow", "the disk is slow"),)}, "agentd a: the disk is slow"),
        ({"restarts": 3, "last_error": "killed"}, "agentd a was restarted 3 times since its board started; killed"),
        ({"errors": 2, "last_error": "disk full", "last_error_age": 7.2}, "2 errors, the last 7 s ago: disk full"),
        ({"counters": {"intentions_failed": 1}}, "agentd a: 1 intention ended by a failure that no plan handles"),
        ({"drops": 60}, "agentd a dropped 50 messages within 10 s"),
        ({"lag": 4.2}, "agentd a is 4.2 s behind"),
    ],
)
def test_what_a_daemon_complains_of_is_a_warning(facts: Facts, more: dict[str, Any], told: str) -> None:
    said = daemons(replace(facts, rows=[row(**more)], earlier=[row(drops=10, uptime=90.0)]))
    assert told in only(said, "warning").text


@pytest.mark.parametrize(
    ("code", "do"), [("failsafe_none", "`failsafe: {gcs: bridge}`"), ("operator_order", "`argosy stop release`")]
)
def test_what_is_to_be_done_about_a_known_warning_is_said_and_no_unit_named(facts: Facts, code: str, do: str) -> None:
    found = only(daemons(replace(facts, rows=[row("uav", "bridged", notes=(Note(code, "any text"),))])), "warning")
    assert do in found.do
    assert "systemctl" not in found.do


def test_a_vehicle_whose_autopilot_is_not_commanded_is_an_error(facts: Facts) -> None:
    note = Note(code="autopilot_unknown", text="the autopilot of the vehicle is PX4")
    found = only(daemons(replace(facts, rows=[row("uav", "bridged", notes=(note,))])), "error")
    assert found.text == "bridged uav: the autopilot of the vehicle is PX4"
    assert "Only ArduPilot and PX4 are flown" in found.do


def test_a_robot_that_nobody_attends_is_an_error_and_told_once(facts: Facts) -> None:
    note = Note(code="robot_unattended", text="in the air with nobody in charge", value=12.5)
    said = daemons(replace(facts, rows=[row("uav", "bridged", notes=(Note("other", "other"), note))]))
    found = only(said, "error")
    assert found.text == "bridged uav: in the air with nobody in charge"
    assert "argosy stop land|rtl" in found.do
    assert only(said, "warning").text == "bridged uav: other"


def test_vehicles_without_a_declared_failsafe_are_told_of_once(facts: Facts, tmp_path: Path) -> None:
    path = tmp_path / "watched.yaml"
    robot = "{manifest: copter, link: 'udpin:127.0.0.1:%d'%s}"
    declared = {"a": "", "b": ", failsafe: {gcs: bridge}", "c": ", failsafe: {gcs: none}", "d": ""}
    robots = "".join(f"  {name}: {robot % (number, said)}\n" for number, (name, said) in enumerate(declared.items(), 1))
    path.write_text(f"mission: m\nagents: {{x: {{program: x.asl, robot: a}}}}\nrobots:\n{robots}")
    rows = [row(name, "bridged", counters={"messages": 100.0}) for name in declared]
    said = failsafes(replace(facts, mission=load_mission(path), rows=rows, earlier=rows))
    assert only(said, "ok").text == "b: monitors heartbeats of `bridge`"
    found = only(said, "warning")
    assert found.text == "a, d: no failsafe is declared: the vehicle does not return if its bridge dies"
    assert "`failsafe: {gcs: bridge}`" in found.do


def test_units_alone_are_named_only_for_boards_with_addresses(facts: Facts, tmp_path: Path) -> None:
    missing = [row(standing="missing")]
    assert "with `argosy run`: see what it prints" in only(daemons(replace(facts, rows=missing)), "error").do
    path = tmp_path / "addressed.yaml"
    path.write_text(MISSION.replace("pi1: {}", "pi1: {address: 10.0.0.11}"))
    assert "argosy run" not in only(daemons(replace(facts, mission=load_mission(path), rows=missing)), "error").do


def test_what_was_dropped_before_is_no_warning_and_neither_is_an_agent_made_at_run_time(facts: Facts) -> None:
    rows = [row(drops=60), row("made", in_mission=False)]
    said = daemons(replace(facts, rows=rows, earlier=[row(drops=60, uptime=90.0)]))
    assert [one.level for one in said] == ["ok"]
    stranger = daemons(replace(facts, rows=[row("pi9", "commd", in_mission=False)]))
    assert only(stranger, "warning").text == "not in the mission: commd pi9"


def test_versions_that_differ_are_named_and_another_major_one_is_an_error(facts: Facts) -> None:
    assert only(versions(replace(facts, rows=[row()])), "ok").text.startswith(f"all run {RELEASE}")
    mixed = only(versions(replace(facts, rows=[row(), row("b", version="0.0.9"), row("c", version="")])), "warning")
    assert mixed.text == f"0.0.9: b; {RELEASE}: a; unknown, older: c; this machine: {RELEASE}"
    assert only(versions(replace(facts, rows=[row(), row("b", version="7.0.0")])), "error")


@pytest.mark.parametrize(
    ("ahead", "level", "told"),
    [
        ({"pi1": 0.001, "pi2": -0.002}, "ok", "2 boards and this machine agree within 3.0 ms (measured to 10.0 ms)"),
        ({"pi1": 0.5, "pi2": 0.001}, "warning", "pi1 is 0.5 s ahead of this machine (measured to 5.0 ms)"),
        ({"pi1": -40.0, "pi2": 1.0}, "error", "pi2 is 41 s ahead of pi1 (measured to 10.0 ms)"),
        ({"pi1": 0.0, "pi2": -7200.0}, "error", "is 2 h ahead of pi2"),
    ],
)
def test_clocks_are_compared_as_round_trips_allow(facts: Facts, ahead: dict[str, float], level: str, told: str) -> None:
    seen = {board: LinkReport(board=board, round_trip=0.01, ahead=one) for board, one in ahead.items()}
    assert told in only(clocks(replace(facts, from_here=seen)), level).text


def test_a_skew_within_what_a_slow_link_leaves_open_is_none(facts: Facts) -> None:
    seen = {"pi1": LinkReport(board="pi1", round_trip=2.0, ahead=0.9)}
    assert only(clocks(replace(facts, from_here=seen)), "ok")


@pytest.mark.parametrize(
    ("free", "level", "told"),
    [
        (50_000_000_000, "ok", "at least 50.0 GB are free for state (pi1)"),
        (800_000_000, "warning", "pi1: 800 MB of 64.0 GB are free at /var/lib/argosy"),
        (10_000_000, "error", "pi1: 10 MB of 64.0 GB are free"),
        (None, "error", "pi1: /var/lib/argosy cannot be read"),
    ],
)
def test_disks_that_fill_are_told(facts: Facts, free: int | None, level: str, told: str) -> None:
    report = BoardReport(board="pi1", state="/var/lib/argosy", disk_free=free, disk_size=64_000_000_000)
    assert told in only(disks(replace(facts, boards={"pi1": report})), level).text


@pytest.mark.parametrize(
    ("link", "level", "told"),
    [
        ({"answered": 5, "round_trip": 0.003, "slowest": 0.01, "rate": 9e6}, "ok", "1 way measured: 3.0 ms at most"),
        ({"problem": "its commd does not answer"}, "error", "pi1 > pi2: its commd does not answer"),
        ({"answered": 3, "round_trip": 0.003}, "warning", "pi1 > pi2: 2 of 5 round trips had no answer"),
        ({"answered": 5, "round_trip": 0.9, "slowest": 1.2}, "warning", "pi1 > pi2: 0.9 s for a round trip at best"),
        ({"answered": 5, "round_trip": 0.1, "rate": 1200.0}, "warning", "pi1 > pi2: 1.2 kB/s"),
        ({"answered": 5, "round_trip": 0.1, "problem": "no"}, "warning", "pi1 > pi2: no"),
    ],
)
def test_links_are_judged_by_answers_time_and_rate(facts: Facts, link: dict[str, Any], level: str, told: str) -> None:
    report = BoardReport(board="pi1", links=(LinkReport(board="pi2", asked=5, **link),))
    assert told in only(links(replace(facts, boards={"pi1": report})), level).text


def test_a_board_that_does_not_answer_is_an_error(facts: Facts) -> None:
    found = only(links(replace(facts, boards={"pi2": "no answer within 3 s"})), "error")
    assert found.text == "pi2 is not reached from here: no answer within 3 s"
    there = replace(facts, boards={"pi2": "its commd does not answer"}, rows=[row("pi2", "commd", "pi2")])
    assert only(links(there), "warning").text.startswith("pi2 runs but answers no checkup")


@pytest.mark.parametrize(
    ("messages", "bad", "level", "told"),
    [
        (1000, 0, "ok", "uav: 100 messages/s on udpin:127.0.0.1:1"),
        (0, 0, "error", "uav: nothing is received on udpin:127.0.0.1:1"),
        (12, 0, "warning", "uav: only 1.2 messages/s"),
        (1000, 100, "warning", "uav: 10.0 of 110 packets/s on"),
    ],
)
def test_links_are_judged_by_what_comes(facts: Facts, messages: float, bad: float, level: str, told: str) -> None:
    before = row("uav", "bridged", "pi2", uptime=90.0, counters={"messages": 50.0, "bad_checksums": 5.0})
    after = row("uav", "bridged", "pi2", counters={"messages": 50.0 + messages, "bad_checksums": 5.0 + bad})
    assert told in only(vehicles(replace(facts, earlier=[before], rows=[after])), level).text


def test_a_simulated_vehicle_without_a_link_is_silent_because_of_its_simulator(facts: Facts, tmp_path: Path) -> None:
    path = tmp_path / "trial.yaml"
    path.write_text(MISSION.replace('link: "udpin:127.0.0.1:1"', "simulate: {vehicle: copter}"))
    row_at = {at: row("uav", "bridged", "pi2", uptime=at, counters={"messages": 50.0}) for at in (90.0, 100.0)}
    silent = Facts(load_mission(path), earlier=[row_at[90.0]], rows=[row_at[100.0]])
    found = only(vehicles(silent), "error")
    assert found.text == "uav: nothing is received on the link to its simulator"
    assert found.do.startswith("does the process of its simulator run?")


def test_a_bridge_that_was_started_again_meanwhile_has_no_rate(facts: Facts) -> None:
    before = row("uav", "bridged", counters={"messages": 50.0}, uptime=9.0, header=Header(boot="one"))
    after = row("uav", "bridged", counters={"messages": 5.0}, header=Header(boot="two"))
    assert vehicles(replace(facts, earlier=[before], rows=[after])) == []


@pytest.mark.parametrize(
    ("driver", "source", "do"),
    [("mavlink", "gas", "SRn_"), ("zenoh", "boot/gas", "put this key"), ("counter", "gas", "its driver report")],
)
def test_the_advice_for_missing_percepts_is_that_of_their_driver(
    facts: Facts, tmp_path: Path, driver: str, source: str, do: str
) -> None:
    path = tmp_path / "boot.yaml"
    path.write_text(MISSION.replace('link: "udpin:127.0.0.1:1"', "prefix: boot"))
    some = RobotFacts({}, {"gas": {"driver": driver, "source": "gas", "ttl": 3}})
    found = only(percepts(replace(facts, mission=load_mission(path), robots={"uav": some})), "warning")
    assert found.text == f"uav: missing: gas (from {source})"
    assert do in found.do
    assert ("SRn_" in found.do) == (driver == "mavlink")


def test_percepts_with_a_live_source_that_are_not_told_are_named_with_their_source(facts: Facts) -> None:
    declared: dict[str, dict[str, object]] = {
        "altitude": {"source": "GLOBAL_POSITION_INT", "ttl": 3},
        "gps": {"source": "GPS_RAW_INT", "ttl": 5},
        "override": {"source": "OVERRIDE"},
        "adsb": {"source": "ADSB_VEHICLE", "ttl": 60, "optional": True},
        "vehicle_text": {"source": "VEHICLE_TEXT", "ttl": 60, "buf": "add"},
    }
    at = 1_000_000_000_000
    some = RobotFacts({"altitude": at}, declared)
    known = replace(facts, now=at + 2_500_000_000, robots={"uav": some})
    assert only(percepts(known), "warning").text == "uav: missing: gps (from GPS_RAW_INT)"
    full = replace(known, robots={"uav": RobotFacts({"altitude": at, "gps": at - 10}, declared)})
    assert only(percepts(full), "ok").text == "uav: 2 percepts, the newest 2.5 s old"
    ahead = replace(full, from_here={"pi2": LinkReport(board="pi2", ahead=1.0)})
    assert only(percepts(ahead), "ok").text == "uav: 2 percepts, the newest 3.5 s old"
    mute = replace(known, robots={"uav": RobotFacts({}, {}, "its bridge does not answer with its manifest")})
    assert only(percepts(mute), "warning").text == "uav: its bridge does not answer with its manifest"


def test_mail_that_waits_long_or_was_given_up_is_told(facts: Facts) -> None:
    queue = Queue(box="outbox", sender="a", receiver="b", messages=3, oldest=90.0, state="pi2 is away")
    waiting = only(mail(replace(facts, mail={"pi1": Mailboxes(board="pi1", queues=(queue,))})), "warning")
    assert waiting.text == "pi1: 3 messages a > b wait, the oldest for 90 s: pi2 is away"
    letter = DeadLetter(
        message=Message(id="1", sender="a", performative="tell", receiver="b", content=1),
        reason=Refusal(code="expired"),
        stamp=0,
    )
    dead = only(mail(replace(facts, mail={"pi1": Mailboxes(board="pi1", dead=(letter,), dead_count=4)})), "warning")
    assert dead.text.startswith("pi1: 4 messages could not be delivered")
    assert only(mail(replace(facts, mail={"pi1": Mailboxes(board="pi1")})), "ok")


def test_of_nothing_known_nothing_is_said_to_be_well(facts: Facts) -> None:
    said = [one for check in CHECKS for one in check(facts)]
    assert [one.text for one in said] == ["no daemon is running"]


def test_findings_are_shown_with_what_to_do_and_counted(capsys: pytest.CaptureFixture[str]) -> None:
    show([Diagnosis("ok", "disks", "fine"), Diagnosis("error", "links", "cut\x1b[2J", "mend it")], as_json=False)
    assert capsys.readouterr().out == (
        "ok       disks  fine\nerror    links  cut [2J\n                do: mend it\n1 error, 0 warnings\n"
    )


def doctor(mission: Path, router: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    return forked.run(["argosy", "doctor", mission, "--router", router, *arguments], timeout=90, cwd=ROOT)


def test_two_real_boards_are_looked_over_and_what_is_missing_is_told(facts: Facts, tmp_path: Path) -> None:
    path = facts.mission.path
    one, two, link = (f"tcp/127.0.0.1:{free_port()}" for _ in range(3))
    state = ("--state", str(tmp_path / "state"))
    started = [
        Daemon("commd", "serve", str(path), "--board", "pi1", "--router", one, "--listen", link, *state),
        Daemon("commd", "serve", str(path), "--board", "pi2", "--router", two, "--connect", link, *state),
        Daemon("agentd", "serve", str(path), "a", "--router", one, *state),
    ]
    try:
        started[2].says("ready")
        for daemon in started[:2]:
            daemon.says("board=")
        found = doctor(path, two, "--json")
        assert found.returncode == 1, found
        told = json.loads(found.stdout)
        errors = [each["text"] for each in told["findings"] if each["level"] == "error"]
        assert [text.split(":")[0] for text in errors] == [
            "bridged uav on pi2 is missing",
            "agentd b on pi2 is missing",
        ]
        well = {each["what"]: each["text"] for each in told["findings"] if each["level"] == "ok"}
        assert {"versions", "clocks", "links", "mail"} <= well.keys()
        assert well["links"].startswith("4 ways measured")
        assert all(each["do"] for each in told["findings"] if each["level"] != "ok")
    finally:
        for daemon in started:
            daemon.kill()
    alone = doctor(path, two)
    assert alone.returncode == 1
    assert f"error    router  no router at {two}: is commd running?" in alone.stdout
    assert "do: is the fleet there? with `argosy run`: start it" in alone.stdout
