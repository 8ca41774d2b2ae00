"""docs/watch-*.svg, screens of `argosy watch` in the search and rescue: `python -m tests.docs.watch_pictures`."""

import asyncio
import re
import tempfile
from pathlib import Path

from textual.pilot import Pilot

from argosy.cli.operator_bus import Where
from argosy.fleet_model.link import FleetLink
from argosy.watch.app import WatchApp
from argosy.watch.pages import AgentPage
from tests.argosy.watch.shown import text_of
from tests.docs.pages import ROOT
from tests.support.ports import free_port
from tests.support.processes import running

SIZE = 120, 36
"""Columns and lines: all panes of an agent are seen at once."""
WITHIN = 120.0
"""Wall seconds within which a screen must show what is to be seen on it."""
FONTS = "ui-monospace, Menlo, Consolas, 'DejaVu Sans Mono', monospace"
"""The reader's own: pages load nothing from elsewhere."""


async def draw() -> dict[str, str]:
    """Fly the mission and return the screens by the names of their files."""
    with tempfile.TemporaryDirectory() as folder:
        mission = _on_free_ports(Path(folder))
        router = f"tcp/127.0.0.1:{free_port()}"
        with running("argosy", "run", str(mission), "--plain", "--router", router) as flying:
            flying.says("commd pi1: up")
            return await _look(router)


def _on_free_ports(folder: Path) -> Path:
    """Copy the mission, with links to its vehicles that nobody uses."""
    shipped = ROOT / "missions" / "search_and_rescue.yaml"
    path = folder / shipped.name
    path.write_text(re.sub(r"udpin:127.0.0.1:\d+", lambda _: f"udpin:127.0.0.1:{free_port()}", shipped.read_text()))
    (folder / shipped.stem).symlink_to(shipped.with_suffix(""))
    return path


async def _look(router: str) -> dict[str, str]:
    link = FleetLink(Where("sar", router))
    app, screens = WatchApp(link), dict[str, str]()
    dialling = asyncio.create_task(link.run())
    try:
        async with app.run_test(size=SIZE) as pilot:
            await _until(app, pilot, r"rescuer1 +flying.*\n(.*\n)*.*buoy dropped for")
            screens["watch-overview.svg"] = _own_fonts(app.export_screenshot(title="argosy watch"))
            await app.push_screen(AgentPage("rescuer1"))
            await _until(app, pilot, r"(?s)^(?!.*not asked for yet).*goto\([^\n]*running")
            screens["watch-agent.svg"] = _own_fonts(app.export_screenshot(title="argosy watch"))
    finally:
        dialling.cancel()
        await asyncio.gather(dialling, return_exceptions=True)
    return screens


async def _until(app: WatchApp, pilot: Pilot[None], pattern: str) -> None:
    """Wait until the screen shows a pattern. Raises TimeoutError, with the screen, if it does not in time."""
    try:
        async with asyncio.timeout(WITHIN):
            while not re.search(pattern, text_of(app)):
                await pilot.pause(0.1)
    except TimeoutError:
        raise TimeoutError(f"no {pattern!r} within {WITHIN:g} s on\n{text_of(app)}") from None


def _own_fonts(svg: str) -> str:
    """Take out what a picture would load from elsewhere, and the blanks at the ends of lines."""
    svg = re.sub(r"<!--.*?-->|@font-face\s*\{[^}]*\}", "", svg, flags=re.DOTALL)
    svg = re.sub(r"font-family: Fira Code[^;]*;", f"font-family: {FONTS};", svg)
    return re.sub(r"\s*\n", "\n", svg).strip() + "\n"


if __name__ == "__main__":
    for name, svg in asyncio.run(draw()).items():
        (ROOT / "docs" / name).write_text(svg, encoding="utf-8")
        print(f"docs/{name}")
