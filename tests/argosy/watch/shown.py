"""The view in a terminal of some size, without a bus: a fleet on paper is shown."""

import asyncio
from collections.abc import Callable, Coroutine
from inspect import Signature, signature
from typing import Any

from textual.pilot import Pilot

from argosy.cli.operator_bus import Where
from argosy.fleet_model.link import FleetLink
from argosy.watch.app import WatchApp
from argosy.watch.row_text import UNICODE, Glyphs
from tests.argosy.fleet_model.fleet import FLEET, Fleet
from tests.support import buses


def link_to(fleet: Fleet) -> FleetLink:
    """A link that has reached the fleet and dials nowhere."""
    link = FleetLink(Where(FLEET, "tcp/127.0.0.1:7447"))
    link.model, link.reached, link.since = fleet.model, True, fleet.at
    return link


def lines_of(app: WatchApp) -> list[str]:
    """Return what stands on the screen, line by line."""
    strips = app.screen._compositor.render_strips()
    return ["".join(segment.text for segment in strip).rstrip() for strip in strips]


def text_of(app: WatchApp) -> str:
    return "\n".join(lines_of(app))


async def until(app: WatchApp, pilot: Pilot[None], words: str, shown: bool = True) -> None:
    """Wait until the screen has these words, or has them no more."""
    for _ in range(4500):
        await pilot.pause(0.02)
        if (words in text_of(app)) is shown:
            return
    raise AssertionError(f"the screen never {'shows' if shown else 'loses'} {words!r}:\n{text_of(app)}")


async def press(app: WatchApp, pilot: Pilot[None], *pressed: str) -> None:
    """Press keys, each when the one before has had its effect: the pilot goes on when the processor is taken away."""

    def idle() -> bool:
        pumps = (app, *app.screen.walk_children(with_self=True))
        return app.screen.is_mounted and all(one._message_queue.empty() for one in pumps)

    for key in pressed:
        await pilot.press(key)
        await buses.until(idle, f"{key} has had its effect")


def shown(
    make: Callable[[], Fleet | FleetLink],
    size: tuple[int, int] = (80, 24),
    *,
    glyphs: Glyphs = UNICODE,
    filter: str = "",
) -> Callable[[Callable[..., Coroutine[Any, Any, None]]], Callable[..., None]]:
    """Run an async test of the view of a fleet, or of what a link reaches, in a terminal of `size` (columns, lines).

    The test takes of `app`, `pilot` and `fleet` what it needs, and fixtures; a parameter `size` is the terminal's.
    """

    def decorate(test: Callable[..., Coroutine[Any, Any, None]]) -> Callable[..., None]:
        taken = signature(test).parameters
        fixtures = [one for one in taken.values() if one.name not in ("app", "pilot", "fleet")]

        def run(**values: Any) -> None:
            fleet = make()

            async def everything() -> None:
                link = link_to(fleet) if isinstance(fleet, Fleet) else fleet
                app = WatchApp(link, glyphs=glyphs, filter=filter, period=0.1)
                async with asyncio.timeout(240), app.run_test(size=values.get("size", size)) as pilot:
                    await until(app, pilot, "argosy watch")
                    await pilot.pause(0.2)
                    given = {"app": app, "pilot": pilot, "fleet": fleet}
                    await test(**values, **{name: one for name, one in given.items() if name in taken})

            asyncio.run(everything())

        run.__name__, run.__doc__, run.__module__ = test.__name__, test.__doc__, test.__module__
        run.__signature__ = Signature(fixtures)  # type: ignore[attr-defined]
        return run

    return decorate
