"""Daemons of two versions at work together: those of an older release as they were, and the present ones."""

from __future__ import annotations

import contextlib
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.compat.older import unpack
from tests.support.processes import ROOT, Daemon, running

Start = Callable[..., Daemon]
FINE = ("defect", "Traceback", "bad_input", "other_version")
"""Words that no daemon says when all is well."""


@pytest.fixture(scope="module")
def older(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return unpack(tmp_path_factory.mktemp("older"))


@pytest.fixture
def start() -> Iterator[Start]:
    """Return a function that starts a daemon of the checkout, or of other `code`, which ends with the test."""
    with contextlib.ExitStack() as stack:
        yield lambda *arguments, code=ROOT: stack.enter_context(running(*arguments, code=code))


def copied(folder: Path, port: int) -> str:
    """Copy the first mission to a link of its own."""
    text = (ROOT / "missions" / "single_uav.yaml").read_text().replace(":14550", f":{port}")
    path = folder / "single_uav.yaml"
    path.write_text(text.replace("program: single_uav/", f"program: {ROOT}/missions/single_uav/"))
    return str(path)


@pytest.mark.parametrize("older_ones", [("bridged",), ("commd", "agentd")], ids=" and ".join)
def test_a_mission_is_flown_by_daemons_of_two_versions(
    older_ones: tuple[str, ...],
    older: Path,
    start: Start,
    tmp_path: Path,
    endpoint: str,
    free_port: Callable[[], int],
) -> None:
    port = free_port()
    mission = copied(tmp_path, port)

    def serve(daemon: str, *arguments: str) -> Daemon:
        code = older if daemon in older_ones else ROOT
        options = ("--router", endpoint, "--state", str(tmp_path / daemon))
        return start(daemon, "serve", mission, *arguments, *options, code=code)

    commd, bridged = serve("commd"), serve("bridged", "uav1", "--speed", "20")
    start("bridged", "simulate", "copter", "--link", f"udpout:127.0.0.1:{port}", "--speed", "20")
    agentd = serve("agentd", "uav", "--speed", "20")
    agentd.says("[uav] mission done", 120)
    for daemon in (commd, bridged, agentd):
        said = [line for line in daemon.lines if any(word in line for word in FINE)]
        assert said == [], daemon.arguments
    newer = next(one for one in (commd, bridged, agentd) if one.arguments[0] not in older_ones)
    assert "unknown_fields" not in newer.text, "the older has no field that the newer does not know"
    if "agentd" in older_ones:
        agentd.says("unknown_fields key=argosy/single-uav/uav1/health/bridged ignored=", 5)


MAIL = """\
mission: letters
boards: {{a: {{}}, b: {{}}}}
agents:
  asker: {{board: a, program: asker.asl}}
  knower: {{board: b, program: knower.asl}}
done: "asker: known(42)"
"""


def test_mail_crosses_from_an_older_board_to_a_newer_and_survives_the_update_of_its_board(
    older: Path, start: Start, tmp_path: Path, endpoint: str, free_port: Callable[[], int]
) -> None:
    mission, between = tmp_path / "letters.yaml", f"tcp/127.0.0.1:{free_port()}"
    mission.write_text(MAIL.format())
    (tmp_path / "asker.asl").write_text(
        "!ask(first). +!ask(What) <- .send(knower, tell, wanted(What)); +asked(What); .print(asked, What).\n"
        "+known(N) : asked(first) <- .print(known, N)."
    )
    (tmp_path / "knower.asl").write_text("+wanted(What)[source(A)] <- .print(wanted, What); .send(A, tell, known(42)).")
    routers = {"a": endpoint, "b": f"tcp/127.0.0.1:{free_port()}"}
    links = {"a": ("--listen", between), "b": ("--connect", between)}

    def board(name: str, agent: str, code: Path) -> tuple[Daemon, Daemon]:
        options = ("--router", routers[name], "--state", str(tmp_path / name))
        router = start("commd", "serve", str(mission), "--board", name, *links[name], *options, code=code)
        return router, start("agentd", "serve", str(mission), agent, *options, code=code)

    before = board("a", "asker", older)
    before[1].says("asked", 30)
    for daemon in reversed(before):  # the board is updated: the letter waits in what the older version has written
        daemon.signal(signal.SIGTERM)
        assert daemon.ends(20) == 0
    after = board("a", "asker", ROOT)
    there = board("b", "knower", older)
    there[1].says("wanted", 30)
    after[1].says("known", 30)
    assert after[1].text.count("asked") == 0, "the mind of the older version goes on, it does not begin anew"
    for daemon in (*after, *there):
        assert [line for line in daemon.lines if any(word in line for word in FINE)] == []


def test_a_daemon_does_not_start_beside_a_commd_of_another_major_version(
    start: Start, tmp_path: Path, endpoint: str, free_port: Callable[[], int]
) -> None:
    mission = copied(tmp_path, free_port())
    start("commd", "serve", mission, "--router", endpoint).says("router board=local", 30)
    for daemon, name in (("agentd", "uav"), ("bridged", "uav1")):
        other = start("tests.compat.next_major", daemon, "serve", mission, name, "--router", endpoint)
        assert other.ends(30) == 1
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
    ours.says("other_version b/services: records of version 2, this daemon speaks version 1", 30)
    theirs.says("other_version a/services: records of version 1, this daemon speaks version 2", 30)
    until = time.monotonic() + 30
    while "version 1 of the record, this daemon speaks version 2" not in (told := mail_of("a", str(mission), endpoint)):
        assert time.monotonic() < until, told


def mail_of(board: str, mission: str, endpoint: str) -> str:
    """Return what `argosy mail` says of the letters to the knower."""
    command = ("argosy", "mail", mission, "--board", board, "--router", endpoint)
    with running(*command) as mail:
        assert mail.ends(30) == 0, mail.text
        return "\n".join(line for line in mail.lines if "knower" in line)
