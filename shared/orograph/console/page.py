"""The page: a film in a browser, on loopback, with a slider over its time; it is told nothing but what to show."""

from __future__ import annotations

import io
import math
import socket
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, redirect_stdout

import numpy as np
import viser

from orograph.console import words
from orograph.console.actors import Actors
from orograph.console.camera import Cameras
from orograph.console.colours import TRUTH
from orograph.console.controls import Controls
from orograph.console.film import Film
from orograph.console.look import Looker
from orograph.console.overview import overview
from orograph.console.picking import cell_hit
from orograph.console.relief import Relief
from orograph.console.timeline import Timeline
from orograph.errors import InputError
from orograph.protocol.explained import Explanation, explain
from orograph.rules import Rules

PICTURE_S, ALONE_S = 0.2, 1.0
WORDS_S = 1.0
PORT = 8080


def open_server(host: str, port: int) -> viser.ViserServer:
    """A page's server on exactly this port; raises InputError where it is taken."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise InputError(f"port {port} on {host} is taken ({error.strerror}); choose another with --port") from None
        port = probe.getsockname()[1]
    with _silent():
        return viser.ViserServer(host, port, label="Orograph", verbose=False)


def _silent() -> AbstractContextManager[object]:
    """viser greets and takes leave on standard output, where our one line is to stand."""
    return redirect_stdout(io.StringIO())


class Page:
    """Shows what `film` returns, which may grow between two calls."""

    def __init__(self, server: viser.ViserServer, film: Callable[[], Film]) -> None:
        self._film, first = film, film()
        self._grid = first.site.scenario.grid.grid
        x0, y0, x1, y1 = self._grid.extent_m
        self._looker = Looker(first.site)
        self._look = self._looker.look(first, 0, ())
        self._looked: tuple[object, ...] = ()
        self._server = server
        self._relief = Relief(server.scene, self._grid)
        self._actors = Actors(server.scene, first, max(x1 - x0, y1 - y0))
        self._cameras = Cameras(server, first)
        self._controls, self._timeline = Controls(server, first, self._cameras), Timeline(server, first)
        self._picked: tuple[int, int] | None = None
        self._worded_s = self._stepped_s = time.monotonic()
        server.scene.on_click()(self._pick)
        server.scene.on_click(modifier="cmd/ctrl")(self._fly)

    @property
    def url(self) -> str:
        """Where a browser finds it."""
        return f"http://127.0.0.1:{self._server.get_port()}"

    @property
    def _seen(self) -> bool:
        """Whether anybody looks: a finished run waits for them, and what nobody sees need not be drawn often."""
        return bool(self._server.get_clients())

    def run(self, stop: threading.Event, alive: Callable[[], None] = lambda: None) -> None:
        """Show until told to stop; `alive` is called with every picture."""
        while not stop.is_set():
            begun_s = time.monotonic()
            self.step()
            alive()
            # A picture that took long is followed by as long a rest: half a core at most.
            took_s, pause_s = time.monotonic() - begun_s, PICTURE_S if self._seen else ALONE_S
            stop.wait(max(pause_s - took_s, took_s))
        with _silent():
            self._server.stop()

    def step(self) -> None:
        """One picture."""
        film, now_s = self._film(), time.monotonic()
        stamp_ns = self._timeline.time_ns(film, (now_s - self._stepped_s) if self._seen else 0.0)
        self._stepped_s = now_s
        scale = self._controls.scale
        wanted = (scale.needs, TRUTH if self._picked else "")
        state = (*self._looker.state(film, stamp_ns), scale.label, *wanted)
        with self._server.atomic():
            self._relief.settle()
            if state != self._looked:
                self._look, self._looked = self._looker.look(film, stamp_ns, wanted), state
                self._relief.show(self._look, scale)
            self._actors.mark(self._grid, self._picked, self._height_m(self._picked))
            self._actors.show(film, stamp_ns, self._controls.shown)
            self._controls.head(words.headline(film, self._look, stamp_ns, self._timeline.pace(film, now_s)))
            if now_s - self._worded_s >= WORDS_S or self._controls.changed:
                self._worded_s, self._controls.changed = now_s, False
                self._controls.say(
                    words.legend(scale, self._look), words.events(film, stamp_ns),
                    overview(film, self._look, scale, stamp_ns), self._cell(film),
                )  # fmt: skip
        self._cameras.follow(film, stamp_ns)

    def _height_m(self, cell: tuple[int, int] | None) -> float:
        return math.nan if cell is None else float(self._controls.scale.surface(self._look)[cell])

    def _cell(self, film: Film) -> str:
        if self._picked is None:
            return words.NO_CELL
        return words.cell(
            self._grid, *self._picked, self._looker.cells(), self._look, self._looker.course.changed_ns
        ) + words.explained(film, explain_cell(film, self._picked[0] * self._grid.cols + self._picked[1]))

    def _pick(self, event: viser.SceneClickEvent) -> None:
        self._picked = self._hit(event)
        self._controls.changed = True

    def _fly(self, event: viser.SceneClickEvent) -> None:
        if (found := self._hit(event)) is not None:
            x, y = self._grid.centre_m(*found)
            self._cameras.fly(event.client, np.array([x, y, float(self._look.height_m[found])]))

    def _hit(self, event: viser.SceneClickEvent) -> tuple[int, int] | None:
        return cell_hit(
            self._grid, self._controls.scale.surface(self._look), np.array(event.ray_origin),
            np.array(event.ray_direction),
        )  # fmt: skip


def explain_cell(film: Film, cell: int) -> Explanation:
    """How a cell came about, as its registers are at the end of what there is."""
    site, registers = film.site, film.registers()
    return explain(site.prior[cell], registers[registers["cell"] == cell], Rules.of(site.scenario.rules))
