"""The wire: what was encoded comes back, and nothing else comes through."""

import dataclasses
import math
import tracemalloc
from contextlib import suppress

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from orograph import keys
from orograph.comms import wire
from orograph.control import CONTROLS
from orograph.fields import Part, bytes_max, kinds_of, pack, saturated
from orograph.kinds import Array, AtMost, Choice, Each, Flag, Kind, Maybe, Number, Raw, Rejected, Table, Text, Whole
from orograph.messages import (
    FRAGMENT_MAX_BYTES,
    KINDS,
    MESSAGE_MAX_BYTES,
    SCHEMA_VERSION,
    UPDATE,
    Batch,
    Drive,
    OccupancyGrid,
    Phase,
    Pose,
    Scan,
)

ALL_KINDS = {**KINDS, **CONTROLS}


def values_of(kind: Kind) -> st.SearchStrategy:
    """Values within a field's bounds."""
    match kind:
        case Whole():
            return st.integers(kind.low, kind.high)
        case Number():
            return st.floats(kind.low, kind.high, allow_nan=False)
        case Flag():
            return st.booleans()
        case Text(pattern=""):
            return st.text(st.characters(categories=("L", "N", "P", "S")), max_size=kind.high)
        case Text():
            return st.from_regex(kind.pattern, fullmatch=True).filter(lambda text: len(text) <= kind.high)
        case Choice():
            return st.sampled_from(kind.words)
        case Raw():
            return st.binary(min_size=kind.low, max_size=min(kind.high, kind.low + 300))
        case Array():
            axes = [st.integers(0, min(5, a.items)) if isinstance(a, AtMost) else st.just(a) for a in kind.axes]
            return st.tuples(*axes).flatmap(lambda shape: _arrays(kind.dtype, shape))
        case Each():
            return st.lists(values_of(kind.of), max_size=min(3, kind.high)).map(tuple)
        case Table():
            return st.dictionaries(values_of(kind.key), values_of(kind.of), max_size=min(3, kind.high))
        case Maybe():
            return st.none() | values_of(kind.of)
        case Part():
            return st.builds(kind.cls, **{name: values_of(of) for name, of in kinds_of(kind.cls).items()})
    raise AssertionError(kind)


def _arrays(dtype: np.dtype, shape: tuple[int, ...]) -> st.SearchStrategy:
    size = math.prod(shape) * dtype.itemsize
    if dtype.names and any(dtype[n].base.kind == "f" for n in dtype.names):
        return st.just(np.zeros(shape, dtype))
    return st.binary(min_size=size, max_size=size).map(lambda b: np.frombuffer(b, dtype).reshape(shape))


@st.composite
def messages(draw: st.DrawFn) -> object:
    cls = ALL_KINDS[draw(st.sampled_from(sorted(ALL_KINDS)))]
    return cls(**{name: draw(values_of(kind)) for name, kind in kinds_of(cls).items()})


def _same(a: object, b: object) -> bool:
    pairs = [(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a)]
    return all(
        np.array_equal(x, y) and x.dtype == y.dtype if isinstance(x, np.ndarray) else (x, type(x)) == (y, type(y))
        for x, y in pairs
    )


@settings(max_examples=300, suppress_health_check=[HealthCheck.too_slow])
@given(messages())
def test_a_message_comes_back(message: object) -> None:
    assert _same(wire.decode(type(message), wire.encode(message)), message)


@settings(max_examples=500)
@given(messages(), st.integers(0, 10_000), st.integers(0, 255), st.booleans())
def test_a_damaged_message_is_rejected_or_still_within_its_bounds(
    message: object, at: int, value: int, cut: bool
) -> None:
    payload = bytearray(wire.encode(message))
    payload[at % len(payload)] = value
    if cut:
        payload = payload[: at % len(payload)]
    try:
        decoded = wire.decode(type(message), bytes(payload))
    except Rejected:
        return
    wire.encode(decoded)


@settings(max_examples=500)
@given(st.sampled_from([*sorted(KINDS), "Nonsense"]), st.binary(max_size=400))
def test_noise_is_rejected(kind: str, noise: bytes) -> None:
    with pytest.raises(Rejected):
        wire.decode(wire.kind_of(kind), noise)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"v_mps": float("nan")}, "range"),
        ({"v_mps": 21.0}, "range"),
        ({"v_mps": "1"}, "type"),
        ({"v_mps": 2**64 - 1}, "range"),
        ({"v_mps": True}, "type"),
        ({"stamp_ns": True}, "type"),
        ({"stamp_ns": -1}, "range"),
        ({"extra": 1}, "keys"),
    ],
)
def test_each_bound_is_named(change: dict[str, object], reason: str) -> None:
    body = {"stamp_ns": 1, "v_mps": 1.0, "yaw_rate_radps": 0.0, **change}
    with pytest.raises(Rejected) as caught:
        wire.decode(Drive, msgpack.packb([SCHEMA_VERSION, body]))
    assert caught.value.reason == reason


def breaches(kind: Kind) -> list[object]:
    """Plain forms that break one bound of the field each."""
    match kind:
        case Whole() | Number():
            beyond = [kind.low - 1, kind.high + 1] if isinstance(kind, Whole) else [2 * kind.high + 1.0, math.inf]
            return [*beyond, math.nan, None, "1", True, [1]]
        case Flag():
            return [0, 1, None, "true"]
        case Text():
            return ["x" * (kind.high + 1), "a\nb", b"x", None]
        case Choice():
            return [*(word + "s" for word in kind.words), "", 1, None]
        case Raw():
            return [bytes(kind.high + 1), *([b""] if kind.low else []), "x", None]
        case Array():
            whole = [axis.items if isinstance(axis, AtMost) else axis for axis in kind.axes]
            longer = [whole[0] + 1, *[0] * (len(whole) - 1)]
            return [[[], b""], [longer, bytes(math.prod(longer) * kind.dtype.itemsize)], [[1] * 9, b""], "x", None,
                    [[0] * len(whole), b"x"], [[-1] * len(whole), b""]]  # fmt: skip
        case Each():
            return [[kind.of.pack(minimal(kind.of))] * (kind.high + 1), [[]], "x", {}, None]
        case Table():
            return [{}.fromkeys(map(str, range(kind.high + 1)), 1), {"": []}, [], "x", None]
        case Maybe():
            return breaches(kind.of)[:3]
        case Part():
            return [{}, [], "x"]
    raise AssertionError(kind)


FIELDS = [(cls, name) for cls in ALL_KINDS.values() for name in kinds_of(cls)]


@pytest.mark.parametrize(("cls", "name"), FIELDS, ids=lambda part: getattr(part, "__name__", part))
def test_every_bound_of_every_field_holds_at_both_ends(cls: type, name: str) -> None:
    whole = cls(**{field: minimal(kind) for field, kind in kinds_of(cls).items()})
    for plain in breaches(kinds_of(cls)[name]):
        if isinstance(plain, int) and abs(plain) >= 2**63:
            continue  # no number of msgpack's
        with pytest.raises(Rejected, match=name):
            wire.decode(cls, msgpack.packb([SCHEMA_VERSION, {**pack(whole), name: plain}]))
        if not isinstance(plain, list | dict):
            with pytest.raises(AssertionError, match=f"{cls.__name__}: .*{name}"):
                wire.encode(dataclasses.replace(whole, **{name: plain}))


def minimal(kind: Kind) -> object:
    """The least that a field may hold."""
    match kind:
        case Whole():
            return kind.low
        case Number():
            return float(kind.low)
        case Flag():
            return False
        case Text():
            return {"": "", keys.ROBOT_ID.pattern: "robot_001"}.get(kind.pattern, "laser")
        case Choice():
            return kind.words[0]
        case Raw():
            return bytes(kind.low)
        case Array():
            return np.zeros([0 if isinstance(axis, AtMost) else axis for axis in kind.axes], kind.dtype)
        case Each():
            return ()
        case Table():
            return {}
        case Maybe():
            return None
        case Part():
            return kind.cls(**{name: minimal(of) for name, of in kinds_of(kind.cls).items()})
    raise AssertionError(kind)


def utmost(kind: Kind) -> object:
    """The most that a field may hold, as large on the wire as can be."""
    match kind:
        case Whole():
            return kind.high
        case Number():
            return float(kind.high)
        case Text(pattern=""):
            return "\U0001f916" * kind.high
        case Choice():
            return max(kind.words, key=len)
        case Raw():
            return bytes(kind.high)
        case Array():
            return np.zeros([axis.items if isinstance(axis, AtMost) else axis for axis in kind.axes], kind.dtype)
    return minimal(kind)


@pytest.mark.parametrize("cls", KINDS.values(), ids=lambda cls: cls.__name__)
def test_a_message_at_all_its_bounds_fits_the_wire(cls: type) -> None:
    message = cls(**{name: utmost(kind) for name, kind in kinds_of(cls).items()})
    payload = wire.encode(message)
    assert len(payload) <= bytes_max(cls) <= MESSAGE_MAX_BYTES
    joiner = wire.Joiner()
    (whole,) = filter(None, (joiner.add("k", piece) for piece in wire.fragments(2**32 - 1, 7, payload)))
    assert _same(wire.decode(cls, whole[2]), message)


def test_what_a_program_gets_wrong_is_named() -> None:
    with pytest.raises(AssertionError, match="Drive: range: yaw_rate_radps: nan"):
        wire.encode(Drive(1, 1.0, math.nan))
    with pytest.raises(AssertionError, match="Drive: range: v_mps: 1000000000"):
        wire.encode(Drive(1, 1e9, 0.0))
    with pytest.raises(AssertionError, match="Phase: range: name: 'pause'"):
        wire.encode(Phase("pause"))


def test_a_whole_number_is_a_number_too() -> None:
    drive = wire.decode(Drive, msgpack.packb([SCHEMA_VERSION, {"stamp_ns": 1, "v_mps": 1, "yaw_rate_radps": 0}]))
    assert (drive.v_mps, type(drive.v_mps)) == (1.0, float)


def test_a_reading_beyond_its_scale_is_the_scales_end_and_no_number_stays_none() -> None:
    zeros = dict.fromkeys(kinds_of(Pose), 0.0) | {"stamp_ns": 5}
    pose = saturated(Pose, **zeros | {"x_m": 3e9, "z_m": -math.inf})
    assert (pose.stamp_ns, pose.x_m, pose.y_m, pose.z_m) == (5, 1e6, 0.0, -1e5)
    wire.encode(pose)
    with pytest.raises(AssertionError, match="roll_rad: nan"):
        wire.encode(saturated(Pose, **zeros | {"roll_rad": math.nan}))


def test_another_schema_version_is_rejected() -> None:
    with pytest.raises(Rejected, match="schema"):
        wire.decode(Drive, msgpack.packb([SCHEMA_VERSION + 1, {"stamp_ns": 1, "v_mps": 1.0, "yaw_rate_radps": 0.0}]))


def test_an_array_longer_than_its_bound_is_rejected() -> None:
    too_many = np.zeros(257, UPDATE)
    body = {"epoch": 1, "records": [[257], too_many.tobytes()]}
    with pytest.raises(Rejected, match="shape"):
        wire.decode(Batch, msgpack.packb([SCHEMA_VERSION, body]))
    assert len(wire.decode(Batch, wire.encode(Batch(1, too_many[:256]))).records) == 256


def test_a_bomb_of_nested_arrays_costs_nothing() -> None:
    bomb = b"\xdd\x00\xff\xff\xff" + b"\x90" * 1_000_000
    tracemalloc.start()
    with pytest.raises(Rejected, match="msgpack"):
        wire.decode(OccupancyGrid, bomb)
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
        with suppress(Rejected):
            results.append(joiner.add("k", pieces[i % parts]))
    wholes = [whole for whole in results if whole is not None]
    assert len(wholes) == (len({i % parts for i in order}) == parts)


def test_what_comes_twice_is_known_among_the_newest_alone() -> None:
    joiner = wire.Joiner(known=8)
    pieces = [next(wire.fragments(1, index, b"x")) for index in range(10)]
    for piece in pieces:
        joiner.add("k", piece)
    for piece in pieces[2:]:
        with pytest.raises(Rejected, match="doubled"):
            joiner.add("k", piece)
    assert joiner.add("k", pieces[0]) is not None


def test_a_damaged_message_may_come_again_whole() -> None:
    (piece,) = wire.fragments(3, 0, wire.encode(Drive(1, 1.0, 0.0)))
    joiner = wire.Joiner()
    with pytest.raises(Rejected, match="crc"):
        joiner.add("k", piece[:-1] + bytes([piece[-1] ^ 1]))
    assert joiner.add("k", piece) is not None


def test_a_flipped_bit_in_a_fragment_is_found() -> None:
    (piece,) = wire.fragments(3, 0, wire.encode(Drive(1, 1.0, 0.0)))
    damaged = piece[:-1] + bytes([piece[-1] ^ 1])
    with pytest.raises(Rejected, match="crc"):
        wire.Joiner().add("k", damaged)


def test_unfinished_messages_are_bounded() -> None:
    joiner = wire.Joiner(bound=8)
    payload = bytes(FRAGMENT_MAX_BYTES)
    for index in range(100):
        first, _ = wire.fragments(1, index, payload)
        assert joiner.add("k", first) is None
    assert joiner.forgotten == 92
