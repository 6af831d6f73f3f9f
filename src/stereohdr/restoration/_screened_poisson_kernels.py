"""Hot loops of the screened Poisson solver; readable twins in tests/reference/screened_poisson.py.

The system has one equation per free pixel i of a grid::

    (screen_i + sum_j coupling_ij) x_i - sum_j coupling_ij x_j = rhs_i

with the four neighbours j on the finest grid and all eight on the coarser ones. Coarser grids keep every other row
and column, and are made by Galerkin products with an interpolation that follows the couplings (Dendy's black box
multigrid), so that values are not carried over weak couplings.

Layout: the even columns of a row of pixels come first, then the odd ones, each with `LANES` zeros before them and
filled up to whole vectors; a row of zeros precedes and follows the grid. So every loop runs over consecutive
numbers, and the pixels of the next coarser grid are the even halves of the odd-numbered rows (rows count from 1).
Element ``(2 * y + half) * stride + LANES + k`` is row y, column ``2 * k + half``. All grids share a flat array per
quantity: `right`, `down`, `right_down` and `left_down` are the couplings to the neighbours in these directions;
`inverse` is 1 / (screen + sum of couplings), and 0 at pixels that are not free, which have no couplings, and whose
solution stays 0. Only blocks of `LANES` columns that hold free pixels are visited.
"""

from __future__ import annotations

from typing import Any, NamedTuple, cast

import numba
import numpy as np
from numpy.typing import NDArray

from stereohdr.float_vectors import (
    LANES,
    any_positive,
    even_lanes,
    first_zipped,
    larger,
    largest,
    last_zipped,
    load,
    odd_lanes,
    pointer,
    splat,
    store,
    total,
    where_positive,
)
from stereohdr.kernels import kernel

SCRATCH_ROWS = 8
"""Rows of scratch, each of the finest stride and three vectors more."""

# Constants for arguments. They have a type, as Numba compiles functions anew for plain numbers.
EVEN = np.int64(0)
ODD = np.int64(1)
FINEST = np.int64(0)
START = np.int64(0)
TOP = np.int64(1)
YES = np.bool_(True)
NO = np.bool_(False)

inner: Any = cast(Any, numba.njit)(nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True)
"""Compile a function that only kernels call."""


class Grids(NamedTuple):
    """All grids, finest first, float32 unless said."""

    table: NDArray[np.int64]
    """``(grids, 6)``: rows, columns of a half, stride, and where the grid begins in the flat arrays, in `first`
    and in `blocks`."""
    solution: NDArray[np.float32]
    rhs: NDArray[np.float32]
    inverse: NDArray[np.float32]
    screen: NDArray[np.float32]
    right: NDArray[np.float32]
    down: NDArray[np.float32]
    edge: NDArray[np.float32]
    """At pixels between two of the coarser grid: 1 / (what the weights of these two are divided by)."""
    right_down: NDArray[np.float32]
    """Without the finest grid, which has no slanted couplings."""
    left_down: NDArray[np.float32]
    lower: NDArray[np.float32]
    """Bounds of the solution; empty if there are none."""
    correction: NDArray[np.float32]
    """What the cycles that heed the bounds found, on the finest grid; empty if there are none."""
    step: NDArray[np.float32]
    """What conjugate gradients found, on the finest grid."""
    direction: NDArray[np.float32]
    """Direction of conjugate gradients, on the finest grid."""
    scratch: NDArray[np.float32]
    first: NDArray[np.int32]
    """Per row y the number of its first block; those of row y end where those of y + 1 begin."""
    blocks: NDArray[np.int32]
    """The first k of each block."""


class Level(NamedTuple):
    """One grid: addresses of its quantities, see `Grids`."""

    solution: Any
    rhs: Any
    inverse: Any
    screen: Any
    right: Any
    down: Any
    edge: Any
    right_down: Any
    left_down: Any
    lower: Any
    scratch: Any
    first: Any
    blocks: Any
    rows: int
    columns: int
    stride: int
    slanted: bool
    """Whether there are slanted couplings: all but the finest grid."""
    bounded: bool


@inner
def level_of(grids, number, bounded, constant):
    """Return one grid; with its screen as right-hand side where `constant`."""
    start = grids.table[number, 3]
    slanted_start = start - grids.table[1, 3] if number > 0 else 0
    rhs = grids.screen if constant else grids.rhs
    return Level(
        pointer(grids.solution, start),
        pointer(rhs, start),
        pointer(grids.inverse, start),
        pointer(grids.screen, start),
        pointer(grids.right, start),
        pointer(grids.down, start),
        pointer(grids.edge, start),
        pointer(grids.right_down, slanted_start),
        pointer(grids.left_down, slanted_start),
        pointer(grids.lower, start if bounded else 0),
        pointer(grids.scratch, 0),
        pointer(grids.first, grids.table[number, 4]),
        pointer(grids.blocks, 0),
        grids.table[number, 0],
        grids.table[number, 1],
        grids.table[number, 2],
        number > 0,
        bounded,
    )


@inner
def row_start(level, y, half):
    """Return the place of column 0 of this half of a row."""
    return (2 * y + half) * level.stride + LANES


@inner
def to_west(level, half):
    """Return the way from a pixel to its left neighbour, which is in the other half; the right one follows it."""
    return level.stride - 1 if half == 0 else -level.stride


@inner
def accumulate(values, i, vector):
    """Add a vector to values."""
    store(values, i, load(values, i) + vector)


@inner
def clear(values, start, stop):
    """Set values to 0."""
    zero = splat(np.float32(0))
    for i in range(start, stop, LANES):
        store(values, i, zero)


# The matrix


@inner
def neighbours(level, half, i, values, j):
    """Return the sum over the neighbours of pixel i of coupling times value; the value of i itself is at j."""
    west = to_west(level, half)
    row = 2 * level.stride
    result = load(level.right, i + west) * load(values, j + west)
    result = result + load(level.right, i) * load(values, j + west + 1)
    result = result + load(level.down, i - row) * load(values, j - row)
    result = result + load(level.down, i) * load(values, j + row)
    if level.slanted:
        result = result + load(level.right_down, i + west - row) * load(values, j + west - row)
        result = result + load(level.left_down, i + west + 1 - row) * load(values, j + west + 1 - row)
        result = result + load(level.left_down, i) * load(values, j + west + row)
        result = result + load(level.right_down, i) * load(values, j + west + 1 + row)
    return result


@inner
def residual(level, half, i, every):
    """Return right-hand side less matrix times solution.

    Without `every`, of pixels whose equations held before their neighbours changed from 0: the first two colours.
    """
    if not every:
        return neighbours(level, half, i, level.solution, i)
    inverse = load(level.inverse, i)
    force = load(level.rhs, i) + neighbours(level, half, i, level.solution, i)
    return where_positive(inverse, force - load(level.solution, i) / inverse, splat(np.float32(0)))


@inner
def multiply(level, half, i, values):
    """Return matrix times values on the finest grid, by differences: exactly 0 for constants without a screen."""
    west = to_west(level, half)
    row = 2 * level.stride
    here = load(values, i)
    result = load(level.screen, i) * here
    result = result + load(level.right, i + west) * (here - load(values, i + west))
    result = result + load(level.right, i) * (here - load(values, i + west + 1))
    result = result + load(level.down, i - row) * (here - load(values, i - row))
    return result + load(level.down, i) * (here - load(values, i + row))


# Smoothing


@inner
def relax(level, y, half):
    """Solve the equation of every pixel of half a row for that pixel, with the others held."""
    at = row_start(level, y, half)
    for n in range(level.first[y], level.first[y + 1]):
        i = at + level.blocks[n]
        force = load(level.rhs, i) + neighbours(level, half, i, level.solution, i)
        value = force * load(level.inverse, i)
        if level.bounded:
            value = larger(value, load(level.lower, i))
        store(level.solution, i, value)


@inner
def relax_rows(level, y, begin):
    """Relax half of each of the rows y, y - 1, y - 2 and y - 3, or without the first `begin` of these.

    For y = 1, 3, 5, ... this is a Gauss-Seidel sweep in four colours: (odd row, even column), (even, odd),
    (odd, odd), (even, even). For y = 2, 4, 6, ... it is the same sweep backwards.
    """
    for back in range(begin, 4):
        if 1 <= y - back <= level.rows:
            relax(level, y - back, int(back == 1 or back == 2))


@inner
def start_row(level, y):
    """Relax the colours that are first, the others being 0: (odd row, even column) or (even, odd)."""
    half = 1 - y % 2
    at = row_start(level, y, half)
    for n in range(level.first[y], level.first[y + 1]):
        i = at + level.blocks[n]
        value = load(level.rhs, i) * load(level.inverse, i)
        if level.bounded:
            value = larger(value, load(level.lower, i))
        store(level.solution, i, value)
        store(level.solution, i + (1 - 2 * half) * level.stride, splat(np.float32(0)))


# Between the grids


@inner
def along(level, half, i):
    """Return the couplings of a pixel between two of the coarser grid to either side, summed across.

    Pixels of the odd half lie between two columns, and are on odd rows; those of the even half between two rows.
    """
    west = to_west(level, half)
    row = 2 * level.stride
    if half == 1:
        before, after = load(level.right, i + west), load(level.right, i)
    else:
        before, after = load(level.down, i - row), load(level.down, i)
    if level.slanted:
        north_west, north_east = load(level.right_down, i + west - row), load(level.left_down, i + west + 1 - row)
        south_west, south_east = load(level.left_down, i), load(level.right_down, i)
        if half == 1:
            near, far = before + north_west + south_west, after + north_east + south_east
        else:
            near, far = before + north_west + north_east, after + south_west + south_east
        # Galerkin products may have negative couplings.
        zero = splat(np.float32(0))
        near, far = larger(near, zero), larger(far, zero)
        before = where_positive(near + far, near, larger(before, zero - before))
        after = where_positive(near + far, far, larger(after, zero - after))
    return before, after


@inner
def edge_weights(level, half, i):
    """Return the weights of the two coarse pixels in the interpolation of a pixel between them."""
    before, after = along(level, half, i)
    edge = load(level.edge, i)
    return before * edge, after * edge


@inner
def restrict_row(level, coarse, y, every):
    """Write the right-hand side of the coarse row at the odd row y: interpolation transposed, times residual.

    Call it for the odd rows in their order, with cleared scratch. After a sweep from 0 only the pixels relaxed
    first have a residual on the finest grid; `every` is for the other cases. Pixels amid four coarse ones are
    interpolated by solving their equation, so their residual first goes to all their neighbours.
    """
    size = level.stride + 3 * LANES
    upper_share, lower_share = LANES, LANES + size  # residual / diagonal amid the rows y and y -+ 2
    west, east = LANES + 2 * size, LANES + 3 * size  # what goes to the coarse pixels beside
    north, upper_south, lower_south = LANES + 4 * size, LANES + 5 * size, LANES + 6 * size
    scratch = level.scratch
    row = 2 * level.stride
    for i in range(0, size - LANES, LANES):
        store(scratch, upper_share + i, load(scratch, lower_share + i))
        store(scratch, upper_south + i, load(scratch, lower_south + i))
    clear(scratch, lower_share, upper_south - LANES)
    clear(scratch, lower_south, lower_south + size - LANES)

    at = row_start(level, y + 1, ODD)
    for n in range(level.first[y + 1], level.first[y + 2]):
        k = level.blocks[n]
        store(scratch, lower_share + k, residual(level, ODD, at + k, every) * load(level.inverse, at + k))
    at = row_start(level, y + 1, EVEN)
    for n in range(level.first[y + 1], level.first[y + 2]):
        k = level.blocks[n]
        i = at + k
        force = load(level.right, i + to_west(level, EVEN)) * load(scratch, lower_share + k - 1)
        force = force + load(level.right, i) * load(scratch, lower_share + k)
        if every:
            force = force + residual(level, EVEN, i, every)
        before, after = edge_weights(level, EVEN, i)
        store(scratch, north + k, force * before)
        store(scratch, lower_south + k, force * after)
    at = row_start(level, y, ODD)
    for n in range(level.first[y], level.first[y + 1]):
        k = level.blocks[n]
        i = at + k
        force = load(level.down, i - row) * load(scratch, upper_share + k)
        force = force + load(level.down, i) * load(scratch, lower_share + k)
        if every:
            force = force + residual(level, ODD, i, every)
        before, after = edge_weights(level, ODD, i)
        store(scratch, west + k, force * before)
        store(scratch, east + k, force * after)

    coarse_y = (y + 1) // 2
    at = row_start(level, y, EVEN)
    out = row_start(coarse, coarse_y, EVEN)
    for n in range(coarse.first[coarse_y], coarse.first[coarse_y + 1]):
        k = coarse.blocks[n]
        low = restricted(level, at, 2 * k, every)
        high = restricted(level, at, 2 * k + LANES, every)
        store(coarse.rhs, out + k, even_lanes(low, high))
        store(coarse.rhs, out + coarse.stride + k, odd_lanes(low, high))


@inner
def restricted(level, at, k, every):
    """Gather for `restrict_row` what goes to coarse pixels."""
    size = level.stride + 3 * LANES
    i = at + k
    share = LANES + k
    scratch = level.scratch
    force = residual(level, EVEN, i, every)
    force = force + load(scratch, share + 2 * size) + load(scratch, share + 3 * size - 1)
    force = force + load(scratch, share + 4 * size) + load(scratch, share + 5 * size)
    if level.slanted:
        west = to_west(level, EVEN)
        row = 2 * level.stride
        force = force + load(level.right_down, i + west - row) * load(scratch, share - 1)
        force = force + load(level.left_down, i + west + 1 - row) * load(scratch, share)
        force = force + load(level.left_down, i) * load(scratch, share + size - 1)
        force = force + load(level.right_down, i) * load(scratch, share + size)
    return force


@inner
def restrict_bounds(level, coarse):
    """Bound the coarse solution so that its interpolation keeps the fine one above its bounds."""
    row = 2 * level.stride
    for coarse_y in range(1, coarse.rows + 1):
        at = row_start(level, 2 * coarse_y - 1, EVEN)
        out = row_start(coarse, coarse_y, EVEN)
        for n in range(coarse.first[coarse_y], coarse.first[coarse_y + 1]):
            k = coarse.blocks[n]
            low, high = splat(np.float32(-np.inf)), splat(np.float32(-np.inf))
            for i in (at - row, at, at + row):
                for step in (0, level.stride, level.stride - 1):
                    low = larger(room(level, i + step + 2 * k), low)
                    high = larger(room(level, i + step + 2 * k + LANES), high)
            store(coarse.lower, out + k, even_lanes(low, high))
            store(coarse.lower, out + coarse.stride + k, odd_lanes(low, high))


@inner
def room(level, i):
    """Return how far the solution can move down, as a negative number."""
    below = load(level.lower, i) - load(level.solution, i)
    return where_positive(load(level.inverse, i), below, splat(np.float32(-np.inf)))


@inner
def prolong_rows(level, coarse, y):
    """Add the interpolated coarse solution to the rows y and y + 1, y even; call it for y = 0, 2, 4, ..."""
    row = 2 * level.stride
    upper, middle, lower = LANES, LANES + row, LANES + 2 * row  # corrections of the rows y - 1, y and y + 1
    scratch = level.scratch
    for i in range(0, row, LANES):
        store(scratch, upper + i, load(scratch, lower + i))
    clear(scratch, middle, lower + row)
    if y + 1 <= level.rows:
        coarse_y = y // 2 + 1
        at = row_start(coarse, coarse_y, EVEN)
        for n in range(coarse.first[coarse_y], coarse.first[coarse_y + 1]):
            k = coarse.blocks[n]
            even = load(coarse.solution, at + k)
            odd = load(coarse.solution, at + coarse.stride + k)
            store(scratch, lower + 2 * k, first_zipped(even, odd))
            store(scratch, lower + 2 * k + LANES, last_zipped(even, odd))
        at = row_start(level, y + 1, EVEN)
        for n in range(level.first[y + 1], level.first[y + 2]):
            k = level.blocks[n]
            i = at + k
            here = load(scratch, lower + k)
            accumulate(level.solution, i, here)
            i += level.stride
            before, after = edge_weights(level, ODD, i)
            value = before * here + after * load(scratch, lower + k + 1)
            store(scratch, lower + level.stride + k, value)
            if level.slanted:  # else it is relaxed before it is read
                accumulate(level.solution, i, value)
    at = row_start(level, y, EVEN)
    for n in range(level.first[y], level.first[y + 1]):
        k = level.blocks[n]
        before, after = edge_weights(level, EVEN, at + k)
        value = before * load(scratch, upper + k) + after * load(scratch, lower + k)
        store(scratch, middle + k, value)  # the solution itself is relaxed before it is read
    at = row_start(level, y, ODD)
    for n in range(level.first[y], level.first[y + 1]):
        k = level.blocks[n]
        i = at + k
        force = neighbours(level, ODD, i, scratch, middle + level.stride + k)
        accumulate(level.solution, i, force * load(level.inverse, i))


# The multigrid cycle


@kernel
def cycle(grids, bounded):
    """Write an approximate solution of the finest grid into its `solution`: one V-cycle from 0.

    Without bounds this is a symmetric positive definite matrix times the right-hand side, and the inner product of
    the two is returned. With bounds, every step on every grid keeps them.
    """
    coarsest = grids.table.shape[0] - 1
    for number in range(coarsest):  # smooth from 0 and restrict, a few rows behind
        level, coarse = level_of(grids, number, bounded, NO), level_of(grids, number + 1, bounded, NO)
        clear(level.scratch, START, SCRATCH_ROWS * (level.stride + 3 * LANES))
        begin = 1 if level.slanted else 2  # else `start_row` has done the second colour, too
        for y in range(1, level.rows + 5, 2):
            if y <= level.rows:
                start_row(level, y)
                start_row(level, y + 1)
            relax_rows(level, y, begin)
            if y > 4:
                restrict_row(level, coarse, y - 4, level.slanted or level.bounded)
        if level.bounded:
            restrict_bounds(level, coarse)
    start_row(level_of(grids, coarsest, bounded, NO), TOP)  # a single pixel
    for number in range(coarsest - 1, -1, -1):  # prolong and smooth backwards, a few rows behind
        level, coarse = level_of(grids, number, bounded, NO), level_of(grids, number + 1, bounded, NO)
        clear(level.scratch, START, SCRATCH_ROWS * (level.stride + 3 * LANES))
        for y in range(0, level.rows + 4, 2):
            if y <= level.rows:
                prolong_rows(level, coarse, y)
            relax_rows(level, y, START)
    level = level_of(grids, FINEST, bounded, NO)
    product = 0.0
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            sums = splat(np.float32(0))
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                sums = sums + load(level.rhs, i) * load(level.solution, i)
            product += total(sums)
    return product


# Making the coarser grids


@inner
def list_blocks(level, first_block, every):
    """List the blocks of every row that hold free pixels, or all."""
    count = first_block
    for y in range(level.rows + 4):
        level.first[y] = count
        if not 1 <= y <= level.rows:
            continue
        at = row_start(level, y, EVEN)
        for k in range(0, level.columns, LANES):
            inverses = larger(load(level.inverse, at + k), load(level.inverse, at + level.stride + k))
            if every or largest(inverses) > 0:
                level.blocks[count] = k
                count += 1


@inner
def prepare_interpolation(level):
    """Fill `edge`; the solution becomes 1 less the interpolation of the constant 1, without cancellation.

    What pulls a pixel to 0, or to a coarse pixel that is not free, is missing from the sum of its weights.
    """
    zero, one = splat(np.float32(0)), splat(np.float32(1))
    row = 2 * level.stride
    for y in range(1, level.rows + 1):
        half = y % 2
        way = to_west(level, ODD) if half == 1 else -row
        way_back = way + 1 if half == 1 else row
        at = row_start(level, y, half)
        for n in range(level.first[y], level.first[y + 1]):
            i = at + level.blocks[n]
            before, after = along(level, half, i)
            screen = larger(load(level.screen, i), zero)  # on coarser grids it may be negative
            divisor = screen + before + after
            free = load(level.inverse, i)
            edge = where_positive(free, where_positive(divisor, one / divisor, zero), zero)
            missing = screen + where_positive(load(level.inverse, i + way), zero, before)
            missing = missing + where_positive(load(level.inverse, i + way_back), zero, after)
            store(level.edge, i, edge)
            store(level.solution, i, where_positive(divisor, missing * edge, where_positive(free, one, zero)))
            store(level.solution, i + (1 - 2 * half) * level.stride, zero)
    for y in range(2, level.rows + 1, 2):
        at = row_start(level, y, ODD)
        for n in range(level.first[y], level.first[y + 1]):
            i = at + level.blocks[n]
            force = load(level.screen, i) + neighbours(level, ODD, i, level.solution, i)
            store(level.solution, i, force * load(level.inverse, i))


@inner
def between(level, half, i):
    """Return the coupling of two coarse pixels through the fine one between them alone."""
    if half == 1:
        before, after = load(level.right, i + to_west(level, ODD)), load(level.right, i)
    else:
        before, after = load(level.down, i - 2 * level.stride), load(level.down, i)
    weight_before, weight_after = edge_weights(level, half, i)
    inverse = load(level.inverse, i)
    coupling = weight_before * after + weight_after * before - weight_before * weight_after / inverse
    return where_positive(inverse, coupling, splat(np.float32(0)))


@inner
def couple_coarse(level, coarse):
    """Fill the couplings of the coarse grid: interpolation transposed, times matrix, times interpolation.

    They are summed cell by cell; a cell has the coarse pixels a b on its upper side and c d on its lower one.
    """
    size = level.stride + 3 * LANES
    ab, next_ab, ac, ad, bc = LANES, LANES + size, LANES + 2 * size, LANES + 3 * size, LANES + 4 * size
    sums = level.scratch
    row = 2 * level.stride
    clear(sums, START, SCRATCH_ROWS * size)
    for coarse_y in range(1, coarse.rows + 1):
        y = 2 * coarse_y - 1
        for i in range(0, size - LANES, LANES):
            store(sums, ab + i, load(sums, next_ab + i))
        clear(sums, next_ab, bc + size - LANES)
        at = row_start(level, y, ODD)
        for n in range(level.first[y], level.first[y + 1]):
            k = level.blocks[n]
            accumulate(sums, ab + k, between(level, ODD, at + k))
        at = row_start(level, y + 1, EVEN)
        for n in range(level.first[y + 1], level.first[y + 2]):
            k = level.blocks[n]
            accumulate(sums, ac + k, between(level, EVEN, at + k))
            add_cell(level, at + level.stride + k, k)
        fine = row_start(level, y, EVEN)
        below = fine + 2 * row if y < level.rows else LANES  # in the row of zeros before the grid
        out = row_start(coarse, coarse_y, EVEN)
        for k in range(0, coarse.columns, LANES):
            here, there = fine + 2 * k, below + 2 * k
            take_coupling(level, coarse, coarse.right, out + k, ab + 2 * k, here, here + 1)
            take_coupling(level, coarse, coarse.down, out + k, ac + 2 * k, here, there)
            take_coupling(level, coarse, coarse.right_down, out + k, ad + 2 * k, here, there + 1)
            take_coupling(level, coarse, coarse.left_down, out + k, bc + 2 * k, here, there - 1)


@inner
def add_cell(level, i, k):
    """Add for `couple_coarse` what passes through the middle i of a cell, and slantwise past it."""
    size = level.stride + 3 * LANES
    ab, next_ab, ac, ad, bc = LANES, LANES + size, LANES + 2 * size, LANES + 3 * size, LANES + 4 * size
    row = 2 * level.stride
    sums = level.scratch
    inverse = load(level.inverse, i)
    north, south = load(level.down, i - row), load(level.down, i)
    west, east = load(level.right, i - level.stride), load(level.right, i)
    north_a, north_b = edge_weights(level, ODD, i - row)
    south_c, south_d = edge_weights(level, ODD, i + row)
    west_a, west_c = edge_weights(level, EVEN, i - level.stride)
    east_b, east_d = edge_weights(level, EVEN, i - level.stride + 1)
    a = north * north_a + west * west_a
    b = north * north_b + east * east_b
    c = south * south_c + west * west_c
    d = south * south_d + east * east_d
    if level.slanted:
        a = a + load(level.right_down, i - level.stride - row)
        b = b + load(level.left_down, i - level.stride + 1 - row)
        c = c + load(level.left_down, i)
        d = d + load(level.right_down, i)
    accumulate(sums, ab + k, a * b * inverse)
    accumulate(sums, next_ab + k, c * d * inverse)
    accumulate(sums, ac + k, a * c * inverse)
    accumulate(sums, ac + k + 1, b * d * inverse)
    accumulate(sums, ad + k, a * d * inverse)
    accumulate(sums, bc + k + 1, b * c * inverse)
    if level.slanted:
        north_west, north_east = load(level.left_down, i - row), load(level.right_down, i - row)
        west_south = load(level.right_down, i - level.stride)
        east_south = load(level.left_down, i - level.stride + 1)
        accumulate(sums, ab + k, north_west * north_b * west_a + north_east * north_a * east_b)
        accumulate(sums, next_ab + k, west_south * west_c * south_d + east_south * east_d * south_c)
        accumulate(sums, ac + k, north_west * north_a * west_c + west_south * west_a * south_c)
        accumulate(sums, ac + k + 1, north_east * north_b * east_d + east_south * east_b * south_d)
        accumulate(sums, ad + k, north_east * north_a * east_d + west_south * west_a * south_d)
        accumulate(sums, bc + k + 1, north_west * north_b * west_c + east_south * east_b * south_c)


@inner
def take_coupling(level, coarse, out, i, j, here, there):
    """Store the summed couplings from j on of coarse pixels that are both free."""
    zero = splat(np.float32(0))
    low = where_positive(load(level.inverse, here), load(level.scratch, j), zero)
    low = where_positive(load(level.inverse, there), low, zero)
    high = where_positive(load(level.inverse, here + LANES), load(level.scratch, j + LANES), zero)
    high = where_positive(load(level.inverse, there + LANES), high, zero)
    store(out, i, even_lanes(low, high))
    store(out, i + coarse.stride, odd_lanes(low, high))


@inner
def finish_coarse(level, coarse):
    """Fill the screens of the coarse grid, which wait in its right-hand side, and the inverses of its diagonal."""
    zero, one = splat(np.float32(0)), splat(np.float32(1))
    ones = 2 * coarse.stride + 2 * LANES
    for i in range(0, 6 * coarse.stride + LANES, LANES):
        store(coarse.scratch, i, one)
    for y in range(1, coarse.rows + 1):
        fine = row_start(level, 2 * y - 1, EVEN)
        for half in range(2):
            at = row_start(coarse, y, half)
            for k in range(0, coarse.columns, LANES):
                i = at + k
                low, high = load(level.inverse, fine + 2 * k), load(level.inverse, fine + 2 * k + LANES)
                free = even_lanes(low, high) if half == 0 else odd_lanes(low, high)
                screen = where_positive(free, load(coarse.rhs, i), zero)
                diagonal = screen + neighbours(coarse, half, i, coarse.scratch, ones + half * coarse.stride)
                free = where_positive(free, diagonal, zero)
                store(coarse.screen, i, screen)
                store(coarse.inverse, i, where_positive(free, one / diagonal, zero))
                store(coarse.solution, i, zero)


@kernel
def coarsen(grids):
    """Make all coarser grids from the finest one; the solution is used as scratch."""
    list_blocks(level_of(grids, FINEST, NO, NO), grids.table[0, 5], NO)
    for number in range(grids.table.shape[0] - 1):
        # The coarse screens are the sums of the rows of the coarse matrix: restriction of matrix times
        # interpolated 1. This is the residual of what the interpolation misses, for the screen as right-hand side.
        level, coarse = level_of(grids, number, NO, YES), level_of(grids, number + 1, NO, NO)
        list_blocks(coarse, grids.table[number + 1, 5], YES)
        prepare_interpolation(level)
        clear(level.scratch, START, SCRATCH_ROWS * (level.stride + 3 * LANES))
        for y in range(1, level.rows + 1, 2):
            restrict_row(level, coarse, y, YES)
        couple_coarse(level, coarse)
        finish_coarse(level, coarse)
        list_blocks(coarse, grids.table[number + 1, 5], NO)
    level = level_of(grids, FINEST, NO, NO)
    clear(level.solution, START, 2 * (level.rows + 2) * level.stride)


# Conjugate gradients


@kernel
def conjugate_step(grids, product, factor):
    """Make the direction solution + factor * direction, and go along it to where the energy is least.

    `product` is what `cycle` returned. The way is added to `step`, and the right-hand side becomes the residual.
    Returns the largest change of a pixel, nan if something is not finite.
    """
    level = level_of(grids, FINEST, NO, NO)
    step, direction = pointer(grids.step, START), pointer(grids.direction, START)
    zero = splat(np.float32(0))
    beta = splat(np.float32(factor))
    longest = zero
    curvature = 0.0
    for y in range(1, level.rows + 2):
        for half in range(2):
            at = row_start(level, y, half)
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                value = load(level.solution, i) + beta * load(direction, i)
                store(direction, i, value)
                longest = larger(longest, larger(value, zero - value))
        for half in range(2):
            at = row_start(level, y - 1, half)
            sums = zero
            for n in range(level.first[y - 1], level.first[y]):
                i = at + level.blocks[n]
                sums = sums + load(direction, i) * multiply(level, half, i, direction)
            curvature += total(sums)
    if not curvature > 0:
        return 0.0 * curvature
    length = product / curvature
    alpha = splat(np.float32(length))
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                accumulate(step, i, alpha * load(direction, i))
                force = load(level.rhs, i) - alpha * multiply(level, half, i, direction)
                store(level.rhs, i, force)
    return length * largest(longest)


# Between the image and the finest grid


@inner
def add_exactly(force, lost, other):
    """Return the sum of two vectors, and what rounding has taken from it so far."""
    result = force + other
    added = result - force
    return result, lost + ((force - (result - added)) + (other - added))


@inner
def equation(strip, plane, width, j):
    """Return right-hand side, screen, inverse and couplings to the right and down of `LANES` pixels from j on."""
    zero, one = splat(np.float32(0)), splat(np.float32(1))
    image, data, gradient_x, gradient_y = j + plane, j + 2 * plane, j + 4 * plane, j + 5 * plane
    here = load(strip, image)
    own = load(strip, j + 3 * plane)
    east, west = load(strip, j + 6 * plane), load(strip, j + 6 * plane - 1)
    south, north = load(strip, j + 7 * plane), load(strip, j + 7 * plane - width)
    # A weight of 0 must also silence values that are not finite. The force of a pixel on another is exactly minus
    # that on itself; the sum keeps its rounding errors, as all of them together may move what is hardly anchored.
    own_pull = where_positive(own, own * (load(strip, data) - here), zero)
    pull = east * (load(strip, image + 1) - here - load(strip, gradient_x))
    force, lost = add_exactly(own_pull, zero, where_positive(east, pull, zero))
    pull = west * (load(strip, image - 1) - here + load(strip, gradient_x - 1))
    force, lost = add_exactly(force, lost, where_positive(west, pull, zero))
    pull = south * (load(strip, image + width) - here - load(strip, gradient_y))
    force, lost = add_exactly(force, lost, where_positive(south, pull, zero))
    pull = north * (load(strip, image - width) - here + load(strip, gradient_y - width))
    force, lost = add_exactly(force, lost, where_positive(north, pull, zero))
    force = force + lost
    free, free_east, free_south = load(strip, j), load(strip, j + 1), load(strip, j + width)
    screen = own + east * (one - free_east) + west * (one - load(strip, j - 1))
    screen = screen + south * (one - free_south) + north * (one - load(strip, j - width))
    diagonal = own + east + west + south + north
    return (
        where_positive(free, force, zero),
        where_positive(free, screen, zero),
        where_positive(free, where_positive(diagonal, one / diagonal, one), zero),  # 1: see `drop_undetermined`
        where_positive(free, free_east * east, zero),
        where_positive(free, free_south * south, zero),
    )


@kernel
def assemble(grids, free, images, lower, corner, strip, first, last, bounded):
    """Write rows of the system of the free pixels, for what is to be added to an image, into the finest grid.

    Parameters
    ----------
    free
        ``(height, width)`` bool, of the window.
    images
        Seven ``(H, W)`` float32: the image, data, data_weight, gradient_x, gradient_y, weight_x and weight_y, of
        which the last column and the last row of the window count as 0.
    lower
        The bounds, ``(H, W)`` float32, anything when not `bounded`.
    corner
        Row and column at which the window begins.
    strip
        ``(9, rows + 2, n)`` float32, scratch memory of 0, n at least twice the finest stride and a vector.
    first, last
        The first row of the window to write, and the one after the last.
    """
    level = level_of(grids, FINEST, bounded, NO)
    planes, plane_rows, strip_width = strip.shape
    plane = plane_rows * strip_width
    height, width = free.shape
    start = pointer(strip, START)
    for top in range(first, last, plane_rows - 2):
        rows = min(plane_rows - 2, last - top)
        for k in range(plane_rows):
            y = top + k - 1
            if 0 <= y < height and k < rows + 2:
                copy_row(free, y, 0, width, strip[0, k])
                for number in range(7):
                    copy_row(images[number], corner[0] + y, corner[1], width, strip[1 + number, k])
                if bounded:
                    copy_row(lower, corner[0] + y, corner[1], width, strip[8, k])
                strip[6, k, LANES + width - 1] = 0
                if y == height - 1:
                    strip[7, k] = 0
            else:
                for number in range(planes):
                    strip[number, k] = 0
        write_rows(level, start, plane, strip_width, top, rows)


@inner
def copy_row(source, y, left, width, row):
    """Copy a part of a row of an image behind the first vector of a row of a strip."""
    part = source[y, left : left + width]
    target = row[LANES : LANES + width]
    for x in range(width):
        target[x] = part[x]


@inner
def write_rows(level, strip, plane, width, top, rows):
    """Write rows of the system, from row `top` of the window on.

    The strip holds planes of rows: free or not (1 or 0), the images, and the bounds. They begin with the row
    before, and a row with `LANES` columns before the window. The right-hand side and the bounds are those of what
    is to be added to the image.
    """
    zero = splat(np.float32(0))
    for y in range(rows):
        at = row_start(level, top + y + 1, EVEN)
        for k in range(0, level.columns, LANES):
            i = at + k
            j = (y + 1) * width + LANES + 2 * k
            if any_positive(load(strip, j)) or any_positive(load(strip, j + LANES)):
                low, high = equation(strip, plane, width, j), equation(strip, plane, width, j + LANES)
            else:
                low = high = (zero, zero, zero, zero, zero)
            put(level, level.rhs, i, low[0], high[0])
            put(level, level.screen, i, low[1], high[1])
            put(level, level.inverse, i, low[2], high[2])
            put(level, level.right, i, low[3], high[3])
            put(level, level.down, i, low[4], high[4])
            if level.bounded:
                put(level, level.lower, i, bound(strip, plane, j), bound(strip, plane, j + LANES))


@inner
def bound(strip, plane, j):
    """Return the lower bound of what is to be added to the image."""
    below = load(strip, j + 8 * plane) - load(strip, j + plane)
    return where_positive(load(strip, j), below, splat(np.float32(-np.inf)))


@inner
def put(level, out, i, low, high):
    """Store the values of columns side by side into the two halves of a row."""
    store(out, i, even_lanes(low, high))
    store(out, i + level.stride, odd_lanes(low, high))


@inner
def anchored_by_columns(level):
    """Return whether every free pixel has, above or below it in its column, one that has a screen; uses `edge`."""
    zero, one = splat(np.float32(0)), splat(np.float32(1))
    row = 2 * level.stride
    found = level.edge
    missing = zero
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            for i in range(at, at + level.columns, LANES):
                above = load(level.down, i - row) * load(found, i - row)
                store(found, i, where_positive(load(level.screen, i) + above, one, zero))
    for y in range(level.rows, 0, -1):
        for half in range(2):
            at = row_start(level, y, half)
            for i in range(at, at + level.columns, LANES):
                below = load(level.down, i) * load(found, i + row)
                anchored = where_positive(load(found, i) + below, one, zero)
                store(found, i, anchored)
                missing = larger(missing, where_positive(load(level.inverse, i), one - anchored, zero))
    return largest(missing) == 0


@kernel
def drop_undetermined(grids, parent):
    """Make pixels unfree whose part of the domain has no screen anywhere; return how many.

    `parent` is int32 scratch of the size of the finest grid. It leads from pixel to pixel to the one that stands
    for their part; element 0 stands for all parts that have a screen.
    """
    level = level_of(grids, FINEST, NO, NO)
    if anchored_by_columns(level):
        return 0
    row = 2 * level.stride
    parent[0] = 0
    for y in range(1, level.rows + 1):
        here = np.int32(0)
        for k in range(level.columns):
            for half in range(2):
                i = row_start(level, y, half) + k
                if not level.inverse[i] > 0:
                    continue
                if not level.right[i + to_west(level, half)] > 0:
                    here = np.int32(i)
                    parent[i] = here
                if level.screen[i] > 0:
                    here = join(parent, here, np.int32(0))
                if level.down[i - row] > 0:
                    here = join(parent, here, parent[i - row])
                parent[i] = here
    count = 0
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            for i in range(at, at + level.columns):
                if level.inverse[i] > 0 and join(parent, parent[i], parent[i]) > 0:
                    level.inverse[i] = 0
                    level.right[i] = 0
                    level.down[i] = 0
                    count += 1
    return count


@inner
def join(parent, one, other):
    """Make the parts of two pixels one; return what stands for it."""
    while parent[one] != one:
        parent[one] = parent[parent[one]]
        one = parent[one]
    while parent[other] != other:
        parent[other] = parent[parent[other]]
        other = parent[other]
    first, last = min(one, other), max(one, other)
    parent[last] = first
    return first


# Bounds


@inner
def rise_of_energy(level, values, factor):
    """Return the rise of the energy by the solution, for the right-hand side + factor * matrix * values."""
    rise = 0.0
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            sums = splat(np.float32(0))
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                force = splat(np.float32(0.5)) * multiply(level, half, i, level.solution) - load(level.rhs, i)
                force = force - splat(factor) * multiply(level, half, i, values)
                sums = sums + load(level.solution, i) * force
            rise += total(sums)
    return rise


@kernel
def sweep(grids):
    """Write into the solution what two Gauss-Seidel sweeps that heed the bounds make of 0, on the finest grid."""
    level = level_of(grids, FINEST, YES, NO)
    list_blocks(level, grids.table[0, 5], NO)
    for y in range(1, level.rows + 1):
        start_row(level, y)
    for begin in range(1, 3):
        for y in range(begin, level.rows + 4, 2):
            relax_rows(level, y, START)


@kernel
def take_solution(grids):
    """Add the solution to `correction`; the equations and bounds become those of the rest.

    If the solution would raise the energy nothing is changed; return whether it was taken.
    """
    level = level_of(grids, FINEST, YES, NO)
    correction = pointer(grids.correction, START)
    if rise_of_energy(level, level.solution, np.float32(0)) > 0:
        return False
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                value = load(level.solution, i)
                accumulate(correction, i, value)
                store(level.lower, i, load(level.lower, i) - value)
                store(level.rhs, i, load(level.rhs, i) - multiply(level, half, i, level.solution))
    return True


@kernel
def largest_deficit(grids):
    """Return how far `step` is below the bounds, at most."""
    level = level_of(grids, FINEST, YES, NO)
    step = pointer(grids.step, START)
    most = splat(np.float32(0))
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                most = larger(load(level.lower, i) - load(step, i), most)
    return largest(most)


@kernel
def hold_bounded(grids):
    """Make pixels unfree that are at their bound and pulled below it; those that stay free keep their diagonal."""
    level = level_of(grids, FINEST, YES, NO)
    zero, one = splat(np.float32(0)), splat(np.float32(1))
    row = 2 * level.stride
    free = level.edge  # which is made anew with the coarser grids
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                away = where_positive(zero - load(level.lower, i), one, zero)
                away = where_positive(load(level.rhs, i), one, away)
                away = where_positive(load(level.inverse, i), away, zero)
                store(free, i, away)
                store(level.inverse, i, load(level.inverse, i) * away)
                store(level.rhs, i, load(level.rhs, i) * away)
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            west = to_west(level, half)
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                screen = load(level.screen, i)
                screen = screen + load(level.right, i + west) * (one - load(free, i + west))
                screen = screen + load(level.right, i) * (one - load(free, i + west + 1))
                screen = screen + load(level.down, i - row) * (one - load(free, i - row))
                screen = screen + load(level.down, i) * (one - load(free, i + row))
                store(level.screen, i, screen * load(free, i))
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            east = to_west(level, half) + 1
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                store(level.right, i, load(level.right, i) * load(free, i) * load(free, i + east))
                store(level.down, i, load(level.down, i) * load(free, i) * load(free, i + row))


@kernel
def project(grids):
    """Add `step`, put above the bounds, to `correction`; return how far it was below them, at most.

    It is shortened until it does not raise the energy. The right-hand side must be the residual after the step.
    """
    level = level_of(grids, FINEST, YES, NO)
    step, correction = pointer(grids.step, START), pointer(grids.correction, START)
    most = splat(np.float32(0))
    factor = np.float32(1)
    while True:
        for y in range(1, level.rows + 1):
            for half in range(2):
                at = row_start(level, y, half)
                for n in range(level.first[y], level.first[y + 1]):
                    i = at + level.blocks[n]
                    value, lower = splat(factor) * load(step, i), load(level.lower, i)
                    most = larger(most, lower - value)
                    value = where_positive(load(level.inverse, i), larger(value, lower), splat(np.float32(0)))
                    store(level.solution, i, value)
        if factor == 0 or rise_of_energy(level, step, np.float32(1)) <= 0:
            break
        factor = np.float32(0.5) * factor if factor > 0.01 else np.float32(0)
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            for n in range(level.first[y], level.first[y + 1]):
                i = at + level.blocks[n]
                accumulate(correction, i, load(level.solution, i))
    return largest(most)


@kernel
def largest_pull(grids):
    """Return how far the equation of a pixel at its bound alone would move it up, at most."""
    level = level_of(grids, FINEST, YES, NO)
    zero = splat(np.float32(0))
    most = zero
    for y in range(1, level.rows + 1):
        for half in range(2):
            at = row_start(level, y, half)
            for k in range(0, level.columns, LANES):
                i = at + k
                move = load(level.rhs, i) * load(level.inverse, i)
                most = larger(most, where_positive(zero - load(level.lower, i), zero, move))
    return largest(most)
