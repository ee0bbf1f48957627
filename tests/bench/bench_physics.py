"""Physics: CPU milliseconds of one 5 ms step with 30 robots that drive and turn over 1 km x 1 km with 150 buildings."""

from __future__ import annotations

import time

import numpy as np
from orograph.scenario import Building, GridSpec, Scenario, Start, TerrainSpec, Wave
from orograph.world import World
from orograph.world.world import STEP_NS

ROBOTS, BUILDINGS_A_SIDE, BLOCK_M = 30, 12, 80.0
FRAME_NS = 100_000_000
DRIVES = ((1.5, 0.0), (1.5, 0.0), (1.0, 0.3), (0.0, 1.0), (1.5, 0.0))
"""What the robots do by turns: mostly straight on, some curves, some turning on the spot."""


def city() -> Scenario:
    """Blocks of 30 m with streets of 50 m between them, on gentle waves; robots start in the streets."""
    corners = [(20 + BLOCK_M * i, 20 + BLOCK_M * j) for i in range(BUILDINGS_A_SIDE) for j in range(BUILDINGS_A_SIDE)]
    waves = tuple(Wave(amplitude_m=3, wavelength_m=w, heading_deg=h) for w, h in ((200, 10), (150, 100)))
    return Scenario(
        name="bench",
        title="Blocks",
        grid=GridSpec(rows=200, cols=200),
        terrain=TerrainSpec(waves=waves),
        buildings=tuple(
            Building(footprint=((x, y), (x + 30, y), (x + 30, y + 30), (x, y + 30)), height_m=10) for x, y in corners
        ),
        starts=tuple(Start(x_m=75 + BLOCK_M * (i % 6), y_m=75 + BLOCK_M * (i // 6)) for i in range(ROBOTS)),
        robots=ROBOTS,
        base_station_m=(1, 1),
        patrol=((5, 5),),
    )


def figures(frames: int = 60) -> dict[str, float]:
    """`physics_ms`: median over frames of the CPU time of the mean step in the frame."""
    world = World(city(), tuple(f"robot_{i + 1:03d}" for i in range(ROBOTS)))
    milliseconds = []
    for k in range(frames):
        drives = {robot: DRIVES[(i + k // 15) % len(DRIVES)] for i, robot in enumerate(world.robots)}
        begin = time.thread_time()
        world.advance(drives, FRAME_NS)
        milliseconds.append((time.thread_time() - begin) * 1e3 * STEP_NS / FRAME_NS)
    return {"physics_ms": float(np.median(milliseconds[5:]))}


if __name__ == "__main__":
    print(figures())
