"""Daemons of two major versions of the records on one bus: they refuse each other with a reason."""

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.support.processes import ROOT, Daemon, running

Start = Callable[..., Daemon]


@pytest.fixture
def start() -> Iterator[Start]:
    """Return a function that starts a daemon of the checkout, which ends with the test."""
    with contextlib.ExitStack() as stack:
        yield lambda *arguments: stack.enter_context(running(*arguments))


def copied(folder: Path, port: int) -> str:
    """Copy the first mission to a link of its own."""
    text = (ROOT / "missions" / "single_uav.yaml").read_text().replace(":14550", f":{port}")
    path = folder / "single_uav.yaml"
    path.write_text(text.replace("program: single_uav/", f"program: {ROOT}/missions/single_uav/"))
    return str(path)


MAIL = """\
mission: letters
boards: {{a: {{}}, b: {{}}}}
agents:
  asker: {{board: a, program: asker.asl}}
  knower: {{board: b, program: knower.asl}}
done: "asker: known(42)"
"""


def test_a_daemon_does_not_start_beside_a_commd_of_another_major_version(
    start: Start, tmp_path: Path, endpoint: str, free_port: Callable[[], int]
) -> None:
    mission = copied(tmp_path, free_port())
    start("commd", "serve", mission, "--router", endpoint).says("router board=local")
    for daemon, name in (("agentd", "uav"), ("bridged", "uav1")):
        other = start("tests.compat.next_major", daemon, "serve", mission, name, "--router", endpoint)
        assert other.ends() == 1
        assert other.lines[-1] == (
            f"error: {daemon}: the commd of board `local` speaks version 1 of the records, this {daemon} version 2:"
            " install the same release of Argosy for all of a board"
        )


def test_a_board_of_another_major_version_is_named_and_its_mail_waits(
    start: Start, tmp_path: Path, endpoint: str, free_port: Callable[[], int]
) -> None:
    mission, between = tmp_path / "letters.yaml", f"tcp/127.0.0.1:{free_port()}"
    mission.write_text(MAIL.format())
    (tmp_path / "asker.asl").write_text("!ask. +!ask <- .send(knower, tell, wanted).")
    (tmp_path / "knower.asl").write_text("+wanted <- .print(wanted).")
    ours = start("commd", "serve", str(mission), "--board", "a", "--router", endpoint, "--listen", between)
    start("agentd", "serve", str(mission), "asker", "--router", endpoint)
    other = ("commd", "serve", str(mission), "--board", "b", "--router", f"tcp/127.0.0.1:{free_port()}")
    theirs = start("tests.compat.next_major", *other, "--connect", between)
    ours.says("other_version b/services: records of version 2, this daemon speaks version 1")
    theirs.says("other_version a/services: records of version 1, this daemon speaks version 2")
    until = time.monotonic() + 30
    while "version 1 of the record, this daemon speaks version 2" not in (told := mail_of("a", str(mission), endpoint)):
        assert time.monotonic() < until, told


def mail_of(board: str, mission: str, endpoint: str) -> str:
    """Return what `argosy mail` says of the letters to the knower."""
    command = ("argosy", "mail", mission, "--board", board, "--router", endpoint)
    with running(*command) as mail:
        assert mail.ends() == 0, mail.text
        return "\n".join(line for line in mail.lines if "knower" in line)
