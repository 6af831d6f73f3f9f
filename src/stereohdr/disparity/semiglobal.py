"""Semi-global matching of both views from one cost volume (Hirschmueller 2008)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import LARGEST_DISPARITY, SemiGlobalConfig
from stereohdr.disparity._semiglobal_kernels import GAP, Layouts, Part, Settings, Winners, new_sweep, visit_rows
from stereohdr.errors import InputError
from stereohdr.strips import available_threads
from stereohdr.vectors import LANES


@dataclass(frozen=True, eq=False)
class SemiGlobalMatch:
    """The disparity of every pixel of a view, and how good the match is.

    Parameters
    ----------
    disparity
        ``(H, W)`` float32, pixels, ``x_main = x_auxiliary + disparity``; may be negative.
    cost
        ``(H, W)`` uint16, the winner's cost, summed over the paths.
    margin
        ``(H, W)`` uint16, how much more the best disparity at least 2 px away costs; 65535 where there is none.
    matching_cost
        ``(H, W)`` uint8, the winner's own matching cost, 0 (equal) to 48.
    """

    disparity: NDArray[np.float32]
    cost: NDArray[np.uint16]
    margin: NDArray[np.uint16]
    matching_cost: NDArray[np.uint8]


Strip = tuple[int, int]
"""The first row of some, and one past the last."""


@dataclass(frozen=True, eq=False)
class Bands:
    """The disparities that the pixels of a view try, block by block.

    Parameters
    ----------
    block
        Side of the square blocks in pixels, at least 2; the last ones of a row or column may be cut.
    lowest
        ``(rows of blocks, columns of blocks)`` int64, each block's smallest disparity.
    count
        The same shape, how many it has from there on, at least 1.
    """

    block: int
    lowest: NDArray[np.int64]
    count: NDArray[np.int64]


def match_semiglobal(
    main_planes: NDArray[np.uint64],
    auxiliary_planes: NDArray[np.uint64],
    guide_main: NDArray[np.float32],
    *,
    disparities: tuple[int, int],
    bands: Bands | None = None,
    config: SemiGlobalConfig | None = None,
    threads: int | None = None,
) -> tuple[SemiGlobalMatch, SemiGlobalMatch]:
    """Match every pixel of both views.

    Parameters
    ----------
    main_planes, auxiliary_planes
        ``(2, H, W)`` uint64, see `census_transform`. The main view is the left one.
    guide_main
        ``(H, W)`` float32, finite: log luminance of the main view, smoothed. Where it changes, depth may.
    disparities
        The smallest and the largest disparity to try, pixels; may be negative.
    bands
        Which of these each block of the main view tries; all of them when None.
    config
        Penalties.
    threads
        Threads to use, at most two; does not change the result.

    Returns
    -------
    of_main, of_auxiliary
        Both from the same sums; every pixel has a value. A main pixel may have its partner outside the auxiliary
        view (``x - disparity`` below 0 or above W - 1), at the constant `outside_cost`. An auxiliary pixel has
        its partner inside the main view; where no disparity of the range allows that, it takes the values of the
        nearest pixel of its row. An auxiliary pixel that no main pixel's band leads to has disparity 65535.

    Raises
    ------
    InputError
        The shapes differ, the range is empty, too long, or has no partner for any pixel, or a band leaves it.

    Notes
    -----
    The matching cost C is the number of unequal census codes, its mean over 3x3 pixels rounded half up. A path
    that comes to pixel p from its neighbour q adds ``L(p, d) = C(p, d) - min L(q) + min(L(q, d), L(q, d - 1) + P1,
    L(q, d + 1) + P1, min L(q) + P2)``. The smallest sum over all paths wins, of equal ones the smallest disparity,
    refined to where two lines of equal slope meet (costs rise linearly, not like a parabola) unless it is at an
    end of the range or beside a disparity that leaves the view. A strong P1 pulls a surface at one constant
    fractional disparity towards whole numbers.

    With bands, everything is as if the other disparities did not exist: a path finds its way between neighbours
    with different bands, at P2 where they have none in common. (Its L is held up to 255; so a P2 above 103 counts
    less there.)

    Memory is `semiglobal_bytes`, mostly 2 bytes per pixel and disparity. One sweep goes down the image and another
    up, four paths each, and leave their sums; past the middle each adds the other's. So every row is visited
    twice, two threads share the work evenly, and more of them would find none.

    References
    ----------
    H. Hirschmueller, Stereo processing by semiglobal matching and mutual information, PAMI 30(2), 2008.
    """
    planes = np.shape(main_planes)
    if len(planes) != 3 or 0 in planes:
        raise InputError(f"census planes must be (2, H, W) of an image that is not empty, got {planes}")
    matcher = StripMatcher(planes[1:], disparities=disparities, bands=bands, config=config, threads=threads)
    return matcher.match((0, planes[1]), main_planes, auxiliary_planes, guide_main)


class StripMatcher:
    """Semi-global matching of an image strip by strip, with the same result as in one piece.

    Two of the sweeps that `match_semiglobal` describes go down and up the image. From strip to strip the one that
    goes down goes on; where the one that goes up comes into a strip from below is found out beforehand, by
    `prepare`, which is a third of the work.

    Parameters
    ----------
    shape
        Rows and columns of the image.
    disparities, bands, config, threads
        See `match_semiglobal`.

    Raises
    ------
    InputError
        See `match_semiglobal`.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        *,
        disparities: tuple[int, int],
        bands: Bands | None = None,
        config: SemiGlobalConfig | None = None,
        threads: int | None = None,
    ) -> None:
        config = config or SemiGlobalConfig()
        lowest, highest = disparities
        _check_range(lowest, highest, shape[1])
        if bands is None:
            whole = np.array([[lowest]]), np.array([[highest - lowest + 1]])
            self._layouts = _layouts(shape, shape, *whole)
        else:
            _check_bands(bands, shape, lowest, highest)
            self._layouts = _layouts(shape, (bands.block, bands.block), bands.lowest, bands.count)
        self._settings = Settings(
            lowest,
            highest - lowest + 1,
            config.outside_cost,
            np.uint8(config.small_penalty),
            np.float32(config.large_penalty),
            np.float32(config.edge_factor),
            config.paths == 8,
        )
        self._shape = shape
        self._threads = min(threads or available_threads(), 2)
        self._sweeps = {step: new_sweep(self._settings, self._layouts) for step in (1, -1)}
        self._entering: dict[int, tuple[NDArray[np.uint8], NDArray[np.uint8]]] = {}

    def rows_around(self, strip: Strip) -> Strip:
        """Return the rows that are to be given for a strip: it, and some above and below."""
        return max(strip[0] - STRIP_MARGIN, 0), min(strip[1] + STRIP_MARGIN, self._shape[0])

    def cells(self, strip: Strip) -> int:
        """Return the number of cells of a strip; each takes 2 bytes."""
        return self._first_cell(strip[1]) - self._first_cell(strip[0])

    def prepare(
        self,
        strip: Strip,
        main_planes: NDArray[np.uint64],
        auxiliary_planes: NDArray[np.uint64],
        guide_main: NDArray[np.float32],
    ) -> None:
        """Follow the paths that go up through a strip, to where they leave it.

        Call this for all strips but the first one, from the last one on, before the first `match`. Parameters are
        those of `match`.
        """
        views = self._views(strip, main_planes, auxiliary_planes, guide_main)
        first, stop = (row - views.top for row in strip)
        part = Part(views.top, 0, False)
        row = np.empty(int(self._layouts.size.max()), dtype=np.uint16)
        self._visit(views, part, -1, stop - 1, first, False, row, _new_winners((0, 0)))
        sweep = self._sweeps[-1]
        self._entering[strip[0]] = sweep.paths[first % 2].copy(), sweep.least[first % 2].copy()

    def match(
        self,
        strip: Strip,
        main_planes: NDArray[np.uint64],
        auxiliary_planes: NDArray[np.uint64],
        guide_main: NDArray[np.float32],
        *,
        scratch: NDArray[np.uint16] | None = None,
    ) -> tuple[SemiGlobalMatch, SemiGlobalMatch]:
        """Match a strip; strips follow one another from the first row to the last.

        Parameters
        ----------
        strip
            First row, an even number, and one past the last.
        main_planes, auxiliary_planes, guide_main
            As for `match_semiglobal`, of the rows that `rows_around` says.
        scratch
            Memory for `cells` numbers at least, whatever they are; allocated when None.

        Returns
        -------
        The match of both views, ``(rows of the strip, W)``.
        """
        if strip[0] % 2 or not (strip[1] == self._shape[0] or strip[1] in self._entering):
            raise InputError(f"rows {strip[0]} to {strip[1]}: prepare the rows below, and begin at an even row")
        views = self._views(strip, main_planes, auxiliary_planes, guide_main)
        first, stop = (row - views.top for row in strip)
        part = Part(views.top, self._first_cell(strip[0]), True)
        volume = np.empty(self.cells(strip), dtype=np.uint16) if scratch is None else scratch
        winners = _new_winners(views.guide.shape)
        if strip[1] in self._entering:
            sweep = self._sweeps[-1]
            sweep.paths[stop % 2], sweep.least[stop % 2] = self._entering.pop(strip[1])
        middle = (first + stop) // 2
        with ThreadPoolExecutor(self._threads) as pool:
            for second, down, up in (
                (False, (first, middle - 1), (stop - 1, middle)),
                (True, (middle, stop - 1), (middle - 1, first)),
            ):
                tasks = [
                    pool.submit(self._visit, views, part, step, *rows, second, volume, winners)
                    for step, rows in ((1, down), (-1, up))
                ]
                for task in tasks:
                    task.result()
        _lend_values(winners, self._settings)
        rows = slice(first, stop)
        return _match_of(winners, 0, rows), _match_of(winners, 1, rows)

    def _visit(
        self,
        views: _Views,
        part: Part,
        step: int,
        first_row: int,
        last_row: int,
        second: bool,
        volume: NDArray[np.uint16],
        winners: Winners,
    ) -> None:
        visit_rows(
            views.main,
            views.sheared,
            views.guide,
            self._settings,
            self._layouts,
            part,
            self._sweeps[step],
            first_row,
            last_row,
            step,
            second,
            volume,
            winners,
        )

    def _views(
        self,
        strip: Strip,
        main_planes: NDArray[np.uint64],
        auxiliary_planes: NDArray[np.uint64],
        guide_main: NDArray[np.float32],
    ) -> _Views:
        top, bottom = self.rows_around(strip)
        main = np.ascontiguousarray(main_planes, dtype=np.uint64)
        guide = np.ascontiguousarray(guide_main, dtype=np.float32)
        expected = (bottom - top, self._shape[1])
        if guide.shape != expected or not main.shape == auxiliary_planes.shape == (2, *expected):
            raise InputError(
                f"census planes must be (2, H, W) and the guide (H, W), with {expected} rows and columns; "
                f"got {main.shape}, {auxiliary_planes.shape} and {guide.shape}"
            )
        sheared = _shear(
            auxiliary_planes, self._settings.lowest, _whole_vectors(self._settings.disparities) + LANES
        )
        return _Views(top, main, sheared, guide)

    def _first_cell(self, row: int) -> int:
        """Return the number of the first cell of a row; that of all cells for the row after the last."""
        layouts = self._layouts
        n = min(row // layouts.rows, len(layouts.size) - 1)
        return int(layouts.start[n] + (row - n * layouts.rows) * layouts.size[n])


STRIP_MARGIN = 2
"""Rows above and below a strip that its rows depend on; even, see `Part.top`."""


class _Views(NamedTuple):
    """The rows of a strip and those around it."""

    top: int
    main: NDArray[np.uint64]
    sheared: NDArray[np.uint64]
    guide: NDArray[np.float32]


def _match_of(winners: Winners, view: int, rows: slice) -> SemiGlobalMatch:
    return SemiGlobalMatch(
        winners.disparity[view, rows],
        winners.cost[view, rows],
        winners.margin[view, rows],
        winners.matching_cost[view, rows],
    )


def _new_winners(shape: tuple[int, ...]) -> Winners:
    return Winners(
        np.empty((2, *shape), dtype=np.float32),
        np.empty((2, *shape), dtype=np.uint16),
        np.empty((2, *shape), dtype=np.uint16),
        np.empty((2, *shape), dtype=np.uint8),
    )


def semiglobal_bytes(height: int, width: int, disparities: tuple[int, int]) -> int:
    """Return the memory in bytes that `match_semiglobal` takes beside its input, to about 5 %."""
    return matcher_bytes(width, disparities, 1) + strip_bytes(height, width, disparities)


def matcher_bytes(width: int, disparities: tuple[int, int], strips: int) -> int:
    """Return the memory in bytes that a `StripMatcher` keeps from strip to strip; less with bands."""
    cells = width * _whole_vectors(disparities[1] - disparities[0] + 1)
    line = cells + width * LANES
    return 2 * (7 * cells + 7 * line) + 3 * line * (strips - 1)


def strip_bytes(rows: int, width: int, disparities: tuple[int, int], bands: Bands | None = None) -> int:
    """Return the memory in bytes that `StripMatcher.match` takes for so many rows, those of the bands if given."""
    depth = _whole_vectors(disparities[1] - disparities[0] + 1)
    cells = rows * width * depth
    if bands is not None:
        columns = np.minimum(width - bands.block * np.arange(bands.count.shape[1]), bands.block)
        heights = np.minimum(rows - bands.block * np.arange(len(bands.count)), bands.block)
        cells = int((_whole_vectors(bands.count) * columns * heights[:, None]).sum())
    planes_and_results = 16 * (width + depth + LANES) + 18 * width
    return 2 * cells + (rows + 2 * STRIP_MARGIN) * planes_and_results


def _check_bands(bands: Bands, shape: tuple[int, int], lowest: int, highest: int) -> None:
    expected = tuple(-(-size // max(bands.block, 1)) for size in shape)
    if bands.block < 2 or bands.lowest.shape != expected or bands.count.shape != expected:
        raise InputError(
            f"bands of {bands.block}x{bands.block} pixels of a {shape[1]}x{shape[0]} image are {expected} "
            f"numbers, got {bands.lowest.shape} and {bands.count.shape}"
        )
    last = bands.lowest + bands.count - 1
    if (bands.count < 1).any() or (bands.lowest < lowest).any() or (last > highest).any():
        raise InputError(f"every band must hold some of the disparities {lowest} to {highest}, and no others")


def _check_range(lowest: int, highest: int, width: int) -> None:
    if not 0 <= highest - lowest <= LARGEST_DISPARITY:
        raise InputError(
            f"a range of disparities goes from the smallest to the largest, over at most {LARGEST_DISPARITY}; "
            f"got {lowest} to {highest}"
        )
    if lowest >= width or highest <= -width:
        raise InputError(
            f"disparities from {lowest} to {highest} leave an image {width} pixels wide at every pixel; "
            f"give a range that includes smaller ones"
        )


def _shear(planes: NDArray[np.uint64], lowest: int, depth: int) -> NDArray[np.uint64]:
    """Return ``(2, H, W + depth)`` planes with pixel x at ``W - 1 - lowest - x``, 0 where there is none."""
    _, height, width = planes.shape
    sheared = np.zeros((2, height, width + depth), dtype=np.uint64)
    start, stop = max(-lowest, 0), min(width - lowest, width + depth)
    sheared[:, :, start:stop] = planes[:, :, ::-1][:, :, start + lowest : stop + lowest]
    return sheared


def _lend_values(winners: Winners, settings: Settings) -> None:
    """Give the auxiliary pixels without a partner the values of the nearest pixel of the row that has one."""
    width = winners.disparity.shape[2]
    lowest, highest = settings.lowest, settings.lowest + settings.disparities - 1
    first, last = max(0, -highest), min(width - 1, width - 1 - lowest)
    for values in winners:
        values[1, :, :first] = values[1, :, first, None]
        values[1, :, last + 1 :] = values[1, :, last, None]


def _whole_vectors(count):
    """Return a number of disparities, or many, rounded up to whole vectors."""
    return -(-count // LANES) * LANES


def _layouts(
    shape: tuple[int, int], block: tuple[int, int], lowest: NDArray[np.integer], count: NDArray[np.integer]
) -> Layouts:
    """Return where the cells of every row are, for blocks of so many rows and columns."""
    height, width = shape
    blocks = np.clip(np.arange(-1, width + 1) // block[1], 0, lowest.shape[1] - 1)
    lowest, count = (np.ascontiguousarray(values[:, blocks], dtype=np.int64) for values in (lowest, count))
    depth = _whole_vectors(count)
    cells = np.zeros_like(depth)
    cells[:, 2:] = np.cumsum(depth[:, 1:-1], axis=1)
    one_band = len(np.unique(lowest)) == 1 and len(np.unique(count)) == 1
    # Where all have the same band, a step goes to the next cell at most, and may go to one that a vector adds.
    stride = (count // LANES + 1) * LANES if one_band else depth + GAP
    place = GAP + np.cumsum(stride, axis=1) - stride
    same = (lowest[:, 1:] == lowest[:, :-1]) & (count[:, 1:] == count[:, :-1])
    alike = np.zeros(lowest.shape, dtype=bool)
    alike[:, 1:-1] = same[:, 1:] & same[:, :-1]
    size = cells[:, -1].copy()
    rows = np.minimum(height - block[0] * np.arange(len(size)), block[0])
    start = np.cumsum(size * rows) - size * rows
    return Layouts(block[0], block[1], lowest, count, depth, cells, place, alike, size, start)
