"""Where robots really were, where they thought they were, and when their radio reached."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from orograph import keys
from orograph.arrays import F64, Mask
from orograph.storage.parts import RunParts


@dataclass(frozen=True, eq=False)
class Track:
    """One robot's run by frames."""

    time_s: F64
    position_m: F64
    """True (n, 2)."""
    radio: Mask
    pose_error_m: tuple[F64, F64]
    """(time [s], distance in the plane [m]) between estimate and truth, empty without an estimate."""

    @property
    def length_m(self) -> float:
        """Length of the true path."""
        return float(np.hypot(*np.diff(self.position_m, axis=0).T).sum())

    def silences_s(self) -> list[tuple[float, float]]:
        """Stretches [begin, end] without radio."""
        silent = np.concatenate([[0], ~self.radio, [0]]).astype(np.int8)
        edges = np.diff(silent)
        begins, ends = np.flatnonzero(edges == 1), np.minimum(np.flatnonzero(edges == -1), len(self.time_s) - 1)
        return list(zip(self.time_s[begins].tolist(), self.time_s[ends].tolist(), strict=True))


def tracks(parts: RunParts) -> dict[str, Track]:
    """Tracks of the robots whose truth the world left, in order of robots."""
    found = {robot: _track(parts, robot) for robot in parts.robots}
    return {robot: track for robot, track in found.items() if track is not None}


def _track(parts: RunParts, robot: str) -> Track | None:
    world = parts.of(keys.WORLD)
    truth = world.get(f"{robot}_truth")
    if truth is None or not len(truth):
        return None
    time_s, position_m = truth[:, 0] / 1e9, truth[:, 1:3]
    radio = world.get(f"{robot}_radio", np.ones(len(truth), np.bool_)).astype(np.bool_)
    return Track(time_s, position_m, radio, _pose_error(parts, robot, time_s, position_m))


def _pose_error(parts: RunParts, robot: str, time_s: F64, position_m: F64) -> tuple[F64, F64]:
    """Estimates compared at the stamps that the truth has too: of a long run both keep some frames, never others."""
    estimate = parts.of(keys.NAVIGATOR, robot).get("trajectory")
    if estimate is None or not len(estimate):
        return np.zeros(0), np.zeros(0)
    at_s = estimate[:, 0] / 1e9
    _, ours, true = np.intersect1d(at_s, time_s, assume_unique=True, return_indices=True)
    return at_s[ours], np.hypot(*(estimate[ours, 1:3] - position_m[true]).T)
