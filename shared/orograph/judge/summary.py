"""A run judged: scores, checks and the figures of summary.json."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from orograph import keys
from orograph.arrays import I64, Mask
from orograph.grid import Grid
from orograph.judge.checks import (
    Checks,
    Ledger,
    checks,
    contacts,
    lost_cells,
    read_ledger,
    surface_changes,
    waypoints_missed,
)
from orograph.judge.improvement import BeforeAfter, improvement, prior_over
from orograph.judge.map_truth import NEAR_GLRM, NEAR_HRM, PLACES_GLRM, PLACES_HRM, MapTruth, true_map
from orograph.judge.reference import Reference
from orograph.judge.score import Truth, coverage, mapping_times_s, score_maps, truth_of_map
from orograph.judge.timing import table_2
from orograph.judge.tracks import Track, tracks
from orograph.layers import CONFIDENT, CellMap, Layer
from orograph.protocol.tiles import map_hash
from orograph.registers import has_evidence, unpack
from orograph.scene import Scene, build_scene
from orograph.scene.prior import given_layers, prior_records
from orograph.storage.parts import RunParts
from orograph.storage.results import Improvements, MapScores, Scores, Summary

BUILDING_FROM_M = 1.0
"""A cell counts as building where the true surface stands more than this above the ground."""
NUMBERS = dict(enumerate(["Two", "Three", "Four", "Five", "Six", "Seven", "Eight", "Nine", "Ten"], 2))


@dataclass(frozen=True)
class RadioRow:
    """One robot's dealings with the radio over the whole run; None where it is not known."""

    robot: str
    up_kb: float | None
    up_kbps: float | None
    down_kb: float | None
    down_kbps: float | None
    silent_s: float | None
    acked: int | None
    lost: int | None
    equal: bool | None


@dataclass(frozen=True, eq=False)
class Verdict:
    """Everything that page and summary say about a run."""

    glrm: CellMap
    prior: CellMap
    scene: Scene
    reference: Reference
    surface: Truth
    """The true top surface over the GLRM grid."""
    checks: Checks
    tracks: Mapping[str, Track]
    radio: list[RadioRow]
    summary: Summary
    sentence: str

    @property
    def good(self) -> bool:
        """Every promise that could be checked was kept, and all could be."""
        return all(check.ok for check in self.checks)

    @property
    def observable_cells(self) -> int:
        """GLRM cells that the patrol can map."""
        return int(self.reference.observable.sum())

    @property
    def driven_m(self) -> float:
        """Length of all true paths together."""
        return sum(track.length_m for track in self.tracks.values())


def judge(parts: RunParts, reference: Reference) -> Verdict:
    """Score a run and check its promises."""
    ledger, scene = read_ledger(parts), build_scene(parts.scenario, round(parts.run.sim_time_s * 1e9))
    given = given_layers(parts.scenario)
    records = prior_records(parts.scenario)
    prior = unpack(records, parts.glrm_grid, *given)
    glrm = prior if ledger.glrm is None else unpack(ledger.glrm, parts.glrm_grid, *given)
    glrm = _with_changed_at(glrm, parts)
    truth = true_map(scene, glrm.grid, PLACES_GLRM, NEAR_GLRM)
    whole = BeforeAfter(prior, glrm, truth, _held(ledger, glrm.grid))
    local = [
        BeforeAfter.of(prior_over(prior, hrm.grid), hrm, true_map(scene, hrm.grid, PLACES_HRM, NEAR_HRM))
        for _, hrm in parts.hrms()
    ]
    ways, promises = tracks(parts), checks(parts, ledger, records)
    radio = [_radio(parts, ledger, ways, robot) for robot in parts.robots]
    summary = _summary(
        parts, ledger, promises, glrm, reference, radio,
        MapScores(
            glrm=_scores([whole], [truth_of_map(reference.glrm)]),
            hrm=_scores(local, [truth_of_map(reference.hrm_over(m.final.grid)) for m in local]),
        ),
        Improvements(glrm=improvement([whole]), hrm=improvement(local)),
    )  # fmt: skip
    return Verdict(
        glrm=glrm, prior=prior, scene=scene, reference=reference, surface=_surface(truth), checks=promises,
        tracks=ways, radio=radio, summary=summary, sentence=sentence(parts, summary),
    )  # fmt: skip


def _with_changed_at(glrm: CellMap, parts: RunParts) -> CellMap:
    """The map with the layer `changed_at`, where anything changed."""
    changed_ms = parts.of(keys.MANAGER).get("changed_ms", np.zeros(0, np.int64))
    if not (changed_ms >= 0).any():
        return glrm
    changed_s = np.where(changed_ms >= 0, changed_ms / 1e3, np.nan).astype(np.float32).reshape(glrm.grid.shape)
    return CellMap(glrm.grid, {**glrm.by_name, "changed_at": changed_s})


def _held(ledger: Ledger, grid: Grid) -> Mask:
    """GLRM cells (rows, cols) of which the manager holds any evidence."""
    held = np.zeros(grid.size, np.bool_)
    held[ledger.held["cell"][has_evidence(ledger.held)]] = True
    return held.reshape(grid.shape)


def _surface(truth: MapTruth) -> Truth:
    return Truth(truth.surface_m, truth.barred, np.isfinite(truth.surface_m))


def _scores(maps: list[BeforeAfter], ideal: list[Truth]) -> Scores:
    finals, surfaces = [m.final for m in maps], [_surface(m.truth) for m in maps]
    seen = [CellMap(m.grid, {**m.by_name, "height": m.visible}) for m in finals]
    buildings = [np.nan_to_num(m.truth.surface_m - m.truth.ground_m) > BUILDING_FROM_M for m in maps]
    against_surface, against_ideal = (
        score_maps(list(zip(cells, truths, buildings, strict=True)))
        for cells, truths in ((seen, surfaces), (finals, ideal))
    )
    return Scores(surface=against_surface, ideal=against_ideal)


def _summary(
    parts: RunParts, ledger: Ledger, promises: Checks, glrm: CellMap, reference: Reference, radio: list[RadioRow],
    score: MapScores, improvements: Improvements,
) -> Summary:  # fmt: skip
    run = parts.run
    told = [row for row in radio if row.robot in parts.staying or row.acked is not None]
    return Summary(
        scenario=parts.scenario.name,
        seed=run.seed,
        robots=len(parts.robots),
        robots_gone=parts.gone,
        robots_revoked=parts.revoked,
        mode=run.mode,
        runner=run.runner,
        commit=run.commit,
        complete=run.complete,
        waypoints=len(parts.scenario.patrol),
        waypoints_missed=waypoints_missed(parts),
        contacts=contacts(parts),
        surface_changes=surface_changes(parts),
        deterministic=bool(promises.deterministic.ok),
        sim_time_s=run.sim_time_s,
        wall_time_s=run.wall_time_s,
        rtf=run.sim_time_s / run.wall_time_s if run.wall_time_s > 0 else None,
        glrm_hash=None if ledger.glrm is None else map_hash(ledger.glrm).hex(),
        copies_hash_equal=promises.copies_equal.ok,
        glrm_is_own_fold=promises.is_own_fold.ok,
        coverage=coverage(glrm, reference.observable),
        observable_cells=int(reference.observable.sum()),
        mapping_time_s=mapping_times_s(first_confident_ns(parts), reference.observable),
        stages_ms={row.stage: row.all for row in table_2(parts)},
        bytes_up_per_robot_s=_mean([row.up_kbps for row in radio], 1000.0),
        bytes_down_per_robot_s=_mean([row.down_kbps for row in radio], 1000.0),
        cells_acked=_sum([row.acked for row in told]),
        cells_lost=_sum([row.lost for row in told]),
        missing_parts=parts.missing(),
        score=score,
        improvement=improvements,
    )


def first_confident_ns(parts: RunParts) -> I64:
    """Stamp (rows * cols,) at which each cell first had confidence 64; negative where it never had."""
    return parts.of(keys.MANAGER).get("first_confident_ns", np.full(parts.glrm_grid.size, -1, np.int64))


def _radio(parts: RunParts, ledger: Ledger, ways: Mapping[str, Track], robot: str) -> RadioRow:
    up, down, seconds = parts.bytes_up.get(robot), parts.bytes_down.get(robot), max(parts.run.sim_time_s, 1e-9)
    track = ways.get(robot)
    copy = ledger.copies.get(robot)
    acked = len(ledger.acked[robot]) if robot in ledger.acked else None
    return RadioRow(
        robot=robot,
        up_kb=None if up is None else up / 1000,
        up_kbps=None if up is None else up / 1000 / seconds,
        down_kb=None if down is None else down / 1000,
        down_kbps=None if down is None else down / 1000 / seconds,
        silent_s=None if track is None else sum(end - begin for begin, end in track.silences_s()),
        acked=acked,
        lost=None if acked is None or ledger.glrm is None else lost_cells(ledger, robot),
        equal=None if copy is None or ledger.copied is None else map_hash(copy) == map_hash(ledger.copied),
    )


def _mean(values: list[float | None], factor: float) -> float | None:
    known = [v for v in values if v is not None]
    return factor * sum(known) / len(known) if known else None


def _sum(values: list[int | None]) -> int | None:
    return None if None in values else sum(v for v in values if v is not None)


def sentence(parts: RunParts, summary: Summary) -> str:
    """The run in two sentences."""
    robots = len(parts.robots)
    who = "One robot" if robots == 1 else f"{NUMBERS.get(robots, str(robots))} robots"
    minutes, seconds = divmod(round(parts.run.sim_time_s), 60)
    share = summary.coverage
    covered = "an unknown share" if math.isnan(share) else f"{100 * share:.1f}\u00a0%"
    time = f"{minutes}\u00a0min\u00a0{seconds:02d}\u00a0s"
    first = f"{who} mapped {covered} of what the patrol can see in {time} of simulation."
    revoked = f"Revoked, and not in the map: {', '.join(parts.revoked)}." if parts.revoked else ""
    same = {
        True: f"Every robot{' that stayed' * bool(parts.gone)} ended with the same map, bit for bit.",
        False: "The robots' copies of the map differ.",
        None: "",
    }
    return " ".join(part for part in (first, same[summary.copies_hash_equal], revoked) if part)


def glrm_errors(verdict: Verdict) -> tuple[Layer, Layer]:
    """The final GLRM minus the true upper surface, and minus the ideal map [m], NaN where it is not confident."""
    sure = verdict.glrm.confidence >= CONFIDENT
    ideal = truth_of_map(verdict.reference.glrm)
    surface = np.where(sure & verdict.surface.known, verdict.glrm.visible - verdict.surface.height_m, np.nan)
    rule = np.where(sure & ideal.known, verdict.glrm.height - ideal.height_m, np.nan)
    return surface.astype(np.float32), rule.astype(np.float32)
