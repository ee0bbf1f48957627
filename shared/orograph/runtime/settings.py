"""Where things are, from at most five environment variables; *what* runs is the scenario's business."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from orograph.control import CAPACITY_MAX
from orograph.keys import ROBOT_ID

VARIABLES = {
    "OROGRAPH_SIM": "endpoint of the sim plane's router, tcp/HOST:PORT",
    "OROGRAPH_RADIO": "endpoint of the radio plane's router",
    "OROGRAPH_RUN_DIR": "where run folders are, or the run folder itself (the orchestrator says which)",
    "OROGRAPH_CAPACITY": "how many robots one process may hold (default 1)",
    "OROGRAPH_ROBOT": "explicit robot ids joined by +, instead of whichever are free",
}


@dataclass(frozen=True)
class Settings:
    """One process's place."""

    sim: str
    radio: str
    run_dir: Path
    capacity: int = 1
    wanted: tuple[str, ...] = ()

    @classmethod
    def from_environment(cls) -> Settings:
        """Read the variables; raises SystemExit(2) naming what is missing."""
        missing = [f"{v} ({VARIABLES[v]})" for v in list(VARIABLES)[:3] if not os.environ.get(v)]
        if missing:
            raise SystemExit("orograph: not set: " + ", ".join(missing))
        return cls(
            os.environ["OROGRAPH_SIM"],
            os.environ["OROGRAPH_RADIO"],
            Path(os.environ["OROGRAPH_RUN_DIR"]),
            _capacity(os.environ.get("OROGRAPH_CAPACITY", "1")),
            _robots(os.environ.get("OROGRAPH_ROBOT", "")),
        )

    @property
    def environment(self) -> dict[str, str]:
        """The variables that make a child process read the same settings."""
        values = (self.sim, self.radio, str(self.run_dir), str(self.capacity), "+".join(self.wanted))
        return {**os.environ, **dict(zip(VARIABLES, values, strict=True))}


def _capacity(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= CAPACITY_MAX:
        raise SystemExit(f"orograph: OROGRAPH_CAPACITY: expected 1 to {CAPACITY_MAX}, found {text!r}")
    return int(text)


def _robots(text: str) -> tuple[str, ...]:
    robots = tuple(robot for robot in text.split("+") if robot)
    if strange := [robot for robot in robots if not ROBOT_ID.fullmatch(robot)]:
        raise SystemExit(f"orograph: OROGRAPH_ROBOT: expected ids such as robot_001, found {strange[0]!r}")
    return robots
