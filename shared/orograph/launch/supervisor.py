"""Starts services as processes, restarts what dies as a container's restart policy would, ends everything."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from orograph.errors import RunError

DEATHS_WINDOW_S = 30.0
DEATHS_MAX = 3
"""One more death within the window ends the run."""
STOP_S = 6.0
LAST_LINES = 12


@dataclass
class Child:
    """One service process and its history."""

    name: str
    module: str
    arguments: tuple[str, ...]
    log: Path
    essential: bool
    """Its death can't be made good by starting it again: the simulated reality."""
    aside: bool
    """No part of the mission, which neither waits for its end nor minds its death."""
    process: subprocess.Popen[bytes]
    deaths_s: list[float] = field(default_factory=list)
    gone: bool = False
    """It died too often, and is missed by nobody."""

    def last_lines(self) -> str:
        """The end of its log."""
        lines = self.log.read_text(errors="replace").splitlines() if self.log.exists() else []
        return "\n".join(f"    {line}" for line in lines[-LAST_LINES:])


class Supervisor:
    """Use as a context manager: leaving it ends every process it started."""

    def __init__(self, environment: Mapping[str, str], log_dir: Path) -> None:
        self._environment, self._log_dir = dict(environment), log_dir
        self.children: list[Child] = []
        self.restarts: list[str] = []
        log_dir.mkdir(parents=True, exist_ok=True)

    def __enter__(self) -> Supervisor:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(
        self, name: str, module: str, *arguments: str, essential: bool = False, aside: bool = False
    ) -> Child:  # fmt: skip
        """Start `python -m <module>`; its output goes to logs/<name>.log."""
        log = self._log_dir / f"{name}.log"
        child = Child(name, module, arguments, log, essential, aside, self._spawn(module, arguments, log))
        self.children.append(child)
        return child

    def _spawn(self, module: str, arguments: tuple[str, ...], log_file: Path) -> subprocess.Popen[bytes]:
        with log_file.open("ab") as log:
            return subprocess.Popen(
                [sys.executable, "-m", module, "--with-parent", *arguments],
                env=self._environment, stdin=subprocess.PIPE, stdout=log, stderr=log, start_new_session=True,
            )  # fmt: skip

    def poll(self) -> bool:
        """Restart what died; True when every service has ended well. Raises RunError when a death can't be mended."""
        running = False
        for child in self.children:
            code = child.process.poll()
            if code is None:
                running = running or not (child.aside or child.name.startswith("router"))
            elif code != 0 and not child.gone:
                self._mend(child, code)
                running = running or not child.aside
        return not running

    def _mend(self, child: Child, code: int) -> None:
        now = time.monotonic()
        child.deaths_s = [t for t in child.deaths_s if now - t < DEATHS_WINDOW_S] + [now]
        if child.aside and len(child.deaths_s) > DEATHS_MAX:
            child.gone = True
            self.restarts.append(f"{child.name} no more: it died too often, the run goes on ({child.log})")
            return
        how = f"signal {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
        if child.essential or len(child.deaths_s) > DEATHS_MAX:
            often = f"{len(child.deaths_s)} times within {DEATHS_WINDOW_S:.0f} s"
            why = "it holds the simulated reality" if child.essential else often
            raise RunError(f"{child.name} died ({how}; {why}). Its last lines ({child.log}):\n{child.last_lines()}")
        self.restarts.append(f"{child.name} ({how})")
        _let_go(child.process)
        child.process = self._spawn(child.module, child.arguments, child.log)

    def stop(self) -> None:
        """SIGTERM to all, SIGKILL to those still there after a few seconds."""
        for child in self.children:
            child.process.terminate()
        deadline = time.monotonic() + STOP_S
        for child in self.children:
            try:
                child.process.wait(max(0.1, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                child.process.kill()
                child.process.wait()
            _let_go(child.process)


def _let_go(process: subprocess.Popen[bytes]) -> None:
    """Close its standard input, which says that its parent lives."""
    if process.stdin is not None:
        process.stdin.close()
