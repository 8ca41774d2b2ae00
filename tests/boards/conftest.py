"""Boards of network namespaces, and fleets on them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.boards.fleet import Fleet
from tests.boards.network import Network

BOARDS = ("pi1", "pi2", "pi3")


@pytest.fixture
def network(namespaces: None) -> Iterator[Network]:
    """Three boards and the ground."""
    with Network(BOARDS) as made:
        yield made


@pytest.fixture
def fleet(network: Network, tmp_path: Path) -> Iterator[Callable[..., Fleet]]:
    """Return what writes a mission for the boards, with its programs, and makes a fleet of it; nothing is started yet.

    In the text of the mission `BOARDS` stands for the three of them.
    """
    made: list[Fleet] = []

    def make(mission: str, **programs: str) -> Fleet:
        for name, program in programs.items():
            (tmp_path / f"{name}.asl").write_text(program)
        entries = ", ".join(f"{name}: {{address: {address}}}" for name, address in network.addresses.items())
        path = tmp_path / "mission.yaml"
        path.write_text(mission.replace("BOARDS", f"{{{entries}}}"))
        made.append(Fleet(network, path, tmp_path / "state"))
        return made[-1]

    yield make
    for one in made:
        one.__exit__(None, None, None)
        print(one.transcript())  # shown with a test that fails
