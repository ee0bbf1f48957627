"""The network of one process: wires that never fail, and a seeded radio whose weather is an options struct.

The model is tigerbeetle's `packet_simulator.zig`: chances per message, cuts by link, direction and time, one seed.
"""

from __future__ import annotations

import heapq
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from orograph import keys
from orograph.kinds import Rejected
from orograph.messages import Envelope, Message
from orograph.radio import delivers
from orograph.randomness import stream
from orograph.routes import check_route
from orograph.scenario import Scenario


@dataclass(frozen=True)
class Weather:
    """How bad a link is: chances per message and receiver; all zero is calm."""

    loss: float = 0.0
    duplication: float = 0.0
    delay: float = 0.0
    """Of arriving 1 to `delay_frames_max` frames late, for each copy by itself."""
    delay_frames_max: int = 1
    reordering: float = 0.0
    """Of overtaking everything that arrives in the same frame."""

    def __post_init__(self) -> None:
        assert self.delay_frames_max >= 1, self
        assert all(0 <= p <= 1 for p in (self.loss, self.duplication, self.delay, self.reordering)), self


CUT = Weather(loss=1.0)


@dataclass(frozen=True)
class Spell:
    """Weather from frame `begin` until before frame `end`, on the links of some robots or on all."""

    weather: Weather
    begin: int
    end: int
    robots: tuple[str, ...] = ()
    """Empty: every link, those between the base station's services too."""
    up: bool = True
    """What robots send."""
    down: bool = True
    """What the base station sends."""

    def covers(self, robot: str, up: bool) -> bool:
        """Whether it lies on one direction of a robot's link ('': the base station's own)."""
        return (self.up if up else self.down) and (not self.robots or robot in self.robots)


class Network:
    """Carries what nodes send in frame k to whom it is for in frame k + 1; on the radio plane later, twice or never.

    On the radio plane first the scenario's model decides, by `radio_up` (robot -> whether it has radio now), then the
    newest spell of `forecast` that lies on the link. Several nodes may have one name: each gets all that comes for it.
    """

    def __init__(
        self, scenario: Scenario, names: Iterable[str], radio_up: Callable[[], Mapping[str, bool]],
        forecast: Sequence[Spell] = (), size_bytes: Callable[[Message], int] = lambda message: 0,
    ) -> None:  # fmt: skip
        self._scenario, self._radio_up, self._size_bytes = scenario, radio_up, size_bytes
        self._forecast, self._robots = forecast, frozenset(scenario.robot_ids)
        self._rng = stream(scenario.seed, "weather")
        self._boxes: dict[str, list[tuple[int, int, int, Envelope]]] = {name: [] for name in names}
        self._receivers: defaultdict[str, list[str]] = defaultdict(list)
        for name in self._boxes:
            self._receivers[name].append(name)
            self._receivers[keys.group(keys.split(name)[0])].append(name)
        self._carried = 0
        self.refused: Counter[str] = Counter()
        """What came along no route of its kind, or from a robot that is not in this run, by reason."""
        self.bytes_up: Counter[str] = Counter()
        """Radio bytes by robot, as sent."""
        self.bytes_down: Counter[str] = Counter()
        """Radio bytes by robot, as sent to it, once per receiver."""

    def carry(self, frame: int, sent: Sequence[Envelope]) -> None:
        """Take what all nodes sent in a frame, ordered by (sender, index)."""
        up = self._radio_up()
        spells = [spell for spell in self._forecast if spell.begin <= frame < spell.end]
        for envelope in filter(self._is_routed, sent):
            receivers = self._receivers[envelope.to]
            if envelope.plane == keys.SIM:
                for receiver in receivers:
                    self._put(envelope, receiver, frame + 1)
            else:
                self._weigh(envelope, receivers)
                for receiver in receivers:
                    if self._in_reach(envelope, receiver, up):
                        self._transmit(envelope, receiver, spells)

    def _is_routed(self, e: Envelope) -> bool:
        try:
            check_route(type(e.message), e.plane, e.sender, e.to, self._robots)
        except Rejected as error:
            self.refused[error.reason] += 1
            return False
        return True

    def arrived(self, name: str, frame: int) -> list[Envelope]:
        """Remove and return what has come for nodes of this name by this frame."""
        box, out = self._boxes[name], []
        while box and box[0][0] <= frame:
            out.append(heapq.heappop(box)[-1])
        return out

    def last_due(self) -> int:
        """The frame by which everything on its way will have come; -1 where nothing is."""
        return max((item[0] for box in self._boxes.values() for item in box), default=-1)

    def _in_reach(self, e: Envelope, receiver: str, up: Mapping[str, bool]) -> bool:
        return delivers(self._scenario.seed, self._scenario.radio.loss, up, e.sender, receiver, e.frame, e.index)

    def _transmit(self, envelope: Envelope, receiver: str, spells: Sequence[Spell]) -> None:
        sender_robot = keys.split(envelope.sender)[1]
        robot = sender_robot or keys.split(receiver)[1]
        weather = next((s.weather for s in reversed(spells) if s.covers(robot, bool(sender_robot))), None)
        due = envelope.frame + 1
        if weather is None:
            self._put(envelope, receiver, due)
            return
        lost, doubled = self._rng.random(2) < (weather.loss, weather.duplication)
        for _ in range(0 if lost else 1 + doubled):
            late, overtakes = self._rng.random(2) < (weather.delay, weather.reordering)
            delay = int(self._rng.integers(1, weather.delay_frames_max + 1)) if late else 0
            self._put(envelope, receiver, due + delay, overtakes)

    def _put(self, envelope: Envelope, receiver: str, due: int, overtakes: bool = False) -> None:
        self._carried += 1
        place = -self._carried if overtakes else self._carried
        heapq.heappush(self._boxes[receiver], (due, place, self._carried, envelope))

    def _weigh(self, envelope: Envelope, receivers: Sequence[str]) -> None:
        size = self._size_bytes(envelope.message)
        if robot := keys.split(envelope.sender)[1]:
            self.bytes_up[robot] += size
        for receiver in receivers:
            if robot := keys.split(receiver)[1]:
                self.bytes_down[robot] += size
