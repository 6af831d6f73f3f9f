"""Matching of both views within a limit of memory: in one piece, in strips, or coarse to fine.

A cost volume grows with the pixels and with the disparities. Strips of rows hold a part of it at a time; they
cost up to half of the work again and change nothing. For large images with many disparities, a first match of a
few rows tells which disparities occur where, and all the others are left out: these bands are short nearly
everywhere. What is thin and upright (a pole, a twig) is seen in such rows as well as in the whole image, while it
vanishes in an image of half the size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.config import CensusConfig, SemiGlobalConfig, TwoWayConfig
from stereohdr.disparity.semiglobal import Bands, Strip, matcher_bytes, strip_bytes
from stereohdr.disparity.two_way import CodedView, CodeRows, ViewMatch, code_both, match_strips
from stereohdr.vectors import LANES

MOST_CELLS = 6_000_000_000
"""Pixels times disparities from which on only those of bands are tried: all would take too long."""

LARGEST_STRIP = 2**29
"""Bytes that a strip takes at most: the system takes longer to find more memory than the strips take to match."""

BLOCK = 32
"""Side of the blocks that share a band, pixels; strips begin at blocks."""

SAMPLED_ROW = 8
"""One of so many rows is matched over all disparities to find the bands."""

SLACK = 16
"""By so much a band goes beyond the disparities found in a block and those around it, at either end, pixels."""

CODED_ROWS = 256
"""Rows that are coded at a time where only some of them are kept."""

PIXEL_BYTES = 100
"""Memory per pixel of a strip beside `strip_bytes`: codes, guides and what is derived from the runs; measured."""

RESULT_BYTES = 22
"""Memory per pixel of the result: value, flag and confidence of both views, and a copy of one's values."""


@dataclass(frozen=True)
class MatchingPlan:
    """How to match within a limit of memory.

    Parameters
    ----------
    strips
        Number of strips; 1 for the image in one piece. Coarse to fine there may be fewer.
    coarse_to_fine
        Whether a first match of a few rows says which disparities to try.
    bytes
        Memory that it takes beside the luminance of both views; coarse to fine, at most.
    """

    strips: int
    coarse_to_fine: bool
    bytes: int


def plan_matching(
    shape: tuple[int, int], disparities: tuple[int, int], *, memory: int | None = None, runs: int = 2
) -> MatchingPlan:
    """Choose how to match, from sizes and limit alone.

    Parameters
    ----------
    shape
        Rows and columns of the views.
    disparities
        Smallest and largest disparity to try, pixels.
    memory
        Bytes that matching may take beside the luminance of both views; None for no limit.
    runs
        See `TwoWayConfig.runs`.

    Returns
    -------
    As few strips as fit, none larger than `LARGEST_STRIP`; if nothing fits, what takes the least. Coarse to fine,
    if there are more than `MOST_CELLS` pixels times disparities: the memory does not change the result.
    """
    height, width = shape
    available = math.inf if memory is None else memory
    coarse_to_fine = height * width * (disparities[1] - disparities[0] + 1) > MOST_CELLS
    plans = []
    for strips in range(1, -(-height // BLOCK) + 1):
        rows = _strip_height(height, strips)
        plans.append(MatchingPlan(strips, coarse_to_fine, _bytes(shape, disparities, rows, runs)))
        if plans[-1].bytes <= available and _strip_bytes(rows, width, disparities) <= LARGEST_STRIP:
            return plans[-1]
    return min(plans, key=lambda plan: plan.bytes)


def match_within(
    main: NDArray[np.float32],
    auxiliary: NDArray[np.float32],
    plan: MatchingPlan,
    *,
    disparities: tuple[int, int],
    census: CensusConfig | None = None,
    semiglobal: SemiGlobalConfig | None = None,
    config: TwoWayConfig | None = None,
    threads: int | None = None,
) -> tuple[ViewMatch, ViewMatch]:
    """Match both views like `match_two_ways`, as planned.

    Parameters
    ----------
    plan
        Of `plan_matching`.
    main, auxiliary, disparities, census, semiglobal, config, threads
        See `match_two_ways`.

    Returns
    -------
    main, auxiliary
        The match of each view. Strips do not change it. Coarse to fine, a pixel can only get a disparity of its
        block's band.
    """
    shape = main.shape
    match = partial(match_strips, disparities=disparities, semiglobal=semiglobal, config=config, threads=threads)
    code = partial(code_both, main, auxiliary, census=census, threads=threads)

    strips = _cut(shape[0], _strip_height(shape[0], plan.strips))
    if not plan.coarse_to_fine:
        return match(code, shape, strips)
    sampled = _sampled_rows(code, shape[0])
    rows = len(sampled[0].guide)
    # As high as the strips of the whole are, so that no more memory is taken.
    views = match(partial(_some_rows, sampled), (rows, shape[1]), _cut(rows, strips[0][1]))
    of_main, of_auxiliary = (view.disparity.values for view in views)
    bands = _bands_around(of_main, shape, disparities), _bands_around(of_auxiliary[:, ::-1], shape, disparities)
    return match(code, shape, _fewer_strips(shape, strips, bands, disparities), bands=bands)


def _strip_height(height: int, strips: int) -> int:
    """Return the rows of so many strips of about the same height, in whole blocks if there are several."""
    return height if strips == 1 else -(-height // (strips * BLOCK)) * BLOCK


def _cut(height: int, rows: int) -> list[Strip]:
    return [(first, min(first + rows, height)) for first in range(0, height, rows)]


def _bytes(shape: tuple[int, int], disparities: tuple[int, int], rows: int, runs: int) -> int:
    """Return the memory that strips of so many rows take, and the result."""
    height, width = shape
    strips = len(_cut(height, rows))
    kept = runs * matcher_bytes(width, disparities, strips)
    return RESULT_BYTES * height * width + kept + _strip_bytes(rows, width, disparities)


def _strip_bytes(rows: int, width: int, disparities: tuple[int, int], bands: Bands | None = None) -> int:
    return strip_bytes(rows, width, disparities, bands) + PIXEL_BYTES * rows * width


def _sampled_rows(code: CodeRows, height: int) -> tuple[CodedView, CodedView]:
    """Return one of `SAMPLED_ROW` rows of both views."""
    kept = []
    for first, stop in _cut(height, CODED_ROWS):
        rows = slice(min(SAMPLED_ROW // 2, stop - first - 1), None, SAMPLED_ROW)
        kept.append(
            [CodedView(view.planes[:, rows].copy(), view.guide[rows].copy()) for view in code(first, stop)]
        )
    of_main, of_auxiliary = (
        CodedView(np.concatenate([v.planes for v in view], axis=1), np.concatenate([v.guide for v in view]))
        for view in zip(*kept, strict=True)
    )
    return of_main, of_auxiliary


def _some_rows(views: tuple[CodedView, CodedView], first: int, stop: int) -> tuple[CodedView, CodedView]:
    of_main, of_auxiliary = (CodedView(view.planes[:, first:stop], view.guide[first:stop]) for view in views)
    return of_main, of_auxiliary


def _bands_around(sampled: NDArray[np.float32], shape: tuple[int, int], disparities: tuple[int, int]) -> Bands:
    """Return bands that hold what was found in each block and in those around it, and `SLACK`.

    Parameters
    ----------
    sampled
        ``(sampled rows, W)``, disparities.
    shape, disparities
        See `plan_matching`.
    """
    rows, columns = (-(-size // BLOCK) for size in shape)
    per_block = BLOCK // SAMPLED_ROW
    row = np.minimum(np.arange(rows * per_block), len(sampled) - 1)
    column = np.minimum(np.arange(columns * BLOCK), shape[1] - 1)
    blocks = sampled[row][:, column].reshape(rows, per_block, columns, BLOCK)
    lowest = ndimage.minimum_filter(blocks.min(axis=(1, 3)), 3, mode="nearest")
    highest = ndimage.maximum_filter(blocks.max(axis=(1, 3)), 3, mode="nearest")
    first = np.clip(np.floor(lowest).astype(np.int64) - SLACK, *disparities)
    last = np.clip(np.ceil(highest).astype(np.int64) + SLACK, *disparities)
    found = last - first + 1
    count = np.minimum(-(-found // LANES) * LANES, disparities[1] - disparities[0] + 1)  # no slower
    first = np.clip(first - (count - found) // 2, disparities[0], disparities[1] + 1 - count)
    return Bands(BLOCK, first, count)


def _fewer_strips(
    shape: tuple[int, int], strips: Sequence[Strip], bands: tuple[Bands, Bands], disparities: tuple[int, int]
) -> list[Strip]:
    """Return strips that take as much memory in bands as the given ones of all disparities."""
    height, width = shape
    available = _strip_bytes(strips[0][1], width, disparities)

    def fits(first: int, stop: int) -> bool:
        rows = slice(first // BLOCK, -(-stop // BLOCK))
        parts = (Bands(BLOCK, view.lowest[rows], view.count[rows]) for view in bands)
        return max(_strip_bytes(stop - first, width, disparities, part) for part in parts) <= available

    fewer, first, previous = [], 0, 0
    for stop in [*range(BLOCK, height, BLOCK), height]:
        if previous > first and not fits(first, stop):
            fewer.append((first, previous))
            first = previous
        previous = stop
    return [*fewer, (first, height)]
