"""`argosy stop` against bridges on a real bus."""

import asyncio
import re
import threading
from collections.abc import Iterator
from contextlib import AsyncExitStack, contextmanager
from pathlib import Path

import pytest

from argosy.__main__ import main
from commd.bus.bus import Bus, Query, open_bus
from commd.process.local_runs import announced
from commd.router.config import write
from schemas.wire import keys
from schemas.wire.records import Outcome, StopOrder
from tests.argosy.beside import beside
from tests.support.ports import free_port
from tests.support.secured import Secured


async def _bridge(bus: Bus, robot: str, answer: Outcome | None, orders: list[tuple[str, str]]) -> None:
    async def told(query: Query[StopOrder]) -> None:
        orders.append((robot, query.record.order))
        if answer is not None:
            query.reply(answer)

    bus.serve(keys.stop(bus.fleet, robot), StopOrder, told)
    await bus.claim(robot)


@contextmanager
def fleet(endpoint: str, **bridges: Outcome | None) -> Iterator[list[tuple[str, str]]]:
    """Run a router and these bridges in a thread of their own; gives the orders that they got."""
    orders: list[tuple[str, str]] = []
    ready, stop = threading.Event(), threading.Event()

    async def serve() -> None:
        async with AsyncExitStack() as stack:
            name: str
            for name in ("board", *bridges):
                bus = await stack.enter_async_context(
                    open_bus(
                        endpoint,
                        fleet="sar",
                        name=name,
                        daemon="commd" if name == "board" else "bridged",
                        mode="router" if name == "board" else "client",
                    )
                )
                if name != "board":
                    await _bridge(bus, name, bridges[name], orders)
            ready.set()
            await asyncio.to_thread(stop.wait)

    with beside(serve, ready, stop):
        yield orders


def test_without_a_name_every_robot_gets_the_order(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    with fleet(endpoint, uav1=Outcome(ok=True, reason="mode RTL"), uav2=Outcome(ok=True)) as orders:
        assert main(["stop", "rtl", "--router", endpoint]) == 0
    assert sorted(orders) == [("uav1", "rtl"), ("uav2", "rtl")]
    told = ["uav1: rtl confirmed (mode RTL)", "uav2: rtl confirmed"]
    assert sorted(capsys.readouterr().out.splitlines()) == told


def test_only_the_robots_that_are_named_get_the_order(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    with fleet(endpoint, uav1=Outcome(ok=True), uav2=Outcome(ok=True)) as orders:
        assert main(["stop", "hold", "uav2", "--fleet", "sar", "--router", endpoint]) == 0
    assert orders == [("uav2", "hold")]


def test_options_of_an_emergency_command_may_stand_anywhere(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    with fleet(endpoint, uav1=Outcome(ok=True), uav2=Outcome(ok=True)) as orders:
        assert main(["stop", "hold", "--router", endpoint, "uav1"]) == 0
        assert main(["stop", "--router", endpoint, "land", "--fleet", "sar", "uav2"]) == 0
    assert orders == [("uav1", "hold"), ("uav2", "land")]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "the following arguments are required: {hold,land,rtl,release,pause,continue}"),
        (["rlt"], "there is no order `rlt`, did you mean `rtl`?"),
        (["hold", "--router", "nonsense"], "Expected an endpoint such as `tcp/127.0.0.1:7447`, got `nonsense`"),
    ],
)
def test_a_wrong_command_is_told(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["stop", *arguments])
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_the_version_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert re.fullmatch(r"argosy \d+\.\d+\.\d+\n", capsys.readouterr().out)


def test_a_robot_that_does_not_confirm_makes_it_fail(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    refusal = Outcome(ok=False, reason="the vehicle did not confirm land within 10 s")
    with fleet(endpoint, uav1=Outcome(ok=True), uav2=refusal, uav3=None):
        assert main(["stop", "land", "--router", endpoint]) == 1
    assert sorted(capsys.readouterr().out.splitlines()) == [
        "uav1: land confirmed",
        "uav2: land NOT confirmed (the vehicle did not confirm land within 10 s)",
        "uav3: land NOT confirmed (its bridge did not answer: it may still carry out the order)",
    ]


def test_a_robot_that_is_not_there_is_named(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    with fleet(endpoint, uav1=Outcome(ok=True)) as orders:
        assert main(["stop", "rtl", "uav1", "uav9", "--router", endpoint]) == 1
    assert orders == [("uav1", "rtl")]
    assert f"uav9: its bridge is not on the bus at {endpoint}; there is uav1" in capsys.readouterr().err


def test_nobody_there_is_said(endpoint: str, capsys: pytest.CaptureFixture[str]) -> None:
    with fleet(endpoint):
        assert main(["stop", "rtl", "--fleet", "sar", "--router", endpoint]) == 1
    assert (
        f"error: no bridge of fleet `sar` is on the bus at {endpoint}: nothing was ordered" in capsys.readouterr().err
    )


def test_the_router_that_a_mission_names_is_taken_whatever_else_of_it_runs_here(endpoint: str, tmp_path: Path) -> None:
    mission = tmp_path / "m.yaml"
    mission.write_text(f"mission: m\nfleet: sar\nagents: {{a: {{program: a.asl}}}}\nrouter: {{endpoint: {endpoint}}}\n")
    simulation = f"tcp/127.0.0.1:{free_port()}"
    with fleet(endpoint, uav1=Outcome(ok=True)) as orders, announced("sar", simulation):
        assert main(["stop", "rtl", "--mission", str(mission)]) == 0
    assert orders == [("uav1", "rtl")]


def test_no_robot_of_the_mission_is_left_out(endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    mission = tmp_path / "m.yaml"
    robots = "robots: {uav1: {manifest: turtle, prefix: a}, uav2: {manifest: turtle, prefix: b}}\n"
    agents = "agents: {a: {program: a.asl, robot: uav1}}\n"
    mission.write_text(f"mission: m\nfleet: sar\n{agents}{robots}router: {{endpoint: {endpoint}}}\n")
    assert main(["stop", "rtl", "--mission", str(mission)]) == 1, "not even a router is there"
    assert capsys.readouterr().out.splitlines() == [
        "uav1: rtl NOT confirmed (no router was reached)",
        "uav2: rtl NOT confirmed (no router was reached)",
    ]
    with fleet(endpoint, uav1=Outcome(ok=True), uav3=Outcome(ok=True)) as orders:
        assert main(["stop", "rtl", "--mission", str(mission)]) == 1
    assert sorted(orders) == [("uav1", "rtl"), ("uav3", "rtl")]
    assert sorted(capsys.readouterr().out.splitlines()) == [
        "uav1: rtl confirmed",
        f"uav2: rtl NOT confirmed (its bridge is not on the bus at {endpoint})",
        "uav3: rtl confirmed",
    ]


def test_robots_of_boards_that_do_not_hear_each_other_are_stopped(capsys: pytest.CaptureFixture[str]) -> None:
    with Secured() as made:
        for board in ("pi1", "pi2"):
            settings = made.settings(board)
            settings["connect"]["endpoints"] = []
            (made.folder / "apart.json5").write_text(write(settings))
            state = ("--state", str(made.folder / "state" / board))
            daemon = made.run(
                "commd", "serve", str(made.path), "--board", board, *state, "--config", str(made.folder / "apart.json5")
            )
            daemon.says("router board=")
        capsys.readouterr()
        by_keys = ("--mission", str(made.path), "--keys", str(made.keys("ops")))
        with _bridges(made, "r1", "r2") as orders:
            assert main(["stop", "hold", *by_keys]) == 1
            said = capsys.readouterr()
            assert main(["status", str(made.path), *by_keys[2:], "--wait", "5"]) == 1
            seen = capsys.readouterr().out
            assert main(["stop", "rtl", "r2", *by_keys]) == 0
    assert sorted(orders) == [("r1", "hold"), ("r2", "hold"), ("r2", "rtl")]
    *confirmed, last = sorted(said.out.splitlines())
    assert confirmed == ["r1: hold confirmed", "r2: hold confirmed"]
    assert last.startswith("r3: hold NOT confirmed (board pi3 is not reached: ")
    assert "note: board pi3 is not reached: " in said.err
    assert {("up", "commd", "pi1"), ("up", "commd", "pi2")} <= {tuple(row.split()[:3]) for row in seen.splitlines()}


@contextmanager
def _bridges(made: Secured, *robots: str) -> Iterator[list[tuple[str, str]]]:
    """Run bridges that confirm whatever they are told, each at the socket of its board; gives the orders they got."""
    orders: list[tuple[str, str]] = []
    ready, stop = threading.Event(), threading.Event()

    async def serve() -> None:
        async with AsyncExitStack() as stack:
            for robot in robots:
                at = made.socket(made.mission.robots[robot].board)
                opened = open_bus(at, fleet="three", name=robot, daemon="bridged")
                await _bridge(await stack.enter_async_context(opened), robot, Outcome(ok=True), orders)
            ready.set()
            await asyncio.to_thread(stop.wait)

    with beside(serve, ready, stop):
        yield orders
