"""The example package of docs/guides/drivers.md: a driver of one's own and functions of one's own, installed and
used."""

import asyncio
import tomllib
from importlib import import_module
from pathlib import Path

import pytest

from bridged.drivers.registry import check_manifest
from schemas.manifest.loader import Manifest, load_manifest, read_manifest
from tests.bridged.plugins import install
from tests.bridged.sky import end_of
from tests.bridged.workshop import Workshop, in_the_workshop
from tests.support.buses import until
from tests.support.notes import identities
from tests.support.ports import free_port

LAMP = Path(__file__).parents[3] / "examples" / "lamp"
MISSION = (LAMP / "lamp.yaml").read_text()


@pytest.fixture
def lamp(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Manifest:
    """Install the package and return its manifest."""
    site = tmp_path / "site"
    site.mkdir()
    project = tomllib.loads((LAMP / "pyproject.toml").read_text())["project"]
    modules = {path.stem: path.read_text() for path in LAMP.glob("*.py")}
    install(monkeypatch, site, modules, project["entry-points"], project["name"])
    manifest = load_manifest(LAMP / "lamp.toml")
    assert check_manifest(manifest) == []
    return manifest


def test_the_driver_is_as_short_as_its_page_says() -> None:
    assert len((LAMP / "lamp_driver.py").read_text().splitlines()) < 100


async def test_a_simulated_lamp_shines_and_its_board_blinks(lamp: Manifest, tmp_path: Path) -> None:
    async with in_the_workshop(Workshop(tmp_path, lamp, mission=MISSION, simulated=True)) as workshop:
        await workshop.perceives("level", 0)
        await workshop.perceives("temperature", 40)
        assert (await workshop.do("brightness", 70)).state == "succeeded"
        await workshop.perceives("level", 70)
        assert end_of(await workshop.do("brightness", 170)) == ("failed", "I would melt")
        assert (await workshop.do("blink", 3)).state == "succeeded"
        await workshop.perceives("temperature", 43)


async def test_a_real_lamp_is_called_at_its_link_and_again_when_it_hangs_up(lamp: Manifest, tmp_path: Path) -> None:
    manifest = read_manifest(
        (LAMP / "lamp.toml").read_text().partition("[percepts.temperature]")[0]
        + '[actions.brightness]\nparams = [{name = "percent"}]\ncall = "set"\nmotion = false\n',
        "lamp.toml",
    )
    port = free_port()
    mission = MISSION.replace("tcp:10.0.0.7:4000", f"tcp:127.0.0.1:{port}")
    async with in_the_workshop(Workshop(tmp_path, manifest, mission=mission)) as workshop:
        served: list[asyncio.StreamWriter] = []
        twin = import_module("lamp_driver").TwinLamp()

        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            served.append(writer)
            await twin.serve(reader, writer)

        assert end_of(await workshop.do("brightness", 1)) == ("failed", "the lamp is not connected")
        async with await asyncio.start_server(serve, "127.0.0.1", port):
            await workshop.perceives("level", 0)
            assert (await workshop.do("brightness", 30)).state == "succeeded"
            served[0].transport.abort()
            await until(lambda: len(served) == 2, "it is called again")
            assert (await workshop.do("brightness", 60)).state == "succeeded"
            await workshop.perceives("level", 60)
            served[1].close()


@pytest.mark.usefixtures("lamp")
def test_what_is_wrong_with_a_manifest_is_told_by_the_driver_at_its_line() -> None:
    text = '[robot]\ndriver = "lamp"\n[percepts.level]\nsource = "volume"\n[actions.louder]\ncall = "shout"\n'
    assert [str(one) for one in check_manifest(read_manifest(text, "radio.toml"))] == [
        "radio.toml:4: error: percepts.level.source: a lamp tells `level`",
        'radio.toml:5: error: actions.louder: expected `call = "set"` and one parameter',
    ]


async def test_a_board_without_the_hardware_says_so(
    lamp: Manifest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(import_module("board_functions"), "ZONE", tmp_path / "none")
    async with in_the_workshop(Workshop(tmp_path, lamp, mission=MISSION.replace("10.0.0.7", "127.0.0.1"))) as workshop:
        wanted = [("function_fails", "board.temperature")]
        await until(lambda: identities(workshop.bridge.health().notes) == wanted, "it is told")
        assert workshop.present("temperature") == []
