"""`orchestrator`: what runs, who holds which robot, who drives where, when the run ends."""

from __future__ import annotations

import argparse
import sys

from orograph import keys
from orograph.comms.bus import Bus
from orograph.errors import InputError
from orograph.launch.cluster_run import ClusterRun
from orograph.launch.lifecycle import resolve
from orograph.nodes.orchestrator import OrchestratorNode
from orograph.runtime.briefing import Briefing, answer
from orograph.runtime.claims import Claims
from orograph.runtime.participant import take_part
from orograph.runtime.settings import Settings
from orograph.runtime.watchdog import Watchdog, leave, options, whole_number
from orograph.scene.site import Site
from orograph.storage.scenario_file import ScenarioError, load_scenario


def _arguments() -> argparse.Namespace:
    parser = options(__doc__)
    parser.add_argument("--scenario", required=True, help="a folder, a scenario file, or a name in ./scenarios")
    parser.add_argument("--robots", type=whole_number, metavar="N", help="how many robots (default: the scenario's)")
    parser.add_argument("--seed", type=whole_number, metavar="S", help="seed of all randomness (the scenario's)")
    parser.add_argument("--time-scale", metavar="max|X", help="max: lockstep; X: paced at X times real time")
    parser.add_argument("--start-with", type=whole_number, metavar="N", help="begin with N whole robots (default: all)")
    parser.add_argument("--run", metavar="NAME", help="folder of the run in the run folders; a new one if not named")
    return parser.parse_args()


def main() -> int:
    """Run the service; a run that it named itself gets its report from it."""
    arguments = _arguments()
    watchdog, settings = Watchdog(keys.ORCHESTRATOR, arguments), Settings.from_environment()
    try:
        asked = resolve(
            load_scenario(arguments.scenario), arguments.robots, arguments.seed, arguments.time_scale or None
        )
        cluster_run = ClusterRun(asked, settings.run_dir, arguments.run)
        _direct(cluster_run, settings, watchdog, arguments.start_with)
        cluster_run.report(watchdog)
    except (InputError, ScenarioError) as error:
        print(f"orograph: {error}", file=sys.stderr)
        return 2
    return 0


def _direct(cluster_run: ClusterRun, settings: Settings, watchdog: Watchdog, start_with: int | None) -> None:
    nodes: list[OrchestratorNode] = []

    def brief(bus: Bus) -> Briefing:
        briefing = cluster_run.begin(bus, watchdog)
        robots = briefing.scenario.robot_ids
        nodes.append(OrchestratorNode(Site(briefing.scenario), robots, briefing.scenario.seed))
        claims = Claims(robots, nodes[0].present, start_with, lambda: nodes[0].revoked)
        claims.attend(bus)
        answer(bus, briefing)
        bus.answer(keys.STATUS, lambda: nodes[0].status.of_run(briefing.run, claims.holders()), keys.RADIO)
        return briefing

    take_part(keys.ORCHESTRATOR, settings, watchdog, build=lambda briefing, robots: (nodes, {}), brief=brief)


if __name__ == "__main__":
    leave(main())
