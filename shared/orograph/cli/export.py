"""`orograph export`: a run's map, or one of recordings, as files of other tools."""

from __future__ import annotations

import argparse
from pathlib import Path

from orograph.errors import InputError

FORMATS = ("geotiff", "cog", "pgm", "npz", "ply", "glb", "las", "laz", "rosbag2", "mcap")


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command's options."""
    parser = subparsers.add_parser(
        "export", help="write a map for other tools",
        description="Write the map of a run's folder, or of one that `orograph map` made, as files of other tools.",
    )  # fmt: skip
    parser.add_argument("folder", type=Path, help="as `orograph run` or `orograph map` leaves it")
    parser.add_argument("--to", required=True, metavar="FORMAT,...", help=", ".join(FORMATS))
    parser.add_argument("--map", metavar="NAME", help="another map of the folder, for instance hrm_robot_001 "
                        "(default: glrm, or map)")  # fmt: skip
    parser.add_argument("--every", metavar="10s", help="a run's global map at many times instead of its last")
    parser.add_argument("--crs", default="", help="the map frame on Earth, where the folder does not say or is wrong")
    parser.add_argument("--out", type=Path, metavar="DIR", help="where to (default: FOLDER/export)")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Write and name each file; raises InputError."""
    formats = [word for word in args.to.split(",") if word]
    if not formats or (unknown := [word for word in formats if word not in FORMATS]):
        raise InputError(f"--to {args.to}: {', '.join(unknown) if formats else 'nothing'} is none of "
                         f"{', '.join(FORMATS)}")  # fmt: skip
    try:
        from orograph.exporters.chart import known_crs
        from orograph.exporters.formats import export
        from orograph.launch.charted import chart_of, course_of

        if args.every is not None:
            name, charts = course_of(args.folder, seconds(args.every), args.crs)
        else:
            name, chart = chart_of(args.folder, args.map, args.crs)
            charts = [chart]
        if charts[0].crs:
            known_crs(charts[0].crs)
        for path in export(charts, name, formats, args.out or args.folder / "export"):
            print(path)
    except ImportError as error:
        raise InputError(f"{error}; pip install 'orograph[export]'") from None
    return 0


def seconds(text: str) -> float:
    """`10s` or `10` as a number; raises InputError."""
    try:
        value = float(text.removesuffix("s"))
    except ValueError:
        value = 0.0
    if not 0.1 <= value < 1e6:
        raise InputError(f"--every {text}: expected seconds, for instance 10s")
    return value
