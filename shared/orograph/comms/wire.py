"""Messages as bytes and back; nothing received is trusted before it is validated (faults.md, "Payload validation").

A message is msgpack `[version, {field: value}]`, arrays as `[shape, little-endian bytes]`. It travels in fragments
of at most FRAGMENT_MAX_BYTES, each behind a fixed header.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from typing import Any, TypeVar

import msgpack

from orograph import fields
from orograph.kinds import Rejected
from orograph.messages import FRAGMENT_MAX_BYTES, KINDS, MESSAGE_MAX_BYTES, SCHEMA_VERSION, Message
from orograph.routes import Routed

HEADER = struct.Struct("<IIHHI")
"""frame, index of the message among its sender's in that frame, part, parts, crc32 of the whole message."""


def encode(message: Routed) -> bytes:
    """One message as bytes; raises AssertionError, naming message and field, if it breaks its own bounds."""
    try:
        body = fields.pack(message)
    except Rejected as error:
        raise AssertionError(f"{type(message).__name__}: {error}") from None
    packed: bytes = msgpack.packb([SCHEMA_VERSION, body], use_bin_type=True)
    return packed


M = TypeVar("M", bound=Routed)
ITEMS_MAX = 4_096
"""No list or map on the wire is longer."""


def decode(cls: type[M], payload: bytes) -> M:
    """The message of this kind that `encode` made; raises Rejected for anything else."""
    if len(payload) > fields.bytes_max(cls):
        raise Rejected("size", str(len(payload)))
    whole = _unpack(payload)
    if type(whole) is not list or len(whole) != 2 or type(whole[0]) is not int or whole[0] != SCHEMA_VERSION:
        raise Rejected("schema")
    return fields.unpack(cls, whole[1])


def _unpack(payload: bytes) -> Any:
    """What msgpack holds, nothing allocated beyond what came."""
    try:
        return msgpack.unpackb(
            payload, raw=False, strict_map_key=True, max_array_len=ITEMS_MAX, max_map_len=ITEMS_MAX,
            max_str_len=len(payload), max_bin_len=len(payload), max_ext_len=0,
        )  # fmt: skip
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise Rejected("msgpack", type(error).__name__) from error


def kind_of(name: str) -> type[Message]:
    """The kind of message that a key names; raises Rejected for none of ours."""
    if name not in KINDS:
        raise Rejected("kind", name[:40])
    return KINDS[name]


def fragments(frame: int, index: int, payload: bytes) -> Iterator[bytes]:
    """Cut one message into pieces that fit the wire."""
    room = FRAGMENT_MAX_BYTES - HEADER.size
    parts = max(1, -(-len(payload) // room))
    crc = zlib.crc32(payload)
    for part in range(parts):
        yield HEADER.pack(frame, index, part, parts, crc) + payload[part * room : (part + 1) * room]


class Joiner:
    """Joins fragments, each message once; holds at most `bound` unfinished ones and forgets the oldest beyond that."""

    def __init__(self, bound: int = 256, known: int = 8_192) -> None:
        """Of `known` finished messages it knows that they came, so that a second time is refused."""
        self._bound, self._known = bound, known
        self._finished: dict[tuple[str, int, int, int], None] = {}
        self._open: dict[tuple[str, int, int, int], dict[int, bytes]] = {}
        self.forgotten = 0

    def add(self, key: str, piece: bytes, bytes_max: int = MESSAGE_MAX_BYTES) -> tuple[int, int, bytes] | None:
        """(frame, index, message) when this piece completes one; raises Rejected for a bad piece.

        `bytes_max` is the most that a message of that key can take: nothing longer is collected.
        """
        if not HEADER.size <= len(piece) <= FRAGMENT_MAX_BYTES:
            raise Rejected("size", str(len(piece)))
        frame, index, part, parts, crc = HEADER.unpack_from(piece)
        if part >= parts or (parts - 1) * (FRAGMENT_MAX_BYTES - HEADER.size) > bytes_max:
            raise Rejected("size", f"{part} of {parts}")
        name = (key, frame, index, crc)
        if name in self._finished:
            raise Rejected("doubled", key)
        message = piece[HEADER.size :] if parts == 1 else self._join(name, part, parts, piece)
        if message is None:
            return None
        if zlib.crc32(message) != crc:
            raise Rejected("crc", key)
        self._finished[name] = None
        if len(self._finished) > self._known:
            del self._finished[next(iter(self._finished))]
        return frame, index, message

    def _join(self, name: tuple[str, int, int, int], part: int, parts: int, piece: bytes) -> bytes | None:
        pieces = self._open.setdefault(name, {})
        pieces[part] = piece[HEADER.size :]
        if len(pieces) == parts:
            del self._open[name]
            return b"".join(pieces[i] for i in range(parts))
        if len(self._open) > self._bound:
            del self._open[next(iter(self._open))]
            self.forgotten += 1
        return None
