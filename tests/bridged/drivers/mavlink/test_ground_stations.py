"""Independent clients fly the simulated copter: mavsdk and MAVProxy, over loopback."""

import asyncio
import queue
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from tests.bridged.radio import Speaker
from tests.support.forked import Forked, run
from tests.support.ports import free_port
from tests.support.promises import kept

SPEED = "5"
ROOT = Path(__file__).parents[4]


@contextmanager
def copter(link: str, *more: str, vehicle: str = "copter") -> Iterator[subprocess.Popen[str]]:
    """A simulated vehicle as a process; it is gone afterwards whatever happened."""
    command = ["bridged", "simulate", vehicle, "--link", link, *more]
    process = Forked(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def test_mavsdk_flies_the_copter_and_returns_to_launch() -> None:
    port = free_port()
    with copter(f"udpout:127.0.0.1:{port}", "--speed", SPEED):
        command = [sys.executable, "-m", "tests.bridged.clients.mavsdk_flight", f"udpin://127.0.0.1:{port}"]
        finished = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert finished.returncode == 0, finished.stderr[-2000:] + finished.stdout[-2000:]
    steps = ["connected", "healthy", "armed", "taken off", "arrived", "landed and disarmed at home"]
    assert [line for line in finished.stdout.splitlines() if line in steps] == steps


class MavProxy:
    """A headless MAVProxy that is told commands and answers with lines."""

    def __init__(self, port: int, directory: Path) -> None:
        command = [
            str(Path(sys.executable).parent / "mavproxy.py"),
            f"--master=udpin:127.0.0.1:{port}",
            "--default-modules=mode,arm,misc,cmdlong,param,link,wp,output",
            f"--state-basedir={directory}",
        ]
        self.process = subprocess.Popen(
            [sys.executable, *command],
            cwd=directory,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            bufsize=1,
        )
        self.printed: list[str] = []
        self._lines: queue.SimpleQueue[str] = queue.SimpleQueue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        for line in self.process.stdout or ():
            self._lines.put(line)

    def say(self, command: str) -> None:
        self.process.stdin.write(command + "\n")

    def until(self, pattern: str, seconds: float = 90.0, ask: str | None = None) -> re.Match[str]:
        """The first new line in which the pattern stands; `ask` is said every half second meanwhile."""
        end, asked = time.monotonic() + seconds, 0.0
        while time.monotonic() < end:
            if ask and time.monotonic() - asked > 0.5:
                asked = time.monotonic()
                self.say(ask)
            try:
                line = self._lines.get(timeout=0.2)
            except queue.Empty:
                continue
            self.printed.append(line)
            if found := re.search(pattern, line):
                return found
        raise AssertionError(f"MAVProxy said no {pattern!r} in {seconds:g} s:\n{''.join(self.printed[-30:])}")

    def until_at(self, north_of: int, height: float) -> None:
        """Waits for a GLOBAL_POSITION_INT at this latitude (1e-7 degrees) and height (m above home)."""
        end = time.monotonic() + 120
        pattern = r"GLOBAL_POSITION_INT {.* lat : (-?\d+),.* relative_alt : (-?\d+),"
        while time.monotonic() < end:
            found = self.until(pattern, ask="status GLOBAL_POSITION_INT")
            lat, relative_alt = int(found[1]), int(found[2])
            if abs(lat - north_of) < 60 and abs(relative_alt / 1000 - height) < 0.3:
                return
        raise AssertionError(f"MAVProxy saw no arrival: {found[0]}")

    def close(self) -> None:
        self.process.kill()
        self.process.wait()


def test_mavproxy_flies_the_copter_and_returns_to_launch(tmp_path: Path) -> None:
    port = free_port()
    with copter(f"udpout:127.0.0.1:{port}", "--speed", SPEED):
        station = MavProxy(port, tmp_path)
        try:
            station.until("online system 1")
            station.until("Received [0-9]+ parameters")
            station.say("mode guided")
            station.until("Mode GUIDED")
            station.say("arm throttle")
            station.until("^ARMED|> ARMED")
            station.say("takeoff 5")
            station.until("NAV_TAKEOFF: ACCEPTED")
            station.until_at(-276040330, 5.0)
            station.say("guided -27.603683 -48.518052 15")
            station.until("DO_REPOSITION: ACCEPTED")
            station.until_at(-276036830, 15.0)
            station.say("mode rtl")
            station.until("Mode RTL")
            station.until("DISARMED", 120)
            station.until_at(-276040330, 0.0)
        finally:
            station.close()


def test_vehicle_time_passes_at_the_speed_that_was_asked_for() -> None:
    async def speed() -> float:
        ear = Speaker(system=255, component=190)
        with closing(ear), copter(f"udpout:127.0.0.1:{ear.port}", "--speed", "20"):
            first = await ear.hears("TIMESYNC")
            begin = time.monotonic()
            passed = ((await ear.hears("TIMESYNC", 6)).ts1 - first.ts1) / 1e9
            return float(passed) / (time.monotonic() - begin)

    assert kept(lambda: abs(asyncio.run(speed()) - 20), 5)


async def test_a_rebooted_copter_speaks_from_another_port() -> None:
    ear = Speaker(system=255, component=190)
    with closing(ear), copter(f"udpout:127.0.0.1:{ear.port}", "--speed", "10"):
        await ear.hears("HEARTBEAT", 5)
        ear.command(dialect.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN, 1)
        await ear.hears("COMMAND_ACK")
        await ear.hears("HEARTBEAT", len(ear.find("HEARTBEAT")) + 3)
    assert len(ear.peers) == 2


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
@pytest.mark.parametrize("link", ["udpout:127.0.0.1:{port}", "tcpin:127.0.0.1:{port}", "tcp:127.0.0.1:{port}"])
def test_the_simulator_ends_within_a_second_when_it_is_told_to(link: str, number: signal.Signals) -> None:
    def ending() -> float:
        with copter(link.format(port=free_port())) as process:
            assert "simulated copter 1 on" in process.stderr.readline()
            asked = time.monotonic()
            process.send_signal(number)
            assert process.wait(timeout=90) == 0
            return time.monotonic() - asked

    assert kept(ending, 1.0)


def test_a_link_that_cannot_be_opened_is_one_clear_line_and_exit_code_2() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        link = f"udpin:127.0.0.1:{taken.getsockname()[1]}"
        with copter(link) as process:
            complaint = process.stderr.read()
            assert process.wait(timeout=90) == 2
    assert complaint == f"bridged simulate: error: link {link} cannot be opened: address already in use\n"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--link", "udp:1"], "error: link 'udp:1': expected udpin:HOST:PORT, udpout:HOST:PORT"),
        (["--link", "udpin:h:1", "--home", "1,2"], "argument --home: expected LAT,LON,ALT such as"),
        (
            ["--link", "udpin:h:1", "--home", "91,2,3"],
            "(latitude -90 to 90, longitude -180 to 180, altitude in metres)",
        ),
        (["--link", "udpin:h:1", "--victims", "1,2"], "two whole numbers and four in degrees, got '1,2'"),
        (["--link", "udpin:h:1", "--victims", "0,2,0,0,1,1"], "argument --victims: expected 1 victim or more, got 0"),
        (["--link", "udpin:h:1", "--victims", "1,2,1,0,0,1"], "argument --victims: expected an area SOUTH,WEST,"),
        (["--link", "udpin:h:1", "--sysid", "256"], "argument --sysid: expected a system id between 1 and 255"),
        (["--link", "udpin:h:1", "--speed", "fast"], "argument --speed: expected a factor between 0.1 and 100"),
        (["--link", "udpin:h:1", "--fault", "rain"], "error: expected one of loss=SHARE, duplicate=SHARE, "),
        (["--link", "udpin:h:1", "--param", "RTL_HEIGHT=3"], "the simulated copter has no parameter 'RTL_HEIGHT'"),
        (["--link", "udpin:h:1", "--param", "RTL_ALT"], "--param: expected NAME=VALUE such as FS_GCS_ENABLE=1, got"),
        (
            ["--link", "udpin:h:1", "--signing-passphrase-file", "/nowhere"],
            "error: /nowhere: no such file or directory",
        ),
        (["--link", "udpin:h:1", "--battery-minutes", "0"], "expected minutes between 0.1 and 10000, got '0'"),
    ],
)
def test_a_wrong_argument_is_one_clear_line_and_exit_code_2(arguments: list[str], complaint: str) -> None:
    finished = run(["bridged", "simulate", "copter", *arguments], cwd=ROOT)
    assert finished.returncode == 2
    assert complaint in finished.stderr
    assert "Traceback" not in finished.stderr
