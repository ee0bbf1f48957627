"""The report's colours and type, and figures turned into inline SVG; colour-blind safe throughout.

Robots by Okabe and Ito's set; values by perceptual maps: viridis (height), cividis (confidence), a paper-to-ink ramp
(occupation), and blue - white - red (errors).
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote

import matplotlib
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

INK, QUIET, RULE, PAPER, GROUND = "#1d2b36", "#5c6b76", "#d9dee2", "#ffffff", "#f3f1ea"
ROBOT_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7a6a00", "#7b4fa3")
ALARM = "#b3261e"
HEIGHT, CONFIDENCE, ERROR = "viridis", "cividis", "RdBu_r"
OCCUPATION = LinearSegmentedColormap.from_list("paper_to_ink", ["#fbf7ee", "#e9c46a", "#c8553d", "#42203b"])
UNKNOWN = "#e4e7ea"

STYLE: Any = {
    "svg.hashsalt": "orograph",
    "svg.fonttype": "none",
    "font.size": 9.0,
    "text.color": INK,
    "axes.edgecolor": QUIET,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 10.0,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.frameon": False,
    "figure.facecolor": PAPER,
    "savefig.facecolor": PAPER,
}
FONTS = "'Helvetica Neue', Arial, 'Liberation Sans', 'DejaVu Sans', sans-serif"
RASTER_DPI = 170
ENCODED = re.compile(r"[^\w !$()*+,./:;=?@~|{}-]", re.ASCII)
"""What must be percent-encoded in a data URI; all else may stand, and most of it is base64."""
Draw = Callable[[Figure], None]


@dataclass(frozen=True)
class Picture:
    """A finished picture for the page."""

    source: str
    """data: URI of an SVG."""
    caption: str
    alt: str
    width: int
    height: int


def robot_colour(index: int) -> str:
    """Colour of the robot at this place in the fleet (0 first); comes round again after eight."""
    return ROBOT_COLOURS[index % len(ROBOT_COLOURS)]


def picture(size_in: tuple[float, float], caption: str, alt: str, draw: Draw) -> Picture:
    """Let `draw` fill a figure of this size [inch] and turn it into inline SVG, the same bytes for the same input."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size_in, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure)
        stream = io.BytesIO()
        figure.savefig(stream, format="svg", dpi=RASTER_DPI, metadata={"Date": None, "Creator": None})
    svg = stream.getvalue().decode().replace("'DejaVu Sans'", FONTS)
    # Percent-encoding and not base64: the rasters inside are base64 already, and a second layer costs a third more.
    return Picture(
        f"data:image/svg+xml,{ENCODED.sub(_percent, svg)}", caption, alt, round(size_in[0] * 96), round(size_in[1] * 96)
    )


def _percent(found: re.Match[str]) -> str:
    return quote(found[0])
