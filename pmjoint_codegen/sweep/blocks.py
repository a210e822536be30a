"""Contiguous blocks of an array, so that a dataset of any size is written and read in little memory."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

BLOCK: Final = 2**18  # numbers in one file of a dataset: 2 MiB


@dataclass(frozen=True)
class Block:
    """A part of an array that is one range of its numbers, row-major.

    Attributes:
        selection: the block, one slice per dimension.
        start: first of its numbers.
        stop: the one after its last.
    """

    selection: tuple[slice, ...]
    start: int
    stop: int

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the block."""
        return tuple(piece.stop - piece.start for piece in self.selection)


def block_shape(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Shape of the blocks of an array: cut along the first dimensions only, at most `BLOCK` numbers each."""
    sizes = list(shape)
    for i in range(len(sizes)):
        sizes[i] = max(1, min(sizes[i], BLOCK // math.prod(sizes[i + 1 :])))
    return tuple(sizes)


def blocks(shape: tuple[int, ...]) -> Iterator[Block]:
    """All blocks of an array, in the order of its numbers."""
    sizes = block_shape(shape)
    for corner in product(*(range(0, length, size) for length, size in zip(shape, sizes, strict=True))):
        ends = (min(i + size, length) for i, size, length in zip(corner, sizes, shape, strict=True))
        selection = tuple(slice(i, end) for i, end in zip(corner, ends, strict=True))
        start = int(np.ravel_multi_index(corner, shape))
        yield Block(selection, start, start + math.prod(piece.stop - piece.start for piece in selection))
