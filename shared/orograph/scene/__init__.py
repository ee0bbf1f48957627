"""Scene geometry: ground, buildings and vehicle loops of a scenario, and the prior that is known of them."""

from orograph.scene.mesh import Mesh
from orograph.scene.model import Scene, build_scene

__all__ = ["Mesh", "Scene", "build_scene"]
