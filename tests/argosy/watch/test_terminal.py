"""`argosy watch` as a user runs it: in a real terminal, with a real fleet."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

import pytest

from tests.argosy.beside import crowd_of, there
from tests.argosy.conftest import Start
from tests.argosy.watch.hostile import RAW, saying
from tests.argosy.watch.terminal import Terminal

ROUTER = """
import asyncio, sys, time
from commd.bus.bus import open_bus
async def serve():
    async with open_bus(sys.argv[1], fleet="crowd", name="board", daemon="commd", mode="router"):
        print("there", flush=True)
        await asyncio.sleep(600)
asyncio.run(serve())
"""
COLOUR = re.compile(rb"\x1b\[[0-9;]*(3[0-7]|38;[25]|9[0-7])[0-9;]*m")


def routed(endpoint: str) -> AbstractContextManager[None]:
    return there("-c", ROUTER, endpoint)


@pytest.fixture
def router(endpoint: str) -> Iterator[None]:
    with routed(endpoint):
        yield


def watch(endpoint: str, *arguments: str, **terminal: object) -> Terminal:
    return Terminal(["argosy", "watch", "--router", endpoint, *arguments], **terminal)  # type: ignore[arg-type]


def test_a_real_flight_is_watched_and_its_agent_looked_into(single_uav: Path, endpoint: str, start: Start) -> None:
    text = single_uav.read_text().replace("radius: 500", "radius: 50000").replace("timeout: 10min", "timeout: 10h")
    single_uav.write_text(text.replace("waypoint(-27.603683", "waypoint(-27.3"))  # 34 km away: it flies until the end
    running = start(single_uav, "--speed", "3", "--plain", real_daemons=True)
    with watch(endpoint, "--mission", str(single_uav), columns=120, lines=24) as terminal:
        terminal.shows("1 of 1 agent  1 of 1 robot  1 of 1 board")
        terminal.until(lambda text: re.search(r"uav1  GUIDED +armed", text) is not None, "the vehicle flies")
        terminal.until(
            lambda text: re.search(r"● +uav +(acting|flying) +1 +\+!", text) is not None, "the agent's intention"
        )
        terminal.shows("▸ goto(")
        terminal.press("\r")
        terminal.shows("INTENTIONS 1")
        terminal.shows("‹ +!fly_mission")
        terminal.press("2")
        terminal.shows("FROM PERCEPT")
        terminal.press("3")
        terminal.shows("+!fly_mission  by uav.asl:")
        terminal.press("\x1b")
        terminal.shows("TIMELINE")
        terminal.press("q")
        assert terminal.end() == 0
    assert running.process.poll() is None, "the flight goes on"


def test_a_router_that_is_lost_is_said_at_once_and_comes_back_by_itself(endpoint: str) -> None:
    with watch(endpoint) as terminal, ExitStack() as stack:
        with routed(endpoint):
            stack.enter_context(crowd_of(2, endpoint))
            terminal.shows("2 of 2 agents  2 of 2 robots")
        terminal.until(lambda text: re.search(r"ROUTER LOST for [3-9]", text) is not None, "how long")
        assert "2 of 2 agents" in terminal.text, "what was known last stays"
        with routed(endpoint):
            terminal.until(lambda text: "ROUTER LOST" not in text, "the banner goes")
            terminal.shows("answers again")
            terminal.press("q")
            assert terminal.end() == 0


def test_without_a_router_it_waits_visibly_and_begins_when_one_comes(endpoint: str) -> None:
    with watch(endpoint) as terminal:
        terminal.shows("no router yet, waiting for")
        terminal.shows("Nobody listens there")
        with routed(endpoint):
            terminal.shows("no daemon is on the bus yet, waiting for")
            with crowd_of(1, endpoint):
                terminal.shows("1 of 1 agent")
            terminal.press("\x03")
            assert terminal.end() == 0


def test_it_can_be_left_while_it_dials(endpoint: str) -> None:
    with watch(endpoint) as terminal:
        terminal.shows("no router yet")
        terminal.press("q")
        assert terminal.end() == 0


@pytest.mark.parametrize("term", ["xterm-256color", "linux"])
def test_it_works_in_terminals_of_all_kinds_and_follows_their_size(router: None, endpoint: str, term: str) -> None:
    with crowd_of(2, endpoint), watch(endpoint, TERM=term) as terminal:
        terminal.shows("+!visit(3)")
        terminal.until(lambda text: text.count("GUIDED") == 2, "the vehicles")
        assert (">" if term == "linux" else "▌") in terminal.text
        assert COLOUR.search(terminal.output)
        terminal.size(50, 12)
        terminal.until(lambda text: "space pause" in text.splitlines()[-1], "the keys at the new end")
        terminal.size(140, 40)
        terminal.until(lambda text: "q quit" in text.splitlines()[-1], "the keys at the new end")
        terminal.press("j\r")
        terminal.shows("2 BELIEFS")
        terminal.shows("seen(0,-27.6,-48.5)")
        terminal.press("q")
        assert terminal.end() == 0
        if term == "linux":
            assert not re.search(rb"\x1b\[[0-9;]*38;[25]", terminal.output), "eight colours are what it has"


def test_no_color_is_honoured(router: None, endpoint: str) -> None:
    with crowd_of(1, endpoint), watch(endpoint, NO_COLOR="1") as terminal:
        terminal.shows("+!visit(3)")
        terminal.press("j\r")
        terminal.shows("INTENTIONS 3")
        terminal.press("q")
        assert terminal.end() == 0
        assert not COLOUR.search(terminal.output)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [([], b"error: argosy watch needs a terminal"), (["--mission", "nowhere"], b"no such file")],
    ids=["in a pipe", "without its mission"],
)
def test_it_says_in_a_line_why_it_cannot_begin(arguments: list[str], told: bytes) -> None:
    command = [sys.executable, "-m", "argosy", "watch", *arguments]
    done = subprocess.run(command, capture_output=True, stdin=subprocess.DEVNULL)
    assert done.returncode == 2
    assert told in done.stderr
    assert b"Traceback" not in done.stderr


def test_nothing_that_a_fleet_says_is_a_command_to_the_terminal_or_ends_the_view(endpoint: str) -> None:
    with saying(endpoint), watch(endpoint, "--fleet", "hostile", columns=160, lines=90) as terminal:
        terminal.shows("+!evil")
        terminal.until(lambda text: "GUIDED" in text and "▸ goto(" in text, "the vehicle")
        assert "1 of 1 agent  1 of 1 robot  1 of 1 board" in terminal.text
        terminal.press("\x1b[B\r")
        terminal.until(lambda text: "INTENTIONS 1" in text and "DROPPED" in text, "the mind")
        terminal.until(lambda text: "BELIEFS" in text and "FROM " in text and "fails" in text, "all panes")
        terminal.press("q")
        assert terminal.end() == 0
        assert b"PWNED" in terminal.output, "its words are shown"
        assert not [sequence for sequence in RAW if sequence in terminal.output]
        assert b"defect" not in terminal.output


def test_markup_that_a_fleet_says_is_shown_as_text(endpoint: str) -> None:
    with saying(endpoint, "markup"), watch(endpoint, "--fleet", "hostile", columns=400, lines=50) as terminal:
        terminal.shows("+!evil<img src=x")
        terminal.shows("[bold red]rich[/]")
        terminal.press("q")
        assert terminal.end() == 0
        assert b"\x1b]8;" not in terminal.output, "no link"
        assert b"defect" not in terminal.output


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_who_ends_it_gets_his_terminal_back(router: None, endpoint: str, number: int) -> None:
    with watch(endpoint) as terminal:
        terminal.shows("no daemon is on the bus yet")
        before = len(terminal.output)
        os.kill(terminal.pid, number)
        assert terminal.end() == 0
        after = terminal.output[before:]
        assert b"\x1b[?1049l" in after, "the screen of before"
        assert b"\x1b[?25h" in after, "the cursor"
