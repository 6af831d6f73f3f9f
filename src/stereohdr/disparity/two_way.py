"""Disparity of both views, matched once along the edges of each, and what was found out about every pixel."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.config import CensusConfig, SemiGlobalConfig, TwoWayConfig
from stereohdr.disparity import _two_way_kernels as kernels
from stereohdr.disparity.census import census_transform
from stereohdr.disparity.semiglobal import SemiGlobalMatch, match_semiglobal
from stereohdr.model import Disparity, DisparityFlag
from stereohdr.warping import main_view_disparity

GUIDE_SIGMA = 0.8
"""Gaussian that smooths the log luminance before its edges guide the penalties, pixels."""

DARKEST_GUIDE = 1e-12
"""Luminance below it is raised to it before the logarithm."""


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
    config = config or TwoWayConfig()
    planes_m = census_transform(main, config=census, threads=threads)
    planes_a = census_transform(auxiliary, config=census, threads=threads)
    along_main = match_semiglobal(
        planes_m, planes_a, _guide(main), disparities=disparities, config=semiglobal, threads=threads
    )
    confirmed = confirmed_left_right(*along_main, tolerance=config.tolerance)
    if config.runs == 1:
        nowhere = np.zeros(main.shape, dtype=bool)
        view_m, view_a = (
            _combined(own, own, found, nowhere, config) for own, found in zip(along_main, confirmed, strict=True)
        )
        return _flagged(view_m, view_a, sign=-1), _flagged(view_a, view_m, sign=1)

    # In a mirror the views change places, and so the second run is guided by the auxiliary view. The order of the
    # bits in a code does not matter, as long as it is the same in both views.
    of_auxiliary, of_main = match_semiglobal(
        planes_a[..., ::-1],
        planes_m[..., ::-1],
        _guide(auxiliary)[:, ::-1],
        disparities=disparities,
        config=semiglobal,
        threads=threads,
    )
    along_auxiliary = (_flipped(of_main), _flipped(of_auxiliary))
    also = confirmed_left_right(*along_auxiliary, tolerance=config.tolerance)
    view_m = _combined(along_main[0], along_auxiliary[0], confirmed[0], also[0], config)
    view_a = _combined(along_auxiliary[1], along_main[1], also[1], confirmed[1], config)
    return _flagged(view_m, view_a, sign=-1), _flagged(view_a, view_m, sign=1)


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


def _guide(luminance: NDArray[np.float32]) -> NDArray[np.float32]:
    smooth = ndimage.gaussian_filter(luminance, GUIDE_SIGMA, mode="nearest")
    return np.log(np.maximum(smooth, np.float32(DARKEST_GUIDE)))


def _flipped(match: SemiGlobalMatch) -> SemiGlobalMatch:
    return SemiGlobalMatch(
        match.disparity[:, ::-1], match.cost[:, ::-1], match.margin[:, ::-1], match.matching_cost[:, ::-1]
    )


def _combined(
    own: SemiGlobalMatch,
    other: SemiGlobalMatch,
    own_confirmed: NDArray[np.bool_],
    other_confirmed: NDArray[np.bool_],
    config: TwoWayConfig,
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]]:
    """Return values, where they are confirmed, and their confidence."""
    views = [np.ascontiguousarray(run.disparity) for run in (own, other)]
    margins = [np.ascontiguousarray(run.margin) for run in (own, other)]
    settings = tuple(np.float32(value) for value in (config.tolerance, config.one_run, config.usual_margin))
    values, confidence = np.empty_like(views[0]), np.empty_like(views[0])
    kernels.combine(*views, *margins, own_confirmed, other_confirmed, settings, values, confidence)
    return values, own_confirmed | other_confirmed, confidence


def _flagged(
    own: tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]],
    other: tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.float32]],
    *,
    sign: int,
) -> ViewMatch:
    values, confirmed, confidence = own
    flags = np.empty(values.shape, dtype=np.uint8)
    kernels.mark(confirmed, other[0], other[1], -sign, flags)
    disparity = Disparity(values, flags)
    return ViewMatch(replace(disparity, values=fill_disparity(disparity)), confidence)
