"""The tree of frames that a robot's recording tells of: which frame stands where in which, and since when."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from orograph.arrays import F64, I64
from orograph.importers.scans.scan import ScanError
from orograph.importers.scans.trajectory import Trajectory, from_quaternions

ROOTS = ("map", "world", "earth", "odom", "odom_combined", "camera_init")
"""Frames that stand still, the best first."""


@dataclass
class _Edge:
    parent: str
    stamps_ns: list[int] = field(default_factory=list)
    rows: list[tuple[float, ...]] = field(default_factory=list)


class Frames:
    """Child frames in their parents, as TF and odometry tell them."""

    def __init__(self) -> None:
        self._fixed: dict[str, tuple[str, F64]] = {}
        self._moving: dict[str, _Edge] = {}

    def add(self, child: str, parent: str, stamp_ns: int | None, row: tuple[float, ...]) -> None:
        """A transform: position (x, y, z) and quaternion (x, y, z, w) of `child` in `parent`; None holds always."""
        child, parent = child.lstrip("/"), parent.lstrip("/")
        values = np.array(row)
        if not np.isfinite(values).all() or np.linalg.norm(values[3:]) < 1e-6 or child == parent:
            return
        if stamp_ns is None:
            self._fixed[child] = parent, from_quaternions(values[None, :3], values[None, 3:])[0]
            return
        edge = self._moving.setdefault(child, _Edge(parent))
        if edge.parent == parent:
            edge.stamps_ns.append(stamp_ns)
            edge.rows.append(row)

    def parent(self, child: str) -> str | None:
        """The frame that a frame stands in."""
        if child in self._moving:
            return self._moving[child].parent
        return self._fixed[child][0] if child in self._fixed else None

    def chain(self, sensor: str) -> list[str]:
        """Frames from the sensor up to the one that stands still: the best known root, else the last."""
        chain = [sensor]
        while (above := self.parent(chain[-1])) is not None and above not in chain:
            chain.append(above)
        known = [chain.index(root) for root in ROOTS if root in chain]
        return chain[: known[0] + 1] if known else chain

    def trajectory(self, sensor: str) -> Trajectory:
        """Poses of a sensor's frame in the frame that stands still; raises ScanError where none leads there."""
        sensor = sensor.lstrip("/")
        chain = self.chain(sensor)[:-1]
        moving = [child for child in chain if child in self._moving]
        if not chain or not (moving or len(chain) == 1):
            known = ", ".join(sorted({*self._fixed, *self._moving})) or "none"
            raise ScanError(
                f"frame {sensor}: no transform or odometry leads from it to a frame that stands still (frames told of: "
                f"{known}); give --poses and --sensor-pose"
            )
        stamps = self._stamps(moving)
        poses = np.tile(np.eye(4), (len(stamps), 1, 1))
        for child in chain:
            poses = self._poses(child, stamps) @ poses
        return Trajectory(stamps, poses)

    def _stamps(self, moving: Iterable[str]) -> I64:
        """When anything of a chain was told of, as long as all of it was."""
        told = [np.array(self._moving[child].stamps_ns, np.int64) for child in moving]
        if not told:
            return np.zeros(1, np.int64)
        first, last = max(stamps.min() for stamps in told), min(stamps.max() for stamps in told)
        stamps = np.unique(np.concatenate(told))
        stamps = stamps[(stamps >= first) & (stamps <= last)]
        return stamps if len(stamps) else np.array([first], np.int64)

    def _poses(self, child: str, stamps_ns: I64) -> F64:
        if child not in self._moving:
            return np.repeat(self._fixed[child][1][None], len(stamps_ns), axis=0)
        edge = self._moving[child]
        rows = np.array(edge.rows)
        return Trajectory(edge.stamps_ns, from_quaternions(rows[:, :3], rows[:, 3:])).at(stamps_ns)
