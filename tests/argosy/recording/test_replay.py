"""`argosy replay`: what was recorded is said once more, in its order and at its times, and never to somebody alive."""

import json
import re
import signal
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import pytest
import zenoh
from mcap.writer import Writer

from argosy.__main__ import main
from argosy.recording.metadata import BEGIN as BEGUN
from argosy.recording.metadata import End
from argosy.recording.player import PlayedMind
from argosy.recording.reader import Recording
from argosy.recording.records import PREFIX, TokenSeen, Unread, to_json, to_msgpack
from argosy.recording.write_queue import Heard
from commd.bus.bus import Bus
from commd.bus.errors import BusError, QueryFailed
from schemas.wire import keys
from schemas.wire.codec import Wire, codec
from schemas.wire.mind_records import MindInputs, MindView
from schemas.wire.records import Perception
from tests.argosy.recording.files import BEGIN, FACTS, SECOND, altitude, heard, stretch, write
from tests.argosy.recording.recorders import Studio, argosy, tried
from tests.support.buses import FLEET, PATIENCE, Connect, session, until
from tests.support.forked import ROOT

ALTITUDE = keys.percept(FLEET, "uav1", "altitude")


def recorded(path: Path, messages: Sequence[Heard]) -> Path:
    """Write a recording and end it."""
    write(path, messages).close(End(why="ctrl-C", ended=BEGIN))
    return path


def fast(count: int, step: float = 0.02) -> list[Heard]:
    """Altitudes at every `step` seconds."""
    return [replace_at(altitude(n, n), n * step) for n in range(count)]


def replace_at(one: Heard, seconds: float, **others: object) -> Heard:
    """The same, heard at another time."""
    return one._replace(at=BEGIN + round(seconds * SECOND), **others)  # type: ignore[arg-type]


def token(seconds: float, alive: bool, name: str = "uav1", daemon: str = "bridged") -> Heard:
    """A token that comes or goes."""
    key = keys.alive(FLEET, name, daemon, "b1")
    seen = heard(f"argosy/{FLEET}/{name}/alive/{daemon}", TokenSeen(key=key, alive=alive), seconds)
    return seen._replace(origin="token")


class Listener:
    """Hears all that is said in a fleet."""

    def __init__(self, bus: Bus, fleet: str) -> None:
        self.heard: list[tuple[float, str, bytes, str]] = []
        self.tokens: list[tuple[str, bool]] = []
        bus.raw.tap(f"argosy/{fleet}/**", self._take)
        bus.watch(keys.alive(fleet, "*", "*", "*"), lambda key, alive: self.tokens.append((key, alive)))

    def _take(self, sample: zenoh.Sample) -> None:
        one = (time.monotonic(), str(sample.key_expr), sample.payload.to_bytes(), str(sample.encoding))
        self.heard.append(one)


async def replayed(studio: Studio, *arguments: str) -> tuple[int, str, str]:
    """Run a replay to its end; that a busy machine was late is no matter here."""
    async with argosy("replay", studio.path, "--router", studio.endpoint, *arguments) as process:
        code, out, err = await process.end(None, 40)
        return code, out, re.sub(r"warning: up to [\d.]+ s late: .*\n", "", err)


async def test_it_says_all_in_order_and_at_the_times_of_the_recording(studio: Studio) -> None:
    recorded(studio.path, fast(101))
    said = Listener(await studio.connect("eye", "argosy"), f"{FLEET}-replay")
    took = dict[str, float]()
    for speed, seconds in (("1", 2.0), ("4", 0.5)):
        said.heard.clear()
        code, out, err = await replayed(studio, "--speed", speed)
        assert (code, err) == (0, "")
        assert out.endswith("replayed 2.0 s: 101 messages\n")
        assert [json.loads(payload)["parameters"] for _, _, payload, _ in said.heard] == [[n] for n in range(101)]
        assert {key for _, key, _, _ in said.heard} == {keys.percept(f"{FLEET}-replay", "uav1", "altitude")}
        assert {encoding for *_, encoding in said.heard} == {codec_encoding("json")}
        took[speed] = said.heard[-1][0] - said.heard[0][0]
        assert took[speed] > 0.9 * seconds  # it may be late on a busy machine, and says so; it is never early
    assert took["1"] > 2 * took["4"]


def codec_encoding(wire: Wire) -> str:
    """The Encoding of percepts."""
    return codec(Perception).encodings[wire]


async def test_payloads_are_those_that_were_put_also_in_messagepack_and_as_bytes(studio: Studio) -> None:
    packed = [altitude(n, n, "msgpack") for n in range(3)]
    blob = Heard(BEGIN, f"argosy/{FLEET}/uav1/blob", b"\x00\xff", "image/png")
    recorded(studio.path, [blob, *(replace_at(one, 0.1) for one in packed)])
    said = Listener(await studio.connect("eye", "argosy"), "other")
    assert (await replayed(studio, "--fleet", "other"))[0] == 0
    found = [(key, payload, encoding) for _, key, payload, encoding in said.heard]
    assert found[0] == ("argosy/other/uav1/blob", b"\x00\xff", "image/png")
    assert [payload for _, payload, _ in found[1:]] == [one.payload for one in packed]
    assert {encoding for _, _, encoding in found[1:]} == {codec_encoding("msgpack")}


async def test_a_part_of_it_is_replayed_by_time_and_key(studio: Studio) -> None:
    other = heard(keys.trace(FLEET, "uav", "inputs"), stretch(0), 0.5)
    recorded(
        studio.path,
        [token(0, True), *fast(26), other, *[replace_at(altitude(n, n), n * 0.02) for n in range(26, 101)]],
    )
    said = Listener(await studio.connect("eye", "argosy"), f"{FLEET}-replay")
    arguments = ("--from", "0.5", "--to", "0.6", "--only", "*/percept/**", "--only", "*/alive/**")
    assert (await replayed(studio, *arguments))[0] == 0
    values = [json.loads(payload)["parameters"][0] for _, _, payload, _ in said.heard]
    assert values == [24, 25, 26, 27, 28, 29]  # the last before it is what was perceived at its beginning
    assert (keys.alive(f"{FLEET}-replay", "uav1", "bridged", "b1"), True) in said.tokens


async def test_daemons_come_and_go_as_they_did_and_answers_to_questions_are_left_out(studio: Studio) -> None:
    answer = heard(keys.mind(FLEET, "uav"), MindView(agent="uav"), 0.1)._replace(origin="query")
    percept = replace_at(altitude(1, 5), 0.1, origin="query")
    recorded(studio.path, [token(0, True), answer, percept, token(0.6, False), token(0.8, True, "uav2")])
    said = Listener(await studio.connect("eye", "argosy"), f"{FLEET}-replay")
    code, out, _ = await replayed(studio)
    assert code == 0
    assert out.endswith("replayed 0.8 s: 1 messages, 1 left out (answers to queries)\n")
    await until(lambda: len(said.tokens) == 4, "all tokens are gone")
    tokens = [(key.split("/")[2], alive) for key, alive in said.tokens]
    assert tokens == [("uav1", True), ("uav1", False), ("uav2", True), ("uav2", False)]
    assert [json.loads(payload)["parameters"] for _, _, payload, _ in said.heard] == [[5]]


async def test_minds_answer_as_they_were_when_the_replay_has_come_so_far(studio: Studio) -> None:
    assert tried(ROOT / "missions/single_uav.yaml", studio.path).success
    bus, views = await studio.connect("eye", "argosy"), list[MindView]()

    async def seen() -> bool:
        with suppress(BusError):
            views.append(await bus.ask_one(f"{keys.mind('flown', 'uav')}?plans=true", None, MindView, 2.0))
        return bool(views)

    part = ("--from", "50", "--to", "60", "--loop", "--fleet", "flown")
    async with argosy("replay", studio.path, "--router", studio.endpoint, *part) as process:
        await until(seen, "the mind answers")
        await process.end()
    view = views[0]
    assert {"homeward[source(self)]", "takeoff_altitude(5)[source(self)]"} <= {one.text for one in view.beliefs}
    assert "mission_done[source(self)]" not in [one.text for one in view.beliefs]
    assert [one.text for one in view.actions if one.kind == "action"][-1] == "return_to_launch"
    assert view.plans
    assert 45 < view.time < 60


async def test_a_mind_with_a_batch_lost_or_unreadable_is_not_shown_as_before(connect: Connect, tmp_path: Path) -> None:
    eye, player = await connect("eye", "argosy"), await connect("player", "argosy")
    inputs, key = keys.trace(FLEET, "uav", "inputs"), keys.mind(FLEET, "uav")
    given = [heard(inputs, stretch(number), number) for number in range(5)]
    other = given[1]._replace(payload=b'{"header": {"boot": "b1"}, "number": 1, "steps": "of another version"}')
    for messages, refusal in (
        ([given[0], given[1], given[4]], "batch 2 to 3 are missing: what went in then is not known"),
        ([given[0], other], "a batch of its inputs cannot be read: MindInputs: "),
    ):
        mind = PlayedMind(player, key)
        for number, message in enumerate(Recording(recorded(tmp_path / "a.mcap", messages)).messages()):
            mind.take(message)
            if number == 0:
                assert (await eye.ask_one(key, None, MindView, PATIENCE)).agent == "uav"
        for _ in range(2):
            with pytest.raises(QueryFailed, match=refusal):
                await eye.ask_one(key, None, MindView, PATIENCE)
        mind.withdraw()


async def test_nothing_is_said_to_somebody_alive(studio: Studio) -> None:
    recorded(studio.path, fast(1001))
    said = Listener(await studio.connect("eye", "argosy"), FLEET)
    alive = await studio.connect("uav", "agentd")
    life = await alive.claim("uav")
    code, _, err = await replayed(studio, "--fleet", FLEET)
    assert (code, said.heard) == (1, [])
    danger = "it must not receive the percepts of another flight. Name another --fleet, or use --force"
    assert err == f"error: agentd uav of fleet `{FLEET}` is running: {danger}\n"
    code, *_ = await replayed(studio, "--fleet", FLEET, "--force", "--speed", "100")
    assert (code, len(said.heard)) == (0, 1001)
    alive.withdraw(life)
    await until(lambda: said.tokens[-1:] == [(keys.alive(FLEET, "uav", "agentd", alive.boot), False)], "it has gone")
    async with argosy("replay", studio.path, "--router", studio.endpoint, "--fleet", FLEET) as process:
        await process.until("replaying")
        await alive.claim("uav")
        code, _, err = await process.end(None)
    assert (code, err) == (1, f"error: stopped: agentd uav of fleet `{FLEET}` is running: {danger}\n")
    assert len(said.heard) < 2002


async def test_what_stands_under_keys_of_others_is_never_said(studio: Studio) -> None:
    wild = [
        f"**/uav1/percept/{FLEET}",
        "argosy/*/uav1/percept/x",
        "argosy/live/$*/x/y",
        "rt/turtle1/cmd_vel",
        "argosy//a/b",
    ]
    strange = [
        replace_at(altitude(n, n), 0.1, key=key) for n, key in enumerate([*wild, "argosy/recorder", "a?b/#/c/d"])
    ]
    tokens = [
        token(0.1, True)._replace(payload=codec(TokenSeen).encode(TokenSeen(key=key, alive=True)))
        for key in (keys.alive("live", "uav1", "agentd", "b"), "@/session", f"argosy/{FLEET}/*/alive/agentd/b", "//")
    ]
    recorded(studio.path, [altitude(0, 0), *strange, *tokens])
    bus = await studio.connect("eye", "argosy")
    said, live = Listener(bus, f"{FLEET}-replay"), Listener(bus, "live")
    bus.raw.tap("rt/**", said._take)
    code, out, err = await replayed(studio)
    assert (code, out.splitlines()[-1]) == (0, "replayed 0.1 s: 1 messages")
    assert err.startswith("warning: 11 messages were not published: their keys are outside the recorded fleets")
    assert [json.loads(payload)["parameters"] for _, _, payload, _ in said.heard] == [[0]]
    assert (live.heard, live.tokens, said.tokens) == ([], [], [])


async def test_what_cannot_be_read_is_left_out_and_told(studio: Studio) -> None:
    bad = [(Unread, b'{"base64": "!!!a"}', "", "put"), (Perception, b"{bad", codec_encoding("msgpack"), "put")]
    bad.append((TokenSeen, b"[", "", "token"))
    with studio.path.open("wb") as file:
        made = Writer(file)
        made.start()
        made.add_metadata(BEGUN, FACTS.metadata())
        for record, data, encoding, origin in bad:
            schema = made.register_schema(PREFIX + record.__name__, "jsonschema", b"{}")
            channel = made.register_channel(ALTITUDE, "json", schema, {"encoding": encoding, "origin": origin})
            made.add_message(channel, BEGIN, data, BEGIN)
        made.finish()
    code, out, err = await replayed(studio)
    assert (code, out.splitlines()[-1]) == (1, "replayed 0.0 s: 0 messages")
    nothing = "error: nothing was published: no message of this part and on these keys can be\n"
    assert err == f"warning: 3 messages were not published: they cannot be read\n{nothing}"
    code, _, err = await replayed(studio, "--loop", "--only", "nobody/**")
    assert (code, err) == (1, nothing)


async def test_ctrl_c_ends_it_and_a_loop_goes_on_until_then(studio: Studio) -> None:
    recorded(studio.path, fast(11))
    said = Listener(await studio.connect("eye", "argosy"), f"{FLEET}-replay")
    async with argosy("replay", studio.path, "--router", studio.endpoint, "--loop") as process:
        await until(lambda: len(said.heard) >= 33, "it is said three times")
        code, out, err = await process.end(signal.SIGINT)
    assert (code, err) == (130, "")
    assert "replayed" in out


async def test_where_no_router_is_it_is_one(endpoint: str, tmp_path: Path) -> None:
    path = recorded(tmp_path / "a.mcap", fast(501))
    async with argosy("replay", path, "--router", endpoint) as process:
        await process.until("replaying")
        async with session(endpoint, "eye", "argosy") as bus:
            said = Listener(bus, f"{FLEET}-replay")
            await until(lambda: len(said.heard) > 10, "it is heard")
        code, out, _ = await process.end()
    assert code == 130
    assert f"no router at {endpoint}: this replay is the router until it ends" in out


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [
        ("b.mcap", 2, "error: b.mcap: not an MCAP file: it does not begin like one"),
        ("a.mcap --from 5", 2, "error: --from 5: a.mcap ends after 0.2 s"),
        ("a.mcap --from 0.1 --to 0.1", 2, "error: --to 0.1: expected more than --from 0.1"),
        ("a.mcap --json", 2, "error: --json: only with --info"),
        ("a.mcap --info --only x", 2, "error: --only: not with --info, which publishes nothing"),
        ("a.mcap --fleet a/b", 2, "error: --fleet a/b: expected letters, digits, `_`, `-` and `.`"),
        ("c.mcap --fleet a", 2, "error: --fleet a: c.mcap has several fleets: second, test"),
        ("a.mcap --router tcp/192.0.2.1:7447", 1, "error: no router at tcp/192.0.2.1:7447"),
    ],
)
def test_bad_arguments_and_files_are_told_in_a_line(
    arguments: str,
    code: int,
    told: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    recorded(tmp_path / "a.mcap", fast(11))
    (tmp_path / "b.mcap").write_text("mission: x")
    two = [altitude(1, 1), replace_at(altitude(1, 1), 1, key=keys.percept("second", "u", "x"))]
    recorded(tmp_path / "c.mcap", two)
    assert main(["replay", *arguments.split()]) == code
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("option", "told"),
    [
        ("--from x", "expected seconds since the beginning of the recording, got `x`"),
        ("--speed 0", "expected a speed above 0, at most 1000, got `0`"),
    ],
)
def test_what_is_no_number_is_told(option: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["replay", "a.mcap", *option.split()])
    assert told in capsys.readouterr().err


def test_what_is_in_it_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    inputs = keys.trace(FLEET, "uav", "inputs")
    messages = [*fast(51), heard(inputs, stretch(0), 1), heard(inputs, stretch(2, agent="uav"), 2)]
    path = recorded(tmp_path / "a.mcap", messages)
    assert main(["replay", str(path), "--info"]) == 0
    out = capsys.readouterr().out
    lines = [line.split() for line in out.splitlines()]
    assert ["ended", "ctrl-C"] in lines
    assert "  uav  b1        incomplete: batches 1 of 3 of its inputs are missing" in out
    assert [ALTITUDE, "Perception", "51", "25.50"] in lines
    assert main(["replay", str(path), "--info", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["fleets"], told["seconds"], told["minds"][0]["missing"]) == ([FLEET], 2.0, [1])


def test_inputs_of_another_version_are_not_told_as_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    inputs = heard(keys.trace(FLEET, "uav", "inputs"), stretch(0))
    other = inputs._replace(payload=b'{"number": 1, "steps": "of another version"}')
    for name, messages, told in (
        (
            "a",
            [other, other],
            ["minds", "  uav  2 batches of its inputs cannot be read: another version of Argosy wrote them"],
        ),
        (
            "b",
            [other, inputs],
            ["minds", "  uav  b1        from its start to 0.0 s of mission time, its end is missing, 0"],
        ),
        ("c", [inputs._replace(encoding="text/plain;x")], ["no minds: the messages on `trace/inputs` are not"]),
        ("d", fast(1), ["no minds: `trace/inputs` was not recorded"]),
    ):
        path = recorded(tmp_path / f"{name}.mcap", messages)
        assert main(["replay", str(path), "--info"]) == 0
        lines = capsys.readouterr().out.splitlines()
        found = lines[lines.index("") + 1 :][: len(told)]
        assert all(line.startswith(wanted) for line, wanted in zip(found, told, strict=True)), found
    assert main(["replay", str(tmp_path / "b.mcap"), "--info", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["unread_inputs"] == [{"fleet": FLEET, "agent": "uav", "batches": 1}]


def test_what_was_messagepack_is_the_same_record_again() -> None:
    inputs = heard(keys.trace(FLEET, "u", "inputs"), stretch(0), 0, "msgpack")
    data = to_json(inputs.payload)
    assert data is not None
    again = to_msgpack(data)
    assert codec(MindInputs).decode(again, codec(MindInputs).encodings["msgpack"]) == stretch(0)
