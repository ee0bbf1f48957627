"""The 3D laser: rays against everything solid, and the true surface that a perfect one would see."""

from orograph.sensing.casting import RayCaster
from orograph.sensing.laser import Laser, RangeImager, View

__all__ = ["Laser", "RangeImager", "RayCaster", "View"]
