"""The wire: what was encoded comes back, and nothing else comes through."""

import dataclasses
import tracemalloc
from contextlib import suppress

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from orograph.comms import wire
from orograph.messages import FRAGMENT_MAX_BYTES, KINDS, UPDATE, Batch, Drive, Scan


def _values(field: dataclasses.Field) -> st.SearchStrategy:
    m = field.metadata
    match m["kind"]:
        case "int":
            return st.integers(m["low"], m["high"])
        case "float":
            return st.floats(m["low"], m["high"], allow_nan=False)
        case "bool":
            return st.booleans()
        case "str":
            return st.text(max_size=m["high"])
        case "bytes":
            return st.binary(max_size=m["high"])
    return st.lists(st.integers(0, 5), min_size=len(m["shape"]), max_size=len(m["shape"])).flatmap(
        lambda free: _arrays(m["dtype"], tuple(n if w is None else w for n, w in zip(free, m["shape"], strict=True)))
    )


def _arrays(dtype: np.dtype, shape: tuple[int, ...]) -> st.SearchStrategy:
    size = int(np.prod(shape)) * dtype.itemsize
    if dtype.names and any(dtype[n].base.kind == "f" for n in dtype.names):
        return st.just(np.zeros(shape, dtype))
    return st.binary(min_size=size, max_size=size).map(lambda b: np.frombuffer(b, dtype).reshape(shape))


@st.composite
def messages(draw: st.DrawFn) -> object:
    cls = KINDS[draw(st.sampled_from(sorted(KINDS)))]
    return cls(**{f.name: draw(_values(f)) for f in dataclasses.fields(cls)})


def _same(a: object, b: object) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)]
    return all(np.array_equal(x, y) and getattr(x, "dtype", 0) == getattr(y, "dtype", 0) for x, y in pairs)


@settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow])
@given(messages())
def test_a_message_comes_back(message: object) -> None:
    assert _same(wire.decode(type(message).__name__, wire.encode(message)), message)


@settings(max_examples=500)
@given(messages(), st.integers(0, 10_000), st.integers(0, 255), st.booleans())
def test_a_damaged_message_is_rejected_or_still_within_its_bounds(
    message: object, at: int, value: int, cut: bool
) -> None:
    payload = bytearray(wire.encode(message))
    payload[at % len(payload)] = value
    if cut:
        payload = payload[: at % len(payload)]
    kind = type(message).__name__
    try:
        decoded = wire.decode(kind, bytes(payload))
    except wire.Rejected:
        return
    wire.encode(decoded)


@settings(max_examples=500)
@given(st.sampled_from([*sorted(KINDS), "Nonsense"]), st.binary(max_size=400))
def test_noise_is_rejected(kind: str, noise: bytes) -> None:
    with pytest.raises(wire.Rejected):
        wire.decode(kind, noise)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"v_mps": float("nan")}, "range"),
        ({"v_mps": 21.0}, "range"),
        ({"v_mps": 1}, "type"),
        ({"stamp_ns": True}, "type"),
        ({"stamp_ns": -1}, "range"),
        ({"extra": 1}, "keys"),
    ],
)
def test_each_bound_is_named(change: dict[str, object], reason: str) -> None:
    body = {"stamp_ns": 1, "v_mps": 1.0, "yaw_rate_radps": 0.0, **change}
    with pytest.raises(wire.Rejected) as caught:
        wire.decode("Drive", msgpack.packb([1, body]))
    assert caught.value.reason == reason


def test_another_schema_version_is_rejected() -> None:
    with pytest.raises(wire.Rejected, match="schema"):
        wire.decode("Drive", msgpack.packb([2, {"stamp_ns": 1, "v_mps": 1.0, "yaw_rate_radps": 0.0}]))


def test_an_array_longer_than_its_bound_is_rejected() -> None:
    too_many = np.zeros(257, UPDATE)
    body = {"epoch": 1, "records": [[257], too_many.tobytes()]}
    with pytest.raises(wire.Rejected, match="shape"):
        wire.decode("Batch", msgpack.packb([1, body]))
    assert len(wire.decode("Batch", wire.encode(Batch(1, too_many[:256]))).records) == 256


def test_a_bomb_of_nested_arrays_costs_nothing() -> None:
    bomb = b"\xdd\x00\xff\xff\xff" + b"\x90" * 1_000_000
    tracemalloc.start()
    with pytest.raises(wire.Rejected, match="msgpack"):
        wire.decode("Batch", bomb)
    assert tracemalloc.get_traced_memory()[1] < 5_000_000
    tracemalloc.stop()


@given(st.permutations(range(4)), st.integers(0, 2**32 - 1), st.integers(0, 2**32 - 1))
def test_fragments_join_in_any_order(order: list[int], frame: int, index: int) -> None:
    payload = wire.encode(Scan(1, np.arange(50_000, dtype="<u2").reshape(100, 500)))
    pieces = list(wire.fragments(frame, index, payload))
    assert len(pieces) == 4
    assert all(len(p) <= FRAGMENT_MAX_BYTES for p in pieces)
    joiner = wire.Joiner()
    results = [joiner.add("k", pieces[i]) for i in order]
    assert results[:-1] == [None] * 3
    assert results[-1] == (frame, index, payload)


@given(st.lists(st.integers(0, 3), min_size=1, max_size=20), st.integers(1, 4))
def test_a_message_joins_once_however_often_its_fragments_come(order: list[int], parts: int) -> None:
    room = FRAGMENT_MAX_BYTES - wire.HEADER.size
    pieces = list(wire.fragments(1, 0, bytes(parts * room)))
    joiner, results = wire.Joiner(), []
    for i in order:
        with suppress(wire.Rejected):
            results.append(joiner.add("k", pieces[i % parts]))
    wholes = [whole for whole in results if whole is not None]
    assert len(wholes) == (len({i % parts for i in order}) == parts)


def test_what_comes_twice_is_known_among_the_newest_alone() -> None:
    joiner = wire.Joiner(known=8)
    pieces = [next(wire.fragments(1, index, b"x")) for index in range(10)]
    for piece in pieces:
        joiner.add("k", piece)
    for piece in pieces[2:]:
        with pytest.raises(wire.Rejected, match="doubled"):
            joiner.add("k", piece)
    assert joiner.add("k", pieces[0]) is not None


def test_a_damaged_message_may_come_again_whole() -> None:
    (piece,) = wire.fragments(3, 0, wire.encode(Drive(1, 1.0, 0.0)))
    joiner = wire.Joiner()
    with pytest.raises(wire.Rejected, match="crc"):
        joiner.add("k", piece[:-1] + bytes([piece[-1] ^ 1]))
    assert joiner.add("k", piece) is not None


def test_a_flipped_bit_in_a_fragment_is_found() -> None:
    (piece,) = wire.fragments(3, 0, wire.encode(Drive(1, 1.0, 0.0)))
    damaged = piece[:-1] + bytes([piece[-1] ^ 1])
    with pytest.raises(wire.Rejected, match="crc"):
        wire.Joiner().add("k", damaged)


def test_unfinished_messages_are_bounded() -> None:
    joiner = wire.Joiner(bound=8)
    payload = bytes(FRAGMENT_MAX_BYTES)
    for index in range(100):
        first, _ = wire.fragments(1, index, payload)
        assert joiner.add("k", first) is None
    assert joiner.forgotten == 92
