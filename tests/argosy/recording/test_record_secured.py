"""A recorder with an observer's keys hears every board of a fleet, each record once, and minds from their birth."""

import asyncio
from collections import Counter
from pathlib import Path

from argosy.recording.reader import Recording
from schemas.wire import keys
from schemas.wire.records import Health
from tests.argosy.recording.files import validated
from tests.argosy.recording.recorders import argosy
from tests.support.buses import until
from tests.support.secured import FLEET, Secured

PROGRAM = "!go. +!go <- +beat; .wait(200); -beat; !go."


def heard(path: Path, key: str) -> int:
    """How many messages on a key are in a file by now."""
    return sum(topic.messages for topic in Recording(path).topics if topic.key == key)


def test_a_recorder_with_keys_hears_each_board(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"

    async def record(fleet: Secured) -> None:
        arguments = ("--mission", fleet.path, "--keys", fleet.keys("eye"), "-o", path)
        async with argosy("record", *arguments) as recorder:
            await recorder.until("recording ")
            for board, agent in (("pi1", "a"), ("pi2", "b")):
                await until(lambda agent=agent: heard(path, keys.trace("three", agent, "inputs")) > 3, f"{agent}")  # type: ignore[misc]
                await until(lambda board=board: heard(path, keys.health("three", board, "agentd")) > 3, f"{board}")  # type: ignore[misc]
            code, _, err = await recorder.end(seconds=40)
        assert code == 0
        assert "board pi3 is not reached" in err

    with Secured(FLEET.replace("[eye]", "{eye: mail}")) as fleet:
        (fleet.folder / "nothing.asl").write_text(PROGRAM)
        fleet.routers(["pi1", "pi2"])
        fleet.start("pi1", "agentd").says("agents=a")
        fleet.start("pi2", "agentd").says("agents=b")
        asyncio.run(record(fleet))
    recording = Recording(path)
    assert {life.agent: life.whole for life in recording.minds()} == {"a": True, "b": True}
    said = Counter((m.key, one.header.boot, one.header.seq) for m, one in recording.typed(Health))
    assert set(said.values()) == {1}
    assert validated(path) > 20
