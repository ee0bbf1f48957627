"""A mission as processes over Zenoh: two routers, the services, a listener for people; nothing here steps a node."""

from __future__ import annotations

import os
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from orograph import control, keys
from orograph.comms.observer import Heard, Observer
from orograph.comms.session import client
from orograph.errors import InputError, RunError
from orograph.launch.progress import Figures, OnProgress
from orograph.launch.supervisor import Supervisor
from orograph.runtime.settings import Settings
from orograph.scenario import Scenario
from orograph.storage.run_folder import LOGS, SCENARIO, WORLD

POLL_S = 0.1


def free_port(port: int = 0) -> int:
    """This port of loopback, by default a free one, for a server of ours; raises InputError where it is taken."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind(("127.0.0.1", port))
        except (OSError, OverflowError) as error:
            raise InputError(f"port {port} on 127.0.0.1 cannot be had ({error}); choose another or 0") from None
        return int(probe.getsockname()[1])


@contextmanager
def held_endpoint(port: int = 0) -> Iterator[str]:
    """An endpoint on loopback for a router of ours, by default on a free port; raises InputError where it is taken.

    The port is bound here all the time and never listened on: our router may (SO_REUSEADDR), also when it is started
    again, and nobody else is given it.
    """
    with socket.socket() as holder:
        holder.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            holder.bind(("127.0.0.1", port))
        except OSError as error:
            raise InputError(f"port {port} on 127.0.0.1 is taken ({error.strerror}); choose another or 0") from None
        yield f"tcp/127.0.0.1:{holder.getsockname()[1]}"


def run_processes(
    scenario: Scenario, out: Path, capacity: int, ports: tuple[int, int], on_progress: OnProgress,
    page_port: int | None = None, record: bool = False,
) -> None:  # fmt: skip
    """Run the mission whose resolved scenario is in out/parts to its end; raises RunError when it can't be.

    `capacity` is robots per process, 0 for the default; of `ports` (sim, radio) 0 is a free one. On `page_port`, if
    any, a console shows it; `record` leaves an MCAP file in `out`.
    """
    with started(scenario, out, capacity or default_capacity(scenario), ports, page_port, record) as (supervisor, sim):
        follow(supervisor, sim, out, on_progress)


def default_capacity(scenario: Scenario) -> int:
    """One robot per process where there are cores for it; on a small machine processes are shared."""
    return scenario.robots if (os.cpu_count() or 1) <= 2 else 1


@contextmanager
def started(
    scenario: Scenario, out: Path, capacity: int, ports: tuple[int, int] = (0, 0), page_port: int | None = None,
    record: bool = False,
) -> Iterator[tuple[Supervisor, str]]:  # fmt: skip
    """All processes of a mission, until it is left; gives who keeps them running and the sim plane's endpoint."""
    with ExitStack() as stack:
        sim, radio = (stack.enter_context(held_endpoint(port)) for port in ports)
        capacity = min(capacity, scenario.robots)
        settings = Settings(sim, radio, out.resolve(), capacity)
        supervisor = stack.enter_context(Supervisor(settings.environment, out / LOGS))
        supervisor.start("router-sim", "services.router", "--listen", sim)
        supervisor.start("router-radio", "services.router", "--listen", radio)
        supervisor.start(keys.WORLD, "services.world", essential=True)
        supervisor.start(keys.MANAGER, "services.map_manager")
        supervisor.start(keys.ORCHESTRATOR, "services.orchestrator", "--run", ".", "--scenario", str(out / SCENARIO))
        for service in keys.ROBOT_SERVICES:
            for i in range(-(-len(scenario.robot_ids) // capacity)):
                supervisor.start(f"{service}-{i + 1}", f"services.{service.replace('-', '_')}")
        if page_port is not None:
            supervisor.start("console", "services.console", "--port", str(page_port), aside=True)
        if record:
            supervisor.start("recorder", "services.recorder", aside=True)
        yield supervisor, sim


def follow(supervisor: Supervisor, sim: str, out: Path, on_progress: OnProgress) -> None:
    """Restart what dies and tell how it goes until the mission has ended; raises RunError where it can't."""
    figures: Figures = {}
    stop = threading.Event()
    listener = threading.Thread(target=_listen, args=(sim, figures, stop), daemon=True)
    listener.start()
    try:
        while not supervisor.poll():
            on_progress(dict(figures), supervisor.restarts)  # a copy: the listener's thread adds to it
            time.sleep(POLL_S)
    finally:
        stop.set()
        listener.join(5)
    if not (out / WORLD).exists():
        raise RunError(f"the services ended without a result; their logs are in {out / LOGS}")


def _listen(sim: str, figures: Figures, stop: threading.Event) -> None:
    def on_figures(heard: Heard) -> None:
        assert isinstance(heard.message, control.Figures)
        figures[heard.sender] = heard.message.figures

    with suppress(InterruptedError), client(sim, stop) as session:
        Observer({keys.SIM: session}, [control.Figures], on_figures)
        stop.wait()
