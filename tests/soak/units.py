"""The units of a board under a real systemd: how exposed they are, a flight by them, and how they come back.

    python -m tests.soak.units

Boots a machine of its own (tests/support/booted.py). Writes docs/measurements/daemons.md.
"""

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from argosy.deploy.unit_files import Board
from argosy.deploy.units_command import write
from schemas.mission.model import load_mission
from tests.docs.pages import with_part
from tests.soak.report import ROOT, here
from tests.support.analyzed import analyzed, exposure, installed
from tests.support.booted import Machine, NoMachine, booted

PAGE = ROOT / "docs/measurements/daemons.md"
ASK = "/opt/checkout/tests/support/ask_mind.py"
KNOCK = "/opt/checkout/tests/support/knock.py"
TWO = {
    "survey.yaml": """\
mission: survey
boards: {pi1: {address: 10.0.0.11}, pi2: {address: 10.0.0.12}}
agents:
  scout: {board: pi1, program: scout.asl}
  diver: {board: pi2, program: diver.asl}
security: {operators: [anna]}
done: "scout: answered(5)"
""",
    "scout.asl": """\
!ask(1).
+!ask(N) <- .send(diver, tell, question(N)).
+answer(N)[source(A)] <- +answered(N); .print("answer ", N, " of ", A); if (N < 5) { !ask(N+1) }.
""",
    "diver.asl": "+question(N)[source(A)] <- .send(A, tell, answer(N)).\n",
}
"""A mission of two boards that ask one another."""
FLIGHT = 240.0
"""Wall seconds for the flight of the paper's first mission, in real time."""
BACK = 60.0
EVERY = ("RootDirectoryOrRootImage", "RestrictAddressFamilies_AF_UNIX")
"""What each unit has, by systemd's names: the system's files, read-only, and unix sockets."""
REMAINS = {
    "RestrictAddressFamilies_AF_INET_INET6": "IP sockets",
    "PrivateNetwork": "the board's network",
    "UMask": "its group may write to its socket",
    "SupplementaryGroups": "the group `dialout`",
    "PrivateDevices": "the folder of devices",
    "DeviceAllow": "devices: ",
}
"""What may be left besides, in words; behind a colon comes systemd's own."""


def main() -> int:
    """Measure, and write the page. Returns the exit code."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            lines = [
                *exposures(Path(folder)),
                *measured(Path(folder)),
                *further(Path(folder)),
                *linked(Path(folder) / "two"),
            ]
        except NoMachine as why:
            print(f"error: {why}", file=sys.stderr)
            return 1
    PAGE.write_text(with_part(PAGE, "units", "\n".join(lines) + "\n"), encoding="utf-8")
    print(f"{PAGE} written")
    return 0


def exposures(folder: Path) -> Iterator[str]:
    """The beginning of the page: what systemd itself says of each unit, and what is left open."""
    venv = installed(folder)
    yield from (
        f"Written by `make soak` on {here()}.",
        "",
        "### Exposure",
        "",
        "`systemd-analyze verify` finds nothing in any of them. `security --offline` (0 is best, 10 worst) rates",
        "them as follows; each sees the system's files, read-only, and may use unix sockets.",
        "",
        "| unit | board | exposure | what it may besides |",
        "|---|---|---|---|",
    )
    with serial_mission() as serial:
        boards = (
            (Board(load_mission("search_and_rescue"), "pi1", venv), "linked to two others, vehicle on loopback"),
            (Board(load_mission("search_and_rescue"), "pi1", venv, True), "the same in one process"),
            (Board(load_mission("single_uav"), "local", venv), "alone, vehicle on loopback"),
            (Board(load_mission(serial), "local", venv), "alone, vehicle on a serial line"),
        )
        for number, (board, _) in enumerate(boards):
            write(board, folder / str(number))
    for number, (board, what) in enumerate(boards):
        out = folder / str(number)
        verified = analyzed(out, "verify", "--man=no", board.target, *board.units)
        assert (verified.returncode, verified.stdout + verified.stderr) == (0, ""), verified
        for unit in board.units:
            total, left = exposure(out, unit)
            words = [in_words(name, text) for name, text in left.items() if name not in EVERY]
            yield f"| `{unit.partition('@')[0]}@` | {what} | {total:.1f} | {'; '.join(words)} |"


def in_words(name: str, text: str) -> str:
    """Return what is left open, by systemd's name for it and its description."""
    if name == "IPAddressDeny":
        return "its own addresses" if "only localhost" in text else "any address"
    found = REMAINS.get(name, text)
    if not found.endswith(": "):
        return found
    return found + text.rpartition(": ")[2]


def measured(folder: Path) -> Iterator[str]:
    """The rest of the page: the units of the paper's first mission at work."""
    board = Board(load_mission("single_uav"), "local")
    write(board, folder / "tree")
    yield from ("", "### At work", "", "The paper's first mission on one board, in real time, all limits in force.", "")
    yield from ("| what | seen |", "|---|---|")
    with booted() as machine:
        machine.install(folder / "tree")
        simulator = subprocess.Popen(
            machine.command("/opt/argosy/bin/argosy", "simulate", board.file, "--speed", "1"),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            stdin=subprocess.DEVNULL,
        )
        try:
            yield from at_work(machine, board)
        finally:
            simulator.kill()
            simulator.wait(10)


def at_work(machine: Machine, board: Board) -> Iterator[str]:
    """Fly, then end each daemon in both ways, then knock at the socket. Yields the rows."""
    begin = time.monotonic()
    machine.run("systemctl", "start", board.target, *board.units)
    yield f"| `systemctl start {board.target}` | all three ready after {time.monotonic() - begin:.1f} s |"
    member = ("runuser", "-u", "member", "--", "/opt/argosy/bin/python")
    machine.run("useradd", "--groups", "argosy", "member")
    machine.run("useradd", "stranger")
    ask = (*member, ASK, board.router, board.mission.fleet, "uav")
    flown = machine.until(lambda: machine.run(*ask).strip() == "done", "the mission is done", FLIGHT)
    yield f"| flight: take-off, waypoint, home, landed | done after {flown:.0f} s |"
    for unit in board.units:
        words, memory = machine.show(unit, "StatusText"), int(machine.show(unit, "MemoryCurrent")) / 2**20
        yield f'| `{unit.partition("@")[0]}` after the flight | {memory:.0f} MB; "{words}" |'
    for name, signal in (("killed (SIGKILL)", "KILL"), ("hung (SIGSTOP)", "STOP")):
        for unit in board.units:
            gone, back = ended(machine, unit, signal)
            yield f"| `{unit.partition('@')[0]}` {name} | ended after {gone:.1f} s, ready again after {back:.1f} s |"
    knocks = [
        machine.run("runuser", "-u", user, "--", "/opt/argosy/bin/python", KNOCK, board.router).strip()
        for user in ("member", "stranger")
    ]
    assert knocks == ["in", "out"], knocks
    yield "| user `member` of group `argosy` opens a Zenoh session at the socket | connected |"
    yield "| user `stranger` does the same | refused by the kernel (no right to the folder, nor to the socket) |"
    begin = time.monotonic()
    machine.run("systemctl", "stop", board.target)
    machine.until(lambda: not any(map(machine.main_pid, board.units)), "all have ended")
    took = time.monotonic() - begin
    results = {machine.show(unit, "Result") for unit in board.units}
    yield f"| `systemctl stop {board.target}` | all ended after {took:.1f} s: {', '.join(results)} |"


def further(folder: Path) -> Iterator[str]:
    """Further rows: all in one process, and the device of a serial link beside another one."""
    one = Board(load_mission("single_uav"), "local", one_process=True)
    write(one, folder / "one")
    with booted() as machine:
        machine.install(folder / "one")
        begin = time.monotonic()
        machine.run("systemctl", "start", one.target, *one.units)
        took, memory = time.monotonic() - begin, int(machine.show(one.units[0], "MemoryCurrent")) / 2**20
        yield f"| `--one-process`: `board` | ready after {took:.1f} s, {memory:.0f} MB |"
    with serial_mission() as path:
        serial = Board(load_mission(path), "local")
        write(serial, folder / "serial")
    unit = serial.units[1]
    with booted() as machine:
        machine.install(folder / "serial")
        for name, number in (("ttyAMA0", "229"), ("ttyAMA1", "200")):  # no serial lines, but denied unless allowed
            machine.run("mknod", "-m", "660", f"/dev/{name}", "c", "10", number)
            machine.run("chown", "root:dialout", f"/dev/{name}")
        machine.run("systemctl", "start", "--no-block", serial.target)
        opened = "cannot be opened: it is not a serial device"
        machine.until(lambda: opened in machine.journal("-u", unit), "the link's device is opened")
        yield "| `bridged` opens the device of its link (here one that is no serial line) | opened |"
        command = machine.show(unit, "ExecStart").partition("argv[]=")[2].partition(" ;")[0]
        text = f"[Service]\nExecStart=\nExecStart={command} --link serial:/dev/ttyAMA1:921600\n"
        machine.run("sh", "-c", f'printf "%s" "$1" > /etc/systemd/system/{unit}.d/other.conf', "sh", text)
        machine.run("systemctl", "daemon-reload")
        machine.run("systemctl", "restart", "--no-block", unit)
        machine.until(lambda: "operation not permitted" in machine.journal("-u", unit), "another device is refused")
        yield "| `bridged` opens another device of the same group | refused: `operation not permitted` |"


@contextmanager
def serial_mission() -> Iterator[Path]:
    """Lend the paper's first mission with a serial link, beside its programs."""
    text = (ROOT / "missions/single_uav.yaml").read_text(encoding="utf-8")
    path = ROOT / "missions" / "serial-for-the-page.yaml"
    path.write_text(text.replace("udpin:127.0.0.1:14550", "serial:/dev/ttyAMA0:921600"), encoding="utf-8")
    try:
        yield path
    finally:
        path.unlink()


def linked(folder: Path) -> Iterator[str]:
    """Two boards with keys of their fleet and a cable between them: mail, an operator's look, and a router's death."""
    folder.mkdir()
    for name, text in TWO.items():
        (folder / name).write_text(text)
    mission, keys = load_mission(folder / "survey.yaml"), folder / "keys"
    printed = subprocess.run(
        [sys.executable, "-m", "argosy", "keys", "init", str(mission.path), "--dir", str(keys)],
        capture_output=True,
        text=True,
        timeout=120,
        cwd=ROOT,
    )
    assert printed.returncode == 0, printed.stderr
    boards = {name: Board(mission, name) for name in mission.boards}
    for name, board in boards.items():
        write(board, folder / name)
        shutil.copytree(keys / "machines" / name, folder / name / board.folder[1:] / "keys")
    yield from (
        "",
        "### Two boards",
        "",
        "Each a machine of its own with a systemd of its own, linked by mutual TLS.",
        "",
    )
    yield from ("| what | seen |", "|---|---|")
    with booted() as one, booted() as other:
        cable({one: "10.0.0.11/24", other: "10.0.0.12/24"})
        begin = time.monotonic()
        for machine, (name, board) in zip((one, other), boards.items(), strict=True):
            machine.install(folder / name)
            machine.run("systemctl", "start", "--no-block", board.target)
        one.until(lambda: "answer 5" in one.journal("-u", "agentd@survey"), "five questions are answered")
        took = time.monotonic() - begin
        yield f"| five questions by mail from `pi1` to `pi2` and back | {took:.1f} s after the start |"
        one.send(keys / "machines" / "anna", "/tmp/anna")
        where = ("--router", "tls/10.0.0.12:7447", "--keys", "/tmp/anna")
        status = one.run("/opt/argosy/bin/argosy", "status", boards["pi1"].file, "--plain", *where, check=False)
        yield f"| `argosy status` of operator `anna` by `pi2` | {status.strip().splitlines()[-1]} |"
        ended(other, "commd@survey.service", "KILL")
        took = one.until(lambda: "pi2" in linked_now(one, boards["pi1"]), "pi2 is linked again")
        yield f"| `commd` of `pi2` killed | linked to `pi1` {took:.1f} s after it was ready again |"


def linked_now(machine: Machine, board: Board) -> str:
    """Return what `argosy status` says of the daemons that are up, at a board."""
    where = ("--router", board.router, "--wait", "2")
    lines = machine.run("/opt/argosy/bin/argosy", "status", board.file, "--plain", *where, check=False).splitlines()
    return "\n".join(line for line in lines if line.startswith("up commd"))


def cable(ends: dict[Machine, str]) -> None:
    """Connect two machines by a cable, with these addresses."""
    names = [f"argosy{os.getpid()}{end}" for end in "ab"]
    subprocess.run(["ip", "link", "add", names[0], "type", "veth", "peer", "name", names[1]], check=True, timeout=30)
    for (machine, address), name in zip(ends.items(), names, strict=True):
        subprocess.run(["ip", "link", "set", name, "netns", str(machine.first)], check=True, timeout=30)
        machine.run("ip", "link", "set", name, "name", "cable")
        machine.run("ip", "addr", "add", address, "dev", "cable")
        machine.run("ip", "link", "set", "cable", "up")


def ended(machine: Machine, unit: str, signal: str) -> tuple[float, float]:
    """End a unit's process. Returns the seconds until it was gone and until its successor was ready."""
    first = machine.main_pid(unit)
    machine.run("kill", f"-{signal}", str(first))
    gone = machine.until(lambda: machine.main_pid(unit) != first, f"{unit} is ended", BACK)
    more = machine.until(
        lambda: machine.main_pid(unit) not in (0, first) and machine.show(unit, "ActiveState") == "active",
        f"{unit} is ready again",
        BACK,
    )
    return gone, gone + more


if __name__ == "__main__":
    sys.exit(main())
