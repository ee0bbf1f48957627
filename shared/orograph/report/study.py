"""One scenario with different numbers of robots: the paper's Table 3 side by side with ours."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.figure import Figure

from orograph.judge.timing import PAPER_TABLE_3_S
from orograph.report import palette
from orograph.report.palette import Picture
from orograph.storage.results import StudyRow, Summary


def study_rows(summaries: Sequence[tuple[str, Summary]], times_s: Mapping[int, float | None]) -> list[StudyRow]:
    """Rows in order of robots from pairs (run folder, summary) and the mapping time of each number of robots.

    Speed-ups are against one robot, None without it.
    """
    ordered = sorted(summaries, key=lambda pair: pair[1].robots)
    return [_row(folder, summary, times_s) for folder, summary in ordered]


def _row(folder: str, summary: Summary, times_s: Mapping[int, float | None]) -> StudyRow:
    robots, alone_s = summary.robots, times_s.get(1)
    mapping_s = times_s[robots]
    paper_s = PAPER_TABLE_3_S.get(robots)
    return StudyRow(
        robots=robots,
        paper_s=paper_s,
        paper_speed_up=None if paper_s is None else PAPER_TABLE_3_S[1] / paper_s,
        mapping_s=mapping_s,
        speed_up=alone_s / mapping_s if alone_s and mapping_s else None,
        coverage=summary.coverage,
        sim_time_s=summary.sim_time_s,
        rtf=summary.rtf,
        height_rmse_m=summary.score.glrm.ideal.rmse_m,
        copies_hash_equal=summary.copies_hash_equal,
        cells_lost=summary.cells_lost,
        run=folder,
    )


def mapping_times(rows: Sequence[StudyRow]) -> Picture:
    """Speed-up over the number of robots: the paper's, ours, and the ideal."""
    ours = [(r.robots, r.speed_up) for r in rows if r.speed_up is not None]
    most = max([*PAPER_TABLE_3_S, *(r.robots for r in rows)])

    def draw(figure: Figure) -> None:
        axes = figure.subplots()
        axes.plot([1, most], [1, most], color=palette.RULE, lw=1.2, label="one robot's time divided by their number")
        paper = [PAPER_TABLE_3_S[1] / s for s in PAPER_TABLE_3_S.values()]
        axes.plot(list(PAPER_TABLE_3_S), paper, "s--", color=palette.QUIET, ms=6, lw=1.3, label="paper")
        axes.plot(
            [n for n, _ in ours], [s for _, s in ours], "o-", color=palette.ROBOT_COLOURS[0], ms=7, label="Orograph"
        )
        axes.set_xticks(range(1, most + 1))
        axes.set_ylim(bottom=0)
        axes.set_xlabel("robots")
        axes.set_ylabel("speed-up")
        axes.legend(loc="upper left")

    return palette.picture(
        (9.0, 3.8),
        "How many times faster the district is mapped with more robots: 95 % mapping time of one robot divided by "
        "that of so many.",
        "Line chart of speed-up over the number of robots, the paper's and ours.",
        draw,
    )
