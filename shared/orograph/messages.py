"""All messages between nodes, in one file: each says who sends it to whom, each field dtype, shape, unit and bounds.

Nodes exchange these objects; `comms/wire.py` packs them. Nothing here does I/O. Integers and packed records on
everything that a map is folded from; floats only for poses, which must be finite.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from orograph.fields import array, bytes_max, choice, flag, integer, number, raw
from orograph.keys import LASER, MANAGER, MAPPING, NAVIGATOR, ORCHESTRATOR, RADIO, SIM, WORLD, group
from orograph.kinds import AtMost
from orograph.layers import MAPPED
from orograph.routes import Route, Routed

SCHEMA_VERSION: Final = 2
FRAGMENT_MAX_BYTES: Final = 30_000
"""Largest piece on the wire (zenoh.md 5); the bus cuts a longer message and joins it again."""
MESSAGE_MAX_BYTES: Final = 4_010_000
"""No message is longer than this: a whole map's occupation, a byte a cell, and its frame."""

Packed = npt.NDArray[Any]

_VALUES: Final = [(kind.name, kind.wire) for kind in MAPPED]
UPDATE: Final = np.dtype(
    [
        ("cell", "<u4"),  # row * cols + col in the GLRM
        ("seq", "<u4"),  # per robot and epoch, grows with each change of the register
        ("tick", "<u4"),  # simulation time of the newest scan in it [ms]
        *_VALUES,  # whole numbers of the steps and with the codes for unknown that `layers.TABLE` says
    ]
)
REGISTER: Final = np.dtype([("epoch", "<u4"), *[(n, UPDATE[n]) for n in UPDATE.names or ()]])
"""A register with the epoch in which it was written: the robot's own row as the manager holds it."""
ROBOT_REGISTER: Final = np.dtype([("robot", "<u2"), *[(n, REGISTER[n]) for n in REGISTER.names or ()]])
"""A register with the number of its robot: the form in which a run folder keeps them."""
CELL: Final = np.dtype([("cell", "<u4"), ("version", "<u4"), *_VALUES])
"""One GLRM cell on its way to the robots, with the manager's version in which it last changed."""

ACKED: Final = np.dtype([("cell", "<u4"), ("seq", "<u4")])
POSE: Final = np.dtype([("position_m", "<f8", (3,)), ("quaternion_wxyz", "<f8", (4,)), ("present", "u1")])
RANGE_UNIT_M: Final = 0.002
"""Ranges travel as u2 in steps of 2 mm; 0 means no return."""


STAMP_MAX_NS: Final = 2**62
SECOND_NS: Final = 1_000_000_000
U4: Final = 2**32 - 1

# What a scenario may ask for: `scenario.py` takes its bounds from here, so that what it accepts can be carried.
GRID_SIDE_MAX: Final = 2_000
"""Cells along a side of a map, the GLRM or the HRM."""
CELLS_MAX: Final = GRID_SIDE_MAX**2
CELL_MIN_M, CELL_MAX_M = 1e-3, 1e3
TILE_CELLS: Final = 20
"""Cells along a side of the tiles by which two holders of a map compare it (protocol.md, "Down")."""
TILES_MAX: Final = (GRID_SIDE_MAX // TILE_CELLS) ** 2
RINGS_MAX, COLUMNS_MAX = 256, 4_096
ROBOTS_MAX, VEHICLES_MAX = 100, 1_900
BODIES_MAX: Final = ROBOTS_MAX + VEHICLES_MAX
WAYPOINTS_MAX: Final = 2_000
SPEED_MAX_MPS, YAW_RATE_MAX_RADPS = 20.0, 20.0


class Message(Routed):
    """What nodes send each other."""


UP = (Route(RADIO, MAPPING, MANAGER),)
DOWN = (Route(RADIO, MANAGER, MAPPING),)
DOWN_TO_ALL = (Route(RADIO, MANAGER, group(MAPPING)),)


def _stamp() -> Any:
    return integer(0, STAMP_MAX_NS, "ns of simulation time")


# --- sim plane: wires and the world itself ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Bodies(Message, routes=(Route(SIM, WORLD, group(LASER)),), newest_by=()):
    """Poses of all moving bodies, robots first by number, then vehicles."""

    stamp_ns: int = _stamp()
    poses: Packed = array(POSE, (AtMost(BODIES_MAX),))


@dataclass(frozen=True, eq=False)
class Sensors(Message, routes=(Route(SIM, WORLD, NAVIGATOR),)):
    """GPS, IMU (with attitude) and wheel odometry of one robot since the last frame."""

    stamp_ns: int = _stamp()
    gps_quality: int = integer(0, 2, "0 none (position then meaningless), 1 single, 2 differential")
    gps_x_m: float = number(-1e6, 1e6)
    gps_y_m: float = number(-1e6, 1e6)
    gps_z_m: float = number(-1e5, 1e5)
    roll_rad: float = number(-4, 4)
    pitch_rad: float = number(-4, 4)
    yaw_rad: float = number(-4, 4)
    yaw_rate_radps: float = number(-100, 100)
    odometry_v_mps: float = number(-100, 100, "mean over the frame, from the wheels")


@dataclass(frozen=True, eq=False)
class Scan(Message, routes=(Route(SIM, LASER, MAPPING),), newest_by=()):
    """One range image."""

    stamp_ns: int = _stamp()
    ranges: Packed = array(
        "<u2", (AtMost(RINGS_MAX), AtMost(COLUMNS_MAX)), "(rings, columns) in RANGE_UNIT_M, 0 = no return"
    )


@dataclass(frozen=True, eq=False)
class Pose(Message, routes=(Route(SIM, NAVIGATOR, MAPPING),)):
    """Estimated pose of the robot's base in the map frame."""

    stamp_ns: int = _stamp()
    x_m: float = number(-1e6, 1e6)
    y_m: float = number(-1e6, 1e6)
    z_m: float = number(-1e5, 1e5)
    roll_rad: float = number(-4, 4)
    pitch_rad: float = number(-4, 4)
    yaw_rad: float = number(-4, 4)
    position_sigma_m: float = number(0, 1e6, "one sigma of x, y")


@dataclass(frozen=True, eq=False)
class Drive(Message, routes=(Route(SIM, NAVIGATOR, WORLD),)):
    """Wanted speed of the robot's body until the next one (stops after 0.5 s without)."""

    stamp_ns: int = _stamp()
    v_mps: float = number(-SPEED_MAX_MPS, SPEED_MAX_MPS)
    yaw_rate_radps: float = number(-YAW_RATE_MAX_RADPS, YAW_RATE_MAX_RADPS)


@dataclass(frozen=True, eq=False)
class OccupancyGrid(Message, routes=(Route(SIM, MAPPING, NAVIGATOR),), newest_by=("is_global",)):
    """Occupation of the HRM (evidence over prior) or of the GLRM copy."""

    stamp_ns: int = _stamp()
    x0_m: float = number(-1e6, 1e6, "outer corner of cell (0, 0)")
    y0_m: float = number(-1e6, 1e6)
    cell_m: float = number(CELL_MIN_M, CELL_MAX_M)
    is_global: bool = flag("True: the GLRM copy; False: the HRM")
    occupation: Packed = array(
        "u1", (AtMost(GRID_SIDE_MAX), AtMost(GRID_SIDE_MAX)), "(rows, cols) in 1/254, 255 = unknown"
    )


# --- radio plane: the map protocol (protocol.md) --------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Hello(Message, routes=UP):
    """A robot that starts asks for its next epoch."""

    nonce: bytes = raw(16)


@dataclass(frozen=True, eq=False)
class Welcome(Message, routes=DOWN):
    """The epoch granted for that nonce, and one part of the robot's own row."""

    nonce: bytes = raw(16)
    epoch: int = integer(1, U4)
    manager_epoch: int = integer(1, U4, "the life of the manager that holds this row")
    part: int = integer(0, 65_535)
    parts: int = integer(1, 65_536)
    row: Packed = array(REGISTER, (AtMost(1024),))


@dataclass(frozen=True, eq=False)
class Fenced(Message, routes=DOWN):
    """Your epoch is over, a later hello won."""

    epoch: int = integer(1, U4, "the epoch that is fenced")


@dataclass(frozen=True, eq=False)
class Batch(Message, routes=UP):
    """Registers that changed."""

    epoch: int = integer(1, U4)
    records: Packed = array(UPDATE, (AtMost(256),))


@dataclass(frozen=True, eq=False)
class Ack(Message, routes=DOWN):
    """These records would survive kill -9 now."""

    epoch: int = integer(1, U4)
    acked: Packed = array(ACKED, (AtMost(256),))


@dataclass(frozen=True, eq=False)
class Delta(Message, routes=DOWN + DOWN_TO_ALL):
    """Changed GLRM cells: to all robots as one beat, to one robot as the answer to its CellsRequest.

    A beat is cut into parts; `first_version` < `last_version` span the whole beat. It applies on a copy whose version
    is at least `first_version`. A repair (`repair` True) may be applied on any version and does not raise it unless
    it is a complete answer "since version".
    """

    manager_epoch: int = integer(1, U4)
    first_version: int = integer(0, U4, "copy must already hold this version")
    last_version: int = integer(0, U4, "copy holds this version after all parts")
    part: int = integer(0, 65_535)
    parts: int = integer(1, 65_536)
    repair: bool = flag()
    cells: Packed = array(CELL, (AtMost(1024),))


@dataclass(frozen=True, eq=False)
class Digest(Message, routes=DOWN_TO_ALL):
    """Version and hash of every tile, every 2 s."""

    manager_epoch: int = integer(1, U4)
    version: int = integer(0, U4)
    tiles: Packed = array("u1", (AtMost(TILES_MAX), 16), "(tiles, 16) blake2b-128 per tile of 20 x 20 cells")


@dataclass(frozen=True, eq=False)
class CellsRequest(Message, routes=UP):
    """Send me what changed since `since_version`, or all of these tiles."""

    manager_epoch: int = integer(0, U4, "of whom this is asked; nobody else answers; 0 = whoever hears it")
    since_version: int = integer(0, U4)
    tiles: Packed = array("<u2", (AtMost(TILES_MAX),), "empty: by version; else whole tiles")


# --- radio plane: missions ------------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Mission(Message, routes=(Route(RADIO, ORCHESTRATOR, NAVIGATOR),)):
    """Waypoints to visit in order; repeated until the status shows it was taken."""

    number: int = integer(1, U4, "later missions replace earlier ones")
    waypoints: Packed = array("<u2", (AtMost(WAYPOINTS_MAX),), "indices into the scenario's patrol")
    flush: bool = flag("True: the patrol is over, stay where there is radio")


STATES: Final = ("idle", "driving", "blocked", "recovering", "returning", "done")
"""What a navigator is at."""
PHASES: Final = ("mapping", "flush", "end")
"""Where a run stands."""


@dataclass(frozen=True, eq=False)
class RobotStatus(Message, routes=(Route(RADIO, NAVIGATOR, ORCHESTRATOR),)):
    """How a robot fares, every second and at every waypoint."""

    stamp_ns: int = _stamp()
    mission: int = integer(0, U4, "number of the mission it holds, 0 = none")
    visited: Packed = array("<u2", (AtMost(WAYPOINTS_MAX),), "patrol indices it has ever visited")
    given_up: Packed = array("<u2", (AtMost(WAYPOINTS_MAX),), "patrol indices it can't reach and hands over")
    state: str = choice(STATES)
    x_m: float = number(-1e6, 1e6)
    y_m: float = number(-1e6, 1e6)


@dataclass(frozen=True, eq=False)
class Phase(Message, routes=(Route(RADIO, ORCHESTRATOR, group(MAPPING)),)):
    """Where the run stands, every second."""

    name: str = choice(PHASES)


@dataclass(frozen=True, eq=False)
class MappingStatus(Message, routes=(Route(RADIO, MAPPING, ORCHESTRATOR),)):
    """How far a robot's map has come home, every second."""

    stamp_ns: int = _stamp()
    flushed: bool = flag("every cell that differs from what was acknowledged has been sent and acknowledged")
    waiting_cells: int = integer(0, CELLS_MAX)
    copy_version: int = integer(0, U4)
    copy_hash: bytes = raw(16, "blake2b-128 of the GLRM copy")


@dataclass(frozen=True, eq=False)
class ManagerStatus(Message, routes=(Route(RADIO, MANAGER, ORCHESTRATOR),)):
    """Which map there is, every second."""

    stamp_ns: int = _stamp()
    version: int = integer(0, U4)
    glrm_hash: bytes = raw(16, "blake2b-128 of the GLRM")
    confident_cells: int = integer(0, CELLS_MAX, "cells with confidence >= 64")
    revoked: Packed = array("<u2", (AtMost(ROBOTS_MAX),), "numbers of robots that take no part any more")


# --- sim plane: from the orchestrator to the world ------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class RunEnd(Message, routes=(Route(SIM, ORCHESTRATOR, WORLD),)):
    """Stop the clock after this frame."""

    complete: bool = flag("False: a waypoint was never visited, or a robot never flushed")
    copies_equal: bool = flag("every robot's copy has the manager's hash")


KINDS: Final[dict[str, type[Message]]] = {kind.__name__: kind for kind in Message.__subclasses__()}
assert all(bytes_max(kind) <= MESSAGE_MAX_BYTES for kind in KINDS.values())


@dataclass(frozen=True, eq=False)
class Envelope:
    """A message on its way: who sent it to whom, on which plane, in which frame, as which of that frame's messages."""

    plane: str
    to: str
    sender: str
    frame: int
    index: int
    message: Message


@dataclass(frozen=True)
class Frame:
    """One round of simulation time: every node steps once per frame with what was sent in the frame before."""

    index: int
    stamp_ns: int
    duration_ns: int
