"""report.html: one self-contained page from a judged run; numbers come from `summary`, pictures from `gallery`."""

from __future__ import annotations

import math
from importlib import resources

import jinja2

from orograph.judge.score import CONFIDENCE_BINS, SHARES
from orograph.judge.summary import Verdict
from orograph.judge.timing import PAPER_ROBOTS, PAPER_TABLE_3_S, table_2
from orograph.layers import OCCUPIED
from orograph.report.gallery import gallery
from orograph.report.study import mapping_times
from orograph.storage.parts import RunParts
from orograph.storage.results import StudyRow

COMPARED = (
    ("Ground away from walls: RMSE [m]", "ground_away_rmse_m", "ground_away_cells", 3, -1),
    ("Ground beside walls: RMSE [m]", "ground_near_rmse_m", "ground_near_cells", 3, -1),
    ("Tops of what stands: mean error [m]", "object_mae_m", "object_cells", 2, -1),
    ("Occupation: precision", "precision", "", 2, 1),
    ("Occupation: recall", "recall", "", 2, 1),
    ("Occupation: overlap (IoU)", "iou", "", 2, 1),
    ("Built-up cells called drivable", "houses_drivable", "object_cells", 2, -1),
)
"""Rows of the table of prior and final map: title, figure, its cells, digits, and whether more is better (1) or not."""


def change(prior: float, final: float, digits: int, better: int) -> str:
    """The class of a final figure beside the prior's: better, worse, or none where both look the same."""
    step = better * (round(final, digits) - round(prior, digits))
    return "better" if step > 0 else "worse" if step < 0 else ""


def render_study(title: str, rows: list[StudyRow]) -> str:
    """study.html: the paper's Table 3 beside ours, as one self-contained page."""
    return template("study.html.j2").render(title=title, rows=rows, picture=mapping_times(rows))


def render(parts: RunParts, verdict: Verdict) -> str:
    """The whole page as HTML text without any outside request."""
    return template("report.html.j2").render(
        parts=parts,
        run=parts.run,
        machine=parts.run.machine,
        scenario=parts.scenario,
        verdict=verdict,
        summary=verdict.summary,
        pictures=gallery(parts, verdict),
        table_2=table_2(parts),
        paper_robots=PAPER_ROBOTS,
        paper_table_3=PAPER_TABLE_3_S,
        bins=CONFIDENCE_BINS,
        shares=SHARES,
        occupied=OCCUPIED,
        compared=COMPARED,
        change=change,
    )


def template(name: str) -> jinja2.Template:
    """One of the pages, with its style and filters."""
    source = resources.files("orograph.report").joinpath(name).read_text(encoding="utf-8")
    style = resources.files("orograph.report").joinpath("style.css.j2").read_text(encoding="utf-8")
    loader = jinja2.DictLoader({name: source, "style.css.j2": style})
    environment = jinja2.Environment(
        loader=loader, autoescape=jinja2.select_autoescape(default=True), undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.filters["fixed"] = fixed
    environment.filters["percent"] = lambda share: fixed(None if share is None else 100 * share, 1)
    return environment.get_template(name)


def fixed(value: float | None, digits: int = 2) -> str:
    """A number with this many digits and thin thousands marks; a dash for what is unknown."""
    if value is None or not math.isfinite(value):
        return "–"
    text = f"{round(value, digits) + 0.0:,.{digits}f}"
    return text.replace(",", "\u202f").replace("-", "\u2212")
