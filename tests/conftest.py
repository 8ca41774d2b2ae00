"""Fixtures that several floors share: free loopback ports and a real router."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from tests.support import ports


@pytest.fixture
def free_port() -> Callable[[], int]:
    """Return a function that finds a loopback port which nobody uses now."""
    return ports.free_port


@pytest.fixture
def endpoint(free_port: Callable[[], int]) -> str:
    """Return a router endpoint on loopback that nobody uses."""
    return f"tcp/127.0.0.1:{free_port()}"
