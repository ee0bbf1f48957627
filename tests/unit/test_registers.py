"""Registers: whole numbers by hand, and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from orograph.grid import Grid
from orograph.layers import KINDS, MAPPED, MAPPED_LAYERS, UNKNOWN_GRADIENT, UNKNOWN_OCCUPATION, CellMap
from orograph.messages import CELL, REGISTER, ROBOT_REGISTER, UPDATE
from orograph.registers import numbers, pack, unpack, values

NAN = np.nan


def packed(**known: float) -> tuple[int, ...]:
    row = [known.get(kind.name, kind.blank) for kind in MAPPED]
    return tuple(numbers(pack(np.array([3]), 7, np.array([row])))[0].tolist())


@pytest.mark.parametrize(("layer", "value", "whole"), [
    ("height", 1.0625, 1063), ("height", -1.0625, -1063), ("height", 3e6, 2**31 - 1), ("height", -3e6, 1 - 2**31),
    ("gradient_x", 5.0, 32767), ("gradient_y", -5.0, -32767), ("gradient_x", NAN, UNKNOWN_GRADIENT),
    ("occupation", 0.25, 64), ("occupation", 1.0, 254), ("occupation", NAN, UNKNOWN_OCCUPATION),
    ("confidence", 0.25, 1), ("confidence", 254.5, 255), ("confidence", 300.0, 255),
])  # fmt: skip
def test_whole_numbers_by_hand(layer, value, whole):
    """Halves away from zero, saturated, unknown; the least confidence is 1."""
    found = packed(**{"confidence": 9.0, layer: value})
    assert found[MAPPED_LAYERS.index(layer)] == whole


@given(st.tuples(*[st.integers(kind.lowest, kind.highest) for kind in MAPPED]), st.sets(st.sampled_from(MAPPED_LAYERS)))
def test_whole_numbers_come_back_whole(whole, unknown):
    row = [kind.unknown if kind.name in unknown and kind.unknown is not None else n
           for kind, n in zip(MAPPED, whole, strict=True)]  # fmt: skip
    record = np.zeros(1, UPDATE)
    record["confidence"] = 1
    for name, n in zip(MAPPED_LAYERS, row, strict=True):
        record[name] = n
    assert numbers(pack(record["cell"], 0, values(record)))[0].tolist() == row
    cells = unpack(record, Grid((0.0, 0.0), 1.0, (1, 1)))
    found = [cells.by_name[k.name][0, 0] if k.name in cells.by_name else k.blank for k in MAPPED]
    np.testing.assert_array_equal(np.array(found, np.float32), values(record)[0].astype(np.float32))


def test_every_record_carries_every_layer_of_the_table():
    for record in (UPDATE, REGISTER, ROBOT_REGISTER, CELL):
        assert tuple(record.names)[-len(MAPPED) :] == MAPPED_LAYERS
        assert [record[kind.name].str.lstrip("<|") for kind in MAPPED] == [kind.wire.lstrip("<") for kind in MAPPED]
    for kind in MAPPED:
        bounds = np.iinfo(kind.wire)
        assert bounds.min <= kind.lowest < kind.highest <= bounds.max
        assert kind.unknown is None or (bounds.min <= kind.unknown <= bounds.max
                                        and not kind.lowest <= kind.unknown <= kind.highest)  # fmt: skip


def test_a_map_has_its_layers_by_name_and_no_others():
    cells = CellMap.unknown(Grid((0.0, 0.0), 1.0, (2, 2)))
    assert cells.height is cells.by_name["height"]
    with pytest.raises(AttributeError, match="no layer hight"):
        _ = cells.hight
    with pytest.raises(AssertionError):
        CellMap(cells.grid, {"height": cells.height})
    with pytest.raises(AssertionError):
        CellMap(cells.grid, {**cells.by_name, "hight": cells.height})
    assert set(KINDS) >= set(cells.by_name)
