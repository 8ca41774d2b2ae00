"""`argosy record`: a real recorder on a real router, and the file that it leaves."""

import asyncio
import os
import re
import signal
import time
from base64 import b64decode
from collections.abc import Callable
from contextlib import AsyncExitStack, nullcontext
from pathlib import Path

import pytest
from msgspec.structs import replace

from argosy.__main__ import main
from argosy.recording.mind_inputs import Gap
from argosy.recording.reader import Recording
from argosy.recording.recorder import NOTES, PERIOD
from argosy.recording.records import RecorderNote, TokenSeen, Unread
from commd.bus.bus import Bus, Query
from schemas.wire import keys
from schemas.wire.codec import codec
from schemas.wire.mind_records import MindInputs
from schemas.wire.records import Health, LiveManifest, ManifestChange, Perception, Record
from tests.argosy.recording.files import stretch, validated
from tests.argosy.recording.recorders import Studio, recording, refused, seen
from tests.argosy.watch.terminal import Terminal
from tests.support.buses import FLEET, session, subscribed
from tests.support.promises import in_time

ALTITUDE = keys.percept(FLEET, "uav1", "altitude")
INPUTS = keys.trace(FLEET, "uav", "inputs")


def altitude(bus: Bus, value: float) -> Perception:
    return Perception(header=bus.header("percepts"), name="altitude", parameters=(value,))


async def test_everything_that_is_put_is_in_the_file_in_order_with_its_times(studio: Studio) -> None:
    sent = list[tuple[str, Record]]()
    bus = await studio.connect("uav1", "bridged")
    async with studio.recording() as recorder:
        await subscribed(bus, ALTITUDE)
        began = time.time_ns()
        for n in range(2000):
            one: Record = altitude(bus, n) if n % 10 else Health(header=bus.header("health"), pid=n)
            key = ALTITUDE if n % 10 else keys.health(FLEET, "uav1", "bridged")
            sent.append((key, one))
            bus.put(key, one)
            if n % 100 == 99:
                await asyncio.sleep(0.01)
        await studio.seen(ALTITUDE, 1800)
        code, out, err = await recorder.end()
    assert (code, err) == (0, "")
    assert out.splitlines()[0] == f"recording {studio.path}"
    assert out.splitlines()[-1].endswith("; ended: ctrl-C")
    found = Recording(studio.path)
    messages = [m for m in found.messages() if m.origin == "put"]
    assert sorted(((m.key, m.record) for m in messages), key=str) == sorted(sent, key=str)
    for key in (ALTITUDE, keys.health(FLEET, "uav1", "bridged")):
        assert [m.record for m in messages if m.key == key] == [record for where, record in sent if where == key]
    assert all(began <= m.stamp <= m.at + 1_000_000 <= time.time_ns() for m in messages)
    assert validated(studio.path) == sum(topic.messages for topic in found.topics)
    assert found.facts.fleet == FLEET


async def test_a_killed_recorder_loses_its_last_moment(studio: Studio, capsys: pytest.CaptureFixture[str]) -> None:
    bus = await studio.connect("uav1", "bridged")
    async with studio.recording() as recorder:
        await subscribed(bus, ALTITUDE)
        said, end = list[float](), time.monotonic() + 3 * PERIOD
        while time.monotonic() < end:
            bus.put(ALTITUDE, altitude(bus, len(said)))
            said.append(time.monotonic())
            await asyncio.sleep(0.01)
        killed = time.monotonic()
        code, _, _ = await recorder.end(signal.SIGKILL)
    assert code == -signal.SIGKILL
    found = Recording(studio.path)
    assert found.end is None
    assert "cut off" in found.missing
    values = [record.parameters[0] for _, record in found.typed(Perception)]
    assert values == list(range(len(values)))
    assert values
    assert all(in_time(killed - lost, 2 * PERIOD) for lost in said[len(values) :][:1])
    assert await asyncio.to_thread(main, ["replay", str(studio.path), "--info"]) == 0
    assert "no: it was cut off, or is still being written" in capsys.readouterr().out


async def test_who_is_there_and_what_is_perceived_already_is_recorded_and_who_comes_and_goes(studio: Studio) -> None:
    bus = await studio.connect("uav1", "bridged")
    gps = altitude(bus, 7)

    async def percepts(query: Query[Perception]) -> None:
        query.reply(gps, ALTITUDE)

    async def manifest(query: Query[ManifestChange]) -> None:
        query.reply(LiveManifest(header=bus.header("manifest"), robot="uav1", version=3))

    bus.serve(f"{keys.ROOT}/{FLEET}/uav1/percept/**", Perception, percepts)
    bus.serve(keys.manifest(FLEET, "uav1"), ManifestChange, manifest)
    await bus.claim("uav1")
    async with studio.recording() as recorder:
        await studio.seen(keys.manifest(FLEET, "uav1"), 1)
        await studio.seen(ALTITUDE, 1)
        other = await studio.connect("uav2", "bridged")
        token = await other.claim("uav2")
        other.withdraw(token)
        await studio.seen(f"{keys.ROOT}/{FLEET}/uav2/alive/bridged", 2)
        await recorder.end()
    found = Recording(studio.path)
    tokens = [(record.key.split("/")[2], record.alive) for _, record in found.typed(TokenSeen)]
    assert tokens == [("uav1", True), ("uav2", True), ("uav2", False)]
    ((percept, record),) = found.typed(Perception)
    assert (percept.origin, record) == ("query", gps)
    assert [one.version for _, one in found.typed(LiveManifest)] == [3]


async def test_the_inputs_of_a_mind_are_asked_for_since_its_birth_and_what_is_lost_again(studio: Studio) -> None:
    bus = await studio.connect("uav", "agentd")
    kept, asked = [stretch(n) for n in range(3)], 0

    async def inputs(query: Query[MindInputs]) -> None:
        nonlocal asked
        asked += 1
        for one in kept:
            query.reply(one)

    bus.serve(INPUTS, MindInputs, inputs)
    await bus.claim("uav")
    async with studio.recording() as recorder:
        await studio.seen(INPUTS, 3)
        kept += [stretch(n) for n in range(3, 7)]
        await subscribed(bus, INPUTS)
        bus.put(INPUTS, kept[3])
        bus.put(INPUTS, kept[6])  # as if two had been lost on the way
        await studio.seen(INPUTS, 7)
        code, out, _ = await recorder.end()
    assert (code, "missing" in out) == (0, False)
    (life,) = Recording(studio.path).minds()
    assert life.batches == kept
    assert life.whole


async def test_inputs_that_nobody_keeps_any_more_are_told_as_missing(studio: Studio) -> None:
    bus = await studio.connect("uav", "agentd")
    async with studio.recording() as recorder:
        await subscribed(bus, INPUTS)
        bus.put(INPUTS, stretch(0))
        bus.put(INPUTS, stretch(3))
        await studio.seen(INPUTS, 2)
        code, out, _ = await recorder.end(signal.SIGTERM)
    assert code == 0
    gap = Gap(FLEET, "uav", "b1", missing=((1, 2),), uncounted=0, batches=4)
    told = "uav (boot b1): batches 1-2 of 4 of its inputs are missing"
    assert str(gap) == told
    assert f"warning: {told}" in out.splitlines()
    found = Recording(studio.path)
    assert (found.end.gaps, found.end.why) == ((gap,), "SIGTERM")
    assert found.minds()[0].missing == [range(1, 3)]


async def test_an_agent_that_is_gone_without_its_last_inputs_is_told(studio: Studio) -> None:
    buses = {name: await studio.connect(name, "agentd") for name in ("killed", "left", "here")}
    tokens = {name: await bus.claim(name) for name, bus in buses.items()}
    async with studio.recording() as recorder:
        for name, bus in buses.items():
            await subscribed(bus, keys.trace(FLEET, name, "inputs"))
            one = stretch(0, bus.boot, name)
            bus.put(keys.trace(FLEET, name, "inputs"), replace(one, final=name == "left"))
            await studio.seen(keys.trace(FLEET, name, "inputs"), 1)
        for name in ("killed", "left"):
            buses[name].withdraw(tokens[name])
            await studio.seen(f"argosy/{FLEET}/{name}/alive/agentd", 2)
        code, out, _ = await recorder.end()
    told = "its end is missing: it was killed, or its last inputs were lost"
    warnings = [line for line in out.splitlines() if line.startswith("warning")]
    assert (code, warnings) == (0, [f"warning: killed (boot {buses['killed'].boot}): {told}"])


async def test_it_records_the_keys_alone_that_it_is_told(studio: Studio) -> None:
    bus = await studio.connect("uav1", "bridged")
    async with studio.recording("--only", "uav1/percept/**") as recorder:
        await subscribed(bus, ALTITUDE)
        bus.put(keys.health(FLEET, "uav1", "bridged"), Health())
        bus.put(ALTITUDE, altitude(bus, 1))
        await studio.seen(ALTITUDE, 1)
        await recorder.end()
    found = Recording(studio.path)
    assert [topic.key for topic in found.topics] == [ALTITUDE]
    assert found.facts.only == (f"argosy/{FLEET}/uav1/percept/**",)


async def test_what_is_put_on_many_keys_at_once_is_no_topic_but_is_kept_and_told(studio: Studio) -> None:
    bus = await studio.connect("uav1", "bridged")
    async with studio.recording() as recorder:
        await subscribed(bus, ALTITUDE)
        bus.put(f"argosy/*/{ALTITUDE.split('/', 2)[2]}", altitude(bus, 1))
        bus.put(ALTITUDE, altitude(bus, 2))
        await studio.seen(ALTITUDE, 1)
        code, out, _ = await recorder.end()
    told = f"warning: 1 messages, put on key expressions (`*`), are under {NOTES}"
    assert (code, told in out.splitlines()) == (0, True)
    found = Recording(studio.path)
    assert [topic.key for topic in found.topics] == [NOTES, ALTITUDE]
    ((_, kept),) = found.typed(Unread)
    assert kept.key == "argosy/*/uav1/percept/altitude"
    assert codec(Perception).decode(b64decode(kept.base64)).parameters == (1,)


async def test_a_file_that_is_there_is_overwritten_only_by_force_and_ends_after_its_time(
    studio: Studio, capsys: pytest.CaptureFixture[str]
) -> None:
    nowhere = studio.folder / "no" / "a.mcap"
    studio.path.write_text("mine")
    told = f"error: {studio.path} exists: name another file, or overwrite it with --force\n"
    assert await refused(capsys, "--router", studio.endpoint, "-o", studio.path) == told
    assert studio.path.read_text() == "mine"
    told = f"error: {nowhere}: No such file or directory\n"
    assert await refused(capsys, "--router", studio.endpoint, "-o", nowhere) == told
    async with studio.recording("--force", "--max-time", "1s") as recorder:
        code, out, _ = await recorder.end(None)
    assert (code, out.splitlines()[-1].rpartition("; ")[2]) == (0, "ended: the time limit of 1s is reached")
    assert Recording(studio.path).end is not None


@pytest.mark.parametrize(
    ("option", "value", "told"),
    [
        ("--only", "a//b", "error: `a//b`: expected a key expression such as `uav1/**` or `*/percept/**`"),
        ("--max-size", "big", "argument --max-size: expected a size such as `2GB` or `500MB`, got `big`"),
        ("--max-time", "0", "argument --max-time: expected more than 0 s"),
    ],
)
def test_bad_arguments_are_told_in_a_line(
    option: str, value: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) if option != "--only" else nullcontext():
        assert main(["record", "-o", str(tmp_path / "a.mcap"), option, value]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "a.mcap").exists()


async def test_a_recorder_of_nobody_says_so(studio: Studio, free_port: Callable[[], int]) -> None:
    async with studio.recording(fleet="misspelt") as recorder:
        line = await asyncio.wait_for(recorder.handle.stderr.readline(), 120)
        told = f"no daemon of fleet `misspelt` is on {studio.endpoint} yet; recording starts when one appears"
        assert line.decode() == f"note: {told}\n"
        code, out, _ = await recorder.end()
    assert code == 0
    assert ": 0 messages in " in out


async def test_a_router_that_goes_and_comes_is_noted_and_what_came_is_asked_for(endpoint: str, tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    async with AsyncExitStack() as stack:
        router = await stack.enter_async_context(AsyncExitStack())
        await router.enter_async_context(session(endpoint, "board", "commd", router=True))
        recorder = await stack.enter_async_context(recording(endpoint, path))
        await router.aclose()
        await seen(path, NOTES, 1)
        async with session(endpoint, "board", "commd", router=True), session(endpoint, "uav1", "bridged") as bus:
            await subscribed(bus, ALTITUDE)
            bus.put(ALTITUDE, altitude(bus, 1))
            await seen(path, ALTITUDE, 1)
            code, _, _ = await recorder.end()
    assert code == 0
    notes = [note.text for _, note in Recording(path).typed(RecorderNote)]
    assert notes == ["the router is lost: nothing is received", "the router is back"]


async def test_on_a_terminal_one_line_tells_how_it_goes(studio: Studio) -> None:
    command = ["argosy", "record", "--fleet", FLEET, "--router", studio.endpoint, "-o", str(studio.folder / "a.mcap")]
    with Terminal(command, columns=200) as terminal:
        await asyncio.to_thread(terminal.shows, "0 dropped")
        assert re.search(rb"\r\x1b\[K\d+ s  \d+ messages/s  \d+ B  0 dropped", terminal.output)
        os.kill(terminal.pid, signal.SIGTERM)
        assert await asyncio.to_thread(terminal.end) == 0
        assert terminal.text.rstrip().endswith("; ended: SIGTERM")
