"""The read-only ear: what goes along a route is told with sender, receiver and frame, anything else is counted."""

from __future__ import annotations

import threading

import numpy as np
from orograph import keys
from orograph.comms import wire
from orograph.comms.bus import Bus
from orograph.comms.observer import Heard, Observer
from orograph.control import Figures
from orograph.messages import POSE, Bodies, Drive, OccupancyGrid
from orograph.routes import PEOPLE
from polling import until

STOP = threading.Event()
NAVIGATOR, MAPPING = "navigator/robot_001", "robot-mapping/robot_001"
GRID = OccupancyGrid(7, 0.0, 0.0, 1.0, True, np.arange(160_000, dtype="u1").reshape(400, 400))


def test_what_goes_along_a_route_is_told_and_anything_else_counted(endpoint: str) -> None:
    told: list[Heard] = []
    with Bus.open(endpoint, None, STOP) as bus, Bus.open(endpoint, None, STOP) as ear:
        observer = Observer(ear.sessions, (Bodies, Drive, OccupancyGrid, Figures), told.append)
        until(lambda: bus.show(NAVIGATOR, Figures({"x_m": 1.5})) or told, "figures are not told")
        bus.begin(3)
        bus.send(keys.WORLD, keys.SIM, "laser/*", Bodies(7, np.zeros(1, POSE)))
        bus.send(MAPPING, keys.SIM, NAVIGATOR, GRID)
        bus.send(NAVIGATOR, keys.SIM, keys.WORLD, Drive(7, 1.0, 0.5))
        until(lambda: any(isinstance(heard.message, Drive) for heard in told), "not all is told")
        (piece,) = wire.fragments(3, 0, wire.encode(Drive(7, 1.0, 0.5)))
        sim = bus.sessions[keys.SIM]
        sim.put("og/sim/world/-/Drive/navigator/-", piece)
        sim.put("og/sim/world/-/Drive/navigator/robot_002", b"junk")
        sim.put("og/telemetry/moon/-", wire.encode(Figures({})))
        until(lambda: sum(observer.callbacks.figures().values()) == 3, "what goes along no route is not counted")
    by_kind = {type(heard.message): heard for heard in told}
    figures = by_kind[Figures]
    assert (figures.sender, figures.to, figures.message.figures) == (NAVIGATOR, PEOPLE, {"x_m": 1.5})
    places = {kind: (heard.sender, heard.to, heard.frame) for kind, heard in by_kind.items() if kind is not Figures}
    assert places == {
        Bodies: (keys.WORLD, "laser/*", 3), OccupancyGrid: (MAPPING, NAVIGATOR, 3), Drive: (NAVIGATOR, keys.WORLD, 3)
    }  # fmt: skip
    assert np.array_equal(by_kind[OccupancyGrid].message.occupation, GRID.occupation)
