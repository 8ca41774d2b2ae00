"""Who may connect to a board's socket: members of the group, as real users, to a real router; and nobody else."""

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.needs import lacks
from tests.support.processes import ROOT, Daemon

GROUP, MEMBER, STRANGER = 61_230, 61_231, 61_232
"""Ids that nobody has: the kernel asks for no more than numbers."""
KNOCK = """\
import os, sys
from commd.bus.session import session_config
import zenoh
endpoint, user, groups = sys.argv[1], int(sys.argv[2]), [int(one) for one in sys.argv[3:]]
os.setgroups(groups)
os.setgid(user)
os.setuid(user)  # only now: the code of the tests may stand where this user cannot read
try:
    with zenoh.open(session_config("client", endpoint, "knocks")) as session:
        print("in" if session.info.routers_zid() else "no router")
except zenoh.ZError as error:
    print("out")
"""


@pytest.fixture(autouse=True)
def root() -> None:
    if os.geteuid() != 0:
        lacks("namespaces", "needs root")


@pytest.fixture
def folder() -> Iterator[Path]:
    """What systemd makes of `RuntimeDirectory=`, `RuntimeDirectoryMode=0750` and `Group=`, where all can come to it."""
    base = Path(tempfile.mkdtemp(prefix="argosy-socket-", dir="/tmp"))
    base.chmod(0o755)
    made = base / "run"
    made.mkdir(mode=0o750)
    os.chown(made, 0, GROUP)
    yield made
    shutil.rmtree(base)


@contextmanager
def router(folder: Path, umask: str) -> Iterator[str]:
    """Run commd at a socket in the folder, in the group, under the umask of its unit or another; yield its endpoint."""
    (folder / "wait.asl").write_text("+x <- true.")
    mission = folder / "m.yaml"
    mission.write_text("mission: m\nagents: {a: {program: wait.asl}}\ndone: 'a: x'\n")
    endpoint = f"unixsock-stream/{folder}/router.sock"
    within = ("setpriv", f"--regid={GROUP}", "--clear-groups", "sh", "-c", f'umask {umask} && exec "$@"', "sh")
    state = str(folder.parent / "state")
    daemon = Daemon("commd", "serve", str(mission), "--router", endpoint, "--state", state, within=within)
    try:
        daemon.says("router board=local")
        yield endpoint
    finally:
        daemon.kill()


def knock(endpoint: str, user: int, *groups: int) -> str:
    """Open a session as a user, in a process of its own."""
    command = [sys.executable, "-c", KNOCK, endpoint, str(user), *map(str, groups)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, cwd=ROOT)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_a_member_of_the_group_connects_and_a_stranger_does_not(folder: Path) -> None:
    with router(folder, "007") as endpoint:
        assert knock(endpoint, MEMBER, GROUP) == "in"
        assert knock(endpoint, STRANGER) == "out"


def test_the_socket_alone_keeps_strangers_out_of_an_open_folder(folder: Path) -> None:
    folder.chmod(0o755)
    with router(folder, "007") as endpoint:
        assert knock(endpoint, MEMBER, GROUP) == "in"
        assert knock(endpoint, STRANGER) == "out"


def test_without_the_umask_of_the_unit_not_even_a_member_would_connect(folder: Path) -> None:
    with router(folder, "022") as endpoint:
        assert knock(endpoint, MEMBER, GROUP) == "out"
        assert knock(endpoint, 0) == "in"
