"""The mapping core (mapping.md sections 2-4): from one scan to the cells worth sending, without I/O or clock."""

from orograph.mapping.fusion import fuse
from orograph.mapping.mapper import RobotMapper
from orograph.mapping.reconstruction import reconstruct
from orograph.mapping.rescaling import rescale
from orograph.rules import Rules as FusionRules

__all__ = ["FusionRules", "RobotMapper", "fuse", "reconstruct", "rescale"]
