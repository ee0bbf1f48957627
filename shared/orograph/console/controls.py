"""The page's panels: what is shown, where from, and what is said; shared by all browsers but for the camera."""

from __future__ import annotations

from typing import Any

import numpy as np
import viser

from orograph.arrays import U1
from orograph.console.camera import VIEWS, Cameras
from orograph.console.colours import SCALES, Scale
from orograph.console.film import Film
from orograph.console.overview import blank

SHOWN = ("trails", "radio links", "radio shadows", "patrol legs", "last scan")
AT_FIRST = frozenset(SHOWN) - {"patrol legs"}
BESIDE_PX = 300
NOBODY = "nobody"
Event = viser.GuiEvent[Any]


class Controls:
    """Wishes of those who look on; `changed` is set when one is new."""

    def __init__(self, server: viser.ViserServer, film: Film, cameras: Cameras) -> None:
        gui = self._gui = server.gui
        self.changed = True
        gui.main_panel.dock_right()
        gui.main_panel.set_width(BESIDE_PX)
        gui.set_panel_label(film.title)
        self._headline = gui.add_html("")
        self._scale = gui.add_dropdown("colour", tuple(SCALES), hint="what a cell's colour says")
        self._scale.on_update(self._change)
        self._legend = gui.add_html("")
        self._overview = gui.add_image(blank(film.site.scenario.grid.grid), format="png")
        self._add_views(film, cameras)
        with gui.add_folder("show", expand_by_default=False):
            self._boxes = {name: gui.add_checkbox(name, name in AT_FIRST) for name in SHOWN}
            self._dark = gui.add_checkbox("dark page", True)
        self._dark.on_update(self._theme)
        self._theme()
        panel = gui.add_panel()
        panel.float(x=16, y=16, width=BESIDE_PX)
        with panel.add_tab("events"):
            self._events = gui.add_html("")
        with panel.add_tab("cell"):
            self._cell = gui.add_html("")

    @property
    def scale(self) -> Scale:
        """How the map is coloured."""
        return SCALES[self._scale.value]

    @property
    def shown(self) -> frozenset[str]:
        """Which of SHOWN are wanted."""
        return frozenset(name for name, box in self._boxes.items() if box.value)

    def head(self, headline: str) -> None:
        """Put how the run stands."""
        if self._headline.content != headline:
            self._headline.content = headline

    def say(self, legend: str, events: str, overview: U1, cell: str) -> None:
        """Put new words and the new overview where they differ from the old."""
        for place, text in ((self._legend, legend), (self._events, events), (self._cell, cell)):
            if place.content != text:
                place.content = text
        if not np.array_equal(self._overview.image, overview):
            self._overview.image = overview

    def _add_views(self, film: Film, cameras: Cameras) -> None:
        views = self._gui.add_button_group("view", VIEWS)
        robots = self._gui.add_dropdown("follow", (NOBODY, *film.robots), hint="this browser's camera goes with it")

        def view(event: Event) -> None:
            if event.client is not None:
                cameras.view(event.client, views.value)

        def follow(event: Event) -> None:
            if event.client is not None:
                cameras.begin_to_follow(event.client, robots.value)

        views.on_click(view)
        robots.on_update(follow)

    def _change(self, _: Event) -> None:
        self.changed = True

    def _theme(self, _: Event | None = None) -> None:
        self._gui.configure_theme(dark_mode=self._dark.value, show_logo=False, show_share_button=False)
