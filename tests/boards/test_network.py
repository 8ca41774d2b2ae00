"""The harness itself: boards reach one another, cuts are what they claim to be, and nothing is left behind."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.boards.network import GROUND, GROUND_ADDRESS, Network, sweep
from tests.support.processes import ROOT

_TALK = """\
import socket, sys
one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
one.bind(("0.0.0.0", 5000)); one.settimeout(20)
print("ready", flush=True)
print(one.recv(9).decode(), flush=True)
"""
_SEND = """\
import socket, sys, time
one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for _ in range(int(sys.argv[2])):
    one.sendto(sys.argv[3].encode(), (sys.argv[1], 5000)); time.sleep(0.02)
"""


def _listening(network: Network, place: str) -> subprocess.Popen[str]:
    command = [*network.within(place), sys.executable, "-c", _TALK]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


def _send(network: Network, place: str, address: str, word: str, times: int = 10) -> subprocess.CompletedProcess[str]:
    command = [*network.within(place), sys.executable, "-c", _SEND, address, str(times), word]
    return subprocess.run(command, capture_output=True, text=True, timeout=30)


def _hears(process: subprocess.Popen[str]) -> str:
    out, _ = process.communicate(timeout=30)
    return out.strip()


def test_boards_reach_one_another_and_the_ground(network: Network) -> None:
    for place, address in ((GROUND, GROUND_ADDRESS), ("pi2", network.addresses["pi2"])):
        listener = _listening(network, place)
        assert _send(network, "pi1", address, "hello").returncode == 0
        assert _hears(listener) == "hello"


@pytest.mark.parametrize(
    ("cut", "heal", "told"),
    [("unplug", "plug", False), ("down", "up", True)],
)
def test_a_cut_board_reaches_nobody_until_it_is_healed(network: Network, cut: str, heal: str, told: bool) -> None:
    _send(network, "pi1", network.addresses["pi2"], "before")  # or the kernel keeps the first packet for its ARP reply
    listener = _listening(network, "pi2")
    getattr(network, cut)("pi1")
    sent = _send(network, "pi1", network.addresses["pi2"], "cut")
    assert (sent.returncode != 0) == told, "only who takes his own interface down is told of it"
    getattr(network, heal)("pi1")
    _send(network, "pi1", network.addresses["pi2"], "healed", 50)
    assert _hears(listener) == "healed"


def test_two_boards_that_are_parted_still_reach_the_third(network: Network) -> None:
    second, third = _listening(network, "pi2"), _listening(network, "pi3")
    network.part("pi1", "pi2")
    _send(network, "pi1", network.addresses["pi2"], "parted")
    _send(network, "pi1", network.addresses["pi3"], "round")
    assert _hears(third) == "round"
    network.join("pi1", "pi2")
    _send(network, "pi1", network.addresses["pi2"], "joined", 50)
    assert _hears(second) == "joined"


def test_what_a_crashed_run_left_is_removed_with_what_runs_there(network: Network) -> None:
    """A process makes a network, starts another one there and is killed before it can clean up."""
    crash = (
        "import os, subprocess, sys\n"
        "from tests.boards.network import Network\n"
        "made = Network(['pi1']).__enter__()\n"
        "command, nothing = [*made.within('pi1'), 'sleep', '300'], subprocess.DEVNULL\n"
        "left = subprocess.Popen(command, stdout=nothing, stderr=nothing)\n"
        "print(made.namespace('pi1'), left.pid, flush=True)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    run = subprocess.run([sys.executable, "-c", crash], capture_output=True, text=True, cwd=ROOT, timeout=30)
    name, pid = run.stdout.split()
    assert os.path.exists(f"/run/netns/{name}")
    sweep()
    assert not os.path.exists(f"/run/netns/{name}")
    state = Path(f"/proc/{pid}/stat")
    assert not state.exists() or state.read_text().split()[2] == "Z"
    assert os.path.exists(f"/run/netns/{network.namespace('pi1')}"), "those of a living process stay"
