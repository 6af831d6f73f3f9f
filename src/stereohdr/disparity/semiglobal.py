"""Semi-global matching of both views from one cost volume (Hirschmueller 2008)."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from stereohdr.config import LARGEST_DISPARITY, SemiGlobalConfig
from stereohdr.disparity._semiglobal_kernels import Settings, Winners, new_sweep, visit_rows
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


def match_semiglobal(
    main_planes: NDArray[np.uint64],
    auxiliary_planes: NDArray[np.uint64],
    guide_main: NDArray[np.float32],
    *,
    disparities: tuple[int, int],
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
        nearest pixel of its row.

    Raises
    ------
    InputError
        The shapes differ, or the range is empty, too long, or has no partner for any pixel.

    Notes
    -----
    The matching cost C is the number of unequal census codes, its mean over 3x3 pixels rounded half up. A path
    that comes to pixel p from its neighbour q adds ``L(p, d) = C(p, d) - min L(q) + min(L(q, d), L(q, d - 1) + P1,
    L(q, d + 1) + P1, min L(q) + P2)``. The smallest sum over all paths wins, of equal ones the smallest disparity,
    refined to where two lines of equal slope meet (costs rise linearly, not like a parabola) unless it is at an
    end of the range or beside a disparity that leaves the view. A strong P1 pulls a surface at one constant
    fractional disparity towards whole numbers.

    Memory is `semiglobal_bytes`, mostly 2 bytes per pixel and disparity. One sweep goes down the image and another
    up, four paths each, and leave their sums; past the middle each adds the other's. So every row is visited
    twice, two threads share the work evenly, and more of them would find none.

    References
    ----------
    H. Hirschmueller, Stereo processing by semiglobal matching and mutual information, PAMI 30(2), 2008.
    """
    config = config or SemiGlobalConfig()
    main = np.ascontiguousarray(main_planes, dtype=np.uint64)
    guide = np.ascontiguousarray(guide_main, dtype=np.float32)
    _check_shapes(main, auxiliary_planes, guide)
    height, width = guide.shape
    lowest, highest = disparities
    _check_range(lowest, highest, width)
    count = highest - lowest + 1
    depth = -(-count // LANES) * LANES
    settings = Settings(
        lowest,
        count,
        config.outside_cost,
        np.uint8(config.small_penalty),
        np.float32(config.large_penalty),
        np.float32(config.edge_factor),
        config.paths == 8,
    )
    sheared = _shear(auxiliary_planes, lowest, depth)
    volume = np.empty((height, width * depth), dtype=np.uint16)
    winners = Winners(
        np.empty((2, height, width), dtype=np.float32),
        np.empty((2, height, width), dtype=np.uint16),
        np.empty((2, height, width), dtype=np.uint16),
        np.empty((2, height, width), dtype=np.uint8),
    )
    sweeps = {step: new_sweep(width, count) for step in (1, -1)}

    def visit(step: int, first_row: int, last_row: int, second: bool) -> None:
        visit_rows(
            main, sheared, guide, settings, sweeps[step], first_row, last_row, step, second, volume, winners
        )

    middle = height // 2
    with ThreadPoolExecutor(min(threads or available_threads(), 2)) as pool:
        for second, down, up in (
            (False, (0, middle - 1), (height - 1, middle)),
            (True, (middle, height - 1), (middle - 1, 0)),
        ):
            for task in [pool.submit(visit, 1, *down, second), pool.submit(visit, -1, *up, second)]:
                task.result()

    _lend_values(winners, lowest, highest)
    of_main, of_auxiliary = (SemiGlobalMatch(*(values[view] for values in winners)) for view in range(2))
    return of_main, of_auxiliary


def semiglobal_bytes(height: int, width: int, disparities: tuple[int, int]) -> int:
    """Return the memory in bytes that `match_semiglobal` takes beside its input, to about 5 %."""
    depth = -(-(disparities[1] - disparities[0] + 1) // LANES) * LANES
    volume = 2 * height * width * depth
    rows = 2 * width * 14 * (depth + LANES)
    planes_and_results = height * (16 * (width + depth) + 18 * width)
    return volume + rows + planes_and_results


def _check_shapes(main: NDArray[np.uint64], auxiliary: NDArray[np.uint64], guide: NDArray[np.float32]) -> None:
    expected = (2, *guide.shape)
    if guide.ndim != 2 or guide.size == 0 or main.shape != expected or auxiliary.shape != expected:
        raise InputError(
            f"census planes must be (2, H, W) and the guide (H, W) of the same, not empty, images; "
            f"got {main.shape}, {auxiliary.shape} and {guide.shape}"
        )


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


def _lend_values(winners: Winners, lowest: int, highest: int) -> None:
    """Give the auxiliary pixels without a partner the values of the nearest pixel of the row that has one."""
    width = winners.disparity.shape[2]
    first, last = max(0, -highest), min(width - 1, width - 1 - lowest)
    for values in winners:
        values[1, :, :first] = values[1, :, first, None]
        values[1, :, last + 1 :] = values[1, :, last, None]
