"""The time machine: a slider over the run so far, and how fast it goes by."""

from __future__ import annotations

from collections import deque
from typing import Any

import viser

from orograph.console.film import Film

SPEEDS = {"1x": 1.0, "4x": 4.0, "16x": 16.0, "64x": 64.0}
PLAY, PAUSE, LIVE, END = "play", "pause", "live", "end"
WIDTH_PX = 460
PACE_PICTURES = 25
MOVED_S = 0.05
"""A slider that stands further than this from where it was put has been moved."""


class Timeline:
    """Which time is shown: the newest of a live run until somebody wants another, a finished run's as it plays."""

    def __init__(self, server: viser.ViserServer, film: Film) -> None:
        self._playing, self._speed = True, SPEEDS["4x"]
        self._at_s = self._put_s = 0.0
        self._end_s = film.end_ns * 1e-9
        self._past: deque[tuple[float, float]] = deque(maxlen=PACE_PICTURES)
        panel = server.gui.add_panel()
        panel.float(x=16, y=-16, width=WIDTH_PX)
        with panel.add_tab("time"):
            self._slider = server.gui.add_slider("second", 0.0, max(round(self._end_s, 1), 0.1), 0.1, 0.0)
            buttons = server.gui.add_button_group("play", (PLAY, PAUSE, LIVE if film.live else END))
            speeds = server.gui.add_button_group("speed", tuple(SPEEDS), visible=not film.live)

        def press(_: viser.GuiEvent[Any]) -> None:
            self.press(buttons.value)

        def speed(_: viser.GuiEvent[Any]) -> None:
            self._speed, self._playing = SPEEDS[speeds.value], True

        buttons.on_click(press)
        speeds.on_click(speed)

    def press(self, button: str) -> None:
        """PLAY goes on from here, from the end anew; LIVE and END go there."""
        self._playing = button != PAUSE
        if button in (LIVE, END):
            self._at_s = self._end_s
        elif button == PLAY and self._at_s >= self._end_s:
            self._at_s = 0.0

    def pace(self, film: Film, now_s: float) -> float:
        """Simulation over real time of a live run, over the last seconds."""
        self._past.append((now_s, film.end_ns * 1e-9))
        (then_s, was_s), (now_s, is_s) = self._past[0], self._past[-1]
        return (is_s - was_s) / max(now_s - then_s, 1e-3)

    def time_ns(self, film: Film, passed_s: float) -> int:
        """The time to show `passed_s` after the last picture; a live film that plays is at its end."""
        was_end_s, self._end_s = self._end_s, film.end_ns * 1e-9
        if moved := abs(self._slider.value - self._put_s) > MOVED_S:
            self._at_s, self._playing = self._slider.value, film.live and self._slider.value >= was_end_s
        elif self._playing:
            self._at_s = self._end_s if film.live else min(self._at_s + passed_s * self._speed, self._end_s)
        if self._end_s != was_end_s:
            self._slider.max = max(round(self._end_s, 1), 0.1)
        self._put_s = round(min(self._at_s, self._end_s), 1)
        if moved:
            # Said again, though it is the same: what was on its way to the browser has put the slider back.
            self._slider.value = self._slider.max - self._put_s  # type: ignore[misc]
        self._slider.value = self._put_s  # type: ignore[misc]
        return round(self._at_s * 1e9)
