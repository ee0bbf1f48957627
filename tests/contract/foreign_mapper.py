"""A mapper that knows docs/messages.json and nothing of Orograph's code: it takes part as docs/messages.md says."""

from __future__ import annotations

import itertools
import json
import os
import queue
import re
import struct
import zlib
from collections import Counter
from pathlib import Path
from typing import Any

import msgpack
import numpy as np
import zenoh

BOOK = json.loads(Path("docs/messages.json").read_text())
HEADER = struct.Struct(BOOK["fragment"]["header"])
INSTANCE, SERVICE = "foreigner", "robot-mapping"
PART = BOOK["fragment"]["max_bytes"] - HEADER.size


def told(kind: dict[str, Any], **fields: Any) -> bytes:
    """A message's bytes; numpy arrays as the book says."""
    assert fields.keys() == kind["fields"].keys()
    body = {k: [list(v.shape), v.tobytes()] if isinstance(v, np.ndarray) else v for k, v in fields.items()}
    return msgpack.packb([BOOK["schema_version"], body])


def understood(kind: dict[str, Any], payload: bytes) -> dict[str, Any]:
    """A message's fields, arrays as numpy arrays."""
    version, body = msgpack.unpackb(payload)
    assert version == BOOK["schema_version"] and body.keys() == kind["fields"].keys()
    for name, field in kind["fields"].items():
        if field["type"] == "array":
            shape, content = body[name]
            body[name] = np.frombuffer(content, dtype_of(field)).reshape(shape)
    return body


def dtype_of(field: dict[str, Any]) -> np.dtype:
    """The layout of an array's items."""
    layout = field["dtype"]
    return np.dtype(layout if isinstance(layout, str) else [(n, t, tuple(shape)) for n, t, shape in layout])


class ForeignMapper:
    """Joins, is welcomed, and brings one record home."""

    def __init__(self, sim: zenoh.Session, radio: zenoh.Session) -> None:
        self._planes = {"sim": sim, "radio": radio}
        self._ticks: queue.SimpleQueue[dict[str, Any]] = queue.SimpleQueue()
        self._arrived: queue.SimpleQueue[tuple[str, bytes]] = queue.SimpleQueue()
        self._inbox: list[tuple[int, str, dict[str, Any]]] = []
        self._here: Counter[tuple[int, str]] = Counter()
        self._pieces: dict[tuple[str, int, int], dict[int, bytes]] = {}
        self._answer = {"instance": INSTANCE, "frame": -1, "sent": {}, "lost": 0}
        self._nonce, self._index, self._sent = os.urandom(16), itertools.count(), Counter[str]()
        self.robot, self.epoch, self.acked, self.phases = "", 0, np.zeros(0), set[str]()

    def _ask(self, kind: str, payload: bytes = b"") -> dict[str, Any] | None:
        control = BOOK["controls"][kind]
        for reply in self._planes["sim"].get(control["key"], payload=payload, timeout=2.0):
            if reply.ok is not None:
                return understood(control, reply.ok.payload.to_bytes())
        return None

    def join(self) -> dict[str, Any]:
        """Steps 1 to 3 of the book; returns the scenario."""
        while (run := self._ask("CurrentRun")) is None:
            pass
        question = told(BOOK["controls"]["Claim"], service=SERVICE, instance=INSTANCE, capacity=1, wanted=[])
        while (grant := self._ask("Grant", question)) is None or not grant["robots"]:
            pass
        (self.robot,) = grant["robots"]
        alive = BOOK["alive_key"].format(service=SERVICE, instance=INSTANCE, robots=self.robot)
        self._token = self._planes["sim"].liveliness().declare_token(alive)
        for (plane, session), to in itertools.product(self._planes.items(), (self.robot, BOOK["every_robot"])):
            hear = lambda s: self._arrived.put((str(s.key_expr), s.payload.to_bytes()))  # noqa: E731
            session.declare_subscriber(f"og/{plane}/{SERVICE}/{to}/**", hear)
        tick = BOOK["controls"]["Tick"]
        self._planes["sim"].declare_subscriber(
            tick["key"], lambda s: self._ticks.put(understood(tick, s.payload.to_bytes()))
        )
        return json.loads(zlib.decompress(run["scenario"]))

    def run(self) -> None:
        """Steps 4 to 6: in lockstep until the end."""
        while True:
            try:
                tick = self._ticks.get(timeout=0.3)
            except queue.Empty:
                tick = None
            if tick and tick["end"]:
                self._token.undeclare()
                return
            if tick and INSTANCE in tick["roster"] and tick["frame"] > self._answer["frame"]:
                self._take(tick)
            node = f"{SERVICE}/{self.robot}"
            answer = told(BOOK["controls"]["Answer"], **self._answer, nodes=[node])
            self._planes["sim"].put(BOOK["controls"]["Answer"]["key"].replace("*", INSTANCE), answer)

    def _take(self, tick: dict[str, Any]) -> None:
        if self._answer["frame"] >= 0 and tick["lockstep"]:
            mine = re.compile(f"[a-z]+/{SERVICE}/({self.robot}|{BOOK['every_robot']})/.*")
            for stream, count in tick["counted"].items():
                while mine.fullmatch(stream) and self._here[tick["frame"] - 1, stream] < count:
                    self._receive(*self._arrived.get(timeout=20))
        while not self._arrived.empty():
            self._receive(*self._arrived.get())
        now = [item for item in self._inbox if item[0] < tick["frame"]]
        self._inbox = [item for item in self._inbox if item[0] >= tick["frame"]]
        self._index, self._sent = itertools.count(), Counter()
        for _, kind, message in now:
            self._hear(kind, message)
        self._speak(tick["frame"])
        self._answer |= {"frame": tick["frame"], "sent": dict(self._sent)}

    def _receive(self, key: str, piece: bytes) -> None:
        frame, index, part, parts, crc = HEADER.unpack_from(piece)
        pieces = self._pieces.setdefault((key, frame, index), {})
        pieces[part] = piece[HEADER.size :]
        if len(pieces) == parts:
            payload = b"".join(pieces[i] for i in range(parts))
            assert zlib.crc32(payload) == crc
            _, plane, to, to_robot, kind, sender, from_robot = key.split("/")
            stream = f"{plane}/{to}/{to_robot}/{sender}/{from_robot}"
            self._here[frame, stream] += 1
            self._inbox.append((frame, kind, understood(BOOK["messages"][kind], payload)))

    def _hear(self, kind: str, message: dict[str, Any]) -> None:
        if kind == "Welcome" and message["nonce"] == self._nonce:
            self.epoch = message["epoch"]
        elif kind == "Ack" and message["epoch"] == self.epoch:
            self.acked = message["acked"]
        elif kind == "Phase":
            self.phases.add(message["name"])

    def _speak(self, frame: int) -> None:
        if not self.epoch and frame % 5 == 0:
            self._send("Hello", nonce=self._nonce, frame=frame)
        elif self.epoch and not len(self.acked) and frame % 5 == 0:
            records = np.zeros(1, dtype_of(BOOK["messages"]["Batch"]["fields"]["records"]))
            records["cell"], records["seq"], records["height"], records["confidence"] = 7, 1, 1234, 200
            self._send("Batch", epoch=self.epoch, records=records, frame=frame)

    def _send(self, kind: str, frame: int, **fields: Any) -> None:
        message = BOOK["messages"][kind]
        (route,) = message["routes"]
        where = {"plane": route["plane"], "to": route["to"], "to_robot": BOOK["no_robot"], "from": SERVICE,
                 "from_robot": self.robot, "kind": kind}  # fmt: skip
        payload, index = told(message, **fields), next(self._index)
        parts = -(-len(payload) // PART)
        for part in range(parts):
            head = HEADER.pack(frame, index, part, parts, zlib.crc32(payload))
            piece = head + payload[part * PART : (part + 1) * PART]
            self._planes[route["plane"]].put(BOOK["message_key"].format(**where), piece)
        self._sent[BOOK["stream"].format(**where)] += 1
