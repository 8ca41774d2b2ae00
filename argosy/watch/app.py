"""The application: the model that is shown, and the keys of every page."""

from __future__ import annotations

import os
from typing import ClassVar

from textual.app import App
from textual.binding import Binding, BindingType
from textual.widgets import Input

from argosy.fleet_model.link import FleetLink
from argosy.fleet_model.model import FleetModel
from argosy.watch.page import Page
from argosy.watch.pages import Help, Overview
from argosy.watch.row_text import UNICODE, Glyphs, safe_text

PERIOD = 0.5
"""Wall seconds between two drawings."""


class WatchApp(App[None]):
    """Shows a fleet. It has no way to give an order."""

    TITLE = "argosy watch"
    ENABLE_COMMAND_PALETTE = False
    CSS = """
    .behind { display: none; }
    ScrollPane:focus { background-tint: transparent; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q,ctrl+c,ctrl+q", "quit", show=False, priority=False),
        Binding("ctrl+c", "quit", show=False, priority=True),
        Binding("space", "pause", show=False),
        Binding("question_mark,f1,h", "help", show=False),
    ]

    def __init__(self, link: FleetLink, *, glyphs: Glyphs = UNICODE, filter: str = "", period: float = PERIOD) -> None:
        super().__init__(ansi_color=True)  # set here, so that NO_COLOR removes all colours and not only the hues
        self.link, self.glyphs, self.filter, self.period = link, glyphs, filter, period
        self._still: FleetModel | None = None
        self.theme = "ansi-dark"  # the terminal's own colours, light or dark

    @property
    def paused(self) -> bool:
        """Whether the view is paused."""
        return self._still is not None

    @property
    def shown(self) -> FleetModel:
        """The model that is shown: the fleet's, or as it was when the view was paused."""
        return self._still or self.link.model

    def _fatal_error(self) -> None:
        """End with one line for an uncaught exception, without a traceback."""
        if os.environ.get("ARGOSY_DEBUG"):
            super()._fatal_error()
            return
        what = f"{type(self._exception).__name__}: {self._exception}"
        self._exit_renderables.append(safe_text(f"error: defect in argosy watch: {what}; ARGOSY_DEBUG=1 shows where"))
        self._close_messages_no_wait()

    def on_mount(self) -> None:
        """Show the fleet."""
        self.push_screen(Overview())

    async def _check_bindings(self, key: str, priority: bool = False) -> bool:
        """Carry out a key before the next one is taken, unless a filter is being written.

        Textual passes most keys from the focused pane upwards, message by message: the letters that follow a `/`
        quickly would still go to the pane, where `q` ends the view.
        """
        if priority and self.screen.is_mounted and not isinstance(self.focused, Input):
            return await super()._check_bindings(key, priority) or await super()._check_bindings(key)
        return await super()._check_bindings(key, priority)

    def action_pause(self) -> None:
        """Pause or continue the view."""
        self._still = None if self._still is not None else self.link.model.frozen()
        if isinstance(self.screen, Page):
            self.screen.redraw()

    def action_help(self) -> None:
        """Show what the keys do."""
        if not isinstance(self.screen, Help):
            self.push_screen(Help())
