"""Parts of an array: together all of it, each number once, in order, and none too large."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pmjoint_codegen.sweep import blocks


@given(
    shape=st.lists(st.integers(1, 7), min_size=1, max_size=4).map(tuple),
    size=st.integers(1, 40),
)
def test_parts_are_ranges_of_the_numbers_that_follow_one_another(shape: tuple[int, ...], size: int) -> None:
    numbers = np.arange(math.prod(shape)).reshape(shape)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blocks, "BLOCK", size)
        pieces = list(blocks.blocks(shape))
        largest = blocks.block_shape(shape)
    assert [piece.start for piece in pieces[1:]] == [piece.stop for piece in pieces[:-1]]
    assert (pieces[0].start, pieces[-1].stop) == (0, numbers.size)
    for piece in pieces:
        block = numbers[piece.selection]
        assert np.array_equal(block.ravel(), np.arange(piece.start, piece.stop))
        assert block.shape == piece.shape
        assert block.size <= size
        assert all(length <= most for length, most in zip(piece.shape, largest, strict=True))


def test_parts_are_as_large_as_they_may_be_and_whole_where_all_fits() -> None:
    assert blocks.block_shape((3000, 1000)) == (blocks.BLOCK // 1000, 1000)
    assert blocks.block_shape((3, blocks.BLOCK)) == (1, blocks.BLOCK)
    assert blocks.block_shape((2, 3, 2 * blocks.BLOCK)) == (1, 1, blocks.BLOCK)
    assert len(list(blocks.blocks((100, 100)))) == 1
