"""The simulated world: rigid-body physics of robots and vehicles, and the noise of navigation sensors."""

from orograph.world.world import World

__all__ = ["World"]
