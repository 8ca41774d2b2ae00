"""The three daemons of a board in one process."""

import argparse
import asyncio
import logging
import re
import signal
import tempfile
from argparse import Namespace
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import agentd.daemon
import bridged.daemon
import commd.daemon
from argosy.deploy import board_command
from argosy.deploy.board_command import Parts
from commd.bus.errors import BusClosed
from commd.process.systemd import Member, Unit
from commd.router import config
from commd.router.config import router_settings
from schemas.files.findings import Finding, Findings
from schemas.mission.model import Mission, load_mission
from tests.support.buses import until
from tests.support.notify_socket import NotifySocket
from tests.support.ports import free_port
from tests.support.processes import ROOT, Daemon, running

_MISSION = ROOT / "missions" / "single_uav.yaml"


@contextmanager
def _flying(folder: Path, **programs: str) -> Iterator[Daemon]:
    """The board of the paper's first mission, with the simulated copter beside it; programs may be replaced."""
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    text = _MISSION.read_text().replace("14550", str(port)).replace("speed: 5 ", "speed: 10 ")
    (folder / "single_uav").mkdir()
    own = (ROOT / "missions" / "single_uav" / "uav.asl").read_text()
    (folder / "single_uav" / "uav.asl").write_text(programs.get("uav", own))
    (folder / "mission.yaml").write_text(text)
    copter = ("bridged", "simulate", "copter", "--link", f"udpout:127.0.0.1:{port}", "--speed", "10")
    where = ("--router", endpoint, "--state", str(folder / "state"))
    with running(*copter), running("argosy", "board", str(folder / "mission.yaml"), *where) as one:
        yield one


def test_one_process_flies_a_mission_and_sigterm_in_flight_leaves_the_robot_as_the_mission_says(tmp_path: Path) -> None:
    with _flying(tmp_path) as one:
        one.says("[uav] flying to")
        one.signal(signal.SIGTERM)
        assert one.ends() == 0
        assert re.search(r"leaving uav1: rtl: the vehicle is in RTL", one.text)
        assert "Traceback" not in one.text
    kept = {path.name for path in (tmp_path / "state").rglob("*") if path.is_file()}
    assert {"uav.minds", "uav1.actions", "local.mail"} <= kept


def test_a_program_that_stops_its_team_ends_no_board(tmp_path: Path) -> None:
    with _flying(tmp_path, uav='!go. +!go <- set_mode("GUIDED"); .stopMAS.') as one:
        one.says("a program has stopped its team; the board goes on without agents")
        one.signal(signal.SIGTERM)
        assert one.ends() == 0


def test_every_option_of_the_three_daemons_is_one_of_the_board() -> None:
    parser = argparse.ArgumentParser()
    board_command.add_arguments(parser)
    args = vars(parser.parse_args([str(_MISSION)]))
    for daemon in (commd.daemon, bridged.daemon, agentd.daemon):
        own = argparse.ArgumentParser()
        daemon.add_arguments(own)
        missing = vars(own.parse_args([str(_MISSION)])).keys() - args.keys() - {"robots", "agents"}
        assert not missing, f"{daemon.__name__} also takes {missing}"


def test_a_mistake_in_the_mission_is_told_and_ends_with_exit_code_2(tmp_path: Path) -> None:
    (tmp_path / "mission.yaml").write_text("mission: m\nagents: {a: {program: none.asl}}\n")
    where = ("--router", f"tcp/127.0.0.1:{free_port()}", "--state", str(tmp_path))
    with running("argosy", "board", str(tmp_path / "mission.yaml"), *where) as one:
        assert one.ends() == 2
    assert "agentd has failed, the board ends: " in one.text
    assert "none.asl" in one.text


class _Doubles:
    """Parts that do what a test wants, and note when they end."""

    def __init__(self) -> None:
        self.ended: list[str] = []

    def obedient(self, name: str, code: int = 0) -> board_command.Serve:
        async def serve(mission: Mission, args: Namespace, stop: asyncio.Event, unit: Member) -> int:
            unit.ready(name)
            await stop.wait()
            unit.stopping()
            await asyncio.sleep(0)
            self.ended.append(name)
            return code

        return serve

    def failing(self, error: BaseException | int) -> board_command.Serve:
        async def serve(mission: Mission, args: Namespace, stop: asyncio.Event, unit: Member) -> int:
            if isinstance(error, int):
                return error
            raise error

        return serve


def _run(
    *,
    stop_at_once: bool = False,
    stop_when_ready: bool = False,
    environment: dict[str, str] | None = None,
    **parts: board_command.Serve,
) -> int:
    async def everything() -> int:
        unit, stop = Unit(environment or {}), asyncio.Event()
        made = Parts(load_mission(str(_MISSION)), Namespace(), parts, unit)
        if stop_at_once:
            stop.set()
        running = asyncio.create_task(made.run(stop))
        if stop_when_ready:
            await until(lambda: all(one.is_ready for one in made.members.values()), "all parts are ready")
            stop.set()
        return await asyncio.wait_for(running, 120)

    return asyncio.run(everything())


def test_a_board_that_is_told_to_stop_at_once_begins_nothing_more() -> None:
    doubles = _Doubles()
    parts = {name: doubles.obedient(name) for name in ("commd", "bridged", "agentd")}
    assert _run(stop_at_once=True, **parts) == 0
    assert doubles.ended == ["commd"]


def test_robots_and_agents_leave_before_the_router() -> None:
    doubles = _Doubles()
    parts = {name: doubles.obedient(name) for name in ("commd", "bridged", "agentd")}
    assert _run(stop_when_ready=True, **parts) == 0
    assert sorted(doubles.ended[:2]) == ["agentd", "bridged"]
    assert doubles.ended[2:] == ["commd"]


_FAILURES: list[tuple[BaseException | int, int, str]] = [
    (3, 1, "exit code 3"),
    (BusClosed("cannot listen at tcp/127.0.0.1:1"), 1, "cannot listen at tcp/127.0.0.1:1"),
    (KeyError("x"), 1, "defect in argosy: KeyError: 'x'"),
    (BaseException("panic"), 1, "defect in argosy: BaseException: panic"),
    (Findings([Finding("m.yaml", 3, 1, "no such program")]), 2, "no such program"),
]


@pytest.mark.parametrize(("error", "code", "said"), _FAILURES)
def test_a_part_that_fails_is_told_and_ends_the_others_in_order(
    error: BaseException | int, code: int, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    doubles = _Doubles()
    with caplog.at_level(logging.INFO):
        ended = _run(
            commd=doubles.obedient("commd"), bridged=doubles.obedient("bridged"), agentd=doubles.failing(error)
        )
    assert ended == code
    assert doubles.ended == ["bridged", "commd"]
    assert "agentd has failed, the board ends: " in caplog.text
    assert said in caplog.text


@pytest.mark.parametrize("name", ["commd", "bridged"])
def test_a_part_that_ends_although_nobody_told_it_to_has_failed(name: str, caplog: pytest.LogCaptureFixture) -> None:
    doubles = _Doubles()
    parts = {one: doubles.obedient(one) for one in ("commd", "bridged", "agentd")} | {name: doubles.failing(0)}
    assert _run(**parts) == 1
    assert f"{name} has failed, the board ends: it ended by itself" in caplog.text


def test_an_endless_part_is_told_and_left(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    async def stubborn(mission: Mission, args: Namespace, stop: asyncio.Event, unit: Member) -> int:
        unit.ready("stubborn")
        await asyncio.sleep(1000)
        return 0

    monkeypatch.setattr(board_command, "LEAVE", 0.05)
    doubles = _Doubles()
    assert _run(stop_when_ready=True, commd=doubles.obedient("commd"), agentd=stubborn) == 1
    assert "agentd did not end within 0.05 s" in caplog.text
    assert doubles.ended == ["commd"]


def test_the_service_manager_knows_the_parts_as_one_unit(tmp_path: Path) -> None:
    with NotifySocket(tmp_path / "notify") as manager:
        parts = {name: _Doubles().obedient(name) for name in ("commd", "bridged", "agentd")}
        assert _run(environment=manager.environment(), stop_when_ready=True, **parts) == 0
        told = manager.take()
    assert [one for one in told if "READY" in one] == [
        {"READY": "1", "STATUS": "commd: commd; bridged: bridged; agentd: agentd"}
    ]
    assert [one for one in told if "STOPPING" in one]


def test_agents_and_bridges_begin_when_the_router_serves() -> None:
    begun: list[str] = []

    def noting(name: str) -> board_command.Serve:
        async def serve(mission: Mission, args: Namespace, stop: asyncio.Event, unit: Member) -> int:
            begun.append(name)
            await asyncio.sleep(0.1)
            unit.ready(name)
            begun.append(f"{name} is ready")
            await stop.wait()
            return 0

        return serve

    assert _run(stop_when_ready=True, commd=noting("commd"), bridged=noting("bridged")) == 0
    assert begun == ["commd", "commd is ready", "bridged", "bridged is ready"]


def test_with_a_routers_file_agents_and_bridges_go_in_where_the_router_opens_for_them(tmp_path: Path) -> None:
    (tmp_path / "idle.asl").write_text('+!begin <- .print("begun").\n!begin.\n')
    (tmp_path / "mission.yaml").write_text("mission: quiet\nagents: {a: {program: idle.asl}}\n")
    mission = load_mission(tmp_path / "mission.yaml")
    with tempfile.TemporaryDirectory() as short:  # the name of a unix socket has 108 bytes at most
        settings = router_settings(mission, "local", socket=f"{short}/router.sock", keys=None)
        (tmp_path / "router.json5").write_text(config.write(settings))
        where = ("--config", str(tmp_path / "router.json5"), "--state", str(tmp_path / "state"))
        with running("argosy", "board", str(mission.path), *where) as one:
            one.says("[a] begun")
            assert f"endpoint=unixsock-stream/{short}/router.sock" in one.text
            one.signal(signal.SIGTERM)
            assert one.ends() == 0
