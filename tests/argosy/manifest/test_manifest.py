"""`argosy manifest`: files checked, the running manifest of a bridge read and changed, on a real bus."""

import asyncio
import json
import threading
from argparse import Namespace
from collections.abc import Iterator
from pathlib import Path

import pytest

from argosy.__main__ import main
from argosy.cli.operator_bus import bridges
from argosy.manifest.live_commands import _show, taken_away
from bridged.daemon import serve
from commd.bus.bus import open_bus
from schemas.files.shipped_files import shipped
from schemas.manifest.document import document
from schemas.manifest.loader import load_manifest
from schemas.mission.model import read_mission
from schemas.wire.records import LiveManifest
from tests.argosy.beside import beside
from tests.argosy.watch.hostile import BAD, RAW
from tests.support.buses import until
from tests.support.ports import free_port

MISSION = """
mission: pond
agents:
  painter: {program: painter.asl, robot: turtle1}
robots:
  turtle1: {manifest: turtle, prefix: sim}
"""
Captured = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def there(tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[str]]:
    """Run a router and the bridge of a turtle in a thread; gives the options that lead there."""
    endpoint, folder = f"tcp/127.0.0.1:{free_port()}", tmp_path_factory.mktemp("turtle")
    ready, ended = threading.Event(), threading.Event()

    async def run() -> None:
        stop = asyncio.Event()
        args = Namespace(
            robots=["turtle1"],
            board=None,
            router=endpoint,
            keys=None,
            speed=None,
            state=folder,
            link=None,
            simulated=False,
            until_home=False,
            logs=None,
        )
        async with open_bus(endpoint, fleet="pond", name="board", daemon="commd", mode="router") as bus:
            bridge = asyncio.create_task(serve(read_mission(MISSION, folder / "pond.yaml"), args, stop))
            await until(lambda: bridges(bus, "pond"), "the bridge serves")
            ready.set()
            await asyncio.to_thread(ended.wait)
            stop.set()
            await bridge

    with beside(run, ready, ended):
        yield ["--router", endpoint]


def test_a_running_manifest_is_read_changed_and_saved(there: list[str], tmp_path: Path, capsys: Captured) -> None:
    assert main(["manifest", "get", "turtle1", *there]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["version"], told["manifest"]) == (1, document(load_manifest("turtle")))

    assert main(["manifest", "get", "turtle1", "percepts.pose.ttl", *there, "--toml"]) == 0
    assert capsys.readouterr().out == '"2s"\n'

    change = ["percepts.pose.rate=5", 'percepts.pose.ttl="3s"', 'actions.stop = {topic = "turtle1/stop"}']
    assert main(["manifest", "set", "turtle1", *change, "--remove", "percepts.velocity", *there]) == 0
    said = capsys.readouterr()
    assert said.out == "turtle1: version 2 is in effect until its bridge ends\n"
    assert said.err == "turtle1: warning: programs that use them miss these percepts from now on: velocity\n"

    assert main(["manifest", "get", "turtle1", "percepts.pose", "--toml", *there]) == 0
    assert capsys.readouterr().out.splitlines()[:3] == [
        "[percepts.pose]",
        'source = "turtle1/pose"',
        'args = ["x", "y", "theta"]',
    ]
    assert main(["manifest", "get", "turtle1", "--toml", *there]) == 0
    written = tmp_path / "turtle1.toml"
    written.write_text(capsys.readouterr().out, encoding="utf-8")
    manifest = load_manifest(written)
    assert (manifest.percepts["pose"].rate, list(manifest.percepts)) == (5, ["pose"])
    assert manifest.actions["stop"].topic == "turtle1/stop"
    assert main(["manifest", "check", str(written)]) == 0


def test_a_change_that_is_refused_is_told_with_all_reasons_and_exit_code_2(there: list[str], capsys: Captured) -> None:
    assert main(["manifest", "get", "turtle1", *there]) == 0
    version = json.loads(capsys.readouterr().out)["version"]
    change = ["percepts.pose.rate=-1", "actions.clear.deadlin=3", 'robot.driver="mavlink"']
    assert main(["manifest", "set", "turtle1", *change, *there]) == 2
    said = capsys.readouterr().err
    assert "turtle1: percepts.pose.rate: expected a number > 0.0, got `-1`" in said
    assert "turtle1: actions.clear.deadlin: there is no such field, did you mean `deadline`?" in said
    assert f"turtle1: nothing was changed, version {version}" in said
    assert main(["manifest", "set", "turtle1", "percepts.pose.rate=1", "--version", "44", *there]) == 2
    assert f"the manifest is at version {version}, the change is for version 44" in capsys.readouterr().err
    assert main(["manifest", "get", "turtle1", "percepts.poes", *there]) == 2
    assert "there is no such percept, did you mean `pose`?" in capsys.readouterr().err


def test_a_robot_that_no_bridge_serves_is_told_with_its_near_misses(there: list[str], capsys: Captured) -> None:
    assert main(["manifest", "get", "turtel1", *there]) == 1
    assert (
        f"error: turtel1: its bridge is not on the bus at {there[1]}, did you mean `turtle1`?"
        in capsys.readouterr().err
    )
    assert main(["manifest", "set", "turtle1", "percepts.pose.rate=1", "--fleet", "sea", *there]) == 1
    assert "; no bridge is running" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "expected what to change: PATH=VALUE or --remove PATH"),
        (["percepts.pose.rate"], "expected PATH=VALUE such as percepts.altitude.rate=5, got `percepts.pose.rate`"),
        (["percepts.pose.ttl=3s"], "percepts.pose.ttl: `3s` is no value in TOML; a text needs quotes"),
        (["percepts.pose.rate=5\n[x]"], "is no value in TOML"),
        (["actions.takeoff.params.altitude.max=inf"], "expected finite numbers, texts, lists and tables, got `inf`"),
    ],
)
def test_what_is_no_change_is_said_before_anybody_is_asked(arguments: list[str], said: str, capsys: Captured) -> None:
    assert main(["manifest", "set", "uav1", *arguments]) == 2
    assert said in capsys.readouterr().err


def test_all_problems_of_all_files_are_told_with_exit_code_2(tmp_path: Path, capsys: Captured) -> None:
    one, two = tmp_path / "one.toml", tmp_path / "two.toml"
    one.write_text('[robot]\ndriver = "zenoh"\n[percepts.p]\nrate = 0\n')
    two.write_text('[robot]\ndriver = "zenho"\n[actions.a]\ntopic = "t"\ncancel = "stop"\n')
    assert main(["manifest", "check", "turtle", str(one), str(two), "boat"]) == 2
    told = capsys.readouterr()
    assert told.out == "turtle: ok: zenoh, 2 percepts, 6 actions\n"
    assert told.err.splitlines() == [
        f"{one}:3: error: percepts.p: needs the field `source`",
        f"{one}:4: error: percepts.p.rate: expected a number > 0.0, got `0`",
        f"{two}:2: error: robot.driver: no driver `zenho`, there is mavlink, zenoh, python",
        f"{two}:5: error: actions.a.cancel: expected `hold` or `none`, got `stop`",
        "boat: error: no such manifest; expected a file or one of: copter, plane, rover, turtle",
    ]


def test_both_ini_files_of_the_paper_are_one(tmp_path: Path, capsys: Captured, monkeypatch: pytest.MonkeyPatch) -> None:
    act, per = "act", "per"
    folder = Path(__file__).parents[3] / "missions" / "paper_uav"
    (tmp_path / act).write_text((folder / "actions_manifest").read_text())
    (tmp_path / per).write_text((folder / "perceptions_manifest").read_text())
    monkeypatch.chdir(tmp_path)
    for pair in ([act, per], ["./act", "./per"], [f"{act},{per}"]):
        assert main(["manifest", "check", *pair, "turtle"]) == 0
        first, second = capsys.readouterr().out.splitlines()
        assert first.startswith(f"{','.join(pair)}: ok: mavlink, ")
        assert second.startswith("turtle: ok")
    for alone in (act, "./act"):
        assert main(["manifest", "check", "turtle", alone]) == 2
        said = capsys.readouterr().err
        assert said == f"{alone}: error: this is one of the paper's two INI files: name both, ACTIONS,PERCEPTS\n"
    assert main(["manifest", "check", act, "no_such"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 2


def test_the_schema_is_printed(capsys: Captured) -> None:
    path = shipped("manifests", "manifest.schema.json")
    assert path is not None
    assert main(["manifest", "schema"]) == 0
    assert capsys.readouterr().out == path.read_text(encoding="utf-8")


def test_the_commands_are_listed(capsys: Captured) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["manifest", "--help"])
    assert ended.value.code == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in ("check", "schema", "convert", "get", "set"))


def test_what_a_change_takes_away_is_told_and_nothing_else() -> None:
    goto = {"call": "goto", "deadline": "5min"}
    before = {"actions": {"goto": goto, "rtl": {}}, "percepts": {"gps": {}}}
    after = {
        "actions": {"goto": goto | {"deadline": "1s"}, "new": {"deadline": "2s"}},
        "percepts": {"gps": {"rate": 1}},
    }
    assert list(taken_away(before, before)) == []
    assert list(taken_away(before, after)) == [
        "programs that use them miss these actions from now on: rtl",
        "actions.goto: the deadline is 1s, it was 5min",
    ]


@pytest.mark.parametrize("toml", [True, False])
@pytest.mark.parametrize("entry", [None, "actions", "actions.x", "actions.x.y", "nothing"])
def test_what_a_bridge_answers_commands_no_terminal(toml: bool, entry: str | None, capfd: Captured) -> None:
    hostile = {"actions": {"x": {"y": BAD, BAD: BAD}}}
    _show(LiveManifest(robot="r3", version=1, file=BAD, manifest=hostile), entry, toml)
    printed, told = capfd.readouterr()
    assert "PWNED" in printed or entry == "nothing"
    assert [one for one in RAW if one in (printed + told).encode()] == []
