"""Boards of network namespaces, and fleets on them."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
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


def fleet_of(network: Network, folder: Path, mission: str, **programs: str) -> Fleet:
    """Write a mission for the boards, in whose text `BOARDS` stands for them, with its programs, and make its fleet.

    Nothing is started yet.
    """
    for name, program in programs.items():
        (folder / f"{name}.asl").write_text(program)
    entries = ", ".join(f"{name}: {{address: {address}}}" for name, address in network.addresses.items())
    path = folder / "mission.yaml"
    path.write_text(mission.replace("BOARDS", f"{{{entries}}}"))
    return Fleet(network, path, folder / "state")


@pytest.fixture
def fleet(network: Network, tmp_path: Path) -> Iterator[Callable[..., Fleet]]:
    """Return what makes a fleet as `fleet_of` does; it ends with the test."""
    with ExitStack() as stack:

        def make(mission: str, **programs: str) -> Fleet:
            made = stack.enter_context(fleet_of(network, tmp_path, mission, **programs))
            stack.callback(lambda: print(made.transcript()))  # shown with a test that fails
            return made

        yield make
