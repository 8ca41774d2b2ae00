"""`argosy units`: what it writes for a board, what it refuses, and what systemd itself says of the units."""

import errno
import json
import os
import shlex
import shutil
import stat
from pathlib import Path

import pytest

from argosy.__main__ import main
from argosy.deploy.unit_files import WATCHDOG, Board
from argosy.deploy.units_command import write
from commd.router import config
from schemas.files.findings import Findings
from schemas.files.shipped_files import shipped
from schemas.mission.model import Mission, load_mission
from tests.support.analyzed import analyzed, exposure, installed
from tests.support.needs import lacks

MOST = 2.0
"""The exposure that `systemd-analyze security` may find in a unit at most."""
FLEET = """\
mission: survey
boards:
  pi1: {address: 10.0.0.11}
  pi2: {address: 10.0.0.12}
agents:
  scout: {board: pi1, program: code/scout.asl, robot: uav1}
  diver: {board: pi2, program: code/diver.asl}
robots:
  uav1: {board: pi1, manifest: copter, link: "LINK"}
done: "scout: over"
"""
TEMPLATES = [shipped("deploy", f"systemd/{name}@.service") for name in ("commd", "bridged", "agentd", "board")]


@pytest.fixture
def systemd() -> None:
    if shutil.which("systemd-analyze") is None:
        lacks("namespaces", "there is no systemd-analyze: install systemd")


def mission(folder: Path, text: str = FLEET, link: str = "serial:/dev/ttyAMA0:921600") -> Mission:
    """Write a mission with two programs, one of which includes a file, and read it."""
    (folder / "code").mkdir(parents=True, exist_ok=True)
    (folder / "code" / "scout.asl").write_text('{ include("common.asl") }\n+x <- !over.\n')
    (folder / "code" / "common.asl").write_text("+!over <- +over.\n")
    (folder / "code" / "scout_test.asl").write_text("+!test <- true.\n")
    (folder / "code" / "diver.asl").write_text("+y <- true.\n")
    (folder / "survey.yaml").write_text(text.replace("LINK", link))
    return load_mission(folder / "survey.yaml")


def tree(folder: Path) -> set[str]:
    """The files below a folder."""
    return {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()}


def added(out: Path, daemon: str) -> list[str]:
    """What a mission adds to a template, if anything."""
    path = out / f"etc/systemd/system/{daemon}@survey.service.d/board.conf"
    return path.read_text().splitlines()[2:] if path.exists() else []


def test_a_board_gets_its_units_its_router_and_the_files_of_its_part_of_the_mission(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission(tmp_path)
    (tmp_path / "code" / "loop.asl").symlink_to("loop.asl")
    out = tmp_path / "pi1"
    assert main(["units", str(tmp_path / "survey.yaml"), "--board", "pi1", "--out", str(out)]) == 0
    assert tree(out) == {
        "INSTALL.md",
        "etc/argosy/survey/board.env",
        "etc/argosy/survey/code/common.asl",
        "etc/argosy/survey/code/diver.asl",  # a program may include what stands beside it at run time
        "etc/argosy/survey/code/scout.asl",
        "etc/argosy/survey/firewall.nft",
        "etc/argosy/survey/router.json5",
        "etc/argosy/survey/survey.yaml",
        "etc/systemd/system/agentd@.service",
        "etc/systemd/system/argosy-survey-firewall.service",
        "etc/systemd/system/argosy-survey.target",
        "etc/systemd/system/bridged@.service",
        "etc/systemd/system/bridged@survey.service.d/board.conf",
        "etc/systemd/system/commd@.service",
        "etc/sysusers.d/argosy.conf",
        "etc/tmpfiles.d/argosy-survey.conf",
    }
    said = capsys.readouterr().out
    assert "argosy-survey.target, commd@survey.service, bridged@survey.service, agentd@survey.service" in said
    assert "BOARD=pi1\n" in (out / "etc/argosy/survey/board.env").read_text()
    settings = json.loads((out / "etc/argosy/survey/router.json5").read_text())
    assert settings["listen"]["endpoints"][0].startswith("unixsock-stream//run/argosy/survey/router.sock")
    assert settings["access_control"]["default_permission"] == "deny"
    read = config.read(out / "etc/argosy/survey/router.json5")
    assert read.secured
    assert str(read.tls.key) == "/etc/argosy/survey/keys/key.pem"


@pytest.mark.parametrize("there", [False, True])
def test_a_folder_that_cannot_be_written_is_left_as_it_was(
    tmp_path: Path, there: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    mission(tmp_path)
    out, write_bytes = tmp_path / "pi1", Path.write_bytes
    if there:
        out.mkdir()

    def full(path: Path, data: bytes) -> int:
        if path.name == "router.json5":
            assert not (out / "etc").exists()  # nor after a kill
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))
        return write_bytes(path, data)

    with monkeypatch.context() as disk:
        disk.setattr(Path, "write_bytes", full)
        assert main(["units", str(tmp_path / "survey.yaml"), "--board", "pi1", "--out", str(out)]) == 1
    assert capsys.readouterr().err == f"error: {out}: No space left on device\n"
    assert (out.exists(), tree(out)) == (there, set())
    assert main(["units", str(tmp_path / "survey.yaml"), "--board", "pi1", "--out", str(out)]) == 0


def test_a_board_without_robots_has_no_bridge(tmp_path: Path) -> None:
    write(Board(mission(tmp_path), "pi2"), tmp_path / "pi2")
    assert not [name for name in tree(tmp_path / "pi2") if "bridged" in name]
    target = (tmp_path / "pi2/etc/systemd/system/argosy-survey.target").read_text()
    assert "Wants=commd@survey.service agentd@survey.service\n" in target


@pytest.mark.parametrize(
    ("link", "expected"),
    [
        (
            "serial:/dev/ttyAMA0:921600",
            [
                "PrivateDevices=no",
                "SupplementaryGroups=dialout",
                "DeviceAllow=/dev/ttyAMA0 rw",
                "PrivateNetwork=yes",
                "IPAddressDeny=any",
                "RestrictAddressFamilies=",
                "RestrictAddressFamilies=AF_UNIX",
            ],
        ),
        ("udpin:127.0.0.1:14550", ["IPAddressDeny=any", "IPAddressAllow=localhost"]),
        ("udpout:10.0.0.99:14550", ["IPAddressDeny=any", "IPAddressAllow=10.0.0.99"]),
        ("udpin:0.0.0.0:14550", []),
        ("tcp:autopilot.local:5760", []),
    ],
)
def test_the_bridge_alone_gets_its_robots_devices_and_addresses(tmp_path: Path, link: str, expected: list[str]) -> None:
    write(Board(mission(tmp_path, link=link), "pi1"), tmp_path / "out")
    assert added(tmp_path / "out", "bridged") == expected
    assert added(tmp_path / "out", "agentd") == added(tmp_path / "out", "commd") == []


def test_the_watchdog_waits_longer_than_the_mission_lets_a_mind_be_busy(tmp_path: Path) -> None:
    long = FLEET.replace('link: "LINK"', 'link: "LINK", agent_silence: 30s')
    write(Board(mission(tmp_path, long), "pi1"), tmp_path / "out")
    assert added(tmp_path / "out", "agentd") == ["WatchdogSec=60"]
    write(Board(mission(tmp_path, long), "pi1", one_process=True), tmp_path / "one")
    assert "WatchdogSec=60" in added(tmp_path / "one", "board")
    assert all(path is not None and f"WatchdogSec={WATCHDOG:g}\n" in path.read_text() for path in TEMPLATES)


def test_an_adapter_that_is_plugged_in_again_is_still_allowed(tmp_path: Path) -> None:
    write(Board(mission(tmp_path, link="serial:/dev/serial/by-id/usb-Pixhawk:57600"), "pi1"), tmp_path / "out")
    assert {"DeviceAllow=char-ttyUSB rw", "DeviceAllow=char-ttyACM rw"} < set(added(tmp_path / "out", "bridged"))


def test_a_board_that_is_linked_to_no_other_has_no_network_and_needs_no_keys(tmp_path: Path) -> None:
    write(Board(load_mission("turtle"), "local"), tmp_path / "out")
    lines = (tmp_path / "out/etc/systemd/system/commd@turtle.service.d/board.conf").read_text()
    assert "PrivateNetwork=yes" in lines
    assert "needs no keys" in (tmp_path / "out/INSTALL.md").read_text()


def test_one_process_is_one_unit_with_what_the_three_may(tmp_path: Path) -> None:
    out = tmp_path / "out"
    write(Board(mission(tmp_path), "pi1", one_process=True), out)
    units = {name for name in tree(out) if name.endswith(".service")}
    assert units == {f"etc/systemd/system/{name}.service" for name in ("board@", "argosy-survey-firewall")}
    assert "DeviceAllow=/dev/ttyAMA0 rw" in added(out, "board")
    assert "PrivateNetwork=yes" not in added(out, "board")
    assert "keys ~0700 argosy-board argosy" in (out / "etc/tmpfiles.d/argosy-survey.conf").read_text()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("done:", "router: {external: true}\ndone:"), "router.external: the units run commd as the board's router"),
        (
            (', link: "LINK"', ", simulate: {home: [1, 2, 3]}"),
            "9:9: error: uav1 needs the field `link`: only `argosy run`",
        ),
        (("code/scout.asl", "../elsewhere.asl"), "is not below the mission file, whose folder is what a board gets"),
        (("code/scout.asl", "code/none.asl"), "there is no file"),
        (
            ('"LINK"', '"serial:/dev/ttyA rw\\nExecStartPre=+/bin/touch /pwned:57600"'),
            "units allow a device such as /dev/ttyAMA0",
        ),
        (('"LINK"', '"serial:/dev/tty%i:57600"'), "units allow a device such as /dev/ttyAMA0"),
        (
            ('"LINK"', '"serial:/dev/ttyA:57600", signing: {passphrase_file: "a\\nb"}'),
            "expected the name of a file without control characters, got 'a\\nb'",
        ),
    ],
)
def test_what_a_board_cannot_run_is_refused_in_words_and_nothing_is_written(
    tmp_path: Path, change: tuple[str, str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "elsewhere.asl").write_text("+x <- true.\n")
    mission(tmp_path / "m", FLEET.replace(*change))
    arguments = ["units", str(tmp_path / "m/survey.yaml"), "--board", "pi1", "--out", str(tmp_path / "out")]
    assert main(arguments) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_passphrases_are_installed_where_the_bridge_reads_them_by_a_command_of_their_own(tmp_path: Path) -> None:
    for number, (named, here, there) in enumerate(
        [
            ("a b; touch x", "a b; touch x", "/etc/argosy/survey/a b; touch x"),
            ("/etc/pass", "pass", "/etc/pass"),
            ("-o", "-o", "/etc/argosy/survey/-o"),
        ]
    ):
        text = FLEET.replace('link: "LINK"', f'link: "LINK", signing: {{passphrase_file: "{named}"}}')
        write(Board(mission(tmp_path, text), "pi1"), out := tmp_path / str(number))
        (line,) = [line for line in (out / "INSTALL.md").read_text().splitlines() if "install -D" in line]
        assert shlex.split(line)[-3:] == ["--", here, there]


@pytest.mark.parametrize("name", ["it's.yaml", "a\nb.yaml", "a\\b.yaml", "50%i.yaml", " a.yaml"])
def test_a_name_that_units_cannot_say_is_refused(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    mission(tmp_path)
    (tmp_path / "survey.yaml").rename(tmp_path / name)
    assert main(["units", str(tmp_path / name), "--board", "pi1", "--out", str(tmp_path / "out")]) == 2
    assert "expected a file name without quotes, control characters" in capsys.readouterr().err


def test_a_file_of_the_mission_takes_the_place_of_no_other(tmp_path: Path) -> None:
    text = FLEET.replace("code/scout.asl", "keys/scout.asl")
    (tmp_path / "keys").mkdir()
    (tmp_path / "keys" / "scout.asl").write_text("+x <- true.\n")
    with pytest.raises(Findings, match="a board has another file of this name"):
        write(Board(mission(tmp_path, text), "pi1"), tmp_path / "out")


def test_daemons_may_read_what_is_written_whatever_the_umask(tmp_path: Path) -> None:
    made, before = mission(tmp_path), os.umask(0o077)
    try:
        write(Board(made, "pi1"), tmp_path / "out")
    finally:
        os.umask(before)
    for path in (tmp_path / "out", *(tmp_path / "out").rglob("*")):
        assert stat.S_IMODE(path.stat().st_mode) == (0o755 if path.is_dir() else 0o644), path


def test_a_folder_that_is_not_empty_is_left_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mission(tmp_path)
    assert main(["units", str(tmp_path / "survey.yaml"), "--board", "pi1", "--out", str(tmp_path)]) == 2
    assert "is not empty" in capsys.readouterr().err
    assert not (tmp_path / "etc").exists()


@pytest.mark.parametrize("venv", ["relative", "/home/pi/argosy", "/opt/with blank", "/opt/../home/pi"])
def test_a_place_that_the_daemons_would_not_see_is_refused(venv: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["units", "turtle", "--out", "x", "--venv", venv])
    assert "--venv" in capsys.readouterr().err


@pytest.mark.usefixtures("systemd")
@pytest.mark.parametrize("one_process", [False, True])
def test_systemd_finds_nothing_wrong_with_any_unit(tmp_path: Path, one_process: bool) -> None:
    board = Board(mission(tmp_path), "pi1", installed(tmp_path), one_process)
    write(board, tmp_path / "out")
    found = analyzed(tmp_path / "out", "verify", "--man=no", board.target, *board.units)
    assert (found.returncode, found.stdout + found.stderr) == (0, "")


@pytest.mark.usefixtures("systemd")
@pytest.mark.parametrize("link", ["serial:/dev/ttyAMA0:921600", "udpin:0.0.0.0:14550"])
def test_no_unit_is_more_exposed_than_it_may_be(tmp_path: Path, link: str) -> None:
    made = mission(tmp_path, link=link)
    for one_process in (False, True):
        board, out = Board(made, "pi1", one_process=one_process), tmp_path / f"out{one_process}"
        write(board, out)
        for unit in board.units:
            found, left = exposure(out, unit)
            assert found <= MOST, (unit, found, left)


def test_every_template_ships() -> None:
    assert None not in TEMPLATES
