"""What breaks the cluster: each nemesis is a function of the running mission, and says what it does to the timeline."""

from __future__ import annotations

import random
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

from chaos import netns
from chaos.cluster import Cluster, call, until
from chaos.evidence import Action
from chaos.watch import Watch
from orograph import keys

ROUTER = "router-radio"
BEGIN_FRAME = 60
RECOVER_S = 120.0
STEADY_SCANS = 4


@dataclass
class Mission:
    """A running cluster in the hands of a nemesis; `seed` decides whatever it leaves to chance."""

    cluster: Cluster
    watch: Watch
    seed: int
    actions: list[Action] = field(default_factory=list)
    restarted: dict[str, int] = field(default_factory=dict)
    conflicts: int = 0
    left: set[str] = field(default_factory=set)
    """Robots whose mapping was taken away for good."""

    def note(self, what: str, heals: bool = False) -> None:
        """Put something on the timeline, as of now."""
        self.actions.append(Action(time.time(), self.watch.frame, what, heals))

    def docker(self, what: str, *arguments: str, heals: bool = False) -> None:
        """Run a docker command and put it on the timeline when it has worked."""
        call("docker", *arguments)
        self.note(what, heals)

    def hold(self, seconds: float) -> None:
        """The fault lasts so long: its duration is the experiment's parameter."""
        threading.Event().wait(seconds)

    def begin(self, frame: int = BEGIN_FRAME) -> None:
        """Let the mission come to `frame`, and to a steady state: every robot drives and maps."""
        for robot in () if self.actions else self.cluster.holders(keys.MAPPING):
            self.watch.await_figure(keys.node(keys.MAPPING, robot), "scans", lambda n: n >= STEADY_SCANS, RECOVER_S)
            self.watch.await_figure(keys.node(keys.NAVIGATOR, robot), "driven_m", lambda m: m > 0.5, RECOVER_S)
        self.watch.await_frame(frame)

    def radio_of(self, robot: str) -> list[str]:
        """The robot's containers that are on the radio plane."""
        return [self.cluster.holder(service, robot) for service in (keys.MAPPING, keys.NAVIGATOR)]


Nemesis = Callable[[Mission], None]


def nothing(m: Mission) -> None:
    """No fault: what all others are compared with."""
    m.begin()


def radio_cut(seconds: float, frame: int = BEGIN_FRAME) -> Nemesis:
    """F1: a robot's containers leave the radio network."""

    def nemesis(m: Mission) -> None:
        m.begin(frame)
        network, containers = m.cluster.network("radio"), m.radio_of("robot_001")
        for container in containers:
            m.docker("robot_001 leaves the radio network", "network", "disconnect", network, container)
        m.hold(seconds)
        for container in containers:
            m.docker("robot_001 is back", "network", "connect", network, container, heals=True)

    return nemesis


def router_down(seconds: float, frame: int = BEGIN_FRAME) -> Nemesis:
    """F2, F8: the radio's router is killed and stays away."""

    def nemesis(m: Mission) -> None:
        m.begin(frame)
        router = m.cluster.only(ROUTER)
        m.docker("router-radio is killed", "kill", "--signal", "KILL", router)
        m.hold(seconds)
        m.docker("router-radio is started", "start", router)
        until(lambda: m.cluster.state(router)["Health"]["Status"] == "healthy", "router-radio healthy", RECOVER_S)
        m.note("router-radio is healthy", heals=True)

    return nemesis


def manager_killed(frames: tuple[int, ...] = (90, 210, 330)) -> Nemesis:
    """F9: kill -9 of the Map Manager; its restart policy brings it back."""

    def nemesis(m: Mission) -> None:
        for frame in frames:
            m.begin(frame)
            epoch = m.watch.of(keys.MANAGER, "manager_epoch")
            m.cluster.kill_inside(m.cluster.only(keys.MANAGER))
            m.note("map-manager: kill -9")
            m.watch.await_figure(keys.MANAGER, "manager_epoch", lambda now, e=epoch: now > e, RECOVER_S)
            m.note("map-manager has recovered", heals=True)

    return nemesis


def mapping_killed(frames: tuple[int, ...] = (120, 280), robot: str = "robot_001") -> Nemesis:
    """F13: kill -9 of a robot's mapping; its memory is gone, the manager gives it its row back."""

    def nemesis(m: Mission) -> None:
        node = keys.node(keys.MAPPING, robot)
        for frame in frames:
            m.begin(frame)
            epoch = m.watch.of(node, "epoch")
            m.cluster.kill_inside(m.cluster.holder(keys.MAPPING, robot))
            m.restarted[robot] = m.restarted.get(robot, 0) + 1
            m.note(f"{node}: kill -9")
            m.watch.await_figure(node, "epoch", lambda now, e=epoch: now > e, RECOVER_S)
            m.note(f"{node} is welcomed again", heals=True)

    return nemesis


def paused(services: tuple[str, ...], seconds: float, frame: int = BEGIN_FRAME) -> Nemesis:
    """F14, F23: containers are frozen and thawed; a robot's service is that of robot_001."""

    def nemesis(m: Mission) -> None:
        m.begin(frame)
        robots = keys.ROBOT_SERVICES
        frozen = {s: m.cluster.holder(s, "robot_001") if s in robots else m.cluster.only(s) for s in services}
        for service, container in frozen.items():
            m.docker(f"{service} is paused", "pause", container)
        m.hold(seconds)
        for service, container in frozen.items():
            m.docker(f"{service} goes on", "unpause", container, heals=True)

    return nemesis


def one_after_the_other(*nemeses: Nemesis) -> Nemesis:
    """Several, in turn."""

    def nemesis(m: Mission) -> None:
        for each in nemeses:
            each(m)

    return nemesis


def orchestrator_killed(m: Mission) -> None:
    """F24: kill -9 of the orchestrator in the middle of the patrol."""
    m.begin(200)
    container = m.cluster.only(keys.ORCHESTRATOR)
    begun = m.cluster.logs(container).count("ready: ")
    m.cluster.kill_inside(container)
    m.note("orchestrator: kill -9")
    until(lambda: m.cluster.logs(container).count("ready: ") > begun, "orchestrator ready again", RECOVER_S)
    m.note("orchestrator is ready again", heals=True)


def packet_loss(percent: int, seconds: float) -> Nemesis:
    """F4: so many of robot_001's packets on the radio plane are dropped, both ways."""

    def nemesis(m: Mission) -> None:
        m.begin()
        address = netns.address(m.cluster.only(ROUTER), m.cluster.network("radio"))
        with netns.dropping(m.radio_of("robot_001"), address, percent, ("up", "down")) as tool:
            m.note(f"{percent} % of robot_001's packets are dropped ({tool})")
            m.hold(seconds)
        m.note("no packet is dropped any more", heals=True)

    return nemesis


def one_direction(direction: str, seconds: float) -> Nemesis:
    """F3: everything robot_001 sends (up) or is sent (down) on the radio plane is dropped."""

    def nemesis(m: Mission) -> None:
        m.begin(m.watch.frame + 30 if m.actions else BEGIN_FRAME)
        address = netns.address(m.cluster.only(ROUTER), m.cluster.network("radio"))
        with netns.dropping(m.radio_of("robot_001"), address, 100, (direction,)) as tool:
            m.note(f"robot_001's packets {direction} are dropped ({tool})")
            m.hold(seconds)
        m.note(f"packets go {direction} again", heals=True)

    return nemesis


def proxied(setting: str, seconds: float) -> Nemesis:
    """F5, F7: the proxy between the robots and the radio's router is told to be bad for a while."""

    def nemesis(m: Mission) -> None:
        m.begin()
        proxy = m.cluster.only("radio-proxy")
        m.docker(f"proxy: {setting}", "exec", proxy, "sh", "-c", f"echo '{setting}' > /tmp/mode")
        m.hold(seconds)
        m.docker("proxy: clear", "exec", proxy, "sh", "-c", "echo > /tmp/mode", heals=True)

    return nemesis


def disk_full(folder: str, seconds: float) -> Nemesis:
    """F12: the Map Manager's disk has no room left, then has again."""

    def nemesis(m: Mission) -> None:
        m.begin()
        manager = m.cluster.only(keys.MANAGER)
        fill = f"cat /dev/zero > {folder}/ballast 2>/dev/null; ls {folder}/ballast"
        m.docker("the manager's disk is full", "exec", manager, "sh", "-c", fill)
        m.watch.await_figure(keys.MANAGER, "store_full", lambda full: full == 1.0)
        m.note("the manager says so")
        m.hold(seconds)
        m.docker("the manager's disk has room again", "exec", manager, "rm", f"{folder}/ballast", heals=True)
        m.watch.await_figure(keys.MANAGER, "store_full", lambda full: full == 0.0)

    return nemesis


def out_of_memory(m: Mission) -> None:
    """F16: a robot's mapping hits a memory limit and is ended by the kernel."""
    m.begin(120)
    node, container = keys.node(keys.MAPPING, "robot_001"), m.cluster.holder(keys.MAPPING, "robot_001")
    epoch, restarts = m.watch.of(node, "epoch"), m.cluster.restarts(container)
    m.restarted["robot_001"] = 1
    m.note("robot_001's mapping has no memory left")
    # Another process of the container takes it all; the kernel is told whom to end first.
    victim = "/proc/$(cat /proc/1/task/1/children | cut -d' ' -f1)/oom_score_adj"
    call("docker", "exec", container, "sh", "-c", f"echo 1000 > {victim}; head -c 2G /dev/zero | tail", check=False)
    until(lambda: m.cluster.restarts(container) > restarts, "the kernel ends robot-mapping", 30)
    m.watch.await_figure(node, "epoch", lambda now: now > epoch, RECOVER_S)
    m.note("robot_001's mapping is welcomed again", heals=True)


def scaled(counts: tuple[int, ...]) -> Nemesis:
    """F18: laser, mapping and navigator are scaled while the mission runs."""

    def nemesis(m: Mission) -> None:
        for i, count in enumerate(counts):
            m.begin(60 + 60 * i)
            before = set(m.cluster.holders(keys.MAPPING)) if i else set()
            scale = [word for service in keys.ROBOT_SERVICES for word in ("--scale", f"{service}={count}")]
            m.cluster.compose("up", "--detach", "--no-recreate", "--timeout", "4", *scale)
            m.note(f"scaled to {count}", heals=True)
            if i and count < counts[i - 1]:
                m.left |= before - set(m.cluster.holders(keys.MAPPING))
            else:
                m.watch.await_figure("world", "robots", lambda n, c=count: n >= c, RECOVER_S)
                m.note(f"{count} robots are in the world", heals=True)

    return nemesis


def second_worker(m: Mission) -> None:
    """F19: another robot-mapping with the explicit id of robot_001."""
    m.begin()
    m.conflicts += 1
    told = m.cluster.compose("run", "--detach", "--no-deps", "--env", "OROGRAPH_ROBOT=robot_001", keys.MAPPING)
    worker = told.split()[-1]
    until(lambda: "waiting for a robot" in m.cluster.logs(worker), "the second worker's refusal", RECOVER_S)
    m.note("a second worker claims robot_001 and is refused")
    m.hold(8)
    m.note("it has had its time", heals=True)


def rolling_restart(m: Mission) -> None:
    """F22: every service but the world is stopped and started, one after the other."""
    m.begin()
    for service in (ROUTER, keys.MANAGER, keys.ORCHESTRATOR, *keys.ROBOT_SERVICES):
        for container in m.cluster.containers(service):
            begun = m.cluster.logs(container).count("ready: ")
            if service == keys.MAPPING:
                robot = next(r for r, c in m.cluster.holders(service).items() if c == container)
                m.restarted[robot] = m.restarted.get(robot, 0) + 1
            m.docker(f"{service} is restarted", "restart", "--time", "4", container)
            if service != ROUTER:
                until(lambda c=container, b=begun: m.cluster.logs(c).count("ready: ") > b, f"{service} again", 60)
            m.note(f"{service} is there again", heals=True)


def storm(m: Mission) -> None:
    """F27: three faults, drawn by the seed."""
    draw = random.Random(m.seed)
    frame = BEGIN_FRAME
    kinds: list[Callable[[int], Nemesis]] = [
        lambda f: radio_cut(draw.uniform(1, 6), f),
        lambda f: router_down(draw.uniform(0.2, 4), f),
        lambda f: manager_killed((f,)),
        lambda f: mapping_killed((f,), draw.choice(("robot_001", "robot_002"))),
        lambda f: paused((draw.choice((keys.MANAGER, keys.MAPPING, keys.LASER)),), draw.uniform(1, 5), f),
    ]
    for make in draw.sample(kinds, 3):
        make(frame)(m)
        frame = max(frame, m.watch.frame) + draw.randrange(20, 60)
