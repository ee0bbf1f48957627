"""Builds the three dashboards: `python ops/grafana/build.py` writes dashboards/*.json, which are checked in.

A panel is one line here: what it is called, what it asks Prometheus, in which unit. Grafana provisions the JSON.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from grafana_foundation_sdk.builders import bargauge, common, dashboard, prometheus, stat, statetimeline, timeseries
from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.models.common import LegendDisplayMode, LegendPlacement, VizOrientation
from grafana_foundation_sdk.models.dashboard import (
    Dashboard,
    DashboardCursorSync,
    DashboardLinkType,
    DataSourceRef,
    ValueMap,
    ValueMappingResult,
    VariableRefresh,
)

FOLDER = Path(__file__).parent / "dashboards"
SOURCE = DataSourceRef(type_val="prometheus", uid="prometheus")
"""Provisioned in provisioning/datasources."""
RATE = "$__rate_interval"
ROBOT = 'robot=~"$robot"'
Builder = timeseries.Panel | stat.Panel | statetimeline.Panel | bargauge.Panel
BUILDERS: dict[str, type[Builder]] = {
    "graph": timeseries.Panel, "number": stat.Panel, "states": statetimeline.Panel, "bars": bargauge.Panel,
}  # fmt: skip


@dataclass(frozen=True)
class Panel:
    """One panel: `queries` are (PromQL, legend), `states` the words for a number."""

    title: str
    queries: tuple[tuple[str, str], ...]
    unit: str = "short"
    kind: str = "graph"
    width: int = 8
    states: tuple[tuple[str, str], ...] = ()
    """(word, colour) of 0, 1, 2, ..."""


def graph(title: str, expr: str, legend: str = "{{robot}}", unit: str = "short", *more: tuple[str, str]) -> Panel:
    """Lines over time; `more` are further (PromQL, legend)."""
    return Panel(title, ((expr, legend), *more), unit)


def number(title: str, expr: str, unit: str = "short", states: tuple[tuple[str, str], ...] = ()) -> Panel:
    """One large figure."""
    return Panel(title, ((expr, ""),), unit, "number", 4, states)


UP_DOWN = (("down", "red"), ("up", "green"))
PHASES = (("mapping", "blue"), ("flush", "yellow"), ("end", "green"))
STATES = (
    ("idle", "text"), ("driving", "green"), ("blocked", "orange"), ("recovering", "red"), ("returning", "blue"),
    ("done", "purple"),
)  # fmt: skip
Rows = Mapping[str, tuple[Panel, ...]]


def quantile(q: float, histogram: str, by: str) -> str:
    """PromQL of a histogram's quantile per label."""
    return f"histogram_quantile({q}, sum by ({by}, le) (rate({histogram}_bucket[{RATE}])))"


MISSION: Rows = {
    "Map": (
        number("Confident cells", "orograph:map_confident:ratio", "percentunit"),
        number("Map version", "max(orograph_map_version)"),
        number("Phase", "max(orograph_run_phase)", states=PHASES),
        number("Waypoints left", "max(orograph_patrol_waypoints_left)"),
        number("Real-time factor", "orograph:real_time_factor:rate30s"),
        number("Alerts", 'count(ALERTS{alertstate="firing"}) or vector(0)'),
        graph("Confident cells", "max(orograph_map_confident_cells)", "confident", "short",
              ("max(orograph_map_cells)", "all")),
        graph("Patrol", "max(orograph_patrol_waypoints_left)", "left", "short",
              ("max(orograph_patrol_waypoints_unreached)", "out of reach")),
        graph("Records acknowledged", f"rate(orograph_map_records_acknowledged_total[{RATE}])", "records", "cps"),
    ),
    "Robots": (
        Panel("What they do", ((f"max by (robot) (orograph_navigator_state{{{ROBOT}}})", "{{robot}}"),),
              kind="states", width=24, states=STATES),
        graph("Position, one sigma", f"max by (robot) (orograph_navigator_position_sigma_meters{{{ROBOT}}})",
              unit="lengthm"),
        graph("Distance driven", f"max by (robot) (orograph_navigator_driven_meters_total{{{ROBOT}}})", unit="lengthm"),
        graph("Waypoints of its order", f"max by (robot) (orograph_navigator_waypoints_left{{{ROBOT}}})"),
        graph("Plans and recoveries", f"sum(increase(orograph_navigator_global_replans_total{{{ROBOT}}}[1m]))",
              "global plans", "short",
              (f"sum(increase(orograph_navigator_local_replans_total{{{ROBOT}}}[1m]))", "local plans"),
              (f"sum(increase(orograph_navigator_recoveries_total{{{ROBOT}}}[1m]))", "recoveries")),
        graph("In the world", "max(orograph_world_robots)", "robots", "short",
              ("max(orograph_robots_heard)", "heard"), ("max(orograph_world_robots_without_radio)", "without radio")),
    ),
    "Radio": (
        Panel("Link to the Map Manager", ((f"max by (robot) (orograph_radio_link_up{{{ROBOT}}})", "{{robot}}"),),
              kind="states", width=24, states=UP_DOWN),
        graph("Oldest unacknowledged cell",
              f"max by (robot) (orograph_uplink_oldest_unacknowledged_seconds{{{ROBOT}}})", unit="s"),
        graph("Unacknowledged cells", f"max by (robot) (orograph_uplink_unacknowledged_cells{{{ROBOT}}})"),
        graph("Versions behind", f"robot:orograph_copy_behind:versions{{{ROBOT}}}"),
        graph("Silence", f"max by (robot) (orograph_robot_silence_seconds{{{ROBOT}}})", unit="s"),
        graph("Batches", f"sum(rate(orograph_uplink_batches_sent_total{{{ROBOT}}}[{RATE}]))", "sent", "cps",
              (f"sum(rate(orograph_uplink_batches_unanswered_total{{{ROBOT}}}[{RATE}]))", "unanswered")),
        graph("Bytes on the radio", 'job_plane:orograph_sent_bytes:rate30s{plane="radio"}', "{{job}}", "Bps"),
    ),
}  # fmt: skip

MAPPING: Rows = {
    "Table 2 stages": (
        Panel("Mean of each stage", ((
            f"sum by (stage) (rate(orograph_stage_duration_seconds_sum[{RATE}]))"
            f" / (sum by (stage) (rate(orograph_stage_duration_seconds_count[{RATE}])) > 0)", "{{stage}}"),),
            "s", "bars", 12),
        Panel("95th percentile", (("stage:orograph_stage_duration_seconds:p95_rate1m", "{{stage}}"),), "s", width=12),
        graph("Passes", f"sum by (stage) (rate(orograph_stage_duration_seconds_count[{RATE}]))", "{{stage}}", "cps"),
        graph("Durable commit", "orograph:store_commit_duration_seconds:p99_rate1m", "99 %", "s",
              (quantile(0.5, 'orograph_store_commit_duration_seconds', 'job'), "half, {{job}}")),
        graph("Frame of a process, 95 %", quantile(0.95, "orograph_step_duration_seconds", "job"), "{{job}}", "s"),
    ),
    "Scans": (
        graph("Scans", f"sum by (robot) (rate(orograph_laser_scans_total{{{ROBOT}}}[{RATE}]))", "{{robot}} made", "cps",
              (f"sum by (robot) (rate(orograph_mapping_scans_total{{{ROBOT}}}[{RATE}]))", "{{robot}} mapped")),
        graph("Scans skipped", "instance:orograph_scans_skipped:ratio_rate1m", "{{instance}}", "percentunit"),
        graph("Rays that came back", f"max by (robot) (orograph_laser_hits_ratio{{{ROBOT}}})", unit="percentunit"),
        graph("Points dropped",
              f"sum by (reason) (rate(orograph_mapping_points_dropped_total{{{ROBOT}}}[{RATE}]))", "{{reason}}", "cps"),
    ),
    "Queues and protocol": (
        graph("Messages waiting", "max by (job) (orograph_mailbox_messages)", "{{job}}"),
        graph("Messages dropped", f"sum by (job) (rate(orograph_mailbox_overflowed_messages_total[{RATE}]))",
              "{{job}} overflow", "cps",
              (f"sum by (job) (rate(orograph_mailbox_skipped_messages_total[{RATE}]))", "{{job}} overtaken"),
              (f"sum by (job) (rate(orograph_mailbox_lost_messages_total[{RATE}]))", "{{job}} lost")),
        graph("Batches in flight", f"max by (robot) (orograph_uplink_batches_in_flight{{{ROBOT}}})"),
        graph("Map Manager", f"sum(rate(orograph_store_commits_total[{RATE}]))", "commits", "cps",
              (f"sum(rate(orograph_map_beats_total[{RATE}]))", "beats"),
              (f"sum(rate(orograph_map_digests_total[{RATE}]))", "digests"),
              (f"sum(rate(orograph_map_answers_total[{RATE}]))", "repairs sent"),
              (f"sum(rate(orograph_map_records_repeated_total[{RATE}]))", "records again")),
        graph("Copies", f"sum(rate(orograph_copy_gaps_total{{{ROBOT}}}[{RATE}]))", "gaps", "cps",
              (f"sum(rate(orograph_copy_digest_mismatches_total{{{ROBOT}}}[{RATE}]))", "digests that differ"),
              (f"sum(rate(orograph_copy_strangers_total{{{ROBOT}}}[{RATE}]))", "of another manager"),
              (f"sum(rate(orograph_copy_requests_total{{{ROBOT}}}[{RATE}]))", "repairs asked for"),
              (f"sum(rate(orograph_copy_repairs_total{{{ROBOT}}}[{RATE}]))", "repairs come")),
        graph("Refused inputs", f"sum by (reason) (rate(orograph_map_inputs_rejected_total[{RATE}]))", "{{reason}}",
              "cps", ("max(orograph_store_full)", "store full"),
              (f"sum(orograph_uplink_registers_lost_total{{{ROBOT}}})", "registers lost")),
    ),
}  # fmt: skip

CLUSTER: Rows = {
    "Processes": (
        graph("Processes that answer", "sum by (job) (up)", "{{job}}"),
        graph("Robots served", "sum by (job) (orograph_robots_held)", "{{job}}"),
        graph("Starts within 5 minutes", "changes(job:process_start_time_seconds:max[5m])", "{{job}}", "short",
              ("changes(robot:orograph_uplink_epoch:max[5m])", "{{robot}} epochs")),
        graph("Claims", f"sum by (answer) (rate(orograph_claims_total[{RATE}]))", "{{answer}}", "cps"),
        graph("Age of the youngest process", "time() - job:process_start_time_seconds:max", "{{job}}", "s"),
        graph("Scrape", "max by (job) (scrape_duration_seconds)", "{{job}}", "s"),
    ),
    "Memory and processor": (
        graph("Resident memory", 'process_resident_memory_bytes{job!="prometheus"}', "{{job}} {{instance}}", "bytes"),
        graph("Peak of each service", "max by (job) (orograph_peak_resident_memory_bytes)", "{{job}}", "bytes"),
        graph("Processor", f"sum by (job) (rate(process_cpu_seconds_total[{RATE}]))", "{{job}}", "percentunit"),
        graph("Open files", "max by (job) (process_open_fds)", "{{job}}"),
        graph("Garbage collections",
              f"sum by (job) (rate(python_gc_collections_total[{RATE}]))", "{{job}}", "cps"),
        graph("Pace", "orograph:real_time_factor:rate30s", "real-time factor", "short",
              ("max(orograph_time_scale_ratio)", "asked for (0: lockstep)")),
    ),
    "Zenoh": (
        graph("Links of a service", "sum by (job, plane) (orograph_zenoh_transports)", "{{job}} {{plane}}"),
        graph("Links of a router", "max by (job) (orograph_router_transports)", "{{job}}"),
        graph("Time of a process", f"avg by (job) (rate(orograph_step_duration_seconds_sum[{RATE}]))",
              "{{job}} steps", "percentunit",
              (f"avg by (job) (rate(orograph_wait_duration_seconds_sum[{RATE}]))", "{{job}} waits for messages")),
        graph("Bytes sent", "job_plane:orograph_sent_bytes:rate30s", "{{job}} {{plane}}", "Bps"),
        graph("Bytes received", f"sum by (job, plane) (rate(orograph_received_bytes_total[{RATE}]))",
              "{{job}} {{plane}}", "Bps"),
        graph("Refused off the wire", f"sum by (reason) (rate(orograph_mailbox_rejected_messages_total[{RATE}]))",
              "{{reason}}", "cps",
              (f"sum by (callback) (rate(orograph_callback_errors_total[{RATE}]))", "{{callback}} could not be taken"),
              ("max(orograph_figures_unnamed)", "figures without a name")),
    ),
}  # fmt: skip
DASHBOARDS = {"mission": MISSION, "mapping": MAPPING, "cluster": CLUSTER}


def build_panel(panel: Panel) -> Builder:
    """A panel of Grafana's; words for numbers where there are."""
    builder = BUILDERS[panel.kind]().title(panel.title).datasource(SOURCE).unit(panel.unit)
    builder.height({"number": 4, "states": 6}.get(panel.kind, 8)).span(panel.width)
    for i, (expr, legend) in enumerate(panel.queries):
        query = prometheus.Dataquery().expr(expr).legend_format(legend).ref_id(chr(ord("A") + i))
        builder.with_target(query.instant() if panel.kind in {"number", "bars"} else query.range())
    if panel.states:
        words = {str(i): ValueMappingResult(text, colour, index=i) for i, (text, colour) in enumerate(panel.states)}
        builder.mappings([ValueMap(words)])
    if isinstance(builder, bargauge.Panel):
        builder.orientation(VizOrientation.HORIZONTAL)
    if isinstance(builder, timeseries.Panel):
        builder.min(0).fill_opacity(8).legend(
            common.VizLegendOptions()
            .display_mode(LegendDisplayMode.LIST)
            .placement(LegendPlacement.BOTTOM)
            .show_legend(True)
            .calcs([])
        )
    return builder


def build_dashboard(name: str, rows: Rows) -> Dashboard:
    """A dashboard of rows of panels, with the choice of robots on top and links to the others."""
    robots = (
        dashboard.QueryVariable("robot").label("Robot").datasource(SOURCE).multi(True).include_all(True).all_value(".*")
        .query("label_values(orograph_radio_link_up, robot)").refresh(VariableRefresh.ON_TIME_RANGE_CHANGED)
    )  # fmt: skip
    board = (
        dashboard.Dashboard(f"Orograph: {name}").uid(f"orograph-{name}").tags(["orograph"]).timezone("browser")
        .refresh("5s").time("now-15m", "now").tooltip(DashboardCursorSync.CROSSHAIR).with_variable(robots)
        .link(dashboard.DashboardLink("Orograph").type(DashboardLinkType.DASHBOARDS).tags(["orograph"]).keep_time(True))
    )  # fmt: skip
    for title, panels in rows.items():
        board.with_row(dashboard.Row(title))
        for panel in panels:
            board.with_panel(build_panel(panel))
    built = board.build()
    for i, placed in enumerate(built.panels or (), 1):
        placed.id_val = i
    return built


def render() -> dict[str, str]:
    """File name -> JSON text of each dashboard."""
    return {
        f"{name}.json": json.dumps(build_dashboard(name, rows), cls=JSONEncoder, indent=1, sort_keys=True) + "\n"
        for name, rows in DASHBOARDS.items()
    }


def main() -> None:
    """Write the dashboards."""
    for name, text in render().items():
        (FOLDER / name).write_text(text)


if __name__ == "__main__":
    main()
