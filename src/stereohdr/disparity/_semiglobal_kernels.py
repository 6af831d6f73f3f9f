"""Hot loops of semi-global matching; the readable twin is tests/reference/semiglobal.py.

A row of cells is held pixel by pixel, the disparities of a pixel side by side: cell k of a main pixel belongs to
its disparity ``lowest + k``. `depth` is their number rounded up to whole vectors; the cells that this adds hold
the largest number there is, so that they never win and no path leads through them. Pixels may differ in the
disparities that they try, block by block; `Layout` says where the cells of each are.

The auxiliary view is held *sheared*, pixel x at position ``W - 1 - lowest - x``, `lowest` being the smallest of
all: the partners of a main pixel lie side by side, in the order of k.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereohdr.kernels import kernel
from stereohdr.vectors import (
    LANES,
    Vector,
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

GAP = 2 * LANES
"""Cells before and after each pixel's in a line of L that hold 255, so that a step may read beyond them."""


class Settings(NamedTuple):
    """Numbers that every row needs."""

    lowest: int
    """The smallest disparity of all."""
    disparities: int
    """How many there are from that to the largest one."""
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


class Layout(NamedTuple):
    """Where the cells of one row are; arrays are ``(W + 2)`` int64, with a pixel before and after the row."""

    block: int
    """So many columns, from a multiple of it on, have the same disparities."""
    lowest: NDArray[np.int64]
    """Each pixel's smallest disparity."""
    disparities: NDArray[np.int64]
    """How many it has."""
    depth: NDArray[np.int64]
    """That, rounded up to whole vectors."""
    cell: NDArray[np.int64]
    """Its first cell in a row of cells."""
    place: NDArray[np.int64]
    """Its first cell in a line of L, which has a gap between pixels."""
    alike: NDArray[np.bool_]
    """Whether both neighbours have the same disparities."""


class Layouts(NamedTuple):
    """The layouts of all rows: those of `Layout` with an axis before it, one for so many rows."""

    rows: int
    """So many rows, from a multiple of it on, have the same layout."""
    block: int
    lowest: NDArray[np.int64]
    disparities: NDArray[np.int64]
    depth: NDArray[np.int64]
    cell: NDArray[np.int64]
    place: NDArray[np.int64]
    alike: NDArray[np.bool_]
    size: NDArray[np.int64]
    """Cells of a row."""
    start: NDArray[np.int64]
    """Number of the first cell of the first row."""


class Part(NamedTuple):
    """Which rows of an image some arrays hold."""

    top: int
    """The first one; even, so that buffers for even and odd rows keep their meaning from part to part."""
    begin: int
    """Number of the cell, among those of all rows, with which the volume begins."""
    kept: bool
    """Whether the volume holds all rows that are visited, and not just one of them at a time."""


class Sweep(NamedTuple):
    """Buffers of the rows of one direction, all of unsigned integers; see `new_sweep`."""

    unequal: NDArray[np.uint8]
    """``(3, cells)``, unequal codes of three rows; row y is at y modulo 3. Every block has a pixel more before and
    after it."""
    columns: NDArray[np.uint8]
    """``(cells)``, their sums."""
    cost: NDArray[np.uint8]
    """``(cells)``, matching cost."""
    penalties: NDArray[np.uint8]
    """``(4, W)``, P2 of the steps that come from x - 1, x and x + 1 of the row before, and along the row; 0 where
    a path begins."""
    paths: NDArray[np.uint8]
    """``(2, 3, line)``, L of the paths from the row before, for row y at y modulo 2."""
    least: NDArray[np.uint8]
    """``(2, 3, W + 2)``, its minima over d, with a zero before and after."""
    along: NDArray[np.uint8]
    """``(line)``, L of the path along the row."""
    totals: NDArray[np.uint16]
    """``(cells)``, sums over all paths."""
    best_main: NDArray[np.uint16]
    """``(3, W)``: winning k, its sum, and the smallest sum at least 2 disparities away."""
    best_auxiliary: NDArray[np.uint16]
    """``(3, W + depth + LANES)``, the same of the auxiliary view, sheared; its k counts from the smallest
    disparity of all."""


def new_sweep(settings: Settings, layouts: Layouts) -> Sweep:
    """Return buffers for images of these layouts, before the first row."""
    width = layouts.lowest.shape[1] - 2
    cells = int(layouts.size.max())
    blocks = -(-width // layouts.block)
    wide = cells + 2 * blocks * int(layouts.depth.max())
    line = int((layouts.place[:, -1] + layouts.depth[:, -1]).max()) + GAP
    depth = -(-settings.disparities // LANES) * LANES
    return Sweep(
        unequal=np.zeros((3, wide), dtype=np.uint8),
        columns=np.zeros(wide, dtype=np.uint8),
        cost=np.zeros(cells, dtype=np.uint8),
        penalties=np.zeros((4, width), dtype=np.uint8),
        paths=np.full((2, 3, line), 255, dtype=np.uint8),
        least=np.zeros((2, 3, width + 2), dtype=np.uint8),
        along=np.full(line, 255, dtype=np.uint8),
        totals=np.zeros(cells, dtype=np.uint16),
        best_main=np.zeros((3, width), dtype=np.uint16),
        best_auxiliary=np.zeros((3, width + depth + LANES), dtype=np.uint16),
    )


class Winners(NamedTuple):
    """Results, ``(2, H, W)`` each: main view, auxiliary view."""

    disparity: NDArray[np.float32]
    cost: NDArray[np.uint16]
    margin: NDArray[np.uint16]
    matching_cost: NDArray[np.uint8]


@kernel
def layout_of(layouts, n):
    """Return the layout of number n."""
    return Layout(
        layouts.block,
        layouts.lowest[n],
        layouts.disparities[n],
        layouts.depth[n],
        layouts.cell[n],
        layouts.place[n],
        layouts.alike[n],
    )


@kernel
def disparities_of(layout, x):
    """Return the smallest disparity of pixel x, how many it has, and its number of cells."""
    return layout.lowest[x + 1], layout.disparities[x + 1], layout.depth[x + 1]


@kernel
def inside_range(x, width, lowest, count):
    """Return the first and one past the last k of main pixel x whose partner lies inside the auxiliary view."""
    first = min(max(x - width + 1 - lowest, 0), count)
    last = max(min(x - lowest + 1, count), first)
    return first, last


@kernel
def unequal_codes_row(main, sheared, y, settings, layout, unequal):
    """Fill a row of cells with the number of unequal codes; 0 where there is no partner, pixel, or row y."""
    height, width = main.shape[1:]
    if y < 0 or y >= height:
        unequal[:] = 0
        return
    higher = sheared[0, y]
    near = sheared[1, y]
    cell = 0
    for first_column in range(0, width, layout.block):
        lowest, count, depth = disparities_of(layout, first_column)
        partners = width - 1 + lowest - settings.lowest
        for x in range(first_column - 1, min(first_column + layout.block, width) + 1):
            if x < 0 or x == width:
                unequal[cell : cell + depth] = 0
                cell += depth
                continue
            own_higher = splat(main[0, y, x])
            own_near = splat(main[1, y, x])
            for k in range(0, depth, LANES):
                at = partners - x + k
                differing = bit_or(bit_xor(load(higher, at), own_higher), bit_xor(load(near, at), own_near))
                store(unequal, cell + k, narrow(count_bits(differing)))
            first, last = inside_range(x, width, lowest, count)
            if last - first < count:
                unequal[cell : cell + first] = 0
                unequal[cell + last : cell + depth] = 0
            cell += depth


@kernel
def matching_cost_row(unequal, rows, columns, settings, layout, cost):
    """Fill a row of cells with the mean of 3x3 numbers of unequal codes, of those that exist, rounded half up.

    `unequal` holds three rows, of which `rows` exist; `columns` is scratch for such a row. The cost is `outside`
    where there is no partner.
    """
    width = layout.lowest.size - 2
    # Dividing by n is multiplying by 1024 / n, rounded up: exact for the mean of 3, 6 or 9 numbers up to 48.
    numbers = 3 * rows
    reciprocal = splat(np.uint16(-(-1024 // numbers)))
    half = splat(np.uint16(numbers // 2))
    ten = splat(np.uint16(10))
    begin = 0
    for first_column in range(0, width, layout.block):
        lowest, count, depth = disparities_of(layout, first_column)
        end_column = min(first_column + layout.block, width)
        end = begin + (end_column - first_column + 2) * depth
        for i in range(begin, end, LANES):
            store(columns, i, add(add(load(unequal[0], i), load(unequal[1], i)), load(unequal[2], i)))
        target = layout.cell[first_column + 1] - begin
        for i in range(begin, end - 2 * depth, LANES):
            total = add(widen(load(columns, i)), widen(load(columns, i + depth)))
            total = add(total, add(widen(load(columns, i + 2 * depth)), half))
            store(cost, target + i, narrow(shift_right(multiply(total, reciprocal), ten)))
        for x in range(first_column, end_column):
            nearest, farthest = x - lowest, x - lowest - count + 1  # partners of the first and the last cell
            if 0 < x < width - 1 and nearest < width - 1 and farthest > 0:
                continue
            at = begin + (x - first_column) * depth
            correct_costs(
                columns[at : at + 3 * depth],
                rows,
                x,
                width,
                lowest,
                count,
                settings.outside,
                cost[target + at : target + at + depth],
            )
        begin = end


@kernel
def correct_costs(columns, rows, x, width, lowest, count, outside, cost):
    """Take the mean again where not all of 3x3 pixels exist, and set the cost where there is no partner."""
    depth = cost.size
    first, last = inside_range(x, width, lowest, count)
    for k in range(first, last):
        partner = x - lowest - k
        if 0 < x < width - 1 and 0 < partner < width - 1:
            continue
        numbers = rows * (1 + int(x > 0 and partner > 0) + int(x < width - 1 and partner < width - 1))
        total = int(columns[k]) + int(columns[k + depth]) + int(columns[k + 2 * depth])
        cost[k] = (total + numbers // 2) // numbers
    cost[:first] = outside
    cost[last:] = outside


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


class Pixel(NamedTuple):
    """Where the cells of a pixel are."""

    place: int
    """In a line of L."""
    cell: int
    """In a row of cells."""
    depth: int
    """Their number."""
    beyond: int
    """Where to begin in the array that marks the cells beyond the disparities."""


class Steps(NamedTuple):
    """Where the paths to a pixel come from: the left, the same and the right pixel of the row before, and the one
    beside."""

    places: tuple[int, ...]
    """Of their cells in a line of L."""
    depths: tuple[int, ...]
    """How many these are."""
    shifts: tuple[int, ...]
    """Their k of this pixel's smallest disparity."""
    limits: tuple[Vector, ...]
    """The minimum of L there, plus P2."""
    leasts: tuple[Vector, ...]
    """The minimum of L there."""


@kernel
def came_from(steps, n, k, alike):
    """Return where, in the line of L of path n, the pixel that it comes from has the disparity of k.

    Where it does not have it, return a place around which all is 255.
    """
    if alike:
        return steps.places[n] + k
    return steps.places[n] + min(max(k + steps.shifts[n], -LANES - 1), steps.depths[n] + 1)


@kernel
def path_sum_pixel(sweep, before, now, step, second, diagonals, alike, pixel, steps, small, beyond, packed):
    """Follow four paths to a pixel: from the left, the same and the right one of the row before, and along it.

    `alike` says that all of these have the same disparities. Returns the minima of L.
    """
    along = sweep.along
    six = splat(np.uint16(COST_BITS))
    cost_mask = splat(np.uint16(2**COST_BITS - 1))
    from_left = from_same = from_right = from_beside = splat(np.uint8(255))
    for j in range(0, pixel.depth, LANES):
        k = j if step > 0 else pixel.depth - LANES - j  # memory is fetched ahead in the order of the visits
        here = pixel.place + k
        stored = load(packed, pixel.cell + k)
        own = bit_and(stored, cost_mask) if second else widen(load(sweep.cost, pixel.cell + k))
        out_of_range = load(beyond, pixel.beyond + k)
        cost = narrow(bit_or(own, out_of_range))
        came = came_from(steps, 3, k, alike)
        path = advance(along, came, cost, small, steps.limits[3], steps.leasts[3], along, here)
        total = widen(path)
        from_beside = minimum(from_beside, path)
        came = came_from(steps, 1, k, alike)
        path = advance(before[1], came, cost, small, steps.limits[1], steps.leasts[1], now[1], here)
        total = add(total, widen(path))
        from_same = minimum(from_same, path)
        if diagonals:
            came = came_from(steps, 0, k, alike)
            path = advance(before[0], came, cost, small, steps.limits[0], steps.leasts[0], now[0], here)
            total = add(total, widen(path))
            from_left = minimum(from_left, path)
            came = came_from(steps, 2, k, alike)
            path = advance(before[2], came, cost, small, steps.limits[2], steps.leasts[2], now[2], here)
            total = add(total, widen(path))
            from_right = minimum(from_right, path)
        if second:
            store(sweep.totals, pixel.cell + k, bit_or(add(total, shift_right(stored, six)), out_of_range))
        else:
            store(packed, pixel.cell + k, bit_or(shift_left(total, six), own))
    return smallest(from_left), smallest(from_same), smallest(from_right), smallest(from_beside)


@kernel
def path_sum_row(sweep, y, step, second, settings, layout, layout_before, alike, beyond, packed):
    """Follow four paths to every pixel of row y: three from the row before, one along the row.

    On the first visit the sum of their L goes into `packed`, with the cost; on the second, the sum over all eight
    goes into `sweep.totals`. `alike` tells the pixels whose paths come from such with the same disparities. The
    second half of `beyond` has all bits set.
    """
    penalties = sweep.penalties
    before = sweep.paths[1 - y % 2]
    now = sweep.paths[y % 2]
    least_before = sweep.least[1 - y % 2]
    least_now = sweep.least[y % 2]
    width = penalties.shape[1]
    small = splat(settings.small)
    least_along = np.uint8(0)
    for i in range(width):
        x = i if step > 0 else width - 1 - i
        lowest, count, depth = disparities_of(layout, x)
        pixel = Pixel(layout.place[x + 1], layout.cell[x + 1], depth, beyond.size // 2 - count)
        left, same, right, beside = x, x + 1, x + 2, x + 1 - step  # in arrays with a pixel before and after
        places = (
            layout_before.place[left],
            layout_before.place[same],
            layout_before.place[right],
            layout.place[beside],
        )
        leasts = (
            splat(least_before[0, left]),
            splat(least_before[1, same]),
            splat(least_before[2, right]),
            splat(least_along),
        )
        limits = (
            add_saturating(leasts[0], splat(penalties[0, x])),
            add_saturating(leasts[1], splat(penalties[1, x])),
            add_saturating(leasts[2], splat(penalties[2, x])),
            add_saturating(leasts[3], splat(penalties[3, x])),
        )
        if alike[x + 1]:
            nothing = (0, 0, 0, 0)
            least = path_sum_pixel(
                sweep,
                before,
                now,
                step,
                second,
                settings.diagonals,
                True,
                pixel,
                Steps(places, nothing, nothing, limits, leasts),
                small,
                beyond,
                packed,
            )
        else:
            depths = (
                layout_before.depth[left],
                layout_before.depth[same],
                layout_before.depth[right],
                layout.depth[beside],
            )
            shifts = (
                lowest - layout_before.lowest[left],
                lowest - layout_before.lowest[same],
                lowest - layout_before.lowest[right],
                lowest - layout.lowest[beside],
            )
            least = path_sum_pixel(
                sweep,
                before,
                now,
                step,
                second,
                settings.diagonals,
                False,
                pixel,
                Steps(places, depths, shifts, limits, leasts),
                small,
                beyond,
                packed,
            )
        least_now[0, x + 1], least_now[1, x + 1], least_now[2, x + 1], least_along = least


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
def best_of_row(totals, settings, layout, main, sheared):
    """Find k of the winners, their sums and the next best ones from the sums over all paths; see `Sweep`."""
    width = main.shape[1]
    winner = sheared[0]
    best = sheared[1]
    other = sheared[2]
    best[:] = LARGEST
    other[:] = LARGEST
    largest = splat(np.uint16(LARGEST))
    three = splat(np.uint16(3))
    for x in range(width):  # so that every auxiliary pixel meets its disparities in rising order
        lowest = largest
        cell = layout.cell[x + 1]
        first = layout.lowest[x + 1] - settings.lowest
        for k in range(0, layout.depth[x + 1], LANES):
            at = width - 1 - x + first + k
            total = load(totals, cell + k)
            lowest = minimum(lowest, total)
            former = load(best, at)
            number = add(lane_numbers(), splat(np.uint16(first + k)))
            store(winner, at, choose(less(total, former), number, load(winner, at)))
            store(best, at, minimum(total, former))
        main[1, x] = smallest(lowest)
    for x in range(width):
        above_best = splat(np.uint16(main[1, x] + 1))
        cell = layout.cell[x + 1]
        depth = layout.depth[x + 1]
        first = layout.lowest[x + 1] - settings.lowest
        for k in range(0, depth, LANES):
            lane = first_lane(less(load(totals, cell + k), above_best))
            if lane < LANES:
                main[0, x] = k + lane
                break
        own = splat(np.uint16(first + main[0, x]))
        lowest = largest
        for k in range(0, depth, LANES):
            at = width - 1 - x + first + k
            total = load(totals, cell + k)
            # Minus the winner this is 0, 1 or 2 for it and its neighbours, and larger elsewhere.
            after = add(lane_numbers(), splat(np.uint16(first + k + 1)))
            lowest = minimum(lowest, choose(less(subtract(after, own), three), largest, total))
            away = choose(less(subtract(after, load(winner, at)), three), largest, total)
            store(other, at, minimum(load(other, at), away))
        main[2, x] = smallest(lowest)


@kernel
def has_disparity(layout, x, d):
    """Return whether d is among the disparities of pixel x."""
    return 0 <= d - layout.lowest[x + 1] < layout.disparities[x + 1]


@kernel
def cell_of(layout, x, d):
    """Return the cell of disparity d of pixel x."""
    return layout.cell[x + 1] + d - layout.lowest[x + 1]


@kernel
def take_winners(sweep, packed, y, settings, layout, winners):
    """Store the winners of both views."""
    totals = sweep.totals
    main = sweep.best_main
    sheared = sweep.best_auxiliary
    width = main.shape[1]
    row = row_of(winners, 0, y)
    for x in range(width):
        lowest, count, _ = disparities_of(layout, x)
        k = np.int64(main[0, x])
        cell = layout.cell[x + 1] + k
        before = after = best = main[1, x]
        first, last = inside_range(x, width, lowest, count)
        if first < k < last - 1:
            before = totals[cell - 1]
            after = totals[cell + 1]
        set_winner(row, x, lowest + k, before, best, after, main[2, x], packed[cell])
    row = row_of(winners, 1, y)
    highest = settings.lowest + settings.disparities - 1
    for x in range(max(0, -highest), min(width, width - settings.lowest)):
        at = width - 1 - settings.lowest - x
        before = after = best = sheared[1, at]
        if best == LARGEST:
            row.disparity[x] = LARGEST
            row.cost[x] = LARGEST
            row.margin[x] = 0
            row.matching_cost[x] = settings.outside
            continue
        d = settings.lowest + np.int64(sheared[0, at])
        partner = x + d
        if (
            0 < partner < width - 1
            and has_disparity(layout, partner - 1, d - 1)
            and has_disparity(layout, partner + 1, d + 1)
        ):
            before = totals[cell_of(layout, partner - 1, d - 1)]
            after = totals[cell_of(layout, partner + 1, d + 1)]
        set_winner(row, x, d, before, best, after, sheared[2, at], packed[cell_of(layout, partner, d)])


@kernel
def visit_rows(
    main, sheared, guide, settings, layouts, part, sweep, first_row, last_row, step, second, volume, winners
):
    """Follow the paths through rows `first_row` to `last_row`, downwards or upwards.

    Rows are counted from the top of the arrays, which may be a part of an image: rows around those that are
    visited belong to the image, rows beyond the arrays do not.

    Parameters
    ----------
    main, sheared
        ``(2, H, W)`` and ``(2, H, W + depth + LANES)`` uint64 census planes; the auxiliary view's sheared.
    guide
        ``(H, W)`` float32.
    settings, layouts, part
        See `Settings`, `Layouts` and `Part`.
    sweep
        Buffers of this direction, kept from call to call.
    first_row, last_row, step
        Rows to visit, both included; `step` is 1 or -1. The path along a row goes right or left accordingly.
    second
        Whether the other direction has visited these rows: then the winners are taken.
    volume
        ``(cells)`` uint16, packed sums of the first visit, row by row.
    winners
        Results.
    """
    height, width = guide.shape
    longest = layouts.depth.max()
    beyond = np.zeros(2 * longest, dtype=np.uint16)
    beyond[longest:] = LARGEST
    nowhere = np.zeros(width + 2, dtype=np.bool_)
    layout = layout_of(layouts, (first_row + part.top) // layouts.rows)
    clear = 0
    for y in range(first_row, last_row + step, step):
        begins = not 0 <= y - step < height
        n = (y + part.top) // layouts.rows
        n_before = n if begins else (y - step + part.top) // layouts.rows
        if y == first_row or n != n_before:
            layout = layout_of(layouts, n)
            layout_before = layout_of(layouts, n_before)
            clear = 2
            if not second:
                unequal_codes_row(main, sheared, y - step, settings, layout, sweep.unequal[(y - step) % 3])
                unequal_codes_row(main, sheared, y, settings, layout, sweep.unequal[y % 3])
        else:
            layout_before = layout
        if clear > 0:  # the gaps of another layout are elsewhere
            sweep.paths[y % 2] = 255
            sweep.along[:] = 255
            clear -= 1
        if not second:
            unequal_codes_row(main, sheared, y + step, settings, layout, sweep.unequal[(y + step) % 3])
            rows = 1 + int(y > 0) + int(y < height - 1)
            matching_cost_row(sweep.unequal, rows, sweep.columns, settings, layout, sweep.cost)
        if begins:
            sweep.penalties[:] = 0
            sweep.least[1 - y % 2] = 0
        else:
            for p in range(3):
                penalty_row(guide[y], guide[y - step], 1 - p, settings, sweep.penalties[p])
        penalty_row(guide[y], guide[y], step, settings, sweep.penalties[3])
        start = 0
        if part.kept:
            start = layouts.start[n] + (y + part.top - n * layouts.rows) * layouts.size[n] - part.begin
        packed = volume[start : start + layouts.size[n]]
        alike = layout.alike if n == n_before else nowhere
        path_sum_row(sweep, y, step, second, settings, layout, layout_before, alike, beyond, packed)
        if second:
            best_of_row(sweep.totals, settings, layout, sweep.best_main, sweep.best_auxiliary)
            take_winners(sweep, packed, y, settings, layout, winners)
