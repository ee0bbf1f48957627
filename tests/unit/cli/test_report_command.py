from __future__ import annotations

import argparse
from pathlib import Path

import pytest
from orograph.cli import report
from orograph.errors import InputError
from orograph.report import folder
from orograph.storage.run_folder import REPORT, SUMMARY


def arguments(*argv: str) -> argparse.Namespace:
    top = argparse.ArgumentParser()
    report.add_parser(top.add_subparsers())
    return top.parse_args(["report", *argv])


def test_it_says_where_the_report_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(folder, "compose", lambda out: out / SUMMARY)
    args = arguments(str(tmp_path))
    assert args.main(args) == 0
    assert capsys.readouterr().out == f"{tmp_path / REPORT}\n"


def test_a_folder_without_a_run_is_bad_input(tmp_path: Path) -> None:
    args = arguments(str(tmp_path))
    with pytest.raises(InputError, match=r"scenario\.json cannot be read"):
        args.main(args)
