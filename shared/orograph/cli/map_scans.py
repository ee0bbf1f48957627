"""`orograph map`: a map from recorded scans, without services."""

from __future__ import annotations

import argparse
import importlib.util
import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from rich.console import Console

from orograph.errors import InputError
from orograph.rules import NamedRules, Rules
from orograph.scenario import Scenario

if TYPE_CHECKING:
    from orograph.arrays import F64
    from orograph.importers.scans.opened import Odometry, Recording
    from orograph.launch.recorded import Told
    from orograph.storage.recorded_map import MapInfo

FORMATS = ("kitti", "nuscenes", "pcd", "ply", "npz", "xyz", "las", "bag")
LINE_EVERY_S = 5.0
"""Where there is no terminal, one line of progress this often."""
REASONS = {
    "self_box": "on the robot itself (--self-box)",
    "not_finite": "not finite: no return",
    "below_range": "nearer than --range-min, or no return",
    "beyond_range": "beyond --range-max",
    "outside_grid": "outside the window around the sensor",
}
EXTRA = "pip install 'orograph[scans]'"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "map", help="map recorded scans",
        description="Make one map of recorded scans: files, folders of files, ROS bags and MCAP. See docs/own-data.md.",
    )  # fmt: skip
    default = Scenario.model_fields["rules"].default
    parser.add_argument("sources", nargs="+", type=Path, metavar="SOURCE", help="a file, a folder of scans, or a bag")
    parser.add_argument("--poses", type=Path, metavar="FILE", help="TUM (time x y z qx qy qz qw) or KITTI (3 x 4)")
    parser.add_argument(
        "--odometry", choices=("kiss-icp",), help="poses from the scans themselves, where there are none"
    )
    parser.add_argument("--out", type=Path, metavar="DIR", help="folder, new or empty (default: runs/map-NNN)")
    parser.add_argument("--format", choices=FORMATS, help="what the files are (default: by content and name)")
    parser.add_argument("--frame", choices=("sensor", "map"), help="whose coordinates points have (default: the "
                        "sensor's; of LAS the map's)")  # fmt: skip
    parser.add_argument("--sensor-pose", default="0,0,0", metavar="X,Y,Z[,R,P,Y]",
                        help="the sensor in the frame that poses are of [m, deg]")  # fmt: skip
    parser.add_argument("--self-box", metavar="X0,Y0,Z0,X1,Y1,Z1", help="the robot itself, in that frame [m]: left out")
    parser.add_argument("--topic", help="topic of the clouds in a bag (default: the only one)")
    parser.add_argument("--crs", default="", help="the map frame on Earth, for instance EPSG:32635")
    parser.add_argument("--cell", type=float, default=0.5, metavar="M", help="side of a cell (default: 0.5)")
    parser.add_argument("--range-min", type=float, default=1.0, metavar="M", help="nearer is no surface (default: 1)")
    parser.add_argument("--range-max", type=float, default=80.0, metavar="M", help="farther is left out (default: 80)")
    parser.add_argument("--rules", choices=get_args(NamedRules), default=default,
                        help=f"mapping rules (default: {default})")  # fmt: skip
    parser.add_argument("--quiet", action="store_true", help="no progress line")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Read, map, write, and say what was dropped; raises InputError."""
    try:
        from orograph.importers.scans.opened import open_recordings
        from orograph.importers.scans.trajectory import sensor_pose
    except ImportError as error:
        raise InputError(f"{error}; {EXTRA}") from None
    from orograph.launch.recorded import MapRules, map_recordings
    from orograph.launch.recorded_folder import write_folder
    from orograph.storage.run_folder import REPORT, new_folder

    crs = metric_crs(args.crs)
    how = MapRules(*_bounds(args), Rules.of(args.rules))
    box = self_box(args.self_box)
    mount = sensor_pose(args.sensor_pose)
    if args.odometry and args.poses:
        raise InputError("--odometry and --poses: one of them")
    with _Line(args.quiet) as line:
        odometry = _odometry(mount, how.range_min_m, how.range_max_m, line) if args.odometry else None
        in_map = None if args.frame is None else args.frame == "map"
        recordings = open_recordings(
            args.sources, args.poses, args.format, args.topic, in_map, mount, box, odometry
        )  # fmt: skip
        out = new_folder(args.out, "map")
        with _empty_no_more(out):
            mapped = map_recordings(recordings, how, line.show)
            line.say(f"drawing {mapped.cells.grid.cols} x {mapped.cells.grid.rows} cells")
            info = write_folder(out, mapped, recordings, args.rules, crs)
    _tell(info, recordings)
    print(f"report: {out / REPORT}")
    return 0


def _odometry(mount: F64, range_min_m: float, range_max_m: float, line: _Line) -> Odometry:
    from orograph.importers.scans.odometry import by_kiss_icp

    if importlib.util.find_spec("kiss_icp") is None:
        raise InputError("--odometry kiss-icp: is not installed; pip install 'orograph[odometry]'")

    def on_scan(done: int, of: int) -> None:
        if line.due():
            line.say(f"odometry of scan {done} of {of}")

    return lambda scans: by_kiss_icp(scans, mount, range_min_m, range_max_m, on_scan)


def _tell(info: MapInfo, recordings: Sequence[Recording]) -> None:
    """What was read, what it became, and what was left out."""
    rate = f"{info.scans / info.took_s:.1f} scans/s, {info.points / info.took_s / 1e6:.1f} M points/s"
    print(f"{info.scans} scans, {info.points:,} points in {info.took_s:.1f} s ({rate}); {info.cells:,} cells of "
          f"{info.cell_m:g} m")  # fmt: skip
    for name, scans, _ in recordings:
        if scans.note:
            print(f"  {name}: {scans.note}")
    for reason, count in info.dropped.items():
        print(f"  dropped {count:,} points ({count / info.points:.1%}): {REASONS.get(reason, reason)}")
    if info.scans_without_pose:
        print(f"  left out {info.scans_without_pose} scans: no pose of their time")
    if info.clock_restarts:
        print(f"  the scans' clock was set back {info.clock_restarts} times")


def self_box(text: str | None) -> tuple[float, ...]:
    """(x0, y0, z0, x1, y1, z1) [m], empty for None; raises InputError."""
    if text is None:
        return ()
    try:
        numbers = tuple(float(word) for word in text.split(","))
    except ValueError:
        numbers = ()
    if (
        len(numbers) != 6
        or not all(math.isfinite(n) for n in numbers)
        or any(low >= high for low, high in zip(numbers[:3], numbers[3:], strict=True))
    ):
        raise InputError(f"--self-box {text}: expected x0,y0,z0,x1,y1,z1 [m], each first less than its second")
    return numbers


def metric_crs(text: str) -> str:
    """A CRS in metres as it was given, empty for none; raises InputError for one that nobody knows."""
    if not text:
        return ""
    from orograph.exporters.chart import known_crs

    try:
        crs = known_crs(text)
    except InputError:
        raise InputError(f"--crs {text}: unknown; expected for instance EPSG:32635 or a PROJ string") from None
    if not crs.is_projected or crs.axis_info[0].unit_conversion_factor != 1:
        raise InputError(f"--crs {text}: not a projected CRS in metres; choose one, for instance a UTM zone")
    return text


def _bounds(args: argparse.Namespace) -> tuple[float, float, float]:
    """Cell, smallest and largest range [m]; raises InputError."""
    if not 0.01 <= args.cell <= 100:
        raise InputError(f"--cell {args.cell:g}: expected 0.01 to 100 m")
    if not 0 < args.range_min < args.range_max <= 1000 or args.range_max > 1000 * args.cell:
        raise InputError(
            f"--range-min {args.range_min:g} --range-max {args.range_max:g}: expected 0 < min < max, at most 1000 m "
            "and 1000 cells"
        )
    return args.cell, args.range_min, args.range_max


@contextmanager
def _empty_no_more(out: Path) -> Iterator[None]:
    """A new folder that goes again where the work did not end."""
    try:
        yield
    except BaseException:
        with suppress(OSError):
            out.rmdir()
        raise


class _Line:
    """One line of progress on stderr: rewritten on a terminal, now and then elsewhere."""

    def __init__(self, quiet: bool) -> None:
        self._console = Console(stderr=True, quiet=quiet)
        self._status = self._console.status("reading")
        self._said_s = time.monotonic()

    def __enter__(self) -> _Line:
        if self._console.is_terminal:
            self._status.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._status.stop()

    def show(self, told: Told) -> None:
        """After each scan."""
        if not self.due():
            return
        took_s = max(time.monotonic() - told.began_s, 1e-3)
        self.say(f"scan {told.scans} of {told.scans_in_all}, {told.scans / took_s:.1f} scans/s, "
                 f"{told.points / took_s / 1e6:.1f} M points/s")  # fmt: skip

    def due(self) -> bool:
        """Whether the line is old enough to be said anew."""
        return time.monotonic() - self._said_s >= (0.25 if self._console.is_terminal else LINE_EVERY_S)

    def say(self, text: str) -> None:
        """What goes on now."""
        self._said_s = time.monotonic()
        if self._console.is_terminal:
            self._status.update(text)
        else:
            self._console.print(text, soft_wrap=True)
