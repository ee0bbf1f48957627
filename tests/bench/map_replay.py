"""Recorded scans through the mapping rules, without a mission: what each robot's maps and planning become."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from orograph.arrays import F64, Mask
from orograph.geometry import laser_position_m, ray_directions, rotation
from orograph.grid import Grid
from orograph.judge.improvement import prior_over
from orograph.judge.map_truth import window
from orograph.layers import UNKNOWN_OCCUPATION, CellMap
from orograph.mapping import RobotMapper
from orograph.mapping.cells import values_of
from orograph.messages import ROBOT_REGISTER, UPDATE
from orograph.navigation.planner import BLOCKED
from orograph.points import points_from_ranges
from orograph.protocol.fold import fold_registers, whole_prior
from orograph.protocol.tiles import map_hash
from orograph.registers import has_evidence, unpack
from orograph.rules import Rules
from orograph.scenario import LaserSpec, Scenario
from orograph.scene.prior import given_layers, prior_records


def has_rules(name: str) -> bool:
    """Whether the mapping knows a rule set of that name."""
    try:
        Rules.of(name)  # type: ignore[arg-type]
    except KeyError:
        return False
    return True


@dataclass(frozen=True, eq=False)
class Planning:
    """What planning holds after a scan: blocked cells (rows, cols) over the HRM's grid."""

    blocked: Mask
    grid: Grid


class Replay:
    """Robots that map what they are given by one rule set, over one prior, and the map that they make together."""

    def __init__(self, scenario: Scenario, rules: str) -> None:
        self.scenario = scenario = scenario.model_copy(update={"rules": rules})
        self._rules = rules
        self._grid, self._factor = scenario.grid.grid, scenario.hrm.per_glrm_cell
        self._prior_records = whole_prior(prior_records(scenario), self._grid.size)
        self._given = given_layers(scenario)
        self.prior = unpack(self._prior_records, self._grid, *self._given)
        occupation, known = self._prior_records["occupation"], has_evidence(self._prior_records)
        self._prior_values = values_of(self.prior)
        self._told = np.where(known, occupation, np.uint8(UNKNOWN_OCCUPATION))
        self._mappers = {n + 1: self._mapper() for n in range(scenario.robots)}
        fine = self._grid.refined(self._factor)
        self._fine, self._hit = fine, {n: np.zeros(fine.shape, np.bool_) for n in self._mappers}

    def _mapper(self) -> RobotMapper:
        s = self.scenario
        rules = Rules.of(self._rules)  # type: ignore[arg-type]
        return RobotMapper(self._grid, s.hrm.cells, self._factor, rules, s.laser.range_max_m, s.robot.slope_max,
                           self._given)  # fmt: skip

    @property
    def prior_blocked(self) -> Mask:
        """Cells (rows, cols) of the fine grid over the whole map that the prior alone bars."""
        blocked = (self._told >= BLOCKED) & (self._told != UNKNOWN_OCCUPATION)
        coarse = blocked.reshape(self._grid.shape)
        return np.repeat(np.repeat(coarse, self._factor, axis=0), self._factor, axis=1)

    def map(self, robot: int, ranges: npt.NDArray[Any], R_map_robot: F64, eye_m: F64, stamp_ns: int) -> Planning:
        """One robot maps one scan; what its planning is told then."""
        mapper = self._mappers[robot]
        directions = ray_directions(self.scenario.laser)
        mapper.step_scan(ranges, directions, R_map_robot, eye_m, stamp_ns)
        points_m, _ = points_from_ranges(ranges, directions, R_map_robot, eye_m)
        rows, cols = self._fine.rows_cols(points_m[:, :2])
        inside = self._fine.contains(rows, cols)
        self._hit[robot][rows[inside], cols[inside]] = True
        codes = mapper.planning_occupation(self._prior_values, self._told)
        return Planning((codes >= BLOCKED) & (codes != UNKNOWN_OCCUPATION), mapper.hrm_grid)

    def glrm_records(self) -> npt.NDArray[Any]:
        """The Map Manager's cells (n,) CELL once every robot has flushed."""
        registers = []
        for robot, mapper in self._mappers.items():
            own = mapper.registers()
            rows = np.zeros(len(own), ROBOT_REGISTER)
            for name in UPDATE.names or ():
                rows[name] = own[name]
            rows["robot"] = robot
            registers.append(rows)
        rules = Rules.of(self._rules)  # type: ignore[arg-type]
        return fold_registers(self._prior_records, np.concatenate(registers), rules)

    def glrm(self) -> CellMap:
        """The same as a map."""
        return unpack(self.glrm_records(), self._grid, *self._given)

    def glrm_hash(self) -> str:
        """Its hash, as a mission's summary names it."""
        return map_hash(self.glrm_records()).hex()

    def glrm_hit(self) -> Mask:
        """GLRM cells (rows, cols) that a point of any robot fell into."""
        hit = np.any(list(self._hit.values()), axis=0)
        shape = (self._grid.rows, self._factor, self._grid.cols, self._factor)
        return np.asarray(hit.reshape(shape).any(axis=(1, 3)))

    def hrms(self) -> Iterator[tuple[CellMap, CellMap, Mask]]:
        """Each robot's HRM over the prior, the prior alone over the same cells, and the robot's hits (rows, cols)."""
        for robot, mapper in self._mappers.items():
            hrm = mapper.hrm(self.prior)
            yield hrm, prior_over(self.prior, hrm.grid), window(self._hit[robot], self._fine, hrm.grid, False)


def believed(scan: np.void, laser: LaserSpec) -> tuple[F64, F64]:
    """(R_map_robot, laser's position [m]) by the pose that a recorded SCAN came with, as the mapping node has them."""
    R_map_robot = rotation(float(scan["roll_rad"]), float(scan["pitch_rad"]), float(scan["yaw_rad"]))
    position_m = np.array([scan["x_m"], scan["y_m"], scan["z_m"]])
    return R_map_robot, laser_position_m(laser, R_map_robot, position_m)
