"""The browser that the tests of the page need."""

import pytest

from tests.argosy.ui.browsing import NoBrowser, chromium
from tests.support.needs import lacks


@pytest.fixture(scope="session")
def browser() -> str:
    """Return the path of the system's chromium."""
    try:
        return chromium()
    except NoBrowser as why:
        lacks("browser", why)
