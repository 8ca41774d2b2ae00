"""Takes the pictures of docs/guides/monitoring.md while a search and rescue flies: `python -m
tests.argosy.ui.pictures`, 3 minutes."""

import asyncio
import re
import shutil
import signal
import tempfile
from pathlib import Path

from playwright.async_api import Browser, Page, async_playwright

from tests.argosy.ui.browsing import APART, chromium
from tests.support.ports import free_port
from tests.support.processes import ROOT, running

MOST = 250_000
"""Bytes of a picture."""


def mission_in(folder: Path) -> Path:
    """Copy the mission, with links of its own and minds that take orders."""
    shutil.copytree(ROOT / "missions" / "search_and_rescue", folder / "search_and_rescue")
    text = (ROOT / "missions" / "search_and_rescue.yaml").read_text(encoding="utf-8")
    text = re.sub(r"udpin:127\.0\.0\.1:\d+", lambda _: f"udpin:127.0.0.1:{free_port()}", text)
    path = folder / "search_and_rescue.yaml"
    path.write_text(f"{text}inject: true\n", encoding="utf-8")
    return path


async def opened(browser: Browser, url: str, width: int, height: int, scheme: str) -> Page:
    """Open the page, with the scout selected."""
    look = {"width": width, "height": height}
    page = await browser.new_page(viewport=look, color_scheme=scheme)  # type: ignore[arg-type]
    await page.goto(url)
    await page.locator(".row[data-agent=scout]").click()
    await page.locator("#pane-mind", has_text="lane(").first.wait_for()
    return page


async def take(page: Page, name: str) -> None:
    """Write a picture."""
    path = ROOT / "docs" / f"ui-{name}.png"
    await page.screenshot(path=path)
    print(f"{path.name}: {path.stat().st_size} bytes", flush=True)
    if path.stat().st_size > MOST:
        raise SystemExit(f"{path.name} has more than {MOST} bytes")


async def pictures(url: str) -> None:
    """Take all of them, of a flight under way."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(executable_path=chromium(), args=["--no-sandbox"])
        page = await opened(browser, url, 1280, 800, "light")
        await page.locator(".message, .event", has_text="rescued(").first.wait_for(timeout=180_000)
        await page.locator("#pane-mind", has_text="lane(2)").first.wait_for(timeout=180_000)
        await page.mouse.move(640, 500)
        await page.wait_for_timeout(2000)
        await take(page, "page")
        await page.close()
        page = await opened(browser, url, 1440, 900, "dark")
        await page.click("#tab-mail")
        await page.click("#tab-why")
        await page.locator("#pane-why", has_text="lane").first.wait_for()
        await page.wait_for_timeout(1000)
        await take(page, "mail-why")
        await page.close()
        page = await opened(browser, url, 1280, 800, "light")
        await page.click("#tab-act")
        await page.fill("#act-belief", "wind(strong)")
        await page.click("button[type=submit][data-do=belief]")
        await page.fill("#act-goal", "climb(40")
        await page.click("button[type=submit][data-do=goal]")
        await page.locator(".acts .bad").wait_for()
        for _ in range(2):
            await page.click("header [data-order=hold]")
            await page.wait_for_timeout(APART)
        await page.locator(".outcome.good").wait_for()
        await page.click("header [data-order=release]")
        await page.wait_for_timeout(500)
        await take(page, "stop")
        await browser.close()


def main() -> None:
    """Fly, and take the pictures."""
    router = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory() as folder:
        mission = str(mission_in(Path(folder)))
        state = {"XDG_STATE_HOME": f"{folder}/state"}
        flight = ("argosy", "run", "--plain", "--speed", "2", mission, "--router", router)
        with (
            running(*flight, environment=state) as flying,
            running("argosy", "ui", "--mission", mission, "--router", router, "--port", "0") as ui,
        ):
            ui.says("open http://")
            found = re.search(r"^open (\S+)$", ui.text, re.M)
            assert found is not None
            try:
                asyncio.run(pictures(found[1]))
            finally:
                flying.signal(signal.SIGINT)
                flying.ends()


if __name__ == "__main__":
    main()
