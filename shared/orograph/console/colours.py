"""What a cell's colour says: for each way to colour the map its values, scale and legend; colour-blind safe."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps
from matplotlib.colors import Colormap, ListedColormap, to_rgb

from orograph.arrays import F64, U1
from orograph.layers import CONFIDENT, Layer
from orograph.report.palette import CONFIDENCE, ERROR, HEIGHT, OCCUPATION, ROBOT_COLOURS, robot_colour

Values = npt.NDArray[np.floating]
UNKNOWN = np.array([0.62, 0.65, 0.68])
"""Of cells of which this scale has nothing to say."""
PALE_LOW, PALE_HIGH = np.array([0.42, 0.45, 0.49]), np.array([0.90, 0.90, 0.88])
"""Of cells that are known from the prior alone, by height: what robots map takes colour."""
TRUTH, WHO = "truth", "who"
FLEET = ListedColormap(ROBOT_COLOURS)
ERROR_MAX_M = 2.0
AGE_MAX_S = 120.0


@dataclass(frozen=True, eq=False)
class Look:
    """The map at one moment, as layers (rows, cols)."""

    height_m: F64
    """Its upper surface."""
    prior_m: F64
    truth_m: F64
    occupation: Layer
    confidence: Layer
    age_s: F64
    """Since the last change; NaN where it is still the prior."""
    by: F64
    """Place in the fleet, 0 first, of the robot that was last to see the cell; NaN where none was."""
    range_m: tuple[float, float]
    """Of heights, the same through the run."""


@dataclass(frozen=True, eq=False)
class Scale:
    """One way to colour the map."""

    label: str
    unit: str
    colours: Colormap
    values: Callable[[Look], Values]
    limits: Callable[[Look], tuple[float, float]]
    surface: Callable[[Look], F64] = lambda look: look.height_m
    """What stands up in 3D meanwhile."""
    says: str = ""
    needs: str = ""
    """TRUTH or WHO, which are dear to make, or nothing."""

    def rgb(self, look: Look) -> Values:
        """Colours (rows, cols, 3) 0..1."""
        low, high = self.limits(look)
        values = np.asarray(self.values(look), np.float64)
        rgb = np.asarray(self.colours((values - low) / (high - low)))[..., :3]
        return np.where(np.isfinite(values)[..., None], rgb, UNKNOWN)


def _map(name: str) -> Colormap:
    return colormaps[name]


def _mapped(look: Look) -> Values:
    """How far each cell has come from hearsay to knowledge, 0..1."""
    seen: Values = np.where(np.isfinite(look.age_s), np.clip(look.confidence / CONFIDENT, 0.25, 1.0), 0.0)
    return seen


@dataclass(frozen=True, eq=False)
class MappedScale(Scale):
    """Coloured where robots have mapped, pale elsewhere."""

    def rgb(self, look: Look) -> Values:
        """Colours (rows, cols, 3) 0..1."""
        share, (low, high) = _mapped(look)[..., None], self.limits(look)
        up = np.clip((np.nan_to_num(self.values(look), nan=low) - low) / (high - low), 0, 1)[..., None]
        pale = PALE_LOW + up * (PALE_HIGH - PALE_LOW)
        return np.asarray(share * super().rgb(look) + (1 - share) * pale)


SCALES = {
    scale.label: scale
    for scale in (
        MappedScale("mapped so far", "m", _map(HEIGHT), lambda k: k.height_m, lambda k: k.range_m,
                    says="height, in colour once a robot has seen it; pale is only the prior"),
        Scale("height", "m", _map(HEIGHT), lambda k: k.height_m, lambda k: k.range_m,
              says="upper surface of the map"),
        Scale("occupation", "", OCCUPATION, lambda k: k.occupation, lambda k: (0.0, 1.0),
              says="dark is barred to a robot"),
        Scale("confidence", "", _map(CONFIDENCE), lambda k: k.confidence, lambda k: (0.0, 255.0),
              says=f"a cell counts as mapped from {CONFIDENT:.0f}"),
        Scale("age", "s", _map("magma_r"), lambda k: k.age_s, lambda k: (0.0, AGE_MAX_S),
              says="since the map last changed there; grey is still the prior"),
        Scale("who saw it last", "", FLEET, lambda k: k.by % FLEET.N, lambda k: (-0.5, FLEET.N - 0.5),
              says="in the colour of the robot; grey is still the prior", needs=WHO),
        Scale("error", "m", _map(ERROR), lambda k: k.height_m - k.truth_m, lambda k: (-ERROR_MAX_M, ERROR_MAX_M),
              says="map minus truth: red is too high, blue too low", needs=TRUTH),
        Scale("prior", "m", _map(HEIGHT), lambda k: k.prior_m, lambda k: k.range_m, lambda k: k.prior_m,
              says="what was believed before the first scan"),
        Scale("truth", "m", _map(HEIGHT), lambda k: k.truth_m, lambda k: k.range_m, lambda k: k.truth_m,
              says="what is really there", needs=TRUTH),
    )
}  # fmt: skip
"""By the word in the page's menu, the first of them at the start."""


def linear_bytes(rgb: npt.NDArray[Any]) -> U1:
    """Colours (..., 3) 0..1 as people see them, as the linear bytes that a glTF file wants."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.round(np.clip(linear, 0, 1) * 255), np.uint8)


def robot_rgb(index: int) -> tuple[int, int, int]:
    """A robot's colour, 0..255."""
    r, g, b = to_rgb(robot_colour(index))
    return round(r * 255), round(g * 255), round(b * 255)
