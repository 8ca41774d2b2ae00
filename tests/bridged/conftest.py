"""What tests of robots have at hand."""

from contextlib import AbstractAsyncContextManager
from pathlib import Path

import pytest

from tests.bridged.sky import Sky
from tests.bridged.studio import Studio, in_the_studio
from tests.bridged.virtual_copter import Station


@pytest.fixture
def sky(tmp_path: Path) -> Sky:
    """A bridge and a simulated copter in virtual time, before the first heartbeat."""
    return Sky(tmp_path)


@pytest.fixture
def station() -> Station:
    """A ground station and a simulated copter that is ready, in virtual time."""
    return Station()


@pytest.fixture
def looks_at_each_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """Orders of a bridge in virtual time look at the robot with each step of it, and not by the wall clock."""
    monkeypatch.setattr("bridged.bridge.safety_orders.LOOK", 0.0)


@pytest.fixture
def studio(endpoint: str, tmp_path: Path) -> AbstractAsyncContextManager[Studio]:
    """A studio of the shipped turtle."""
    return in_the_studio(endpoint, tmp_path)
