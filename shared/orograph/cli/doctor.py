"""`orograph doctor`: what this machine lacks to run Orograph, and the one command that mends each thing.

Nothing of ours or of others is imported before it is checked: the doctor must work where the patient does not.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib
import os
import shutil
import socket
import sys
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

MODULES = {
    "": ("jinja2", "mapbox_earcut", "matplotlib", "msgpack", "numba", "numpy", "prometheus_client", "pydantic", "rich",
         "scipy", "shapely", "yaml", "zenoh"),
    "world": ("dartpy",),
    "laser": ("embreex", "trimesh"),
    "mission": ("ortools.constraint_solver.pywrapcp",),
    "osm": ("osmium", "pyproj"),
    "scans": ("laspy", "pypcd4", "pyproj", "rosbags", "trimesh"),
    "odometry": ("kiss_icp",),
    "export": ("laspy", "pyproj", "rasterio", "rosbags", "trimesh"),
}  # fmt: skip
"""Importable names by the extra that brings them ('' is what every installation has)."""
PORTS_NEEDED = 2
"""One router per plane."""
MEMORY_MIN_BYTES = 2 * 1024**3
DISK_MIN_BYTES = 500 * 1024**2
REINSTALL = "make setup"


@dataclass(frozen=True)
class Check:
    """One thing looked at: what was found, and the command that mends it where it is not well."""

    name: str
    ok: bool
    found: str
    cure: str


def check_python(version: tuple[int, ...] = tuple(sys.version_info[:3])) -> Check:
    """A Python for which every dependency has wheels."""
    found = ".".join(str(part) for part in version)
    cure = "sudo apt-get install python3.11 python3.11-venv && rm -rf .venv && make setup PYTHON=python3.11"
    return Check("Python 3.11 to 3.13", (3, 11) <= version[:2] <= (3, 13), found, cure)


def check_library(soname: str = "libGL.so.1", package: str = "libgl1") -> Check:
    """The shared library that dartpy's wheel leaves to the system."""
    try:
        ctypes.CDLL(soname)
    except OSError as error:
        return Check(soname, False, str(error), f"sudo apt-get install {package}")
    return Check(soname, True, "loads", "")


def check_module(module: str, extra: str) -> Check:
    """One import, with what it says where it fails."""
    cure = f"{REINSTALL}   # or: pip install 'orograph{f'[{extra}]' if extra else ''}'"
    try:
        loaded = importlib.import_module(module)
    except Exception as error:  # a broken wheel raises anything at all
        reason = str(error).splitlines()[0] if str(error) else ""
        return Check(f"import {module}", False, f"{type(error).__name__}: {reason}", cure)
    return Check(f"import {module}", True, str(getattr(loaded, "__version__", "imports")), "")


def check_ports(host: str = "127.0.0.1") -> Check:
    """Free loopback ports for the two routers."""
    name, cure = f"{PORTS_NEEDED} free ports on {host}", "ip link set lo up && sysctl net.ipv4.ip_local_port_range"
    sockets: list[socket.socket] = []
    try:
        for _ in range(PORTS_NEEDED):
            sockets.append(socket.socket(socket.AF_INET, socket.SOCK_STREAM))
            sockets[-1].bind((host, 0))
            sockets[-1].listen(1)
        return Check(name, True, ", ".join(str(s.getsockname()[1]) for s in sockets), "")
    except OSError as error:
        return Check(name, False, str(error), cure)
    finally:
        for opened in sockets:
            opened.close()


def check_writable(name: str, folder: Path, cure: str) -> Check:
    """A folder in which files can be made (itself made where it is missing)."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return Check(name, True, str(folder), "")
    except OSError as error:
        return Check(name, False, f"{folder}: {error.strerror or error}", cure)


def check_numba_cache() -> Check:
    """Where numba may keep compiled kernels (NUMBA_CACHE_DIR, else beside the code, else the user's own cache)."""
    cure = "export NUMBA_CACHE_DIR=$(mktemp -d)   # without a cache every process compiles for a minute"
    try:
        given = str(getattr(importlib.import_module("numba.core.config"), "CACHE_DIR", ""))
    except Exception:  # numba's own import check says what is wrong
        given = ""
    folders = [Path(given)] if given else [Path(__file__).resolve().parents[1] / "__pycache__", Path("~/.cache")]
    checks = [check_writable("numba cache", folder.expanduser(), cure) for folder in folders]
    return next((check for check in checks if check.ok), checks[0])


def check_memory(available_bytes: Callable[[], int] | None = None) -> Check:
    """Memory that a run with three robots takes, with room to spare."""
    free = (available_bytes or _available_bytes)()
    found = f"{free / 1024**3:.1f} GB available"
    return Check("memory >= 2 GB", free >= MEMORY_MIN_BYTES, found, "ps aux --sort=-rss | head   # end what is large")


def _available_bytes() -> int:
    for line in Path("/proc/meminfo").read_text().splitlines():
        if line.startswith("MemAvailable:"):
            return int(line.split()[1]) * 1024
    return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def check_disk(folder: Path) -> Check:
    """Room for a run folder."""
    free = shutil.disk_usage(folder).free
    found = f"{free / 1024**3:.1f} GB free in {folder}"
    return Check("disk >= 0.5 GB", free >= DISK_MIN_BYTES, found, "make clean   # removes runs/ and .venv")


def run_checks(modules: dict[str, tuple[str, ...]] = MODULES) -> list[Check]:
    """All checks, in the order in which a person would mend them."""
    here = Path.cwd()
    return [
        check_python(),
        check_library(),
        *(check_module(module, extra) for extra, names in modules.items() for module in names),
        check_ports(),
        check_numba_cache(),
        check_writable("this folder (runs/ goes here)", here, "cd to a folder of yours, or run with --out DIR"),
        check_memory(),
        check_disk(here),
    ]


def print_report(checks: Iterable[Check], quiet: bool = False) -> None:
    """A line for each check, and under what is missing the command that mends it; `quiet` leaves out what is well."""
    say = _printer()
    for check in checks:
        if not check.ok:
            say(f"missing  {check.name}: {check.found}", "bold red")
            say(f"         {check.cure}", "bold")
        elif not quiet:
            say(f"ok       {check.name}: {check.found}", "")


def _printer() -> Callable[[str, str], None]:
    """Coloured lines through rich, plain ones where rich itself is missing; never wrapped, for people to copy."""
    try:
        from rich.console import Console
    except ImportError:
        return lambda line, style: print(line)
    console = Console(soft_wrap=True, highlight=False)
    return lambda line, style: console.print(line, style=style or None, markup=False)


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `doctor` to the command line."""
    parser = subparsers.add_parser("doctor", help="say what is missing on this machine, and how to mend it")
    parser.add_argument("--quiet", action="store_true", help="print only what is missing")
    parser.set_defaults(main=main)


def main(args: argparse.Namespace) -> int:
    """Run all checks; 1 if anything is missing."""
    checks = run_checks()
    print_report(checks, args.quiet)
    return 0 if all(c.ok for c in checks) else 1
