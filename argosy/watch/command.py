"""`argosy watch`: arguments, terminal and exit."""

from __future__ import annotations

import asyncio
import logging
import os
import signal
import sys
from argparse import ArgumentParser, Namespace

from argosy.cli.errors import BadInput
from argosy.cli.operator_bus import Where, add_fleet_arguments, where
from commd.process.process import EXIT_DONE, EXIT_FAILED, on_end_signals


def add_arguments(parser: ArgumentParser) -> None:
    """Declare the arguments of `argosy watch`."""
    add_fleet_arguments(parser, "this fleet (default: the first that appears at the router)")
    parser.add_argument(
        "--filter", default="", metavar="TEXT", help="show only lines of the timeline that contain this text"
    )


def run(args: Namespace) -> int:
    """Show the fleet until the user leaves. Raises BadInput without a terminal."""
    place = where(args)
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        raise BadInput("argosy watch needs a terminal; in a pipe use argosy status, argosy echo or argosy why")
    logging.getLogger().addHandler(logging.NullHandler())  # the view shows what the bus would log
    return asyncio.run(_show(place, args.filter))


async def _show(place: Where, words: str) -> int:
    from argosy.fleet_model.link import FleetLink
    from argosy.watch.app import WatchApp
    from argosy.watch.row_text import glyphs_of

    link = FleetLink(place)
    app = WatchApp(link, glyphs=glyphs_of(os.environ, sys.stdout.encoding or ""), filter=words)
    on_end_signals(lambda _: app.exit(), signal.SIGTERM, signal.SIGHUP)  # it gives the terminal back
    dialling = asyncio.create_task(link.run())
    dialling.add_done_callback(lambda _: app.exit())
    try:
        await app.run_async(mouse=False)
    finally:
        dialling.cancel()
        (ended,) = await asyncio.gather(dialling, return_exceptions=True)
    if isinstance(ended, Exception):  # such as Findings: the router cannot be reached with these keys
        raise ended
    return EXIT_FAILED if app.return_code else EXIT_DONE
