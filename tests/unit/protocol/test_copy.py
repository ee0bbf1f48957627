"""The GLRM copy: versions, gaps, parts, digests, repairs; and how a map is cut and hashed."""

from __future__ import annotations

import hashlib

import numpy as np
import pytest
from made_up.cells import flat_prior
from orograph.grid import Grid
from orograph.messages import CELL, Delta, Digest
from orograph.protocol.copy import GlrmCopy
from orograph.protocol.tiles import TileHashes, Tiles, map_hash

SHAPE = (45, 25)
SIZE = 45 * 25


@pytest.fixture
def copy():
    return GlrmCopy(SHAPE, flat_prior(SIZE))


def cells(numbers, version, height) -> np.ndarray:
    out = np.zeros(len(numbers), CELL)
    out["cell"], out["version"], out["height"], out["confidence"] = numbers, version, height, 99
    return out


def beat(first, last, values, part=0, parts=1, epoch=1):
    return Delta(epoch, first, last, part, parts, False, values)


def repair(first, last, values, part=0, parts=1, epoch=1):
    return Delta(epoch, first, last, part, parts, True, values)


def digest_of(copy, version, epoch=1):
    return Digest(epoch, version, TileHashes(Tiles(SHAPE), copy.cells).current().copy())


def test_tiles_of_a_map_that_does_not_divide():
    tiles = Tiles(SHAPE)
    assert tiles.count == 6
    assert [len(tiles.cells(tile)) for tile in range(6)] == [400, 100, 400, 100, 100, 25]
    assert tiles.of(np.array([0, 19, 20, 25 * 20, SIZE - 1])).tolist() == [0, 1, 2, 5]
    assert sorted(np.concatenate([tiles.cells(tile) for tile in range(6)])) == list(range(SIZE))


def test_hash_is_blake2b_of_the_canonical_arrays(copy):
    copy.take_delta(beat(0, 1, cells([3], 1, -5)))
    expected = hashlib.blake2b(digest_size=16)
    for name, dtype in (("height", "<i4"), ("gradient_x", "<i2"), ("gradient_y", "<i2"), ("occupation", "u1"),
                        ("confidence", "u1")):  # fmt: skip
        expected.update(b"".join(np.array(value, dtype).tobytes() for value in copy.cells[name].tolist()))
    assert copy.hash() == expected.digest() == map_hash(copy.cells)


def test_beats_in_order_raise_the_version(copy):
    copy.take_delta(beat(0, 1, cells([3], 1, 5)))
    copy.take_delta(beat(1, 4, cells([3, 7], 4, 6)))
    assert copy.version == 4 and copy.cells["height"][[3, 7]].tolist() == [6, 6] and copy.wanted is None


def test_gap_does_not_raise_the_version_and_asks_since(copy):
    copy.take_delta(beat(0, 1, cells([3], 1, 5)))
    copy.take_delta(beat(2, 3, cells([4], 3, 6)))
    assert copy.version == 1 and copy.wanted.since_version == 1 and not len(copy.wanted.tiles)
    copy.take_delta(repair(1, 3, cells([3, 4], 3, 6)))
    assert copy.version == 3 and copy.wanted is None


def test_version_waits_for_all_parts_in_any_order(copy):
    for part in (2, 0, 0, 2):
        copy.take_delta(beat(0, 2, cells([part], 2, 5), part, 3))
        assert copy.version == 0
    copy.take_delta(beat(0, 2, cells([1], 2, 5), 1, 3))
    assert copy.version == 2


def test_late_beat_and_late_repair_do_not_overwrite(copy):
    copy.take_delta(beat(0, 1, cells([3], 1, 5)))
    copy.take_delta(beat(1, 2, cells([3], 2, 6)))
    copy.take_delta(beat(0, 1, cells([3], 1, 5)))
    copy.take_delta(repair(0, 1, cells([3], 1, 5)))
    assert copy.cells["height"][3] == 6 and copy.version == 2


def test_whole_tiles_do_not_raise_the_version_by_themselves(copy):
    copy.take_delta(beat(0, 1, cells([3], 1, 5)))
    copy.take_delta(repair(9, 9, cells([4], 9, 5)))
    assert copy.version == 1 and copy.cells["height"][4] == 5


def test_digest_that_agrees_raises_the_version(copy):
    copy.take_digest(digest_of(copy, 7))
    assert copy.version == 7 and copy.wanted is None


def test_digest_of_the_past_is_ignored(copy):
    copy.take_delta(beat(0, 5, cells([3], 5, 5)))
    copy.take_digest(Digest(1, 4, np.zeros((6, 16), np.uint8)))
    assert copy.version == 5 and copy.wanted is None


def test_tiles_that_differ_are_wanted_and_repair_them(copy):
    manager = GlrmCopy(SHAPE, flat_prior(SIZE))
    manager.take_delta(beat(0, 1, cells([20, 21], 1, 5)))
    copy.take_delta(beat(0, 1, cells([], 1, 5)))
    copy.take_digest(digest_of(manager, 1))
    assert copy.wanted.tiles.tolist() == [1]
    tile = manager.cells[Tiles(SHAPE).cells(1)]
    copy.take_delta(repair(1, 1, tile[:50], 0, 2))
    assert copy.wanted.tiles.tolist() == [1]
    copy.take_delta(repair(1, 1, tile[50:], 1, 2))
    assert copy.wanted is None and copy.hash() == manager.hash()


def answered_by(copy, epoch):
    """The copy asks a life of the manager that it heard of, and that life answers."""
    copy.asked()
    copy.take_delta(repair(copy.wanted.since_version, 6, cells([], 6, 0), epoch=epoch))


@pytest.mark.parametrize("epoch", [2, 9], ids=["lower", "higher"])
def test_another_life_is_followed_once_it_answers_and_confirmed_by_a_digest(copy, epoch):
    copy.take_delta(beat(0, 5, cells([3], 5, 5), epoch=5))
    copy.take_digest(digest_of(copy, 6, epoch))
    assert (copy.manager_epoch, copy.version, copy.wanted.manager_epoch) == (5, 5, epoch)
    answered_by(copy, epoch)
    assert (copy.manager_epoch, copy.version) == (epoch, 0) and copy.counts["strangers"] == 1
    copy.take_digest(digest_of(copy, 6, epoch))
    assert copy.version == 6 and copy.wanted is None


def test_another_life_is_asked_for_the_tiles_that_differ(copy):
    manager = GlrmCopy(SHAPE, flat_prior(SIZE))
    for each in (copy, manager):
        each.take_delta(beat(0, 5, cells([3], 5, 5)))
    manager.take_delta(beat(5, 6, cells([24], 6, 8)))
    copy.take_digest(digest_of(manager, 6, epoch=2))
    answered_by(copy, 2)
    copy.take_digest(digest_of(manager, 6, epoch=2))
    assert copy.wanted.tiles.tolist() == [1]
    copy.take_delta(repair(6, 6, manager.cells[Tiles(SHAPE).cells(1)], epoch=2))
    assert copy.version == 6 and copy.hash() == manager.hash()


def test_an_empty_map_of_another_life_replaces_what_an_earlier_one_knew(copy):
    empty = GlrmCopy(SHAPE, flat_prior(SIZE))
    copy.take_delta(beat(0, 500, cells([3, 24], 500, 5), epoch=7))
    copy.take_digest(digest_of(empty, 0, epoch=2))
    answered_by(copy, 2)
    copy.take_delta(beat(0, 1, cells([30], 1, 5), epoch=2))
    assert copy.version == 0, "a beat from the beginning says nothing of what the copy holds otherwise"
    empty.take_delta(beat(0, 1, cells([30], 1, 5)))
    copy.take_digest(digest_of(empty, 1, epoch=2))
    for tile in copy.wanted.tiles.tolist():
        copy.take_delta(repair(1, 1, empty.cells[Tiles(SHAPE).cells(tile)], epoch=2))
    assert copy.version == 1 and copy.hash() == empty.hash()


LIES = [
    Digest(2**32 - 1, 2**32 - 1, np.zeros((6, 16), np.uint8)),
    beat(0, 2**32 - 1, cells([3], 2**32 - 1, 666), epoch=2**32 - 1),
    repair(0, 2**32 - 1, cells([3], 2**32 - 1, 666), epoch=2**32 - 1),
]


@pytest.mark.parametrize("lie", LIES, ids=["digest", "beat", "repair"])
def test_one_word_of_another_life_is_counted_and_changes_nothing(copy, lie):
    copy.take_delta(beat(0, 1, cells([3], 1, 5)))
    before = copy.hash()
    (copy.take_digest if isinstance(lie, Digest) else copy.take_delta)(lie)
    assert copy.counts["strangers"] == 1 and copy.hash() == before
    copy.take_delta(beat(1, 2, cells([4], 2, 5)))
    assert (copy.manager_epoch, copy.version) == (1, 2) and copy.wanted is None


def test_answer_to_another_question_is_none(copy):
    copy.take_delta(beat(0, 1, cells([3], 1, 5)))
    copy.take_digest(digest_of(copy, 0, epoch=2))
    copy.asked()
    copy.take_delta(repair(0, 0, cells([], 0, 0), epoch=2))
    assert copy.manager_epoch == 1


TRAPS = [
    beat(0, 2**32 - 1, cells([3], 2**32 - 1, 666)),
    beat(7, 2**32 - 1, cells([3], 2**32 - 1, 666)),
    repair(1, 1, cells([3], 2**32 - 1, 666)),
    repair(0, 2**32 - 1, cells([3], 1, 666)),
]


@pytest.mark.parametrize("trap", TRAPS, ids=["version", "gap", "cell", "answer"])
def test_a_lie_about_versions_holds_for_some_digests_only(copy, trap):
    """Forged in the name of the life that is followed: what comes after must be believed again, soon."""
    manager = GlrmCopy(SHAPE, flat_prior(SIZE))
    for each in (copy, manager):
        each.take_delta(beat(0, 1, cells([3], 1, 5)))
    copy.take_delta(trap)
    for _ in range(12):
        copy.take_digest(digest_of(manager, 1))
        if copy.wanted:
            copy.asked()
            tiles = copy.wanted.tiles.tolist()
            for part, tile in enumerate(tiles):
                copy.take_delta(repair(1, 1, manager.cells[Tiles(SHAPE).cells(tile)], part, len(tiles)))
    assert copy.hash() == manager.hash() and copy.version == 1 and copy.counts["misled"] <= 1


@pytest.mark.parametrize(
    "bad", [beat(0, 1, cells([SIZE], 1, 5)), beat(0, 1, cells([1], 1, 5), part=1, parts=1)], ids=["cell", "part"]
)
def test_delta_out_of_range_is_counted_and_changes_nothing(copy, bad):
    before = copy.hash()
    copy.take_delta(bad)
    assert copy.counts["rejected"] == 1 and copy.hash() == before and copy.version == 0


def test_digest_of_another_grid_is_counted(copy):
    copy.take_digest(Digest(1, 3, np.zeros((7, 16), np.uint8)))
    assert copy.counts["rejected"] == 1 and copy.wanted is None


def test_unfinished_parts_are_bounded(copy):
    for last in range(1, 200):
        copy.take_delta(beat(0, last, cells([1], last, 5), 0, 2))
    assert len(copy._parts) <= 9


def test_cell_map_shows_the_values(copy):
    copy.take_delta(beat(0, 1, cells([26], 1, 1500)))
    shown = copy.cell_map(Grid((0.0, 0.0), 5.0, SHAPE))
    assert shown.height[1, 1] == np.float32(1.5) and shown.confidence[1, 1] == 99
