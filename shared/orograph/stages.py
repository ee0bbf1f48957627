"""Stage timing by an injected context manager: the paper's Table 2 from the same call sites everywhere."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext

Stage = Callable[[str], AbstractContextManager[None]]

STAGES = {
    "points": "Collision point list",
    "height": "Heights layer",
    "gradients": "Gradient estimation",
    "confidence": "Confidence layer",
    "occupation": "Occupation layer",
    "fuse_hrm": "Fusion 3D laser aux map with HRM",
    "rescale": "Fusion HRM2LRML",
    "fold": "Fusion LRML with LRMG",
}
"""Our stage names and the rows of the paper's Table 2."""


def untimed(name: str) -> AbstractContextManager[None]:
    """The stage context that measures nothing."""
    return nullcontext()


class StageRecorder:
    """Collects each stage's durations [ns] by a clock given from outside; keeps the newest `keep` of each."""

    def __init__(self, clock_ns: Callable[[], int], keep: int = 20_000) -> None:
        self._clock_ns, self._keep = clock_ns, keep
        self.durations_ns: defaultdict[str, list[int]] = defaultdict(list)
        self.passes: Counter[str] = Counter()
        """How often each stage was measured, those no longer kept included."""

    @contextmanager
    def __call__(self, name: str) -> Iterator[None]:
        """Measure one pass of a stage."""
        assert name in STAGES, name
        begin = self._clock_ns()
        yield
        durations = self.durations_ns[name]
        durations.append(self._clock_ns() - begin)
        self.passes[name] += 1
        if len(durations) > self._keep:
            del durations[: self._keep // 2]
