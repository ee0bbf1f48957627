"""Runs in a container of its own on both planes and writes down what passes: one JSON line each on standard output.

What the Map Manager promised is thus recorded by somebody who was not killed, paused or cut off.
"""

from __future__ import annotations

import hashlib
import json
import queue
import signal
import sys
import threading
import time
from typing import Any

from orograph import keys
from orograph.comms import wire
from orograph.comms.session import client
from orograph.messages import Ack, Batch, Delta, Digest, Fenced, Message, Welcome

SIM, RADIO = "tcp/router-sim:7447", "tcp/router-radio:7447"
PLANE = f"{keys.ROOT}/{keys.RADIO}"
DOWN = ("Ack", "Delta", "Digest", "Fenced", "Welcome")
HEARD = (f"{PLANE}/{keys.MANAGER}/*/Batch/**", *(f"{PLANE}/{keys.MAPPING}/*/{kind}/**" for kind in DOWN))
Line = dict[str, Any]


def told(message: Message) -> Line:
    """What a checker needs of a message; raises AssertionError for one that is not listened to."""
    match message:
        case Ack():
            return {"epoch": message.epoch, **_columns(message.acked, "cell", "seq")}
        case Batch():
            return {"epoch": message.epoch, **_columns(message.records, "cell", "seq", "tick", "confidence")}
        case Delta():
            names = ("manager_epoch", "first_version", "last_version", "part", "parts", "repair")
            return {**{name: getattr(message, name) for name in names}, **_columns(message.cells, "cell")}
        case Digest():
            digest = hashlib.blake2b(message.tiles.tobytes(), digest_size=16).hexdigest()
            return {"manager_epoch": message.manager_epoch, "version": message.version, "hash": digest}
        case Welcome() | Fenced():
            return {"epoch": message.epoch}
    raise AssertionError(message)


def _columns(packed: Any, *names: str) -> Line:
    return {name: packed[name].tolist() for name in names}


class Notebook:
    """Lines in the order of arrival, written by the main thread alone."""

    def __init__(self) -> None:
        self._lines: queue.SimpleQueue[Line | None] = queue.SimpleQueue()
        self._joiner, self._lock = wire.Joiner(), threading.Lock()

    def on_message(self, key: str, piece: bytes) -> None:
        """One fragment from the radio plane."""
        at = time.time()
        with self._lock:
            whole = self._joiner.add(key, piece)
        if whole is not None:
            _, to, kind, sender = keys.parse_message_key(key)
            robot = keys.split(sender)[1] or keys.split(to)[1]
            self._lines.put({"at": at, "kind": kind, "robot": robot, "frame": whole[0],
                             **told(wire.decode(kind, whole[2]))})  # fmt: skip

    def on_figures(self, key: str, payload: bytes) -> None:
        """A node's figures from the sim plane."""
        service, robot = key.split("/")[2:4]
        name = service if robot == keys.NONE else keys.node(service, robot)
        self._lines.put({"at": time.time(), "kind": "figures", "node": name, "figures": wire.unpack_plain(payload)})

    def close(self) -> None:
        """Let `write` return."""
        self._lines.put(None)

    def write(self) -> None:
        """Write lines until closed."""
        while (line := self._lines.get()) is not None:
            sys.stdout.write(json.dumps(line, separators=(",", ":")) + "\n")
            sys.stdout.flush()


def main() -> None:
    """Listen until told to stop."""
    stop, notebook = threading.Event(), Notebook()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: notebook.close())
    with client(SIM, stop) as sim, client(RADIO, stop) as radio:
        sim.declare_subscriber(
            f"{keys.TELEMETRY}/**", lambda s: notebook.on_figures(str(s.key_expr), s.payload.to_bytes())
        )
        for key in HEARD:
            radio.declare_subscriber(key, lambda s: notebook.on_message(str(s.key_expr), s.payload.to_bytes()))
        notebook.write()


if __name__ == "__main__":
    main()
