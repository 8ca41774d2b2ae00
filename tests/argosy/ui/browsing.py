"""A headless chromium of the system's, that notes what it asked for and what went wrong in it."""

import shutil
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from urllib.parse import urlsplit

from playwright.async_api import Locator, Page, async_playwright

PATIENCE = 90_000.0
"""Milliseconds for anything that the page is to show."""


APART = 500.0
"""Milliseconds between two clicks that are no double click."""


class NoBrowser(RuntimeError):
    """This machine has no chromium."""


@dataclass
class Seen:
    """An open page, and what it did."""

    page: Page
    hosts: set[str] = field(default_factory=set)
    """Where its requests went."""
    errors: list[str] = field(default_factory=list)

    async def shows(self, selector: str, words: str = "") -> None:
        """Wait until an element is there and says the words."""
        found = self.page.locator(selector)
        await (found.filter(has_text=words) if words else found).first.wait_for(timeout=PATIENCE)

    async def gone(self, selector: str) -> None:
        """Wait until no such element is seen."""
        await self.page.locator(selector).first.wait_for(state="hidden", timeout=PATIENCE)

    async def says(self, selector: str) -> str:
        """Return what an element says."""
        return await self.page.locator(selector).first.inner_text(timeout=PATIENCE)

    async def twice(self, button: Locator) -> None:
        """Click a button of an order as somebody does who means it."""
        await button.click()
        await self.page.wait_for_timeout(APART)
        await button.click()


def chromium() -> str:
    """Return the browser's path. Raises NoBrowser."""
    found = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    if found is None:
        raise NoBrowser("no chromium is there")
    return found


@asynccontextmanager
async def browsing(url: str, width: int = 1280, height: int = 800, touch: bool = False) -> AsyncIterator[Seen]:
    """Open a page; it is closed at the end, whatever happens."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        try:
            page = await browser.new_page(viewport={"width": width, "height": height}, has_touch=touch)
            page.set_default_timeout(PATIENCE)
            seen = Seen(page)
            page.on("request", lambda request: seen.hosts.add(urlsplit(request.url).hostname or request.url[:40]))
            page.on("websocket", lambda socket: seen.hosts.add(urlsplit(socket.url).hostname or socket.url))
            page.on("pageerror", lambda error: seen.errors.append(str(error)))
            page.on("console", lambda line: seen.errors.append(line.text) if line.type == "error" else None)
            await page.goto(url)
            yield seen
        finally:
            await browser.close()
