"""Hot loops of semi-global matching; the readable twin is tests/reference/semiglobal.py.

A row of cells is held pixel by pixel, the disparities of a pixel side by side: cell ``x * depth + k`` belongs to
main pixel x and disparity ``d = lowest + k``. `depth` is the number of disparities rounded up to whole vectors;
the cells that this adds hold the largest number there is, so that they never win and no path leads through them.

The auxiliary view is held *sheared*, pixel x at position ``W - 1 - lowest - x``: the partners of a main pixel x
lie at ``W - 1 - x + k``, side by side and in the order of k.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereohdr.kernels import kernel
from stereohdr.vectors import (
    LANES,
    add,
    add_saturating,
    bit_and,
    bit_or,
    bit_xor,
    choose,
    count_bits,
    first_lane,
    lane_numbers,
    less,
    load,
    minimum,
    multiply,
    narrow,
    shift_left,
    shift_right,
    smallest,
    splat,
    store,
    subtract,
    widen,
)

COST_BITS = 6
"""Low bits of a packed cell, which hold the matching cost; above them is the sum of L over four paths."""

LARGEST = 65535
"""Beyond the last disparity, and the margin of a pixel without another disparity."""

BORDER = 2
"""Pixels before and after a row of L, where paths begin; steps may read a vector beyond the first."""


class Settings(NamedTuple):
    """Numbers that every row needs."""

    lowest: int
    """The smallest disparity."""
    disparities: int
    """How many there are."""
    outside: int
    """Cost where there is no partner."""
    small: np.uint8
    """P1."""
    large: np.float32
    """P2 where the guide is flat."""
    edge_factor: np.float32
    """How fast P2 falls with the difference of the guide."""
    diagonals: bool
    """Whether to follow the diagonal paths."""


class Sweep(NamedTuple):
    """Buffers of the rows of one direction, all of unsigned integers; see `new_sweep`."""

    unequal: NDArray[np.uint8]
    """``(3, W * depth)``, unequal codes of three rows; row y is at y modulo 3."""
    columns: NDArray[np.uint8]
    """``((W + 2) * depth)``, their sums, with a pixel of zeros before and after."""
    cost: NDArray[np.uint8]
    """``(W * depth)``, matching cost."""
    penalties: NDArray[np.uint8]
    """``(4, W)``, P2 of the steps that come from x - 1, x and x + 1 of the row before, and along the row; 0 where
    a path begins."""
    paths: NDArray[np.uint8]
    """``(2, 3, (W + 2 BORDER) * stride)``, L of the paths from the row before, for row y at y modulo 2."""
    least: NDArray[np.uint8]
    """``(2, 3, W + 2)``, its minima over d, with a zero before and after."""
    along: NDArray[np.uint8]
    """``((W + 2 BORDER) * stride)``, L of the path along the row."""
    totals: NDArray[np.uint16]
    """``(W * depth)``, sums over all paths."""
    best_main: NDArray[np.uint16]
    """``(3, W)``: winning k, its sum, and the smallest sum at least 2 disparities away."""
    best_auxiliary: NDArray[np.uint16]
    """``(3, W + depth)``, the same of the auxiliary view, sheared."""


def new_sweep(width: int, count: int) -> Sweep:
    """Return buffers for images of so many columns and disparities, before the first row."""
    depth = -(-count // LANES) * LANES
    stride = (count // LANES + 1) * LANES
    return Sweep(
        unequal=np.zeros((3, width * depth), dtype=np.uint8),
        columns=np.zeros((width + 2) * depth, dtype=np.uint8),
        cost=np.zeros(width * depth, dtype=np.uint8),
        penalties=np.zeros((4, width), dtype=np.uint8),
        paths=np.full((2, 3, (width + 2 * BORDER) * stride), 255, dtype=np.uint8),
        least=np.zeros((2, 3, width + 2), dtype=np.uint8),
        along=np.full((width + 2 * BORDER) * stride, 255, dtype=np.uint8),
        totals=np.zeros(width * depth, dtype=np.uint16),
        best_main=np.zeros((3, width), dtype=np.uint16),
        best_auxiliary=np.zeros((3, width + depth), dtype=np.uint16),
    )


class Winners(NamedTuple):
    """Results, ``(2, H, W)`` each: main view, auxiliary view."""

    disparity: NDArray[np.float32]
    cost: NDArray[np.uint16]
    margin: NDArray[np.uint16]
    matching_cost: NDArray[np.uint8]


@kernel
def inside_range(x, width, settings):
    """Return the first and one past the last k of main pixel x whose partner lies inside the auxiliary view."""
    first = min(max(x - width + 1 - settings.lowest, 0), settings.disparities)
    last = max(min(x - settings.lowest + 1, settings.disparities), first)
    return first, last


@kernel
def unequal_codes_row(main, sheared, y, settings, depth, unequal):
    """Fill a row of cells with the number of unequal codes; 0 where there is no partner, or no row y."""
    height, width = main.shape[1:]
    if y < 0 or y >= height:
        unequal[:] = 0
        return
    higher = sheared[0, y]
    near = sheared[1, y]
    for x in range(width):
        own_higher = splat(main[0, y, x])
        own_near = splat(main[1, y, x])
        for k in range(0, depth, LANES):
            at = width - 1 - x + k
            differing = bit_or(bit_xor(load(higher, at), own_higher), bit_xor(load(near, at), own_near))
            store(unequal, x * depth + k, narrow(count_bits(differing)))
        first, last = inside_range(x, width, settings)
        if last - first < settings.disparities:
            unequal[x * depth : x * depth + first] = 0
            unequal[x * depth + last : (x + 1) * depth] = 0


@kernel
def matching_cost_row(unequal, rows, columns, settings, depth, cost):
    """Fill a row of cells with the mean of 3x3 numbers of unequal codes, of those that exist, rounded half up.

    `unequal` holds three rows, of which `rows` exist; `columns` is scratch for a row and for one pixel of zeros
    before and after it. The cost is `outside` where there is no partner.
    """
    width = columns.size // depth - 2
    # Dividing by n is multiplying by 1024 / n, rounded up: exact for the mean of 3, 6 or 9 numbers up to 48.
    numbers = 3 * rows
    reciprocal = splat(np.uint16(-(-1024 // numbers)))
    half = splat(np.uint16(numbers // 2))
    ten = splat(np.uint16(10))
    for i in range(0, width * depth, LANES):
        store(columns, i + depth, add(add(load(unequal[0], i), load(unequal[1], i)), load(unequal[2], i)))
    for i in range(0, width * depth, LANES):
        total = add(widen(load(columns, i)), widen(load(columns, i + depth)))
        total = add(total, add(widen(load(columns, i + 2 * depth)), half))
        store(cost, i, narrow(shift_right(multiply(total, reciprocal), ten)))
    for x in range(width):
        first, last = inside_range(x, width, settings)
        if x == 0 or x == width - 1:
            correct_means(columns, rows, x, first, last, settings, depth, cost)
        elif x - settings.lowest - first >= width - 1 or x - settings.lowest - (last - 1) <= 0:
            correct_means(columns, rows, x, first, min(first + 1, last), settings, depth, cost)
            correct_means(columns, rows, x, max(last - 1, first), last, settings, depth, cost)
        if last - first < settings.disparities:
            cost[x * depth : x * depth + first] = settings.outside
            cost[x * depth + last : (x + 1) * depth] = settings.outside


@kernel
def correct_means(columns, rows, x, first, last, settings, depth, cost):
    """Take the means at pixel x and k from `first` to before `last` again, of the columns that exist."""
    width = columns.size // depth - 2
    for k in range(first, last):
        partner = x - settings.lowest - k
        numbers = rows * (1 + int(x > 0 and partner > 0) + int(x < width - 1 and partner < width - 1))
        cell = x * depth + k
        total = int(columns[cell]) + int(columns[cell + depth]) + int(columns[cell + 2 * depth])
        cost[cell] = (total + numbers // 2) // numbers


@kernel
def penalty_row(guide, guide_before, shift, settings, penalties):
    """Fill ``penalties[x]`` with P2 of the step to pixel x of `guide` from pixel x - shift of `guide_before`.

    Pixels without such a step are left alone.
    """
    first = max(0, shift)
    steps = guide.size - abs(shift)
    after = guide[first : first + steps]
    before = guide_before[first - shift : first - shift + steps]
    out = penalties[first : first + steps]
    least = np.int32(settings.small) + np.int32(1)
    for i in range(steps):
        penalty = settings.large / (np.float32(1) + settings.edge_factor * np.abs(after[i] - before[i]))
        out[i] = np.uint8(max(np.int32(penalty + np.float32(0.5)), least))


@kernel
def advance(line, came, cost, small, limit, least, out, cell):
    """Take a step along a path: store L of a vector of disparities at ``out[cell]`` and return it.

    L of the pixel before is at ``line[came]``, `least` is its minimum over all d, and `limit` that plus P2. Where
    a path begins both are 0, and L is the cost.
    """
    changed = add_saturating(minimum(load(line, came - 1), load(line, came + 1)), small)
    reached = minimum(minimum(load(line, came), changed), limit)
    own = add_saturating(cost, subtract(reached, least))
    store(out, cell, own)
    return own


@kernel
def path_sum_row(sweep, y, step, second, settings, beyond, packed):
    """Follow four paths to every pixel of row y: three from the row before, one along the row.

    On the first visit the sum of their L goes into `packed`, with the cost; on the second, the sum over all eight
    goes into `sweep.totals`. `beyond` has all bits set for k that are not disparities.
    """
    penalties = sweep.penalties
    before = sweep.paths[1 - y % 2]
    now = sweep.paths[y % 2]
    least_before = sweep.least[1 - y % 2]
    least_now = sweep.least[y % 2]
    along = sweep.along
    width = penalties.shape[1]
    depth = packed.size // width
    stride = along.size // (width + 2 * BORDER)
    small = splat(settings.small)
    six = splat(np.uint16(COST_BITS))
    cost_mask = splat(np.uint16(2**COST_BITS - 1))
    least_along = np.uint8(0)
    for i in range(width):
        x = i if step > 0 else width - 1 - i
        here = (x + BORDER) * stride
        left_least = splat(least_before[0, x])
        same_least = splat(least_before[1, x + 1])
        right_least = splat(least_before[2, x + 2])
        along_least = splat(least_along)
        left_limit = add(left_least, splat(penalties[0, x]))
        same_limit = add(same_least, splat(penalties[1, x]))
        right_limit = add(right_least, splat(penalties[2, x]))
        along_limit = add(along_least, splat(penalties[3, x]))
        from_left = from_same = from_right = from_beside = splat(np.uint8(255))
        for j in range(0, depth, LANES):
            k = j if step > 0 else depth - LANES - j  # memory is fetched ahead in the order of the visits
            cell = here + k
            stored = load(packed, x * depth + k)
            own = bit_and(stored, cost_mask) if second else widen(load(sweep.cost, x * depth + k))
            own_cost = narrow(bit_or(own, load(beyond, k)))
            path = advance(along, cell - step * stride, own_cost, small, along_limit, along_least, along, cell)
            total = widen(path)
            from_beside = minimum(from_beside, path)
            path = advance(before[1], cell, own_cost, small, same_limit, same_least, now[1], cell)
            total = add(total, widen(path))
            from_same = minimum(from_same, path)
            if settings.diagonals:
                path = advance(before[0], cell - stride, own_cost, small, left_limit, left_least, now[0], cell)
                total = add(total, widen(path))
                from_left = minimum(from_left, path)
                path = advance(before[2], cell + stride, own_cost, small, right_limit, right_least, now[2], cell)
                total = add(total, widen(path))
                from_right = minimum(from_right, path)
            if second:
                store(sweep.totals, x * depth + k, bit_or(add(total, shift_right(stored, six)), load(beyond, k)))
            else:
                store(packed, x * depth + k, bit_or(shift_left(total, six), own))
        least_along = smallest(from_beside)
        least_now[0, x + 1] = smallest(from_left)
        least_now[1, x + 1] = smallest(from_same)
        least_now[2, x + 1] = smallest(from_right)


@kernel
def row_of(winners, view, y):
    """Return one row of one view's results."""
    return Winners(
        winners.disparity[view, y],
        winners.cost[view, y],
        winners.margin[view, y],
        winners.matching_cost[view, y],
    )


@kernel
def set_winner(row, x, disparity, before, best, after, other, packed):
    """Store the winner of a pixel, between whole disparities where two lines of equal slope meet.

    One line goes through the winner's sum and the larger of those beside it, the other through the smaller one.
    Where there are not both, pass `best` for each.
    """
    rise = max(before, after) - best
    offset = np.float32(0)
    if rise > 0:
        offset = np.float32(np.int64(before) - np.int64(after)) / np.float32(2 * rise)
    row.disparity[x] = np.float32(disparity) + offset
    row.cost[x] = best
    row.margin[x] = other - best if other < LARGEST else LARGEST
    row.matching_cost[x] = packed & (2**COST_BITS - 1)


@kernel
def best_of_row(totals, main, sheared):
    """Find k of the winners, their sums and the next best ones from the sums over all paths; see `Sweep`."""
    width = main.shape[1]
    depth = totals.size // width
    winner = sheared[0]
    best = sheared[1]
    other = sheared[2]
    best[:] = LARGEST
    other[:] = LARGEST
    largest = splat(np.uint16(LARGEST))
    three = splat(np.uint16(3))
    for x in range(width):  # so that every auxiliary pixel meets its disparities in rising order
        lowest = largest
        for k in range(0, depth, LANES):
            at = width - 1 - x + k
            total = load(totals, x * depth + k)
            lowest = minimum(lowest, total)
            former = load(best, at)
            number = add(lane_numbers(), splat(np.uint16(k)))
            store(winner, at, choose(less(total, former), number, load(winner, at)))
            store(best, at, minimum(total, former))
        main[1, x] = smallest(lowest)
    for x in range(width):
        above_best = splat(np.uint16(main[1, x] + 1))
        for k in range(0, depth, LANES):
            lane = first_lane(less(load(totals, x * depth + k), above_best))
            if lane < LANES:
                main[0, x] = k + lane
                break
        own = splat(main[0, x])
        lowest = largest
        for k in range(0, depth, LANES):
            at = width - 1 - x + k
            total = load(totals, x * depth + k)
            # Minus the winner this is 0, 1 or 2 for it and its neighbours, and larger elsewhere.
            after = add(lane_numbers(), splat(np.uint16(k + 1)))
            lowest = minimum(lowest, choose(less(subtract(after, own), three), largest, total))
            away = choose(less(subtract(after, load(winner, at)), three), largest, total)
            store(other, at, minimum(load(other, at), away))
        main[2, x] = smallest(lowest)


@kernel
def take_winners(sweep, packed, y, settings, winners):
    """Store the winners of both views."""
    totals = sweep.totals
    main = sweep.best_main
    sheared = sweep.best_auxiliary
    width = main.shape[1]
    depth = totals.size // width
    row = row_of(winners, 0, y)
    for x in range(width):
        k = np.int64(main[0, x])
        cell = x * depth + k
        before = after = best = main[1, x]
        first, last = inside_range(x, width, settings)
        if first < k < last - 1:
            before = totals[cell - 1]
            after = totals[cell + 1]
        set_winner(row, x, settings.lowest + k, before, best, after, main[2, x], packed[cell])
    row = row_of(winners, 1, y)
    highest = settings.lowest + settings.disparities - 1
    for x in range(max(0, -highest), min(width, width - settings.lowest)):
        at = width - 1 - settings.lowest - x
        k = np.int64(sheared[0, at])
        d = settings.lowest + k
        cell = (x + d) * depth + k
        before = after = best = sheared[1, at]
        if 0 < k < settings.disparities - 1 and 0 < x + d < width - 1:
            before = totals[cell - depth - 1]
            after = totals[cell + depth + 1]
        set_winner(row, x, d, before, best, after, sheared[2, at], packed[cell])


@kernel
def visit_rows(main, sheared, guide, settings, sweep, first_row, last_row, step, second, volume, winners):
    """Follow the paths through rows `first_row` to `last_row`, downwards or upwards.

    Parameters
    ----------
    main, sheared
        ``(2, H, W)`` and ``(2, H, W + depth)`` uint64 census planes; the auxiliary view's sheared.
    guide
        ``(H, W)`` float32.
    settings
        See `Settings`.
    sweep
        Buffers of this direction, kept from call to call.
    first_row, last_row, step
        Rows to visit, both included; `step` is 1 or -1. The path along a row goes right or left accordingly.
    second
        Whether the other direction has visited these rows: then the winners are taken.
    volume
        ``(H, W * depth)`` uint16, packed sums of the first visit.
    winners
        Results.
    """
    height, width = guide.shape
    depth = volume.shape[1] // width
    beyond = np.zeros(depth, dtype=np.uint16)
    beyond[settings.disparities :] = LARGEST
    if not second:
        for y in (first_row - step, first_row):
            unequal_codes_row(main, sheared, y, settings, depth, sweep.unequal[y % 3])
    for y in range(first_row, last_row + step, step):
        if not second:
            unequal_codes_row(main, sheared, y + step, settings, depth, sweep.unequal[(y + step) % 3])
            rows = 1 + int(y > 0) + int(y < height - 1)
            matching_cost_row(sweep.unequal, rows, sweep.columns, settings, depth, sweep.cost)
        if 0 <= y - step < height:
            for p in range(3):
                penalty_row(guide[y], guide[y - step], 1 - p, settings, sweep.penalties[p])
        penalty_row(guide[y], guide[y], step, settings, sweep.penalties[3])
        path_sum_row(sweep, y, step, second, settings, beyond, volume[y])
        if second:
            best_of_row(sweep.totals, sweep.best_main, sweep.best_auxiliary)
            take_winners(sweep, volume[y], y, settings, winners)
