"""What keeps a run from its start: it is told in a line, before any process is there."""

import fcntl
import re
import socket
from collections.abc import Callable
from pathlib import Path

import pytest

from argosy.__main__ import main
from tests.argosy.conftest import Start

Refused = Callable[..., tuple[int, str]]


@pytest.fixture
def refused(capsys: pytest.CaptureFixture[str], endpoint: str) -> Refused:
    """Return what runs `argosy run MISSION ...` in this process; it returns exit code and complaint."""

    def run(mission: Path, *arguments: str) -> tuple[int, str]:
        try:
            code = main(["run", str(mission), "--router", endpoint, *arguments])
        except SystemExit as ended:  # of the parser
            code = int(str(ended.code))
        out, err = capsys.readouterr()
        assert out == ""
        return code, err

    return run


def edit(mission: Path, pattern: str, new: str) -> None:
    """Change the lines of a mission that fit a pattern."""
    mission.write_text(re.sub(rf"(?m){pattern}", new, mission.read_text()))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ("--real uav1 --speed 5", "--speed 5: uav1 is real, and real time runs at speed 1"),
        ("--real uav2", "--real uav2: there is no such robot; the mission has uav1"),
        ("--speed 0", "argument --speed: expected a speed above 0, at most 100, got `0`"),
        ("--router no", "argument --router: Expected an endpoint such as `tcp/127.0.0.1:7447`, got `no`"),
        ("--report /proc/nowhere", "--report /proc/nowhere: No such file or directory"),
        ("--record MISSION", "--record MISSION: the file exists: name another one\n"),
        ("--record /no/a.mcap", "--record /no/a.mcap: folder /no does not exist\n"),
        ("--record /proc/a.mcap", "--record /proc/a.mcap: No such file or directory\n"),
    ],
)
def test_options_that_cannot_be(refused: Refused, single_uav: Path, arguments: str, message: str) -> None:
    before = single_uav.read_text()
    code, err = refused(single_uav, *arguments.replace("MISSION", str(single_uav)).split())
    assert code == 2
    assert message.replace("MISSION", str(single_uav)) in err
    assert single_uav.read_text() == before


def test_a_report_that_another_run_writes_is_left_alone(refused: Refused, single_uav: Path, tmp_path: Path) -> None:
    with (tmp_path / "mission.log").open("w") as log:
        log.write("of the other")
        log.flush()
        fcntl.flock(log, fcntl.LOCK_EX)
        told = f"error: --report {tmp_path}: another run writes its report there\n"
        assert refused(single_uav, "--report", str(tmp_path)) == (2, told)
    assert (tmp_path / "mission.log").read_text() == "of the other"


@pytest.mark.parametrize("before", [None, "of an earlier flight"])
def test_a_refused_run_leaves_its_report_as_it_was(
    refused: Refused, single_uav: Path, tmp_path: Path, before: str | None
) -> None:
    report = tmp_path / "report"
    if before:
        report.mkdir()
        (report / "mission.log").write_text(before)
    assert refused(single_uav, "--real", "uav1", "--report", str(report))[0] == 2
    assert [path.read_text() for path in report.glob("*")] == [before] * bool(before)


def test_a_mission_that_does_not_check(refused: Refused, single_uav: Path) -> None:
    edit(single_uav, "^timeout:", "time_out:")
    code, err = refused(single_uav)
    assert code == 2
    assert "time_out: there is no such field, did you mean `timeout`?" in err


@pytest.mark.parametrize("named", [True, False])
def test_a_real_robot_without_a_terminal_and_without_yes(refused: Refused, single_uav: Path, named: bool) -> None:
    if not named:  # real in any case
        edit(single_uav, r"^.*(?:simulate|speed):.*\n", "")
    why = "this would arm and fly the real vehicle uav1; there is no terminal to ask at: confirm by --yes"
    assert refused(single_uav, *(["--real", "uav1"] if named else [])) == (2, f"error: {why}\n")


def test_a_serial_link_that_is_simulated_and_no_real_one(refused: Refused, start: Start, single_uav: Path) -> None:
    edit(single_uav, "^    link:.*", "    link: serial:/dev/nowhere:57600")
    why = "uav1 on serial:/dev/nowhere:57600: a serial line cannot be simulated; fly the real one with --real uav1"
    assert refused(single_uav) == (2, f"error: {why}\n")
    start(single_uav, "--real", "uav1", "--yes").until("bridged uav1: started")


def test_real_and_simulated_robots_on_one_link(refused: Refused, three_uavs: Path) -> None:
    link = re.search(r"udpin:\S+", three_uavs.read_text())
    why = f"uav2 is real, and uav1, uav3 on the same link {link[0]} would be simulated"
    told = f"error: {why}: fly all of them with --real uav1,uav2,uav3\n"
    assert refused(three_uavs, "--real", "uav2", "--yes") == (2, told)


def test_a_port_that_is_in_use(refused: Refused, single_uav: Path, endpoint: str) -> None:
    with socket.create_server(("127.0.0.1", int(endpoint.rpartition(":")[2]))):
        code, err = refused(single_uav)
    assert code == 1
    assert f"error: {endpoint} is in use: is another mission running? Name another one, such as --router" in err
    assert "and give the robots other links" in err


@pytest.mark.parametrize("kind", ["udpin", "tcpin", "udpout", "tcp"])
def test_a_link_that_is_in_use(refused: Refused, single_uav: Path, kind: str) -> None:
    edit(single_uav, "udpin:", f"{kind}:")
    found = re.search(rf"{kind}:127.0.0.1:(\d+)", single_uav.read_text())
    assert found is not None
    with socket.socket(type=socket.SOCK_DGRAM if kind.startswith("udp") else socket.SOCK_STREAM) as other:
        other.bind(("127.0.0.1", int(found[1])))
        if kind.startswith("tcp"):
            other.listen()
        told = refused(single_uav)
    line = 1 + single_uav.read_text()[: found.start()].count("\n")
    bound = f"{ {'udpout': 'udpin', 'tcp': 'tcpin'}.get(kind, kind) }:127.0.0.1:{found[1]}"
    why = f"{bound} is in use: is another mission running? Give uav1 another link"
    assert told == (1, f"error: {single_uav}:{line}: {why}\n")
