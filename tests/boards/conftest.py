"""Skips the tests of this folder where namespaces cannot be made, with the reason; in CI they fail then."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.boards.fleet import Fleet
from tests.boards.network import NEEDED, Network, NoNamespaces, possible

BOARDS = ("pi1", "pi2", "pi3")


@functools.cache
def why_not() -> str:
    """Return why namespaces cannot be made here; empty: they can."""
    try:
        possible()
    except NoNamespaces as error:
        return str(error)
    return ""


def needs_namespaces() -> None:
    """Skip the test where namespaces cannot be made; where they must be, fail."""
    if why := why_not():
        pytest.fail(why) if os.environ.get(NEEDED) else pytest.skip(why)


@pytest.fixture
def network() -> Iterator[Network]:
    """Three boards and the ground."""
    needs_namespaces()
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
