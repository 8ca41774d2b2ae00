"""What a test needs of the machine, by fixtures: each also marks the tests that use it."""

import os
from typing import NoReturn

import pytest

NEEDS = ("browser", "internet", "namespaces")
"""Fixtures whose tests ``make test`` leaves out."""


def lacks(need: str, why: object) -> NoReturn:
    """Skip the test; fail it where the machine must have what it needs (``ARGOSY_NEEDS_<NEED>``), as in CI."""
    if os.environ.get(f"ARGOSY_NEEDS_{need.upper()}"):
        pytest.fail(str(why))
    pytest.skip(str(why))
