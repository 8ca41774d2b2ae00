"""`argosy echo`, `hz`, `list` as users type them, on a real bus: JSON and MessagePack, one router, several boards."""

import asyncio
import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from typing import Any, cast

import pytest
import zenoh

from argosy.__main__ import main
from argosy.tools import echo
from argosy.tools.bus_tap import LATER, ROOM, BusTap, Copies, Heard, key_expressions
from argosy.tools.rate import MOST_KEYS, Rates, figures
from commd.bus.bus import Bus, open_bus
from schemas.wire import keys
from schemas.wire.codec import Wire
from schemas.wire.records import Perception
from tests.argosy.beside import beside
from tests.argosy.tools.flying import Trial, trial
from tests.argosy.watch.terminal import Terminal
from tests.support import forked
from tests.support.buses import Connect, subscribed, until
from tests.support.processes import ROOT, running


@pytest.fixture(scope="module")
def flying(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Trial]:
    with trial(tmp_path_factory.mktemp("trial"), wire="msgpack") as mission:
        yield mission


@contextlib.contextmanager
def talking(endpoint: str, say: Callable[[Bus], Coroutine[Any, Any, None]], wire: Wire = "json") -> Iterator[None]:
    """Let a router and an agent's bridge run in a thread; `say` talks again and again."""
    ready, stop = threading.Event(), threading.Event()

    async def serve() -> None:
        async with (
            open_bus(endpoint, fleet="sar", name="b", daemon="commd", mode="router"),
            open_bus(endpoint, fleet="sar", name="uav1", daemon="bridged", wire=wire) as bus,
        ):
            await bus.claim("uav1")
            ready.set()
            while not stop.is_set():
                await say(bus)

    with beside(serve, ready, stop):
        yield


async def tell(bus: Bus) -> None:
    """One percept, every tenth of a second."""
    bus.put(
        keys.percept("sar", "uav", "altitude"),
        Perception(header=bus.header("percept"), name="altitude", parameters=(4.9,)),
    )
    await asyncio.sleep(0.1)


def typed(*words: str) -> tuple[int, list[str], str]:
    """Type a command; return its exit code, the lines that it printed, and what it said besides."""
    done = forked.run(["argosy", *words], cwd=ROOT)
    assert "Traceback" not in done.stderr
    return done.returncode, done.stdout.splitlines(), done.stderr.strip()


TOLD = ("percept/**", "percept_by_hand/**", "status/**", "services", "manifest", "run", "health/**")
"""What is listened to of each who."""


@pytest.mark.parametrize("wire", ["json", "msgpack"])
def test_echo_shows_a_record_in_each_line(endpoint: str, wire: Wire) -> None:
    with talking(endpoint, tell, wire):
        code, lines, said = typed("echo", "--router", endpoint, "--count", "2")
        assert (code, said, len(lines)) == (0, "", 2)
        line = r"[\d:]{8}\.\d{3} argosy/sar/uav/percept/altitude  altitude\(4\.9\)"
        assert all(re.fullmatch(line, one) for one in lines)
        code, lines, _ = typed("echo", "uav", "--router", endpoint, "--count", "1", "--fleet", "sar")
        assert re.fullmatch(line, lines[0]), "the key as any tool of Zenoh takes it, whatever was asked for"
        code, lines, _ = typed("echo", "uav/percept/*", "--json", "--router", endpoint, "--count", "1")
        one = json.loads(lines[0])
        assert one["key"] == "argosy/sar/uav/percept/altitude"
        assert one["encoding"] == f"application/{wire};argosy.Perception/1"
        assert one["record"]["parameters"] == [4.9]
        code, lines, _ = typed("echo", "argosy/sar/**", "--raw", "--router", endpoint, "--count", "1")
        assert lines[0].startswith("argosy/sar/uav/percept/altitude ")
        assert "altitude" in "\n".join(lines).partition(" ")[2], (
            "as it came: a stamp may have any byte, ends of lines too"
        )


def test_a_reader_that_goes_ends_it_and_so_does_ctrl_c(endpoint: str) -> None:
    with talking(endpoint, tell):
        command = f"{sys.executable} -m argosy echo --router {endpoint} | head -n 1"
        done = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=90, cwd=ROOT)
        assert (done.returncode, done.stderr, done.stdout.count("\n")) == (0, "", 1)
        with running("argosy", "echo", "--router", endpoint) as echo:
            echo.says("altitude(4.9)")
            echo.signal(signal.SIGINT)
            assert echo.ends() == 130
            assert "Traceback" not in echo.text


def test_when_nothing_is_heard_it_is_said_who_is_there(endpoint: str) -> None:
    with talking(endpoint, tell), running("argosy", "echo", "nobody", "--router", endpoint) as echo:
        echo.says("note: nothing was published by or to `nobody` within 3 s; fleet sar has uav1")
        assert echo.process.poll() is None, "it goes on listening"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["echo", "a//b"], "expected a key expression such as `uav/percept/*`, got `a//b`"),
        (["echo", "--count", "0"], "expected a number, 1 or more, got `0`"),
        (["echo", "--fleet", "**"], "argument --fleet: Expected a name of letters, digits"),
        (["list", "--fleet", "a#b"], "argument --fleet: Expected a name of letters, digits"),
        (["act", ""], "argument AGENT: Expected a name of letters, digits"),
        (["act", "*", "land"], "argument AGENT: Expected a name of letters, digits"),
        (["why", "u$v"], "argument agent: Expected a name of letters, digits"),
        (["why", "uav", "--last", "abc"], "expected a number, 1 or more, got `abc`"),
        (["list", "--wait", "0"], "expected more than 0 s, got 0"),
        (["hz", "--window", "0"], "expected 100ms to 1h, got 0"),
        (["hz", "--window", "soon"], "Expected a duration such as `5s`, `500ms` or `15min`, got `soon`"),
    ],
)
def test_a_wrong_command_is_said(words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert message in capsys.readouterr().err


def test_hz_measures_each_key(endpoint: str) -> None:
    with talking(endpoint, tell):
        code, lines, said = typed("hz", "--router", endpoint, "--once", "--window", "2s", "--fleet", "sar")
        assert (code, said) == (0, "")
        assert lines[0].split() == [
            "key",
            "Hz",
            "min",
            "ms",
            "max",
            "ms",
            "jitter",
            "ms",
            "B/s",
            "n",
            "last",
            "s",
            "ago",
        ]
        key, rate, *_, size, number, last = lines[1].split()
        assert key == "argosy/sar/uav/percept/altitude"
        assert 3 < float(rate) < 11
        assert int(number) >= 6
        assert float(last) < 2
        assert int(size) > 100
        code, lines, said = typed("hz", "nobody", "--router", endpoint, "--once", "--window", "500ms")
        assert (code, lines) == (1, [])
        assert re.search(r"nothing was published by or to `nobody` within \d\.\d s; fleet sar has uav1", said), said


def test_figures_are_those_of_the_intervals_in_the_window() -> None:
    assert figures([10.0, 10.1, 10.3], 300, 2.0) == ("1.50", "100.0", "200.0", "50.0", "150", "3")
    assert figures([10.0], 100, 5.0) == ("0.20", "-", "-", "-", "20", "1")
    rates = Rates(1.0)
    for at in (0.0, 0.5, 1.0, 1.5):
        rates.add("a", at, 10)
    assert rates.rows(1.6, 0.0)[0][-2:] == ("2", "0.1")
    assert not rates.silent(1.6)


def test_a_channel_that_has_gone_quiet_says_since_when() -> None:
    rates = Rates(5.0)
    for at in (0.0, 1.0, 2.0):
        rates.add("a", at, 10)
    assert rates.rows(6.5, 0.0) == [("a", "0.20", "-", "-", "-", "2", "1", "4.5")]
    assert rates.rows(16.0, 0.0) == [("a", "0.00", "-", "-", "-", "0", "0", "14.0")]
    assert rates.silent(16.0)


def test_keys_that_are_silent_make_room_for_new_ones() -> None:
    rates = Rates(5.0)
    for number in range(MOST_KEYS):
        rates.add(f"k{number}", number / 1000, 1)
    rates.add("k0", 5.0, 1)
    rates.add("new", 5.0, 1)
    assert rates.left_out == 1, "all of them are heard in this window"
    rates.add("new", 6.5, 1)
    assert rates.left_out == 1
    names = {row[0] for row in rates.rows(6.5, 0.0)}
    assert {"k0", "new"} <= names
    assert "k1" not in names


def test_hz_on_a_terminal_draws_the_silence(endpoint: str) -> None:
    quiet = threading.Event()

    async def say(bus: Bus) -> None:
        await (asyncio.sleep(0.05) if quiet.is_set() else tell(bus))

    silence = re.compile(r"percept/altitude +0\.00 +- .*nothing was published in the last 0\.5 s", re.DOTALL)
    hz = ["argosy", "hz", "uav", "--router", endpoint, "--window", "500ms"]
    with talking(endpoint, say), Terminal(hz, columns=120) as terminal:
        terminal.until(lambda text: re.search(r"percept/altitude +[1-9]", text) is not None, "its rate")
        quiet.set()
        terminal.until(lambda text: silence.search(text) is not None, "the silence")


def said_by(board: str, *times: float) -> list[Heard]:
    return [Heard("x", b"ok", "", at, at, board=board) for at in times]


def test_what_is_said_again_in_the_same_words_is_no_copy_of_another_board() -> None:
    copies = Copies()
    assert [copies.is_new(one) for one in said_by("pi1", 0.0, 0.1, 0.2)] == [True, True, True]
    assert [copies.is_new(one) for one in said_by("pi2", 0.1, 0.2, 0.3)] == [False, False, False]
    assert [copies.is_new(one) for one in said_by("pi2", 0.4)] == [True], "pi1 has told it three times only"
    assert [copies.is_new(one) for one in said_by("pi1", 0.5)] == [False]
    assert [copies.is_new(one) for one in said_by("pi2", 0.6 + LATER)] == [True]


def test_a_board_that_tells_no_more_does_not_silence_the_other() -> None:
    copies = Copies()
    assert all(copies.is_new(one) for one in said_by("pi1", *(number / 10 for number in range(10))))
    heard = [copies.is_new(one) for one in said_by("pi2", *(3 + number / 10 for number in range(10)))]
    assert heard == [True] * 10


@pytest.mark.parametrize("key", ["**/state", "uav/percept/state", "argosy/*/*/percept/st$*", "uav"])
def test_echo_begins_with_the_last_known_value_of_a_percept_that_does_not_change(flying: Trial, key: str) -> None:
    typed("echo", "uav/percept/state", "--mission", str(flying.path), "--count", "1")  # from now on it is known
    with running("argosy", "echo", key, "--mission", str(flying.path)) as echo:
        echo.says('argosy/trial/uav/percept/state  state("STABILIZE",true,false)  (last known)')
    if key != "uav":  # of which there is more
        _, [line], _ = typed("echo", key, "--mission", str(flying.path), "--count", "1", "--json")
        told = json.loads(line)
        assert (told["key"], told["last_known"]) == ("argosy/trial/uav/percept/state", True)
        assert told["record"]["parameters"] == ["STABILIZE", True, False]


async def test_a_value_that_was_asked_for_is_not_shown_after_a_newer_one(capsys: pytest.CaptureFixture[str]) -> None:
    said = [("a", "old", True), ("a", "new", False), ("a", "older", True), ("b", "kept", True), ("b", "kept too", True)]

    class Said:
        async def samples(self) -> AsyncIterator[Heard]:
            for key, text, known in said:
                yield Heard(key, text.encode(), "text/plain", 0.0, 0.0, last_known=known)

    noticing = asyncio.create_task(asyncio.sleep(0))
    await echo._echo(cast(BusTap, Said()), lambda heard: heard.payload.decode(), None, noticing)
    assert capsys.readouterr().out.split("\n") == ["old", "new", "kept", "kept too", ""]


def test_list_shows_who_serves_and_who_says_what(flying: Trial) -> None:
    code, lines, said = typed("list", "--mission", str(flying.path), "--types")
    assert (code, said) == (0, "")
    assert lines[0] == "argosy/trial/base  agent"
    uav = lines[lines.index("argosy/trial/uav  agent") : lines.index("argosy/trial/uav1  robot")]
    assert "  query  argosy/trial/uav/action/takeoff  Action -> ActionStatus" in uav
    assert "  query  argosy/trial/uav/percept/**  nothing -> Perception" in uav
    assert "  query  argosy/trial/uav/mind  nothing -> MindView" in uav
    assert any(
        re.fullmatch(r"  put    argosy/trial/local/health/agentd  Health  [\d.]+ Hz, \d+ B", line) for line in lines
    )
    base = lines[: lines.index("argosy/trial/local  board")]
    assert not any("action" in line for line in base), "it has no robot"
    assert "  query  argosy/trial/uav1/stop  StopOrder -> Outcome" in lines
    assert "  query  argosy/trial/local/mailboxes  nothing -> Mailboxes" in lines


def test_what_cannot_be_shown_is_written_otherwise_and_what_is_lost_is_no_success(endpoint: str) -> None:
    async def speak(bus: Bus) -> None:
        key = keys.percept("sar", "uav", "name")
        bus.put(key, Perception(header=bus.header("percept"), name="name", parameters=("Zoë",)))
        await asyncio.sleep(0.1)

    def command(line: str, **environment: str) -> subprocess.CompletedProcess[str]:
        said = f"{sys.executable} -m argosy echo --count 1 --router {endpoint} {line}"
        env = {**os.environ, **environment}
        return subprocess.run(said, shell=True, capture_output=True, text=True, timeout=60, cwd=ROOT, env=env)

    with talking(endpoint, speak):
        ascii_alone = command("", LC_ALL="C", PYTHONUTF8="0", PYTHONCOERCECLOCALE="0")
        assert (ascii_alone.returncode, ascii_alone.stderr) == (0, "")
        assert 'name("Zo\\xeb")' in ascii_alone.stdout
        closed = command(">&-")
        assert (closed.returncode, closed.stderr) == (0, "")
        full = command("> /dev/full")
        assert full.returncode == 1
        assert full.stderr == "error: the output cannot be written: No space left on device\n"


async def test_list_of_nobody_fails(connect: Connect, endpoint: str) -> None:
    code, lines, said = await asyncio.to_thread(typed, "list", "--router", endpoint, "--wait", "300ms")
    assert (code, lines) == (1, [])
    assert said == f"error: no daemon of any fleet is on the bus at {endpoint}"


@pytest.mark.parametrize(
    ("text", "expressions"),
    [
        (None, [f"argosy/f/*/{rest}" for rest in TOLD]),
        ("**", ["argosy/f/**"]),
        ("uav", [f"argosy/f/uav/{rest}" for rest in TOLD]),
        ("uav/percept/*", ["argosy/f/uav/percept/*", "uav/percept/*"]),
        ("**/altitude", ["argosy/f/**/altitude", "**/altitude"]),
        ("argosy/*/uav/**", ["argosy/*/uav/**"]),
        ("@/*/router", ["@/*/router"]),
    ],
)
def test_a_name_or_a_key_expression_says_what_is_listened_to(text: str | None, expressions: list[str]) -> None:
    assert key_expressions(text, "f") == expressions


@pytest.mark.parametrize("text", ["**/altitude", "*/**/altitude", "argosy/**", "**", "uav", "uav/percept/*", None])
async def test_a_record_is_heard_once_though_many_expressions_match_its_key(connect: Connect, text: str | None) -> None:
    speaker, listener = await connect("uav1"), await connect("x")
    ears = BusTap(listener, key_expressions(text, "test"))
    ours, theirs = keys.percept("test", "uav", "altitude"), "uav/percept/altitude"
    last = keys.health("test", "uav", "end") if text in ("argosy/**", "**", "uav", None) else theirs
    await subscribed(speaker, ours)
    for key in (ours, ours, last):
        speaker._session.put(key, b"{}", congestion_control=zenoh.CongestionControl.BLOCK)
    heard = []
    async for one in ears.samples(asyncio.get_running_loop().time() + 90):
        heard.append(one.key)
        if one.key == last:
            break
    assert heard == [ours, ours, last]


async def test_what_comes_faster_than_it_is_shown_is_counted(connect: Connect) -> None:
    speaker, listener = await connect("uav1"), await connect("x")
    ears = BusTap(listener, ["argosy/test/**"])
    key = keys.health("test", "uav1", "bridged")
    await subscribed(speaker, key)
    for _ in range(ROOM + 500):
        speaker._session.put(key, b"{}", congestion_control=zenoh.CongestionControl.BLOCK)
    await until(lambda: ears.dropped == 500, "the excess is counted")
    taken = 0
    async for _ in ears.samples(asyncio.get_running_loop().time() + 90):
        taken += 1
        if taken == ROOM:
            break
    assert not ears._waiting
