"""By hand in a fleet with keys: where a mission says `inject: true` operators act and tell percepts, observers not."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from argosy.__main__ import main
from commd.client import join
from schemas.wire import keys
from schemas.wire.records import Perception
from tests.attacks.world import NAME, TEXT, World
from tests.docs.pages import blocks
from tests.support.buses import until
from tests.support.secured import Secured

INJECT = TEXT.replace("mission: three", "mission: three\nfleet: three\ninject: true")


@pytest.fixture(scope="module")
def world() -> Iterator[World]:
    with Secured(INJECT) as fleet:
        world = World(fleet)
        world.begin()
        yield world


def act(world: World, who: str, *words: str) -> int:
    return main(["act", *words, "--mission", str(world.fleet.path), "--keys", str(world.fleet.keys(who))])


def test_an_operator_acts_at_the_board_of_the_robot(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert act(world, "ops", "a", "cmd_vel", "1", "0", "0") == 0
    assert capsys.readouterr().out.splitlines()[-1] == "a: cmd_vel(1,0,0) succeeded"
    assert act(world, "ops", "nobody", "cmd_vel") == 1
    assert "mission.yaml has no agent `nobody`; known are a, b, c" in capsys.readouterr().err


def test_an_observer_does_not(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert act(world, "eye", "a", "cmd_vel", "1", "0", "0") == 1
    said = capsys.readouterr().err
    assert "answers for `a`; where access is controlled, only operators may ask" in said
    assert "note: `eye` is an observer in the mission: it may not give orders" in said


def test_an_operator_asks_a_bridge_for_what_its_vehicle_stores_and_an_observer_does_not(
    world: World, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mission = ("--mission", str(world.fleet.path))
    for command in (("params", "save", "r1", str(tmp_path / "r1.param")), ("plan", "save", "r1", "r1.plan")):
        assert main([*command, *mission, "--keys", str(world.fleet.keys("ops"))]) == 1
        assert capsys.readouterr().err == "error: r1: its driver knows no parameters and no stored mission\n"
        assert main([*command, *mission, "--keys", str(world.fleet.keys("eye"))]) == 1
        said = capsys.readouterr().err
        assert "r1: its bridge does not answer" in said
        assert "note: `eye` is an observer in the mission: it may not give orders" in said


def test_an_observer_of_telemetry_is_told_it_sees_no_minds(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["why", "a", "--mission", str(world.fleet.path), "--keys", str(world.fleet.keys("eye"))]) == 1
    why = "a: `eye` is an observer of telemetry by the mission: it may not see this (docs/guides/security.md)"
    assert why in capsys.readouterr().err


async def test_an_operator_tells_percepts_and_an_observer_does_not(world: World) -> None:
    mission = world.fleet.mission
    async with (
        join("pi1_x", mission=mission, board="pi1", router=world.fleet.socket("pi1")) as member,
        world.machine("ops", "pi1") as operator,
        world.machine("eye", "pi1") as observer,
    ):
        percepts = member.percepts("a")

        def arrives() -> bool:
            observer.put(keys.percept_by_hand(NAME, "a", "forged"), Perception(parameters=(1,)))
            operator.put(keys.percept_by_hand(NAME, "a", "victim"), Perception(parameters=(1,)))
            return bool(percepts.of("victim"))

        await until(arrives, "the operator's percept arrives")
        assert percepts.of("forged") == []
        assert percepts.of("victim") == [(1,)]


def test_an_observer_lists_what_all_boards_tell(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    observer = ["--mission", str(world.fleet.path), "--keys", str(world.fleet.keys("eye"))]
    assert main(["list", *observer]) == 0
    out, said = capsys.readouterr()
    assert said == ""
    heads = [line for line in out.splitlines() if not line.startswith(" ")]
    assert {f"argosy/three/{one}" for one in ("pi1  board", "pi2  board", "pi3  board", "r1  robot")} <= set(heads)
    assert "  query  argosy/three/a/percept/**" in out


def test_zenoh_cli_reads_and_acts_with_an_operators_keys_and_the_settings_of_the_page(world: World) -> None:
    [settings] = [
        block.text for block in blocks("docs/guides/command-line-tools.md") if "root_ca_certificate" in block.text
    ]
    settings = settings.replace("tls/10.0.0.11:7447", world.fleet.link("pi1"))
    file = world.fleet.folder / "operator.json5"
    file.write_text(settings.replace("keys/", f"{world.fleet.keys('ops')}/"))

    def zenoh(*words: str) -> str:
        tool = str(Path(sys.executable).with_name("zenoh"))
        command = [tool, "--mode", "client", "--config", str(file), *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert "argosy/three/r1/alive/bridged/" in zenoh("liveliness", "get", "-k", "argosy/**")
    asked = ("-s", "argosy/three/a/action/cmd_vel", "-v", '{"parameters":[1,0,0]}', "--decoder", "json")
    assert '"state": "succeeded"' in zenoh("get", *asked)
    assert zenoh("get", "-s", "argosy/three/a/percept/pose", "--decoder", "argosy").startswith("pose(")
