"""The physical world: DART steps of 5 ms over ground, buildings, robots and vehicles; exact poses for everybody."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import dartpy as dart
import numpy as np

from orograph.arrays import F64
from orograph.geometry import quaternion, roll_pitch_yaw
from orograph.keys import robot_number
from orograph.messages import POSE, Packed
from orograph.scenario import Scenario
from orograph.scene import build_scene
from orograph.scene.bodies import standing_robot, standing_rotation
from orograph.scene.changes import epoch
from orograph.world.contact_kernels import feel
from orograph.world.contacts import Outline
from orograph.world.ground import ground_skeleton
from orograph.world.motors import Motors, odometry
from orograph.world.robot_body import RobotBody
from orograph.world.traffic import Lane, Traffic
from orograph.world.tyres import Tyres
from orograph.world.vehicle_body import VehicleBody

STEP_NS = 5_000_000
STEP_S = STEP_NS / 1e9
GRAVITY_MPS2 = 9.81
DROP_M = 0.02
"""A robot starts this much above the exact ground, because the mesh's facets may lie above it."""
STOP = 0.0, 0.0
"""The drive of a robot that has none."""
CONTACTS_PER_BODY_MAX = 64
PUSH_MPS = 0.15
"""What changes a robot's speed by so much within one `advance` has pushed it; edges of the ground's mesh do less."""


class World:
    """Bodies of a scenario under physics; robot_00i starts at `scenario.starts[i - 1]`."""

    def __init__(self, scenario: Scenario, robots: Sequence[str]) -> None:
        """All robots stand at their starts from the beginning; raises ValueError where a robot has no start."""
        for robot in robots:
            if robot_number(robot) > len(scenario.starts):
                raise ValueError(f"{robot} has no start: the scenario has {len(scenario.starts)}")
        self.scenario, self.robots, self.stamp_ns = scenario, tuple(robots), 0
        self.scene = build_scene(scenario)
        self.present: dict[str, bool] = dict.fromkeys(self.robots, False)
        self._epoch, self._ground = epoch(scenario, 0), ground_skeleton(self.scene.mesh)
        self._physics = _new_physics(len(self.robots) + len(scenario.vehicles))
        self._physics.addSkeleton(self._ground)
        self._motors = Motors(scenario.robot, len(self.robots))
        self._tyres = Tyres(scenario.robot, len(self.robots), STEP_S)
        self._poses, self._velocities, self._carried = np.zeros((3, len(self.robots), 6))
        self._impulse_ns, self._push_n = np.zeros((len(self.robots), 3)), np.zeros(len(self.robots))
        self._bodies = {robot: RobotBody(robot, scenario.robot) for robot in self.robots}
        self._odometry = dict.fromkeys(self.robots, (0.0, 0.0))
        self._traffic = Traffic(self.scene, scenario.vehicles)
        self._vehicles = [self._new_vehicle(i, lane) for i, lane in enumerate(self._traffic.lanes)]
        for robot in self.robots:
            self._place_at_start(robot)
            self.add_robot(robot)

    # --- what happens -------------------------------------------------------------------------------------------

    def advance(self, drives: Mapping[str, tuple[float, float]], duration_ns: int) -> None:
        """Let whole 5 ms steps pass; `drives` holds (speed, yaw rate) in m/s, rad/s; a robot without one stops."""
        assert duration_ns > 0 and duration_ns % STEP_NS == 0, duration_ns
        self._follow_changes()
        for i, robot in enumerate(self.robots):
            self._motors.want(i, *(drives.get(robot, STOP) if self.present[robot] else STOP))
        self._send_vehicles_on(duration_ns / 1e9)
        angles_before = self._tyres.angles_rad.copy()
        self._impulse_ns[:], self._push_n[:] = 0.0, 0.0
        for _ in range(duration_ns // STEP_NS):
            self._step()
        for robot, turns_rad in zip(self.robots, self._tyres.angles_rad - angles_before, strict=True):
            self._odometry[robot] = odometry(self.scenario.robot, turns_rad, duration_ns / 1e9)
        self.stamp_ns += duration_ns

    def add_robot(self, robot: str) -> None:
        """A robot appears where it was last, at its start the first time; no effect on one that is there."""
        if not self.present[robot]:
            self._physics.addSkeleton(self._bodies[robot].skeleton)
            self.present[robot] = True
            self._moving = self._bodies_present()

    def remove_robot(self, robot: str) -> None:
        """A robot's body is taken out of the world; no effect on one that is not there."""
        if self.present[robot]:
            self._physics.removeSkeleton(self._bodies[robot].skeleton)
            self._bodies[robot].halt()
            self._motors.reset(self.robots.index(robot))
            self._tyres.halt(self.robots.index(robot))
            self.present[robot] = False
            self._moving = self._bodies_present()

    # --- what is true -------------------------------------------------------------------------------------------

    def poses(self) -> Packed:
        """POSE (robots + vehicles,): robots in their order, then the scenario's vehicles."""
        poses = np.zeros(len(self.robots) + len(self._vehicles), POSE)
        for pose, robot in zip(poses, self.robots, strict=False):
            pose["position_m"], pose["quaternion_wxyz"] = self.position_m(robot), quaternion(self.rotation(robot))
            pose["present"] = self.present[robot]
        for pose, vehicle in zip(poses[len(self.robots) :], self._vehicles, strict=True):
            pose["position_m"], pose["quaternion_wxyz"] = vehicle.position_m, quaternion(vehicle.R)
            pose["present"] = 1
        return poses

    def position_m(self, robot: str) -> F64:
        """Origin (3,) of the robot frame in the map frame."""
        return self._bodies[robot].position_m()

    def rotation(self, robot: str) -> F64:
        """R_map_robot (3, 3)."""
        return self._bodies[robot].rotation()

    def speed_mps(self, robot: str) -> float:
        """Speed along the robot's own x axis, now."""
        return float((self.rotation(robot)[:, 0] * self._bodies[robot].velocity_mps()).sum())

    def wheel_odometry(self, robot: str) -> tuple[float, float]:
        """(speed [m/s], yaw rate [rad/s]) that the wheels turned on average in the last `advance`, slip unseen."""
        return self._odometry[robot]

    def pushes(self) -> dict[str, float]:
        """Robots that something pushed along the ground in the last `advance`, and the greatest force [N]."""
        limit_ns = PUSH_MPS * self.scenario.robot.mass_kg
        hard = np.sqrt((self._impulse_ns**2).sum(axis=1)) >= limit_ns
        return {r: float(self._push_n[i]) for i, r in enumerate(self.robots) if hard[i] and self.present[r]}

    def outlines(self) -> dict[str, Outline]:
        """Where robots that are there and vehicles (`vehicle_000`) stand."""
        (length_m, width_m, _), out = self.scenario.robot.size_m, dict[str, Outline]()
        for robot in self.robots:
            if self.present[robot]:
                x, y, _ = self.position_m(robot).tolist()
                out[robot] = Outline(x, y, roll_pitch_yaw(self.rotation(robot))[2], length_m, width_m)
        for i, ((x, y, yaw), lane) in enumerate(zip(self.vehicle_poses().tolist(), self._traffic.lanes, strict=True)):
            length_m, width_m, _ = lane.vehicle.size_m
            out[f"vehicle_{i:03d}"] = Outline(x, y, yaw, length_m, width_m)
        return out

    def vehicle_poses(self) -> F64:
        """(vehicles, 3): x, y [m] and yaw [rad]."""
        rows = [(*v.position_m[:2], math.atan2(v.R[1, 0], v.R[0, 0])) for v in self._vehicles]
        return np.array(rows, np.float64).reshape(-1, 3)

    # --- how ----------------------------------------------------------------------------------------------------

    def _step(self) -> None:
        for row, skeleton in self._moving:
            self._poses[row] = skeleton.getPositions()
            self._velocities[row] = skeleton.getVelocities()
            self._carried[row] = skeleton.getConstraintForces()
        feel(self._poses, self._carried, STEP_S, self._impulse_ns, self._push_n)
        torques_nm = self._motors.torques_nm(self._tyres.speeds_radps, STEP_S)
        wrenches = self._tyres.step(self._poses, self._velocities, self._carried, torques_nm)
        for row, skeleton in self._moving:
            skeleton.setCommands(wrenches[row])
        self._physics.step(False)

    def _bodies_present(self) -> list[tuple[int, dart.dynamics.Skeleton]]:
        """Rows and skeletons of the robots that are there."""
        return [(i, self._bodies[robot].skeleton) for i, robot in enumerate(self.robots) if self.present[robot]]

    def _place_at_start(self, robot: str) -> None:
        start = self.scenario.starts[robot_number(robot) - 1]
        R, position_m = standing_robot(self.scene, start.x_m, start.y_m, math.radians(start.heading_deg))
        self._bodies[robot].place(R, position_m + np.array([0.0, 0.0, DROP_M]))

    def _new_vehicle(self, index: int, lane: Lane) -> VehicleBody:
        body = VehicleBody(f"vehicle_{index:03d}", lane.vehicle)
        body.place(*self._standing(lane))
        self._physics.addSkeleton(body.skeleton)
        self._spare_ground(body)
        return body

    def _spare_ground(self, body: VehicleBody) -> None:
        """A vehicle is moved along the ground and does not collide with it."""
        unhurt = self._physics.getConstraintSolver().getCollisionOption().collisionFilter
        unhurt.addBodyNodePairToBlackList(body.node, self._ground.getBodyNode(0))

    def _follow_changes(self) -> None:
        """Bring what stands up to date, as one new mesh."""
        if (now := epoch(self.scenario, self.stamp_ns)) == self._epoch:
            return
        self._epoch, self.scene = now, build_scene(self.scenario, self.stamp_ns)
        self._physics.removeSkeleton(self._ground)
        self._ground = ground_skeleton(self.scene.mesh)
        self._physics.addSkeleton(self._ground)
        for body in self._vehicles:
            self._spare_ground(body)

    def _standing(self, lane: Lane) -> tuple[F64, F64]:
        x, y, z, yaw = lane.pose()
        return standing_rotation(self.scene, x, y, yaw, lane.vehicle.size_m[:2]), np.array([x, y, z])

    def _send_vehicles_on(self, duration_s: float) -> None:
        there = [self.position_m(robot)[:2] for robot in self.robots if self.present[robot]]
        radius_m = 0.5 * math.hypot(*self.scenario.robot.size_m[:2])
        self._traffic.drive(np.array(there).reshape(-1, 2), radius_m, duration_s)
        for lane, body in zip(self._traffic.lanes, self._vehicles, strict=True):
            body.move(*self._standing(lane), duration_s)


def _new_physics(bodies: int) -> dart.simulation.World:
    physics = dart.simulation.World()
    physics.setTimeStep(STEP_S)
    physics.setGravity([0.0, 0.0, -GRAVITY_MPS2])
    sleep = physics.getDeactivationOptions()
    sleep.mEnabled = False  # A sleeping robot does not wake when its motors are told to turn.
    physics.setDeactivationOptions(sleep)
    solver = physics.getConstraintSolver()
    solver.setCollisionDetector(dart.collision.BulletCollisionDetector())
    solver.getCollisionOption().maxNumContacts = CONTACTS_PER_BODY_MAX * max(1, bodies)
    return physics
