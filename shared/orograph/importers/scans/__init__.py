"""Recorded lidar from files of many formats, one reader each, as sequences of scans (docs/own-data.md)."""

from orograph.importers.scans.formats import FORMATS, open_scans
from orograph.importers.scans.scan import Scan, ScanError, Scans
from orograph.importers.scans.trajectory import Trajectory

__all__ = ["FORMATS", "Scan", "ScanError", "Scans", "Trajectory", "open_scans"]
