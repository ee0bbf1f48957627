"""Messages as bytes and back; nothing received is trusted before it is validated (faults.md, "Payload validation").

A message is msgpack `[version, {field: value}]`, arrays as `[shape, little-endian bytes]`. It travels in fragments
of at most FRAGMENT_MAX_BYTES, each behind a fixed header.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import Field, fields
from functools import lru_cache
from typing import Any

import msgpack
import numpy as np

from orograph.messages import FRAGMENT_MAX_BYTES, KINDS, MESSAGE_MAX_BYTES, SCHEMA_VERSION, Message

HEADER = struct.Struct("<IIHHI")
"""frame, index of the message among its sender's in that frame, part, parts, crc32 of the whole message."""


class Rejected(ValueError):  # noqa: N818 - the word the protocol uses
    """A payload that must not be believed; `reason` is a short word to count by."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason = reason


@lru_cache(maxsize=64)
def _fields(kind: str) -> tuple[Field[Any], ...]:
    return fields(KINDS[kind])


def encode(message: Message) -> bytes:
    """One message as bytes; raises AssertionError if it breaks its own bounds (a programming error)."""
    kind = type(message).__name__
    body = {f.name: _encode_value(getattr(message, f.name), f) for f in _fields(kind)}
    packed: bytes = msgpack.packb([SCHEMA_VERSION, body], use_bin_type=True)
    assert len(packed) <= MESSAGE_MAX_BYTES, (kind, len(packed))
    return packed


def _encode_value(value: Any, spec: Field[Any]) -> Any:
    kind = spec.metadata["kind"]
    if kind == "array":
        dtype = spec.metadata["dtype"]
        assert value.dtype == dtype and value.size <= spec.metadata["high"], (spec.name, value.dtype, value.shape)
        return [list(value.shape), value.tobytes()]
    return {"int": int, "float": float, "bool": bool}.get(kind, lambda v: v)(value)


def decode(kind: str, payload: bytes) -> Message:
    """The message that `encode` made; raises Rejected for anything else."""
    if kind not in KINDS:
        raise Rejected("kind", kind[:40])
    if len(payload) > MESSAGE_MAX_BYTES:
        raise Rejected("size", str(len(payload)))
    body = _unpack(payload)
    specs = _fields(kind)
    if body.keys() != {f.name for f in specs}:
        raise Rejected("keys", kind)
    return KINDS[kind](**{f.name: _decode_value(body[f.name], f) for f in specs})  # type: ignore[no-any-return]


def _unpack(payload: bytes) -> dict[str, Any]:
    whole = unpack_plain(payload)
    if type(whole) is not list or len(whole) != 2 or whole[0] != SCHEMA_VERSION or type(whole[1]) is not dict:
        raise Rejected("schema")
    return whole[1]


def pack_plain(value: Any) -> bytes:
    """Any plain value (dict, list, str, int, bytes) for the barrier's and the claims' own messages."""
    packed: bytes = msgpack.packb(value, use_bin_type=True)
    return packed


def unpack_plain(payload: bytes, max_items: int = 4096) -> Any:
    """What `pack_plain` made, with explicit limits; raises Rejected."""
    try:
        return msgpack.unpackb(
            payload, raw=False, strict_map_key=True, max_array_len=max_items, max_map_len=max_items,
            max_str_len=4096, max_bin_len=MESSAGE_MAX_BYTES, max_ext_len=0,
        )  # fmt: skip
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise Rejected("msgpack", type(error).__name__) from error


def _decode_value(value: Any, spec: Field[Any]) -> Any:
    return _DECODERS[spec.metadata["kind"]](value, spec)


def _decode_int(value: Any, spec: Field[Any]) -> int:
    if type(value) is not int:
        raise Rejected("type", spec.name)
    if not spec.metadata["low"] <= value <= spec.metadata["high"]:
        raise Rejected("range", spec.name)
    return value


def _decode_float(value: Any, spec: Field[Any]) -> float:
    if type(value) is not float:
        raise Rejected("type", spec.name)
    if not (math.isfinite(value) and spec.metadata["low"] <= value <= spec.metadata["high"]):
        raise Rejected("range", spec.name)
    return value


def _decode_bool(value: Any, spec: Field[Any]) -> bool:
    if type(value) is not bool:
        raise Rejected("type", spec.name)
    return value


def _decode_sized(value: Any, spec: Field[Any]) -> Any:
    if type(value) is not (str if spec.metadata["kind"] == "str" else bytes):
        raise Rejected("type", spec.name)
    if len(value) > spec.metadata["high"]:
        raise Rejected("range", spec.name)
    return value


def _decode_array(value: Any, spec: Field[Any]) -> np.ndarray[Any, Any]:
    dtype, want = spec.metadata["dtype"], spec.metadata["shape"]
    if type(value) is not list or len(value) != 2 or type(value[0]) is not list or type(value[1]) is not bytes:
        raise Rejected("type", spec.name)
    shape, content = value
    if len(shape) != len(want) or any(type(n) is not int or n < 0 for n in shape):
        raise Rejected("shape", spec.name)
    if any(w is not None and n != w for n, w in zip(shape, want, strict=True)):
        raise Rejected("shape", spec.name)
    if math.prod(shape) > spec.metadata["high"] or math.prod(shape) * dtype.itemsize != len(content):
        raise Rejected("shape", spec.name)
    # Writable, as an array that never was on a wire: Numba compiles a kernel anew for one that is read-only.
    decoded = np.frombuffer(bytearray(content), dtype).reshape(shape)
    if not _finite(decoded):
        raise Rejected("range", spec.name)
    return decoded


def _finite(values: np.ndarray[Any, Any]) -> bool:
    if values.dtype.names:
        return all(_finite(values[name]) for name in values.dtype.names)
    return values.dtype.kind != "f" or bool(np.isfinite(values).all())


_DECODERS = {
    "int": _decode_int, "float": _decode_float, "bool": _decode_bool, "str": _decode_sized, "bytes": _decode_sized,
    "array": _decode_array,
}  # fmt: skip


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

    def add(self, key: str, piece: bytes) -> tuple[int, int, bytes] | None:
        """(frame, index, message) when this piece completes one; raises Rejected for a bad piece."""
        if not HEADER.size <= len(piece) <= FRAGMENT_MAX_BYTES:
            raise Rejected("size", str(len(piece)))
        frame, index, part, parts, crc = HEADER.unpack_from(piece)
        if part >= parts or parts * (FRAGMENT_MAX_BYTES - HEADER.size) > MESSAGE_MAX_BYTES + FRAGMENT_MAX_BYTES:
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
