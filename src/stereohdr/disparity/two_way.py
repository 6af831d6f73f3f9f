"""Disparity of both views, matched once along the edges of each, and what was found out about every pixel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.config import CensusConfig, SemiGlobalConfig, TwoWayConfig
from stereohdr.disparity import _two_way_kernels as kernels
from stereohdr.disparity.census import census_transform
from stereohdr.disparity.semiglobal import Bands, SemiGlobalMatch, Strip, StripMatcher
from stereohdr.model import Disparity, DisparityFlag
from stereohdr.strips import run_together
from stereohdr.warping import main_view_disparity

GUIDE_SIGMA = 0.8
"""Gaussian that smooths the log luminance before its edges guide the penalties, pixels."""

DARKEST_GUIDE = 1e-12
"""Luminance below it is raised to it before the logarithm."""

CODE_RADIUS = 3
"""Rows above and below that the code and the guide of a row depend on."""


@dataclass(frozen=True, eq=False)
class ViewMatch:
    """The disparity of one view.

    Parameters
    ----------
    disparity
        A value and a flag for every pixel; ``MATCHED`` where the left-right check confirms it.
    confidence
        ``(H, W)`` float32, 0..1: see `match_two_ways`.
    """

    disparity: Disparity
    confidence: NDArray[np.float32]

    def mirrored(self) -> ViewMatch:
        """Return the match seen in a mirror."""
        return replace(self, disparity=self.disparity.mirrored(), confidence=self.confidence[:, ::-1].copy())


class CodedView(NamedTuple):
    """What is compared of a view, and what guides the paths."""

    planes: NDArray[np.uint64]
    """``(2, H, W)``, see `census_transform`."""
    guide: NDArray[np.float32]
    """``(H, W)``, smoothed log luminance."""


CodeRows = Callable[[int, int], tuple[CodedView, CodedView]]
"""Gives both views' rows from the first number to before the second."""


def coded_rows(
    luminance: NDArray[np.float32],
    first: int,
    stop: int,
    *,
    census: CensusConfig | None = None,
    threads: int | None = None,
) -> CodedView:
    """Code the rows `first` to before `stop` of a view, ``(H, W)`` float32 of positive luminance."""
    top, bottom = max(first - CODE_RADIUS, 0), min(stop + CODE_RADIUS, len(luminance))
    part = luminance[top:bottom]
    smooth = ndimage.gaussian_filter(part, GUIDE_SIGMA, mode="nearest")[first - top : stop - top]
    guide = np.log(np.maximum(smooth, np.float32(DARKEST_GUIDE)))
    planes = census_transform(part, config=census, threads=threads)
    return CodedView(planes[:, first - top : stop - top], guide)


def code_both(
    main: NDArray[np.float32],
    auxiliary: NDArray[np.float32],
    first: int,
    stop: int,
    *,
    census: CensusConfig | None = None,
    threads: int | None = None,
) -> tuple[CodedView, CodedView]:
    """Code the same rows of both views, see `coded_rows`."""
    views = (partial(coded_rows, view, first, stop, census=census, threads=1) for view in (main, auxiliary))
    of_main, of_auxiliary = run_together(*views, threads=threads)
    return of_main, of_auxiliary


def match_two_ways(
    main: NDArray[np.float32],
    auxiliary: NDArray[np.float32],
    *,
    disparities: tuple[int, int],
    census: CensusConfig | None = None,
    semiglobal: SemiGlobalConfig | None = None,
    config: TwoWayConfig | None = None,
    threads: int | None = None,
) -> tuple[ViewMatch, ViewMatch]:
    """Match both views, twice: with paths that follow the main view's edges, and the auxiliary view's.

    Depth changes where the brightness of a view does, but a clipped or dark area of one view has no edges; the
    other view may see them. A pixel takes the value of its own view's run if the left-right check confirms it
    there, else that of the other run if it is confirmed there.

    Parameters
    ----------
    main, auxiliary
        ``(H, W)`` float32, luminance of both views, positive, cut to the range that both can see.
    disparities
        Smallest and largest disparity to try, pixels.
    census, semiglobal, config
        Settings.
    threads
        Threads to use; does not change the result.

    Returns
    -------
    main, auxiliary
        The match of each view. Values are sub-pixel. A pixel that no run confirms is ``OCCLUDED`` where no
        confirmed pixel of the other view meets it, and ``MISMATCHED`` else; its value is borrowed, see
        `fill_disparity`. Confidence is 1 where both runs are confirmed and agree, `TwoWayConfig.one_run` where
        one is confirmed, times how clearly the winner beats other depths; 0 where the value is borrowed.
    """

    code = partial(code_both, main, auxiliary, census=census, threads=threads)
    return match_strips(
        code,
        main.shape,
        [(0, len(main))],
        disparities=disparities,
        semiglobal=semiglobal,
        config=config,
        threads=threads,
    )


def match_strips(
    code: CodeRows,
    shape: tuple[int, int],
    strips: Sequence[Strip],
    *,
    disparities: tuple[int, int],
    bands: tuple[Bands, Bands] | None = None,
    semiglobal: SemiGlobalConfig | None = None,
    config: TwoWayConfig | None = None,
    threads: int | None = None,
) -> tuple[ViewMatch, ViewMatch]:
    """Do what `match_two_ways` does strip by strip, with the same result.

    Parameters
    ----------
    code
        Called for the rows of every strip, with some around it; twice, if there is more than one.
    shape
        Rows and columns of the views.
    strips
        First row, an even number, and one past the last of each strip; from the first row to the last.
    bands
        Which of the disparities are tried in the blocks of the main view, and in those of the auxiliary view seen
        in a mirror; all of them when None.
    disparities, semiglobal, config, threads
        See `match_two_ways`.
    """
    config = config or TwoWayConfig()
    # In a mirror the views change places, and so the second run is guided by the auxiliary view.
    runs = [
        StripMatcher(shape, disparities=disparities, bands=own, config=semiglobal, threads=threads)
        for own in (bands or (None, None))[: config.runs]
    ]
    for strip in strips[:0:-1]:
        views = code(*runs[0].rows_around(strip))
        tasks = (partial(run.prepare, strip, *_as_seen(views, n)) for n, run in enumerate(runs))
        run_together(*tasks, threads=threads)

    of_main, of_auxiliary = (
        ViewMatch(Disparity(np.empty(shape, np.float32), np.empty(shape, np.uint8)), np.empty(shape, np.float32))
        for _ in range(2)
    )
    scratch = np.empty(max(run.cells(strip) for run in runs for strip in strips), dtype=np.uint16)
    for strip in strips:
        views = code(*runs[0].rows_around(strip))
        matches = [run.match(strip, *_as_seen(views, n), scratch=scratch) for n, run in enumerate(runs)]
        _combine_runs(matches, config, _rows_of(of_main, strip), _rows_of(of_auxiliary, strip), threads)
    filled = run_together(partial(_filled, of_main), partial(_filled, of_auxiliary), threads=threads)
    return filled[0], filled[1]


def _as_seen(
    views: tuple[CodedView, CodedView], run: int
) -> tuple[NDArray[np.uint64], NDArray[np.uint64], NDArray[np.float32]]:
    """Return the planes and the guide for a run, in a mirror for the second one.

    The order of the bits in a code does not matter, as long as it is the same in both views.
    """
    main, auxiliary = views
    if run == 0:
        return main.planes, auxiliary.planes, main.guide
    return auxiliary.planes[..., ::-1], main.planes[..., ::-1], auxiliary.guide[:, ::-1]


def _rows_of(view: ViewMatch, strip: Strip) -> ViewMatch:
    rows = slice(*strip)
    return ViewMatch(Disparity(view.disparity.values[rows], view.disparity.flags[rows]), view.confidence[rows])


def _combine_runs(
    runs: Sequence[tuple[SemiGlobalMatch, SemiGlobalMatch]],
    config: TwoWayConfig,
    of_main: ViewMatch,
    of_auxiliary: ViewMatch,
    threads: int | None,
) -> None:
    """Write what one or two runs say of each view; what is not matched is not filled yet."""
    along_main = runs[0]
    along_auxiliary = along_main if config.runs == 1 else (_flipped(runs[1][1]), _flipped(runs[1][0]))
    pairs = [along_main] if config.runs == 1 else [along_main, along_auxiliary]
    check = partial(confirmed_left_right, tolerance=config.tolerance)
    confirmed = run_together(*(partial(check, *pair) for pair in pairs), threads=threads)
    if config.runs == 1:
        confirmed.append((np.zeros_like(confirmed[0][0]), np.zeros_like(confirmed[0][1])))
    by_main, by_auxiliary = confirmed
    main_found, auxiliary_found = run_together(
        partial(_combine, along_main[0], along_auxiliary[0], by_main[0], by_auxiliary[0], config, of_main),
        partial(_combine, along_auxiliary[1], along_main[1], by_auxiliary[1], by_main[1], config, of_auxiliary),
        threads=threads,
    )
    main, auxiliary = of_main.disparity, of_auxiliary.disparity
    run_together(
        partial(kernels.mark, main_found, auxiliary.values, auxiliary_found, 1, main.flags),
        partial(kernels.mark, auxiliary_found, main.values, main_found, -1, auxiliary.flags),
        threads=threads,
    )


def given_match(of_auxiliary: Disparity) -> tuple[ViewMatch, ViewMatch]:
    """Return what `match_two_ways` would for a known disparity of the auxiliary view; main view first."""
    of_main = main_view_disparity(of_auxiliary)
    matches = []
    for known in (of_main, of_auxiliary):
        matched = known.flags == DisparityFlag.MATCHED
        flags = np.where(matched, DisparityFlag.MATCHED, DisparityFlag.OCCLUDED).astype(np.uint8)
        complete = Disparity(fill_disparity(replace(known, flags=flags)), flags)
        matches.append(ViewMatch(complete, matched.astype(np.float32)))
    return matches[0], matches[1]


def confirmed_left_right(
    of_main: SemiGlobalMatch, of_auxiliary: SemiGlobalMatch, *, tolerance: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return where each view's partner, inside the other view, has nearly the same disparity, ``(H, W)`` bool."""
    views = [np.ascontiguousarray(view.disparity) for view in (of_main, of_auxiliary)]
    confirmed = np.empty((2, *views[0].shape), dtype=bool)
    kernels.confirm(views[0], views[1], -1, tolerance, confirmed[0])
    kernels.confirm(views[1], views[0], 1, tolerance, confirmed[1])
    return confirmed[0], confirmed[1]


def partner_columns(values: NDArray[np.float32], *, sign: int) -> tuple[NDArray[np.intp], NDArray[np.bool_]]:
    """Return the nearest column ``x + sign * d`` of each pixel, cut to the image, and whether it is inside."""
    width = values.shape[1]
    column = np.arange(width)
    inside = (column + sign * values >= 0) & (column + sign * values <= width - 1)
    # The disparity is rounded, not the column, so that in a mirror halves go the same way.
    return np.clip(column + sign * np.rint(values), 0, width - 1).astype(np.intp), inside


def hidden(of_main: Disparity, of_auxiliary: Disparity, *, tolerance: float) -> NDArray[np.bool_]:
    """Return the main pixels, ``(H, W)`` bool, at whose place the auxiliary view sees something nearer.

    Parameters
    ----------
    of_main, of_auxiliary
        Disparity of both views; that of the auxiliary view counts where it is ``MATCHED``.
    tolerance
        By how much the disparity seen there must exceed that of the pixel, pixels.
    """
    partner, _ = partner_columns(of_main.values, sign=-1)
    seen = np.take_along_axis(of_auxiliary.values, partner, axis=1)
    known = np.take_along_axis(of_auxiliary.flags, partner, axis=1) == DisparityFlag.MATCHED
    return known & (seen > of_main.values + tolerance)


def fill_disparity(disparity: Disparity) -> NDArray[np.float32]:
    """Give every pixel that is not ``MATCHED`` the smaller disparity of the nearest matched pixels of its row.

    What one view hides from the other is background. A row without a match takes the median of all matches.

    Returns
    -------
    ``(H, W)`` float32.
    """
    values = np.ascontiguousarray(disparity.values, dtype=np.float32)
    filled, found = np.empty_like(values), np.empty(len(values), dtype=bool)
    kernels.fill_rows(values, np.ascontiguousarray(disparity.flags), filled, found)
    if not found.all():
        matched = values[disparity.flags == DisparityFlag.MATCHED]
        filled[~found] = np.median(matched) if matched.size else 0
    return filled


def _flipped(match: SemiGlobalMatch) -> SemiGlobalMatch:
    return SemiGlobalMatch(
        match.disparity[:, ::-1], match.cost[:, ::-1], match.margin[:, ::-1], match.matching_cost[:, ::-1]
    )


def _combine(
    own: SemiGlobalMatch,
    other: SemiGlobalMatch,
    own_confirmed: NDArray[np.bool_],
    other_confirmed: NDArray[np.bool_],
    config: TwoWayConfig,
    view: ViewMatch,
) -> NDArray[np.bool_]:
    """Write values and confidence, and return where they are confirmed."""
    runs = [np.ascontiguousarray(a) for a in (own.disparity, other.disparity, own.margin, other.margin)]
    settings = tuple(np.float32(value) for value in (config.tolerance, config.one_run, config.usual_margin))
    kernels.combine(*runs, own_confirmed, other_confirmed, settings, view.disparity.values, view.confidence)
    return own_confirmed | other_confirmed


def _filled(view: ViewMatch) -> ViewMatch:
    return replace(view, disparity=replace(view.disparity, values=fill_disparity(view.disparity)))
