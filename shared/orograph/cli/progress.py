"""The live view of a run: where simulation time is, what the robots do, how much of the map is there."""

from __future__ import annotations

import time

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from orograph import keys
from orograph.launch.progress import Figures
from orograph.scenario import Scenario

LINE_EVERY_S = 5.0
"""Where there is no terminal, one line this often."""


class Progress:
    """A context manager; `show` takes the newest telemetry by node name and the restarts so far."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._console = Console(stderr=True)
        self._live = Live(console=self._console, refresh_per_second=4, transient=True)
        self._begin_s = self._said_s = time.monotonic()
        self._first: tuple[float, float] | None = None
        self._restarts = 0

    def __enter__(self) -> Progress:
        if self._console.is_terminal:
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._console.is_terminal:
            self._live.stop()

    def show(self, figures: Figures, restarts: list[str]) -> None:
        """Draw the newest state."""
        for restart in restarts[self._restarts :]:
            self._console.print(f"[yellow]restarted[/] {restart}")
        self._restarts = len(restarts)
        if self._console.is_terminal:
            self._live.update(Group(self._headline(figures), self._robots(figures)))
        elif time.monotonic() - self._said_s > LINE_EVERY_S:
            self._said_s = time.monotonic()
            self._console.print(self._headline(figures).plain, soft_wrap=True)

    def _headline(self, figures: Figures) -> Text:
        frame = figures.get(keys.WORLD, {}).get("frame")
        if frame is None:
            return Text(f"{self._scenario.title}: starting services ({time.monotonic() - self._begin_s:.0f} s)", "bold")
        now, sim_s = time.monotonic(), frame * self._scenario.frame_ns * 1e-9
        self._first = self._first or (now, sim_s)
        rtf = (sim_s - self._first[1]) / max(now - self._first[0], 1.0)
        manager = figures.get(keys.MANAGER, {})
        orchestrator = figures.get(keys.ORCHESTRATOR, {})
        share = manager.get("confident_cells", 0) / self._scenario.grid.grid.size
        mapping = [f for n, f in figures.items() if n.startswith(keys.MAPPING)]
        acked, waiting = manager.get("records_acked", 0), sum(f.get("waiting_cells", 0) for f in mapping)
        return Text(
            f"{self._scenario.title}   {sim_s:6.1f} s simulated, x{rtf:.1f} real time   map {share:.1%} of the area   "
            f"cells {acked:.0f} acknowledged, {waiting:.0f} waiting   "
            f"{orchestrator.get('waypoints_left', 0):.0f} waypoints left",
            "bold",
        )

    def _robots(self, figures: Figures) -> Table:
        table = Table("robot", "radio", "driven", "pose sigma", "scans", "waiting cells", "map version", box=None)
        for robot in self._scenario.robot_ids:
            mapping = figures.get(keys.node(keys.MAPPING, robot), {})
            navigator = figures.get(keys.node(keys.NAVIGATOR, robot), {})
            table.add_row(
                robot,
                Text("up", "green") if mapping.get("link_up") else Text("down", "red"),
                f"{navigator.get('driven_m', 0):.0f} m",
                f"{navigator.get('position_sigma_m', 0):.2f} m",
                f"{mapping.get('scans', 0):.0f}",
                f"{mapping.get('waiting_cells', 0):.0f}",
                f"{mapping.get('copy_version', 0):.0f}",
            )
        return table
