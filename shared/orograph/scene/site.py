"""What a scenario makes of its place, made once for all nodes of a process that work there."""

from __future__ import annotations

from functools import cached_property

from orograph.layers import CellMap, Layer
from orograph.messages import Packed
from orograph.registers import unpack
from orograph.scenario import Scenario
from orograph.scene.changes import epoch
from orograph.scene.model import Scene, build_scene
from orograph.scene.prior import given_layers, prior_records


class Site:
    """A scenario's prior, given layers and scene, each made when first asked for; whoever takes them only reads."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        self._scenes: dict[tuple[bool, ...], Scene] = {}

    @cached_property
    def prior(self) -> Packed:
        """`prior_records`: one UPDATE per GLRM cell."""
        return prior_records(self.scenario)

    @cached_property
    def given(self) -> tuple[Layer, Layer]:
        """`given_layers`: GPS quality and communications."""
        return given_layers(self.scenario)

    @cached_property
    def prior_map(self) -> CellMap:
        """The prior and the given layers as a map on the GLRM grid."""
        return unpack(self.prior, self.scenario.grid.grid, *self.given)

    def scene(self, stamp_ns: int = 0) -> Scene:
        """The scene as it stands at a time: one object until it changes."""
        now = epoch(self.scenario, stamp_ns)
        if now not in self._scenes:
            self._scenes = {now: build_scene(self.scenario, stamp_ns)}
        return self._scenes[now]
