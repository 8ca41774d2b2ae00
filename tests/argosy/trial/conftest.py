"""What flies a shipped mission in a trial."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import TypeAlias

import pytest

from argosy.trial.faults import Fault
from argosy.trial.single_run import Outcome, Request
from argosy.trial.workers import workers

MISSIONS = Path(__file__).parents[3] / "missions"


Fly: TypeAlias = Callable[..., Outcome]


@pytest.fixture(scope="module")
def fly() -> Iterator[Fly]:
    """Yield what flies a shipped mission once: `fly(mission, seed, *faults, until=None)`."""
    with workers(1) as run_all:

        def once(mission: str, seed: int, *faults: Fault, until: float | None = None) -> Outcome:
            path = str(MISSIONS / f"{mission}.yaml")
            return next(iter(run_all([Request(path, seed, faults, journal=True, until=until)])))

        yield once


@pytest.fixture(scope="module")
def undisturbed(fly: Fly) -> Callable[[str], Outcome]:
    """Return what flies a mission without faults, once for all tests of a module."""
    return cache(lambda mission: fly(mission, 1))
