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
from orograph.comms.observer import Heard, Observer
from orograph.comms.session import client
from orograph.control import Figures
from orograph.messages import Ack, Batch, Delta, Digest, Fenced, Message, Welcome

SIM, RADIO = "tcp/router-sim:7447", "tcp/router-radio:7447"
KINDS = (Ack, Batch, Delta, Digest, Fenced, Welcome, Figures)
Line = dict[str, Any]


def told(message: Message | Figures) -> Line:
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
        case Figures():
            return {"figures": message.figures}
    raise AssertionError(message)


def _columns(packed: Any, *names: str) -> Line:
    return {name: packed[name].tolist() for name in names}


class Notebook:
    """Lines in the order of arrival, written by the main thread alone."""

    def __init__(self) -> None:
        self._lines: queue.SimpleQueue[Line | None] = queue.SimpleQueue()

    def hear(self, heard: Heard) -> None:
        """One message from the radio plane, or a node's figures from the sim plane."""
        line: Line = {"at": time.time(), "kind": type(heard.message).__name__, **told(heard.message)}
        if isinstance(heard.message, Figures):
            line |= {"kind": "figures", "node": heard.sender}
        else:
            line |= {"robot": keys.split(heard.sender)[1] or keys.split(heard.to)[1], "frame": heard.frame}
        self._lines.put(line)

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
        Observer({keys.SIM: sim, keys.RADIO: radio}, KINDS, notebook.hear)
        notebook.write()


if __name__ == "__main__":
    main()
