"""The orchestrator's beat: once a second, in whatever frame it steps."""

from orograph import keys
from orograph.messages import Frame, Message, Phase
from orograph.nodes.orchestrator import OrchestratorNode
from orograph.scenario import Scenario
from orograph.scene.site import Site


def test_a_frame_that_is_skipped_skips_no_second(city_scenario: Scenario) -> None:
    node = OrchestratorNode(Site(city_scenario), city_scenario.robot_ids, 1)
    spoken: list[int] = []

    def step(index: int) -> None:
        def send(plane: str, to: str, message: Message) -> None:
            if isinstance(message, Phase) and (plane, to) == (keys.RADIO, keys.group(keys.MAPPING)):
                spoken.append(index)

        node.step(Frame(index, index * 10**8, 10**8), [], send, lambda *_: None)

    for index in (*range(10), *range(13, 31)):
        step(index)
    assert spoken == [0, 13, 20, 30]
