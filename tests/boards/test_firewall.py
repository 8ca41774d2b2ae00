"""The firewall rules that `argosy units` writes, loaded by nft on a board: only who connects too often has to wait."""

import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from argosy.deploy.firewall import firewall_unit, rules_path, table
from argosy.deploy.unit_files import Board
from argosy.deploy.units_command import write
from commd.router.admission import AT_ONCE, UNHEARD
from schemas.mission.model import load_mission
from tests.boards.network import GROUND, Network
from tests.support.analyzed import analyzed
from tests.support.booted import NoMachine, booted
from tests.support.needs import lacks
from tests.support.promises import in_time
from tests.support.secured import FLEET, Secured

PORT, ELSEWHERE = 7447, 7448
FLOOD = UNHEARD + 300
LISTEN = """\
import socket, sys
made = [socket.create_server(("0.0.0.0", int(port)), backlog=4096) for port in sys.argv[1:]]
print("listening", flush=True)
sys.stdin.read()
"""
"""The kernel takes the connections; nobody else does."""
CONNECT = """\
import resource, select, socket, sys, time
host, port, wanted, kept = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4] == "kept"
resource.setrlimit(resource.RLIMIT_NOFILE, (4096, resource.getrlimit(resource.RLIMIT_NOFILE)[1]))
began, trying, open_ones = time.monotonic(), {}, 0
poll = select.epoll()
for _ in range(wanted):
    one = socket.socket()
    one.setblocking(False)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\\1\\0\\0\\0\\0\\0\\0\\0")  # what is closed, is reset
    one.connect_ex((host, port))
    poll.register(one, select.EPOLLOUT)
    trying[one.fileno()] = one
keep = []
while trying and time.monotonic() < began + 3:
    for number, _ in poll.poll(0.1):
        one = trying.pop(number)
        poll.unregister(number)
        open_ones += not one.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        keep.append(one) if kept else one.close()
print(open_ones, time.monotonic() - began, flush=True)
if kept:
    sys.stdin.read()
"""
RESETS = """\
import select, socket, struct, sys, threading
def attack():
    while True:
        ones = [socket.socket() for _ in range(100)]
        for one in ones:
            one.setblocking(False)
            one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            one.connect_ex((sys.argv[1], int(sys.argv[2])))
        select.select([], ones, [], 0.1)
        for one in ones:
            one.close()
threading.Thread(target=attack, daemon=True).start()
print("connecting", flush=True)
sys.stdin.read()
"""
STOP = """\
import sys, time
from argosy.__main__ import main
began = time.monotonic()
code = main(["stop", *sys.argv[1:]])
print(code, time.monotonic() - began)
"""
CONFIRMED = 3.0
"""Seconds in which an order to stop is to be confirmed."""
BURST = 1500
SECURED = FLEET.replace("prefix: r1}", "prefix: r1, simulate: {vehicle: turtle}}")
MISSION = """\
mission: search-and-rescue
boards:
  pi1: {address: 10.77.0.1}
  pi2: {address: 10.77.0.2}
  six: {address: "[fd00::6]:7000"}
  named: {address: named.local}
agents:
  a: {board: pi1, program: a.asl}
"""


@pytest.fixture
def nft(namespaces: None) -> None:
    """Load rules in a namespace."""
    if shutil.which("nft") is None:
        lacks("namespaces", "there is no `nft`: install nftables")


@pytest.fixture
def board(tmp_path: Path, nft: None) -> tuple[Board, Path]:
    """Return board pi1 of a mission, and the tree that is written for it."""
    (tmp_path / "a.asl").write_text("+x <- true.\n")
    (tmp_path / "mission.yaml").write_text(MISSION)
    made = Board(load_mission(tmp_path / "mission.yaml"), "pi1")
    write(made, tmp_path / "out")
    return made, tmp_path / "out"


def test_who_connects_too_often_is_limited_boards_and_others_not(network: Network, board: tuple[Board, Path]) -> None:
    rules = str(board[1] / rules_path(board[0])[1:])
    for check in (["-c"], [], []):  # a second time: it takes the place of the first
        _on(network, "pi1", "nft", *check, "-f", rules)
    with _started(network, "pi1", LISTEN, str(PORT), str(ELSEWHERE)):
        with _connected(network, "pi3", PORT, FLOOD) as (flood, _):
            assert 0 < flood <= UNHEARD, "so many of one address are open at once"
            with _connected(network, GROUND, PORT, 1) as (stranger, _):
                assert stranger == 1, "another address is not limited by it"
            with _connected(network, "pi2", PORT, FLOOD) as (known, _):
                assert known == FLOOD, "a board of the mission is never limited"
            with _connected(network, "pi3", ELSEWHERE, FLOOD) as (other, _):
                assert other == FLOOD, "no other port is"
        with _connected(network, GROUND, PORT, FLOOD, "reset") as (passed, seconds):
            assert passed <= UNHEARD + AT_ONCE * (seconds + 1), "and so many begin in a second, though they end at once"
        loaded = _on(network, "pi1", "nft", "list", "ruleset")
        assert loaded.count("table inet ") == 1
        assert f"table inet {table(board[0].mission)} " in loaded
        assert "counter packets 0" not in next(line for line in loaded.splitlines() if "@open4" in line)


def test_a_stop_is_confirmed_by_a_real_commd_behind_them_during_a_burst_from_another_address(nft: None) -> None:
    with Network(("pi1", "pi2", "pi3", "attacker")) as network, Secured(network=network, text=SECURED) as fleet:
        write(Board(fleet.mission, "pi1"), fleet.folder / "out")
        rules = fleet.folder / "out" / rules_path(Board(fleet.mission, "pi1"))[1:]
        _on(network, "pi1", "nft", "-f", str(rules))
        fleet.routers(("pi1",))
        socket = fleet.socket("pi1")
        fleet.run("argosy", "simulate", str(fleet.path), "--board", "pi1", "--router", socket, on="pi1").says(
            "simulated turtle", 60
        )
        fleet.start("pi1", "bridged").says("serving r1")
        order = ("r1", "--mission", str(fleet.path), "--keys", str(fleet.keys("ops")))
        port = fleet.ports["pi1"]
        assert in_time(_stopped(network, "hold", *order), CONFIRMED), "before"
        with _connected(network, "attacker", port, BURST) as (open_ones, _), _resetting(network, "attacker", port):
            assert 0 < open_ones <= UNHEARD
            assert in_time(_stopped(network, "release", *order), CONFIRMED), (
                "while as many are open as may be, and others try"
            )
            assert in_time(_stopped(network, "hold", *order), CONFIRMED), "once more"
        assert in_time(_stopped(network, "release", *order), CONFIRMED), "after it"
        loaded = _on(network, "pi1", "nft", "list", "ruleset")
        assert "counter packets 0" not in next(line for line in loaded.splitlines() if "@open4" in line)


def test_the_unit_that_loads_them_is_right_and_off_until_it_is_enabled(board: tuple[Board, Path]) -> None:
    if shutil.which("systemd-analyze") is None:
        lacks("namespaces", "there is no systemd-analyze: install systemd")
    made, out = board
    found = analyzed(out, "verify", "--man=no", firewall_unit(made))
    assert (found.returncode, found.stdout + found.stderr) == (0, "")
    assert "firewall" not in (out / f"etc/systemd/system/{made.target}").read_text()
    assert firewall_unit(made) in (out / "INSTALL.md").read_text()


def test_systemd_loads_them_and_takes_them_away(board: tuple[Board, Path]) -> None:
    made, out = board
    try:
        with booted() as machine:
            machine.install(out)
            machine.run("systemctl", "start", firewall_unit(made))
            machine.run("systemctl", "restart", firewall_unit(made))
            assert machine.run("nft", "list", "tables").split() == ["table", "inet", table(made.mission)]
            machine.run("systemctl", "stop", firewall_unit(made))
            assert machine.run("nft", "list", "tables") == ""
    except NoMachine as why:
        pytest.skip(str(why))


def _stopped(network: Network, *order: str) -> float:
    """Order it from the ground as an operator does. Returns the seconds until it is confirmed."""
    command = [*network.within(GROUND), "timeout", "60", sys.executable, "-c", STOP, *order]
    done = subprocess.run(command, capture_output=True, text=True, timeout=90)
    code, seconds = done.stdout.splitlines()[-1].split()
    assert code == "0", done.stdout + done.stderr
    return float(seconds)


@contextmanager
def _resetting(network: Network, place: str, port: int) -> Iterator[None]:
    """Connect to pi1 from a place and reset it again, as often as it goes, while the block runs."""
    with _started(network, place, RESETS, network.addresses["pi1"], str(port)) as line:
        assert line == "connecting\n"
        yield


def _on(network: Network, place: str, *command: str) -> str:
    done = subprocess.run([*network.within(place), *command], capture_output=True, text=True, timeout=20)
    assert done.returncode == 0, done.stderr
    return done.stdout


@contextmanager
def _started(network: Network, place: str, code: str, *arguments: str) -> Iterator[str]:
    """Run a program that ends with its standard input; yields its first line."""
    command = [*network.within(place), "timeout", "60", sys.executable, "-c", code, *arguments]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process.stdout.readline()


@contextmanager
def _connected(network: Network, place: str, port: int, wanted: int, then: str = "kept") -> Iterator[tuple[int, float]]:
    """Connect from a place to pi1, many at once; yields how many came through, and in how many seconds."""
    with _started(network, place, CONNECT, network.addresses["pi1"], str(port), str(wanted), then) as line:
        count, seconds = line.split()
        yield int(count), float(seconds)
