"""`orchestrator`: what runs, who holds which robot, who drives where, when the run ends."""

from __future__ import annotations

import argparse
import sys

from orograph import keys
from orograph.cli.campaign import Campaign
from orograph.cli.errors import InputError
from orograph.cli.run import resolve
from orograph.edge import wire
from orograph.edge.briefing import Briefing, answer
from orograph.edge.bus import Bus
from orograph.edge.claims import Claims
from orograph.edge.guard import Guard, leave, options, whole_number
from orograph.edge.participant import take_part
from orograph.edge.scenario_file import ScenarioError, load_scenario
from orograph.edge.settings import Settings
from orograph.nodes.fleet import robots_of
from orograph.nodes.orchestrator import OrchestratorNode


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
    guard, settings = Guard(keys.ORCHESTRATOR, arguments), Settings.from_environment()
    try:
        asked = resolve(
            load_scenario(arguments.scenario), arguments.robots, arguments.seed, arguments.time_scale or None
        )
        campaign = Campaign(asked, settings.run_dir, arguments.run)
        _direct(campaign, settings, guard, arguments.start_with)
        campaign.report(guard)
    except (InputError, ScenarioError) as error:
        print(f"orograph: {error}", file=sys.stderr)
        return 2
    return 0


def _status(node: OrchestratorNode, briefing: Briefing, claims: Claims) -> bytes:
    """How the cluster stands; nothing before the first second."""
    standing = node.standing
    told = standing.of_run(briefing.run, claims.holders()).model_dump() if standing is not None else None
    return wire.pack_plain(told)


def _direct(campaign: Campaign, settings: Settings, guard: Guard, start_with: int | None) -> None:
    nodes: list[OrchestratorNode] = []

    def brief(bus: Bus) -> Briefing:
        briefing = campaign.begin(bus, guard)
        robots = robots_of(briefing.scenario)
        nodes.append(OrchestratorNode(briefing.scenario, robots, briefing.scenario.seed))
        claims = Claims(robots, nodes[0].present, start_with)
        claims.attend(bus)
        answer(bus, briefing)
        bus.answer(keys.STATUS, lambda _: _status(nodes[0], briefing, claims), keys.RADIO)
        return briefing

    take_part(keys.ORCHESTRATOR, settings, guard, build=lambda briefing, robots: (nodes, {}), brief=brief)


if __name__ == "__main__":
    leave(main())
