"""Composes the finished run folder from what the services left in OUT/parts, summary.json last."""

from __future__ import annotations

import json
from pathlib import Path

from orograph.judge import reference, summary
from orograph.report import page
from orograph.storage.parts import read_parts
from orograph.storage.recorded_map import map_arrays
from orograph.storage.run_folder import EVENTS, GLRM, REPORT, SUMMARY, cache_folder, hrm_file, write_arrays, write_whole


def compose(out: Path, cache: Path | None = None) -> Path:
    """Make the finished run folder from `out`/parts and give the path of its summary.json; raises FolderError.

    `cache` keeps reference maps, which depend on the scenario alone; None: where this machine keeps such things.
    """
    (out / SUMMARY).unlink(missing_ok=True)
    parts = read_parts(out)
    verdict = summary.judge(parts, reference.cached(parts.scenario, cache or cache_folder()))
    write_whole(out / EVENTS, "".join(json.dumps(e, sort_keys=True) + "\n" for e in parts.events))
    write_arrays(out / GLRM, map_arrays(verdict.glrm))
    for robot, hrm in parts.hrms():
        write_arrays(out / hrm_file(robot), map_arrays(hrm))
    write_whole(out / REPORT, page.render(parts, verdict))
    verdict.summary.write(out)
    return out / SUMMARY
