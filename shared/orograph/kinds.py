"""Kinds of values that a message may carry: what each may be, its plain form on the wire, the bytes it takes there."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np

HEAD_BYTES: Final = 9
"""The most that msgpack puts before a value or takes for a number."""


class Rejected(ValueError):  # noqa: N818 - the word the protocol uses
    """A value or payload that must not be believed; `reason` is a short word to count by."""

    def __init__(self, reason: str, detail: str = "") -> None:
        super().__init__(f"{reason}: {detail}" if detail else reason)
        self.reason, self.detail = reason, detail


class Kind(Protocol):
    """What one field may hold."""

    @property
    def unit(self) -> str:
        """Unit or meaning, for people."""

    @property
    def bytes_max(self) -> int:
        """The most that a value takes on the wire."""

    def check(self, value: Any) -> None:
        """Raise Rejected with the reason `type`, `range` or `shape` for what the field may not hold."""

    def pack(self, value: Any) -> Any:
        """The plain form of a checked value."""

    def unpack(self, plain: Any) -> Any:
        """The value of a plain form, not checked yet; raises Rejected where there can be none."""

    def schema(self) -> dict[str, Any]:
        """Type and bounds as data, for the reference."""


def require(holds: bool | np.bool_, reason: str, value: Any) -> None:
    """Raise Rejected with that reason, showing the value, unless it holds."""
    if not holds:
        raise Rejected(reason, repr(value)[:60])


class Simple:
    """What msgpack carries as it is."""

    def pack(self, value: Any) -> Any:
        """As it is."""
        return value

    def unpack(self, plain: Any) -> Any:
        """As it is."""
        return plain


@dataclass(frozen=True)
class Whole(Simple):
    """A whole number within [low, high]."""

    low: int
    high: int
    unit: str = ""
    bytes_max: int = HEAD_BYTES

    def check(self, value: Any) -> None:
        """Booleans are no numbers."""
        require(isinstance(value, (int, np.integer)) and not isinstance(value, bool), "type", value)
        require(self.low <= value <= self.high, "range", value)

    def pack(self, value: Any) -> int:
        """A Python int."""
        return int(value)

    def schema(self) -> dict[str, Any]:
        """Bounds, both included."""
        return {"type": "int", "min": self.low, "max": self.high}


@dataclass(frozen=True)
class Number(Simple):
    """A finite number within [low, high]; some languages write 1.0 as 1, so a whole number is one too."""

    low: float
    high: float
    unit: str = ""
    bytes_max: int = HEAD_BYTES

    def check(self, value: Any) -> None:
        """NaN is within no bounds."""
        known = isinstance(value, (float, int, np.floating, np.integer)) and not isinstance(value, bool)
        require(known, "type", value)
        require(self.low <= value <= self.high and math.isfinite(value), "range", value)

    def pack(self, value: Any) -> float:
        """A Python float."""
        return float(value)

    def unpack(self, plain: Any) -> Any:
        """A whole number of a size that a float can hold becomes a float."""
        return float(plain) if type(plain) is int and abs(plain) < 2**63 else plain

    def schema(self) -> dict[str, Any]:
        """Bounds, both included."""
        return {"type": "float", "min": self.low, "max": self.high}


@dataclass(frozen=True)
class Flag(Simple):
    """True or false."""

    unit: str = ""
    bytes_max: int = 1

    def check(self, value: Any) -> None:
        """Nothing else will do, 0 and 1 included."""
        require(isinstance(value, (bool, np.bool_)), "type", value)

    def pack(self, value: Any) -> bool:
        """A Python bool."""
        return bool(value)

    def schema(self) -> dict[str, Any]:
        """No bounds."""
        return {"type": "bool"}


@dataclass(frozen=True)
class Text(Simple):
    """Printable text of at most `high` characters; all of it matches `pattern` if there is one."""

    high: int
    unit: str = ""
    pattern: str = ""

    @property
    def bytes_max(self) -> int:
        """UTF-8 takes four bytes for a character at most."""
        return HEAD_BYTES + 4 * self.high

    @cached_property
    def _matches(self) -> Callable[[str], object]:
        # What cannot be printed can hide something in a log, and half a surrogate cannot be written at all.
        return re.compile(self.pattern).fullmatch if self.pattern else str.isprintable

    def check(self, value: Any) -> None:
        """All of it matches; without a pattern it can be printed."""
        require(type(value) is str, "type", value)
        require(len(value) <= self.high and bool(self._matches(value)), "range", value)

    def schema(self) -> dict[str, Any]:
        """The greatest length in characters, and the pattern where there is one."""
        return {"type": "str", "max": self.high, **({"pattern": self.pattern} if self.pattern else {})}


@dataclass(frozen=True)
class Choice(Simple):
    """One of a few words."""

    words: tuple[str, ...]
    unit: str = ""

    @property
    def bytes_max(self) -> int:
        """The longest word's."""
        return HEAD_BYTES + max(map(len, self.words))

    def check(self, value: Any) -> None:
        """No other word is known."""
        require(type(value) is str, "type", value)
        require(value in self.words, "range", value)

    def schema(self) -> dict[str, Any]:
        """The words."""
        return {"type": "str", "one_of": list(self.words)}


@dataclass(frozen=True)
class Raw(Simple):
    """Bytes, from `low` to `high` of them."""

    low: int
    high: int
    unit: str = ""

    @property
    def bytes_max(self) -> int:
        """They travel as they are."""
        return HEAD_BYTES + self.high

    def check(self, value: Any) -> None:
        """Bytes and nothing that merely holds some."""
        require(type(value) is bytes, "type", value)
        require(self.low <= len(value) <= self.high, "range", len(value))

    def schema(self) -> dict[str, Any]:
        """Length in bytes, both bounds included."""
        return {"type": "bytes", "min": self.low, "max": self.high}


@dataclass(frozen=True)
class AtMost:
    """The length of an array along one axis: any up to this."""

    items: int


@dataclass(frozen=True)
class Array:
    """A little-endian array, rows first; along each axis as many items as said, or up to as many; floats are finite."""

    dtype: np.dtype[Any]
    axes: tuple[int | AtMost, ...]
    unit: str = ""

    @property
    def items_max(self) -> int:
        """The greatest number of items."""
        return math.prod(axis.items if isinstance(axis, AtMost) else axis for axis in self.axes)

    @property
    def bytes_max(self) -> int:
        """Shape and content."""
        return HEAD_BYTES * (3 + len(self.axes)) + self.items_max * self.dtype.itemsize

    def check(self, value: Any) -> None:
        """A type of the same width is another type."""
        require(isinstance(value, np.ndarray) and value.dtype == self.dtype, "type", getattr(value, "dtype", value))
        require(self._fits(value.shape), "shape", value.shape)
        require(_finite(value), "range", "not finite")

    def _fits(self, shape: tuple[int, ...]) -> bool:
        return len(shape) == len(self.axes) and all(
            n <= axis.items if isinstance(axis, AtMost) else n == axis for n, axis in zip(shape, self.axes, strict=True)
        )

    def pack(self, value: Any) -> list[Any]:
        """[shape, content]."""
        return [list(value.shape), value.tobytes()]

    def unpack(self, plain: Any) -> np.ndarray[Any, Any]:
        """Nothing is allocated beyond what came; writable, as Numba compiles a kernel anew for what is read-only."""
        require(type(plain) is list and len(plain) == 2, "type", type(plain))
        shape, content = plain
        require(type(shape) is list and type(content) is bytes, "type", type(content))
        require(all(type(n) is int and n >= 0 for n in shape) and self._fits(tuple(shape)), "shape", shape)
        require(math.prod(shape) * self.dtype.itemsize == len(content), "shape", len(content))
        return np.frombuffer(bytearray(content), self.dtype).reshape(shape)

    def schema(self) -> dict[str, Any]:
        """NumPy's name of the type, or name, type and shape of each of a record's fields; the axes."""
        axes = [{"max": axis.items} if isinstance(axis, AtMost) else axis for axis in self.axes]
        return {"type": "array", "dtype": _layout(self.dtype), "item_bytes": self.dtype.itemsize, "axes": axes}


@dataclass(frozen=True)
class Each:
    """A list of at most `high` values of one kind; a tuple in the program."""

    of: Kind
    high: int
    unit: str = ""

    @property
    def bytes_max(self) -> int:
        """Of all of them."""
        return HEAD_BYTES + self.high * self.of.bytes_max

    def check(self, value: Any) -> None:
        """Their number, and each."""
        require(type(value) in (tuple, list), "type", type(value))
        require(len(value) <= self.high, "range", len(value))
        for item in value:
            self.of.check(item)

    def pack(self, value: Any) -> list[Any]:
        """A list."""
        return [self.of.pack(item) for item in value]

    def unpack(self, plain: Any) -> Any:
        """A tuple."""
        require(type(plain) is list, "type", type(plain))
        return tuple(self.of.unpack(item) for item in plain[: self.high + 1])

    def schema(self) -> dict[str, Any]:
        """The greatest number, and what each may be."""
        return {"type": "list", "max": self.high, "of": self.of.schema()}


@dataclass(frozen=True)
class Table:
    """At most `high` values of one kind by name."""

    key: Text
    of: Kind
    high: int
    unit: str = ""

    @property
    def bytes_max(self) -> int:
        """Of all names and values."""
        return HEAD_BYTES + self.high * (self.key.bytes_max + self.of.bytes_max)

    def check(self, value: Any) -> None:
        """Their number, and each name and value."""
        require(type(value) is dict, "type", type(value))
        require(len(value) <= self.high, "range", len(value))
        for name, item in value.items():
            self.key.check(name)
            self.of.check(item)

    def pack(self, value: Any) -> dict[str, Any]:
        """A map."""
        return {name: self.of.pack(item) for name, item in value.items()}

    def unpack(self, plain: Any) -> Any:
        """A dict."""
        require(type(plain) is dict and len(plain) <= self.high, "type", type(plain))
        return {name: self.of.unpack(item) for name, item in plain.items()}

    def schema(self) -> dict[str, Any]:
        """The greatest number, and what names and values may be."""
        return {"type": "map", "max": self.high, "keys": self.key.schema(), "of": self.of.schema()}


@dataclass(frozen=True)
class Maybe:
    """A value, or None where there is none."""

    of: Kind
    unit: str = ""

    @property
    def bytes_max(self) -> int:
        """The value's."""
        return self.of.bytes_max

    def check(self, value: Any) -> None:
        """The value's."""
        if value is not None:
            self.of.check(value)

    def pack(self, value: Any) -> Any:
        """The value's, or None."""
        return None if value is None else self.of.pack(value)

    def unpack(self, plain: Any) -> Any:
        """The value's, or None."""
        return None if plain is None else self.of.unpack(plain)

    def schema(self) -> dict[str, Any]:
        """The value's, marked."""
        return {**self.of.schema(), "or_none": True}


def _layout(dtype: np.dtype[Any]) -> Any:
    if dtype.names is None:
        return dtype.str
    return [[name, dtype[name].base.str, list(dtype[name].shape)] for name in dtype.names]


def _finite(values: np.ndarray[Any, Any]) -> bool:
    if values.dtype.names:
        return all(_finite(values[name]) for name in values.dtype.names)
    return values.dtype.kind != "f" or bool(np.isfinite(values).all())
