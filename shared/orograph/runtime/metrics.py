"""What Prometheus scrapes from a service: its nodes' figures, its process, the durations of what it does.

Everything is measured always and costs next to nothing; `--metrics-port` alone decides whether it can be scraped.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from wsgiref.simple_server import WSGIServer

from prometheus_client import REGISTRY, CollectorRegistry, Counter, Histogram, start_http_server
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from orograph import keys
from orograph.comms.bus import Bus
from orograph.comms.mailbox import Mailbox
from orograph.runtime import metric_names
from orograph.runtime.metric_names import Metric
from orograph.scenario import Scenario
from orograph.stages import STAGES, StageRecorder

MICRO_S = (10e-6, 30e-6, 100e-6, 300e-6, 1e-3, 3e-3, 10e-3, 30e-3, 100e-3, 300e-3, 1.0)
MILLI_S = (1e-3, 2e-3, 5e-3, 10e-3, 20e-3, 50e-3, 100e-3, 200e-3, 500e-3, 1.0, 2.0)

STEP = Histogram("orograph_step_duration_seconds", "One frame of all nodes of a process.", buckets=MILLI_S)
WAIT = Histogram("orograph_wait_duration_seconds", "Wait for a frame's counted messages, in lockstep.", buckets=MILLI_S)
STAGE = Histogram("orograph_stage_duration_seconds", "One stage of the mapping method.", ["stage"], buckets=MICRO_S)
COMMIT = Histogram("orograph_store_commit_duration_seconds", "One durable commit of the map store.", buckets=MILLI_S)
CLAIMS = Counter("orograph_claims_total", "Replicas' claims on robots, by answer.", ["answer"])

Family = CounterMetricFamily | GaugeMetricFamily
Labels = tuple[tuple[str, str], ...]
Samples = dict[Metric, dict[Labels, float]]


class Figures(Collector):
    """The newest figures of a process; written by the thread that steps, read by a scrape."""

    def __init__(self) -> None:
        self._nodes: dict[str, Mapping[str, float]] = {}
        self._process: Mapping[str, float] = {}
        self._recorders: Sequence[StageRecorder] = ()
        self._seen: defaultdict[tuple[int, str], int] = defaultdict(int)

    def show(self, nodes: Mapping[str, Mapping[str, float]], process: Mapping[str, float]) -> None:
        """Replace the figures by those of now: of each node by its name, and of the process."""
        self._nodes, self._process = dict(nodes), dict(process)
        self._observe_stages()

    def time_stages(self, recorders: Iterable[StageRecorder]) -> None:
        """Take stage durations from these recorders whenever figures are shown."""
        self._recorders = tuple(recorders)
        self._seen.clear()
        for stage in STAGES if self._recorders else ():
            STAGE.labels(stage)

    def _observe_stages(self) -> None:
        for i, recorder in enumerate(self._recorders):
            for stage, passes in recorder.passes.items():
                durations = recorder.durations_ns[stage]
                new = min(passes - self._seen[i, stage], len(durations))
                self._seen[i, stage] = passes
                for duration_ns in durations[len(durations) - new :]:
                    STAGE.labels(stage).observe(duration_ns * 1e-9)

    def collect(self) -> Iterator[Family]:
        """Families in the order of the table; figures that it does not name are counted."""
        samples: Samples = {}
        unnamed = 0
        for name, figures in self._nodes.items():
            service, robot = keys.split(name)
            of_robot: Labels = (("robot", robot),) if robot else ()
            sums = {figure for s, figure in metric_names.SUMS if s == service}
            figures = {figure: value for figure, value in figures.items() if figure not in sums}
            unnamed += _sort(samples, metric_names.TELEMETRY[service], figures, of_robot)
        if self._process:
            unnamed += _sort(samples, metric_names.PROCESS, self._process, ())
        yield from (_family(metric, values) for metric, values in samples.items())
        yield GaugeMetricFamily("orograph_figures_unnamed", "Figures that have no name here: a defect.", unnamed)


def _sort(samples: Samples, table: Mapping[str, Metric], figures: Mapping[str, float], more: Labels) -> int:
    """Add figures to their families, in place; returns how many the table does not know."""
    for pattern, metric in table.items():
        for value in metric.known:
            samples.setdefault(metric, {})[(*more, (str(metric_names.label_of(pattern)), value))] = 0.0
    unnamed = 0
    for figure, number in figures.items():
        found = metric_names.place(table, figure)
        if found is None:
            unnamed += 1
        else:
            samples.setdefault(found.metric, {})[(*more, *found.labels)] = float(number)
    return unnamed


def _family(metric: Metric, values: Mapping[Labels, float]) -> Family:
    kind = CounterMetricFamily if metric.kind == "counter" else GaugeMetricFamily
    names = [name for name, _ in next(iter(values))]
    family = kind(metric.name, metric.help, labels=names)
    for labels, number in values.items():
        family.add_metric([value for _, value in labels], number)
    return family


def process_figures(
    stamp_ns: int, scenario: Scenario, nodes: Iterable[str], mailbox: Mailbox, bus: Bus
) -> dict[str, float]:
    """Figures of this process as a whole, named as in `metric_names.PROCESS`."""
    figures: dict[str, float] = {
        "simulation_s": stamp_ns * 1e-9,
        "time_scale": 0.0 if scenario.time_scale == "max" else scenario.time_scale,
        "robots_held": len({robot for _, robot in map(keys.split, nodes) if robot}),
        "mailbox_waiting": mailbox.waiting,
        **dict.fromkeys(("lost", "overflowed", "forgotten", "skipped"), 0),
        **dict(mailbox.counts),
        **bus.callbacks.figures(),
        **{f"zenoh_transports_{plane}": len(session.info.transports()) for plane, session in bus.sessions.items()},
    }
    # dict() first: Zenoh's threads add routes while this one counts.
    for way, counted in (("sent", dict(bus.bytes_sent)), ("received", dict(mailbox.bytes_received))):
        for (plane, _, _), size in counted.items():
            figures[f"{way}_bytes_{plane}"] = figures.get(f"{way}_bytes_{plane}", 0) + size
    return figures


FIGURES = Figures()
"""Of this process; registered once."""
REGISTRY.register(FIGURES)


def endpoint(text: str) -> tuple[str, int]:
    """(address, port) of `--metrics-port [ADDRESS:]PORT`, as argparse's type; raises ValueError."""
    address, _, port = text.rpartition(":")
    if not port.isdecimal() or not 0 < int(port) < 65_536:
        raise ValueError(f"not [ADDRESS:]PORT: {text!r}")
    return address or "0.0.0.0", int(port)


def serve(address: str, port: int, registry: CollectorRegistry = REGISTRY) -> WSGIServer:
    """Answer scrapes from a thread of its own, until the process ends; raises SystemExit where the port is taken."""
    try:
        return start_http_server(port, address, registry)[0]
    except OSError as error:
        raise SystemExit(f"orograph: cannot serve metrics on {address}:{port}: {error.strerror}") from None
