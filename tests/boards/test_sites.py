"""Two sites of two boards each, linked by one link: mail and presence cross it, percepts only to those who listen.

n2 --- n1 === s1 --- s2
"""

import select
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import pytest

from tests.boards.fleet import Fleet
from tests.boards.network import Network
from tests.boards.numbered_mail import Post, judge
from tests.support.processes import ROOT

SITES = ("n1", "n2", "s1", "s2")
DIALS: dict[str, list[str]] = {"n1": [], "n2": ["n1"], "s1": ["n1"], "s2": ["s1"]}
AGENTS = {"ann": "n1", "bob": "n2", "cid": "s1", "dan": "s2"}
PERCEPTS = 400
TEXT_BYTES = 600
"""Of each percept: all of them are far more than what the routers say to one another while they are published."""
ROUTER = "tcp/127.0.0.1:7447"
"""Of each board, for its own daemons."""
_BUS = """\
import asyncio, sys, time
from commd.bus.bus import open_bus
from schemas.wire import keys
from schemas.wire.records import Perception
from tests.support.buses import subscribed, until
async def main(what, endpoint, count, size):
    key = keys.percept("letters", "uav1", "global_pos")
    async with open_bus(endpoint, fleet="letters", name=what, daemon="test", patience=20) as bus:
        if what != "listen":
            if what == "tell":
                await subscribed(bus, key)
            for number in range(count):
                bus.put(key, Perception(name="global_pos", parameters=(number, "x" * size)))
                await asyncio.sleep(0.002)
            assert await bus.round_trip(20)
        else:
            come = []
            bus.subscribe(key, Perception, lambda _, one: come.append(one))
            assert await bus.round_trip(20)
            print("listening", flush=True)
            await asyncio.get_running_loop().run_in_executor(None, sys.stdin.readline)
            await until(lambda: len(come) >= count, "all has come", 20)
            print(len(come), flush=True)
asyncio.run(main(sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])))
"""


@pytest.fixture
def network(namespaces: None) -> Iterator[Network]:
    """Four boards; those that are not to be linked cannot reach one another either."""
    with Network(SITES) as made:
        for one, other in (("n2", "s1"), ("n2", "s2"), ("n1", "s2")):
            made.part(one, other)
        yield made


@pytest.fixture
def sites(network: Network, tmp_path: Path) -> Iterator[Fleet]:
    """A fleet whose boards have routers that dial their neighbours alone; its commd run."""
    post = Post(AGENTS, each=40, pause=60)
    for name, program in post.programs().items():
        (tmp_path / f"{name}.asl").write_text(program)
    file = tmp_path / "mission.yaml"
    file.write_text(post.mission().replace("BOARDS", "{" + ", ".join(f"{board}: {{}}" for board in SITES) + "}"))
    with Fleet(network, file, tmp_path / "state") as team:
        for board in DIALS:
            _commd(team, board)
        for board in SITES:
            team.ready(board, "commd")
        yield team
        print(team.transcript())


def _commd(team: Fleet, board: str) -> None:
    """Start the commd of a board: it dials its neighbours alone."""
    options = ["--listen", f"tcp/{team.network.addresses[board]}:7448"]
    for other in DIALS[board]:
        options += ["--connect", f"tcp/{team.network.addresses[other]}:7448"]
    team.start(board, "commd", *options)


def _agents(team: Fleet) -> None:
    for board in SITES:
        team.start(board, "agentd")
    for board in SITES:
        team.ready(board, "agentd")


def test_mail_crosses_the_sites_in_order_and_a_cut_of_their_link(sites: Fleet) -> None:
    _agents(sites)
    look = sites.look("n2")
    look.until(lambda one: {"ann/agentd", "bob/agentd", "cid/agentd", "dan/agentd"} <= set(one.alive()), "all are seen")
    sites.network.part("n1", "s1")
    look.until(lambda one: not {"cid/agentd", "dan/agentd"} & set(one.alive()), "the other site is gone")
    assert "ann/agentd" in look.alive(), "the board of the same site is as near as before"
    time.sleep(1)
    sites.network.join("n1", "s1")
    look.until(lambda one: {"cid/agentd", "dan/agentd"} <= set(one.alive()), "the other site is back")
    post = Post(AGENTS, each=40, pause=60)
    minds = {name: sites.look(board) for name, board in AGENTS.items()}

    def all_taken(_: object) -> bool:
        beliefs = {name: one.mind(name) for name, one in minds.items()}
        if any(found is None for found in beliefs.values()):
            return False
        verdict = judge(post, {name: found or [] for name, found in beliefs.items()})
        return (verdict.sent, verdict.taken) == (post.total, post.total)

    look.until(all_taken, "all messages are taken", 90)
    verdict = judge(post, {name: one.mind(name) or [] for name, one in minds.items()})
    assert verdict.clean, verdict.details


def test_percepts_cross_only_links_behind_which_somebody_listens(sites: Fleet) -> None:
    behind = {"s1/commd", "s2/commd"}
    sites.look("n2").until(lambda one: behind <= set(one.alive()), "the other site is seen")
    with _crossing(sites.network, "s1") as unheard:
        _put(sites.network)
    with (
        _listener(sites.network, "s1") as listener,
        _crossing(sites.network, "s1") as heard,
        _crossing(sites.network, "s2") as beyond,
    ):
        _put(sites.network, "tell")
        assert listener() == PERCEPTS
    smallest = TEXT_BYTES * PERCEPTS
    assert heard() > smallest, "with a listener they come: the count can see them"
    assert unheard() < smallest / 5, "nobody listens at the other site: they stay at theirs"
    assert beyond() < smallest / 5, "they go no further than to the listener"
    with _listener(sites.network, "s2") as listener:
        _put(sites.network, "tell")
        assert listener() == PERCEPTS, "routers pass on what comes from a router: s2 hears n2 by way of n1 and s1"


def test_a_listener_hears_again_what_comes_by_way_of_a_board_that_was_lost(sites: Fleet) -> None:
    look = sites.look("n2")
    look.until(lambda one: {"s1/commd", "s2/commd"} <= set(one.alive()), "the other site is seen")
    with _listener(sites.network, "s2") as listener:
        sites.kill("s1", "commd")
        look.until(lambda one: not {"s1/commd", "s2/commd"} & set(one.alive()), "nobody is seen behind what is lost")
        _put(sites.network)
        _commd(sites, "s1")
        sites.ready("s1", "commd")
        look.until(lambda one: "s2/commd" in one.alive(), "the board behind it is back")
        _put(sites.network, "tell")
        assert listener() == PERCEPTS, "what was told meanwhile is lost, what came after is heard"


def _put(network: Network, how: Literal["put", "tell"] = "put") -> None:
    """Publish `PERCEPTS` percepts on board n2; `tell` waits until somebody listens."""
    command = [*network.within("n2"), sys.executable, "-c", _BUS, how, ROUTER, str(PERCEPTS), str(TEXT_BYTES)]
    subprocess.run(command, check=True, cwd=ROOT, timeout=60)


@contextmanager
def _listener(network: Network, board: str) -> Iterator[Callable[[], int]]:
    """Listen on a board; yields what tells how many have come."""
    command = [*network.within(board), sys.executable, "-c", _BUS, "listen", ROUTER, str(PERCEPTS), str(TEXT_BYTES)]
    process = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def count() -> int:
        out, _ = process.communicate("\n", timeout=30)
        return int(out)

    try:
        assert select.select([process.stdout], [], [], 30)[0], "the listener says nothing"
        assert process.stdout.readline() == "listening\n"
        yield count
    finally:
        process.kill()
        process.wait(10)


@contextmanager
def _crossing(network: Network, board: str) -> Iterator[Callable[[], int]]:
    """Count the bytes that come in by a board's cable while the block lasts; yields what tells them."""
    counted: list[int] = [_received(network, board)]
    yield lambda: counted[1] - counted[0]
    counted.append(_received(network, board))


def _received(network: Network, board: str) -> int:
    command = [*network.within(board), "cat", "/proc/net/dev"]
    lines = subprocess.run(command, check=True, capture_output=True, text=True, timeout=20).stdout.splitlines()
    return next(int(line.partition(":")[2].split()[0]) for line in lines if line.strip().startswith("cable:"))
