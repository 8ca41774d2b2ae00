"""A machine whose first process is a real systemd: in namespaces of this one, over a file system that nothing keeps.

Needs root, systemd, cgroups and overlay file systems. Argosy is in /opt/argosy as on a board.
"""

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.support.processes import ROOT, poll

_CGROUPS = Path("/sys/fs/cgroup")
_BOOT = Path(__file__).with_name("boot.sh")
SYSTEMD = Path("/lib/systemd/systemd")
PATIENCE = 60.0
"""Seconds for what a machine is asked to do."""


class NoMachine(RuntimeError):
    """No machine can be made here; says why."""


def why_not() -> str:
    """Return in words why no such machine can be made here; empty if one can be tried."""
    if os.geteuid() != 0:
        return "a machine of its own needs root"
    missing = [name for name in ("unshare", "nsenter", "setpriv", "ip", "mount") if shutil.which(name) is None]
    if not SYSTEMD.exists():
        missing.append("systemd")
    return f"a machine of its own needs {', '.join(missing)}" if missing else ""


class Machine:
    """A booted machine."""

    def __init__(self, process: subprocess.Popen[bytes], first: int) -> None:
        self.process = process
        self.first = first
        """The process id of its systemd, as seen from here."""

    def command(self, *command: str) -> list[str]:
        """Return the command that runs `command` there."""
        return ["nsenter", "-t", str(self.first), "-m", "-p", "-n", "-i", "-u", "-r", "-w", *command]

    def run(self, *command: str, check: bool = True, seconds: float = PATIENCE) -> str:
        """Run a command there as root. Returns what it said; fails if it failed, unless `check` is false."""
        done = subprocess.run(
            self.command(*command),
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            timeout=seconds,
            text=True,
            errors="replace",
        )
        assert not check or done.returncode == 0, f"{' '.join(command)}: exit {done.returncode}\n{done.stdout}"
        return done.stdout

    def show(self, unit: str, name: str) -> str:
        """Return a property of a unit, such as `StatusText`."""
        return self.run("systemctl", "show", "--value", "-p", name, unit).strip()

    def main_pid(self, unit: str) -> int:
        """Return the process of a unit, by its id there; 0 if it has none."""
        return int(self.show(unit, "MainPID") or 0)

    def until(self, condition: Callable[[], bool], wish: str, seconds: float = PATIENCE) -> float:
        """Wait until something holds there. Returns the seconds that it took."""
        return poll(condition, wish, seconds, said=self.journal)

    def journal(self, *options: str) -> str:
        """Return what its services have said."""
        return self.run("journalctl", "--no-pager", "-n", "200", "-o", "short-monotonic", *options, check=False)

    def send(self, folder: Path, to: str) -> None:
        """Copy a folder into one there; what is copied belongs to root."""
        archive = subprocess.run(["tar", "-C", str(folder), "-c", "."], capture_output=True, check=True, timeout=60)
        self.run("mkdir", "-p", to)
        command = self.command("tar", "-C", to, "-x", "--no-same-owner", "--no-overwrite-dir")
        subprocess.run(command, input=archive.stdout, check=True, timeout=60)

    def install(self, tree: Path) -> None:
        """Do what INSTALL.md says with what `argosy units` has written."""
        self.send(tree / "etc", "/etc")
        self.run("systemd-sysusers")
        self.run("systemd-tmpfiles", "--create", check=False)  # of Debian's own it cannot do everything in here
        self.run("systemctl", "daemon-reload")


@contextlib.contextmanager
def booted() -> Iterator[Machine]:
    """Boot a machine and end it, with all that runs there, when the block ends. Raises NoMachine."""
    if why := why_not():
        raise NoMachine(why)
    name = f"argosy-{os.getpid()}-{time.monotonic_ns()}"
    try:
        sweep()
        groups = _cgroups(name)
    except OSError as error:
        raise NoMachine(f"{error.filename}: {error.strerror}") from None
    folder = tempfile.mkdtemp(prefix="argosy-machine-")
    unshare = ["unshare", "--mount", "--pid", "--fork", "--kill-child=KILL", "--uts", "--ipc", "--net", "--cgroup"]
    enter = "".join(f"echo $$ > {group}/cgroup.procs && " for group in groups)
    python = f"python{sys.version_info.major}.{sys.version_info.minor}"
    boot = ["sh", str(_BOOT), folder, str(ROOT), sys.base_prefix, python, sysconfig.get_path("platlib")]
    process = subprocess.Popen(
        ["setpriv", "--pdeathsig", "KILL", "sh", "-c", f'{enter}exec "$@"', "sh", *unshare, *boot],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,
    )
    try:
        yield _up(process)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait(10)
        _remove(groups)
        with contextlib.suppress(OSError):
            os.rmdir(folder)


def _up(process: subprocess.Popen[bytes]) -> Machine:
    """Wait until systemd has started what there is to start."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end and process.poll() is None:
        with contextlib.suppress(OSError):  # it has just ended
            children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            if children and Path(f"/proc/{children[0]}/comm").read_text().strip() == "systemd":
                machine = Machine(process, int(children[0]))
                state = machine.run("systemctl", "is-system-running", "--wait", check=False).strip()
                if state in ("running", "degraded"):
                    return machine
        time.sleep(0.05)
    said = b"" if process.poll() is None or process.stdout is None else process.stdout.read()
    raise NoMachine(f"no systemd came up within {PATIENCE:g} s: {said.decode(errors='replace')}")


def sweep() -> None:
    """Remove the groups that runs which were killed have left behind; their machines died with them."""
    for root in _roots():
        for group in root.glob("argosy-*-*"):
            if not Path("/proc", group.name.split("-")[1]).exists():
                _gone(group)


def _roots() -> list[Path]:
    if (_CGROUPS / "cgroup.controllers").exists():
        return [_CGROUPS]
    roots = [_CGROUPS / one for one in ("systemd", "unified", "memory", "pids", "devices")]
    return [root for root in roots if (root / "cgroup.procs").exists()]


def _cgroups(name: str) -> list[Path]:
    """Make the groups that the machine's processes begin in: its systemd manages what is below."""
    made = [root / name for root in _roots()]
    for group in made:
        group.mkdir()
    return made


def _remove(groups: list[Path]) -> None:
    """Remove what the machine's systemd has made of its groups, once the last of its processes is gone."""
    end = time.monotonic() + PATIENCE
    while left := [group for group in groups if not _gone(group)]:
        if time.monotonic() > end:
            raise AssertionError(f"processes are left in {', '.join(map(str, left))}")
        time.sleep(0.05)


def _gone(group: Path) -> bool:
    for folder, _, _ in os.walk(group, topdown=False):
        with contextlib.suppress(OSError):
            os.rmdir(folder)
    return not group.exists()
