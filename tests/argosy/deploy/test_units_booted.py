"""The units of a board under a real systemd, in a machine of its own: they start, are watched, keep strangers out."""

from collections.abc import Iterator

import pytest

from argosy.deploy.unit_files import Board
from argosy.deploy.units_command import write
from schemas.mission.model import load_mission
from tests.support.booted import Machine, NoMachine, booted

MISSION = """\
mission: survey
agents: {scout: {program: scout.asl, robot: uav1}}
robots: {uav1: {manifest: copter, link: "udpin:127.0.0.1:14550"}}
done: "scout: over"
"""
UNITS = {daemon: f"{daemon}@survey.service" for daemon in ("commd", "bridged", "agentd")}
KNOCK = "/opt/checkout/tests/support/knock.py"


@pytest.fixture(scope="module")
def machine(tmp_path_factory: pytest.TempPathFactory, namespaces: None) -> Iterator[Machine]:
    """A machine on which the units of a board run; skips where none can be made."""
    folder = tmp_path_factory.mktemp("booted")
    (folder / "survey.yaml").write_text(MISSION)
    (folder / "scout.asl").write_text("+x <- +over.\n")
    board = Board(load_mission(folder / "survey.yaml"), "local")
    write(board, folder / "tree")
    try:
        with booted() as made:
            made.install(folder / "tree")
            made.run("systemctl", "start", board.target, *board.units)
            yield made
    except NoMachine as why:
        pytest.skip(str(why))


def test_every_unit_starts_with_all_that_it_may_not_and_says_what_it_does(machine: Machine) -> None:
    states = {machine.show(unit, "ActiveState") for unit in UNITS.values()}
    assert states == {"active"}  # `systemctl start` of the target had waited until they were ready
    told = {daemon: machine.show(unit, "StatusText") for daemon, unit in UNITS.items()}
    assert told["commd"] == "router of local at unixsock-stream//run/argosy/survey/router.sock"
    assert told["bridged"].startswith("serving uav1")
    assert told["agentd"].startswith("reasoning: scout")
    for daemon, unit in UNITS.items():
        status = machine.run("cat", f"/proc/{machine.main_pid(unit)}/status")
        fields = dict(line.split(":\t", 1) for line in status.splitlines() if ":\t" in line)
        assert fields["NoNewPrivs"] == "1"
        assert fields["Seccomp"] == "2"  # a filter
        assert int(fields["CapEff"], 16) == int(fields["CapBnd"], 16) == 0
        user = machine.run("id", "-u", f"argosy-{daemon}").strip()
        assert fields["Uid"].split() == [user] * 4


def test_a_member_of_the_group_is_served_and_a_stranger_is_not(machine: Machine) -> None:
    machine.run("useradd", "--groups", "argosy", "member")
    machine.run("useradd", "stranger")
    socket = "unixsock-stream//run/argosy/survey/router.sock"
    knock = ("/opt/argosy/bin/python", KNOCK, socket)
    assert machine.run("runuser", "-u", "member", "--", *knock).strip() == "in"
    assert machine.run("runuser", "-u", "stranger", "--", *knock).strip() == "out"


def test_the_agents_have_no_network_and_no_devices(machine: Machine) -> None:
    pid = str(machine.main_pid(UNITS["agentd"]))
    links = machine.run("nsenter", "-t", pid, "-n", "ip", "-o", "link").splitlines()
    assert [line.split(":")[1].strip() for line in links] == ["lo"]
    devices = machine.run("ls", f"/proc/{pid}/root/dev").split()
    assert "null" in devices
    assert not [
        name for name in devices if name.startswith(("tty0", "ttyS", "ttyA", "ttyU", "mem", "kmsg", "sd", "vd"))
    ]


def test_a_daemon_that_hangs_is_ended_by_the_watchdog_and_started_again(machine: Machine) -> None:
    unit = UNITS["agentd"]
    first, restarts = machine.main_pid(unit), int(machine.show(unit, "NRestarts"))
    machine.run("kill", "-STOP", str(first))
    machine.until(lambda: machine.main_pid(unit) not in (0, first), "systemd starts it again")
    machine.until(lambda: machine.show(unit, "ActiveState") == "active", "it serves again")
    assert int(machine.show(unit, "NRestarts")) == restarts + 1
    assert machine.main_pid(UNITS["bridged"])


def test_the_end_of_the_target_is_the_end_of_all_and_leaves_no_socket(machine: Machine) -> None:
    machine.run("systemctl", "stop", "argosy-survey.target")
    machine.until(lambda: not any(map(machine.main_pid, UNITS.values())), "all have ended")
    assert {machine.show(unit, "Result") for unit in UNITS.values()} == {"success"}
    assert "survey" not in machine.run("ls", "/run/argosy")
