from __future__ import annotations

import pytest
from made_up.run import made_up_summary
from orograph.report.page import render_study
from orograph.report.study import study_rows


def test_speed_ups_by_hand() -> None:
    rows = study_rows(
        [("b", made_up_summary(3)), ("a", made_up_summary(1)), ("c", made_up_summary(2)), ("d", made_up_summary(4))],
        {1: 450.0, 2: None, 3: 150.0, 4: 100.0},
    )
    assert [r.robots for r in rows] == [1, 2, 3, 4]
    assert [r.speed_up for r in rows] == [1.0, None, 3.0, 4.5]
    assert [r.paper_s for r in rows] == [445, 310, 190, None]
    assert rows[2].paper_speed_up == pytest.approx(2.342, abs=1e-3)
    assert rows[1].paper_speed_up == pytest.approx(1.435, abs=1e-3)


def test_without_a_run_of_one_robot_there_is_no_speed_up() -> None:
    assert [r.speed_up for r in study_rows([("a", made_up_summary(2))], {2: 300.0})] == [None]


def test_the_page_links_to_the_runs_and_escapes() -> None:
    page = render_study(
        "A <b>city</b>",
        study_rows([("robots-1", made_up_summary(1)), ("robots-3", made_up_summary(3))], {1: 450.0, 3: 150.0}),
    )
    assert 'href="robots-3/report.html"' in page
    assert "A &lt;b&gt;city" in page
    assert ">3.00<" in page
