"""A router that comes back with other rules: whom it denies now hears of it, and when it is allowed again."""

import asyncio

import pytest

from commd.bus import access_probe
from commd.bus.bus import Bus, open_bus
from commd.router.config import write
from schemas.wire import keys
from schemas.wire.mind_records import MindView
from tests.support.buses import until, virtual_test
from tests.support.processes import Daemon
from tests.support.secured import Secured

NAME = "three"


def start(fleet: Secured, denied: str) -> Daemon:
    """Start commd of pi1, whose rules for the board's own daemons leave out the keys of an agent."""
    settings = fleet.settings("pi1")
    for rule in settings["access_control"]["rules"]:
        if rule["id"].startswith("on this board") and denied:
            rule["key_exprs"] = [key for key in rule["key_exprs"] if f"/{denied}/" not in key]
    file = fleet.folder / "rules.json5"
    file.write_text(write(settings))
    state = ("--state", str(fleet.folder / "state"))
    daemon = fleet.run("commd", "serve", str(fleet.path), "--board", "pi1", *state, "--config", str(file))
    daemon.says("router board=")
    return daemon


def test_they_are_noticed_without_a_declaration_and_forgotten_when_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access_probe, "SETTLING", 0.05)
    monkeypatch.setattr(access_probe, "PATIENCE", 0.3)
    monkeypatch.setattr(access_probe, "LOOK_AGAIN", 0.1)

    async def body(fleet: Secured) -> None:
        router = start(fleet, "")
        async with open_bus(fleet.socket("pi1"), fleet=NAME, name="a", daemon="agentd", patience=10) as bus:
            bus.serve(keys.mind(NAME, "a"), MindView, _nothing)
            await bus.permitted()
            await until(lambda: not bus.access.note, "it is allowed")
            router.kill()
            router = await asyncio.to_thread(start, fleet, "a")
            await until(lambda: "to serve argosy/three/a/mind" in bus.access.note, "it is denied, and noted")
            router.kill()
            router = await asyncio.to_thread(start, fleet, "")
            await until(lambda: bus.access.note == "", "it is forgotten")

    with Secured() as fleet:
        asyncio.run(asyncio.wait_for(body(fleet), 240))


@virtual_test
async def test_what_could_not_be_known_is_seen_again_a_defect_ends_no_watch(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = ["denied", None, ValueError("no"), "denied", ""]
    looks: list[str] = []

    class Some:
        declared, declarations_changed = True, asyncio.Event()

    async def find_denials(bus: Bus) -> str | None:
        looks.append(watch.note)
        answer = answers.pop(0)
        if isinstance(answer, ValueError):
            raise answer
        return answer

    monkeypatch.setattr(access_probe, "find_denials", find_denials)
    watch = access_probe.Watch(Some())  # type: ignore[arg-type]
    watching = asyncio.create_task(watch.run())
    Some.declarations_changed.set()
    await asyncio.sleep(1000)
    assert not watch.note
    assert not watching.done()
    watching.cancel()
    assert looks == ["", "denied", "denied", "denied", "denied"], "no look is owed once all is well"


async def _nothing(query: object) -> None:
    pass
