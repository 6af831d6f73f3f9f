"""Middlebury stereo data: 2005 and 2006 (views, illuminations, exposures), MiddEval3 and 2014 (two views).

References
----------
Scharstein and Pal 2007, "Learning conditional random fields for stereo", doi:10.1109/CVPR.2007.383191 (2005 sets).
Hirschmueller and Scharstein 2007, "Evaluation of cost functions for stereo matching",
doi:10.1109/CVPR.2007.383248 (2006 sets).
Scharstein et al. 2014, "High-resolution stereo datasets with subpixel-accurate ground truth",
doi:10.1007/978-3-319-11752-2_3.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from stereohdr.datasets.brackets import bracket_reference
from stereohdr.datasets.ground_truth import (
    Values,
    disparity_between,
    known_disparities,
    read_disparity,
    reduced_disparity,
)
from stereohdr.datasets.resizing import reduced_photo
from stereohdr.datasets.scene import EvaluationScene, any_channel_out_of_range
from stereohdr.datasets.simulated import SameExposurePair
from stereohdr.errors import FileFormatError, InputError
from stereohdr.io import read_photo
from stereohdr.model import Disparity, Photo, StereoPair
from stereohdr.radiance import initial_radiance
from stereohdr.response.bracket import estimate_bracket_response

FULL_HEIGHT = 1110
"""Rows of every full-size image of 2005 and 2006; half-size ones have 555, third-size ones 370."""

LARGEST_DISPARITY = 240
"""Full-size pixels that suffice for views 1 and 5 of every 2005 and 2006 set."""

TRUTH_VIEWS = (1, 5)
"""The two of the seven equally spaced views (0 to 6, left to right) that have ground truth, for each other."""


@dataclass(frozen=True)
class MiddleburyFolder:
    """One scene of the 2005 and 2006 sets.

    Either the official layout, ``Illum{1..3}/Exp{0..2}/view{0..6}.png`` with an ``exposure_ms.txt`` beside the
    views, or a flat folder with ``view1_Illum1_Exp0.png`` (anything may follow the exposure) and one
    ``exposure_ms.txt`` with a line per exposure. ``disp1.png`` and ``disp5.png`` lie in the folder itself.
    (``dmin.txt`` there is an offset for cropped 3-D reconstruction and has no part in the disparities.)
    """

    folder: Path
    """The folder of the scene."""
    exposure_times: tuple[float, ...] = ()
    """Seconds of exposures 0, 1, ..., where no ``exposure_ms.txt`` states them."""

    def photo_path(self, view: int, illumination: int, exposure: int) -> Path | None:
        """Return the file of one photo, None if it is not there."""
        official = self.folder / f"Illum{illumination}" / f"Exp{exposure}" / f"view{view}.png"
        if official.is_file():
            return official
        return next(iter(sorted(self.folder.glob(f"view{view}_Illum{illumination}_Exp{exposure}*.png"))), None)

    def truth_paths(self) -> tuple[Path, ...]:
        """Return the files of both disparity maps, whether they exist or not."""
        return tuple(self.folder / f"disp{view}.png" for view in TRUTH_VIEWS)

    def photo(self, view: int, illumination: int, exposure: int) -> Photo:
        """Read one photo with its exposure time.

        Raises
        ------
        FileFormatError
            It is not there, cannot be read, or its exposure time is stated nowhere.
        """
        path = self.photo_path(view, illumination, exposure)
        if path is None:
            raise FileFormatError(
                f"{self.folder}: has no photo of view {view}, illumination {illumination}, exposure {exposure}; "
                f"get Illum{illumination}/Exp{exposure}/view{view}.png of the full data set"
            )
        return read_photo(path, exposure_time=self._exposure_time(path, exposure))

    def disparities(self) -> tuple[Values, Values]:
        """Read the ground truth of views 1 and 5, ``(H, W)`` float32 each, in pixels of the images here.

        Raises
        ------
        FileFormatError
            A map is missing, or not of a size that Middlebury publishes.
        """
        maps = [read_disparity(path) for path in self.truth_paths()]
        for path, values in zip(self.truth_paths(), maps, strict=True):
            values /= _size_factor(path, values.shape[0])
        return maps[0], maps[1]

    def size_factor(self) -> int:
        """Return 1, 2 or 3 for images of full, half or third size."""
        path = self.truth_paths()[0]
        return _size_factor(path, read_disparity(path).shape[0])

    def _exposure_time(self, photo: Path, exposure: int) -> float:
        path = photo.with_name("exposure_ms.txt")
        if path.is_file():
            line = exposure if photo.parent == self.folder else 0
            stated = path.read_text(encoding="utf-8", errors="replace").split()
            if line < len(stated) and re.fullmatch(r"[0-9]+(\.[0-9]*)?", stated[line]) and float(stated[line]) > 0:
                return float(stated[line]) / 1000
            raise FileFormatError(
                f"{path}: states no time in milliseconds for exposure {exposure}; get the file again"
            )
        if exposure < len(self.exposure_times):
            return self.exposure_times[exposure]
        raise FileFormatError(
            f"{photo}: its exposure time is stated nowhere; put exposure_ms.txt of the data set beside it"
        )


@dataclass(frozen=True)
class ExposurePair:
    """Two views of a Middlebury scene at two exposures, and how to make a scene of them."""

    main: tuple[int, int]
    """View (1 to 5) and exposure of the MV."""
    auxiliary: tuple[int, int]
    """View (1 to 5) and exposure of the AV."""
    max_disparity: int
    """Pixels after the reduction."""
    bracket: tuple[int, ...]
    """Exposures of the MV that are merged into the reference. When only one exists, the reference is the MV's own
    radiance, flagged where a channel is out of range."""
    auxiliary_bracket: tuple[int, ...] = ()
    """Exposures of the AV's view, which determine the response when the MV has one exposure only."""
    illumination: int = 1
    """1 to 3."""
    reduce: int = 1
    """Blocks of this many pixels are averaged."""


def exposure_scene(name: str, source: MiddleburyFolder, recipe: ExposurePair) -> EvaluationScene:
    """Make a scene of two real photos at two exposures.

    Parameters
    ----------
    name
        Name of the scene.
    source
        Where the photos are.
    recipe
        Which photos, and how they are reduced.

    Returns
    -------
    The view with the lower number is the left one. The ground truth of views 1 and 5 for each other is brought to
    the views in use: views are equally spaced, so the disparity of views 1 and 2 is a quarter of ``disp1``.

    Raises
    ------
    FileFormatError
        A file is missing or damaged.
    InputError
        The two views are the same, or lie outside of those with ground truth.
    """
    views = recipe.main[0], recipe.auxiliary[0]
    first, last = TRUTH_VIEWS
    if views[0] == views[1] or not all(first <= view <= last for view in views):
        raise InputError(
            f"scene {name}: needs two different views of {first} to {last}, got {views[0]} and {views[1]}"
        )

    def read(view: int, exposure: int) -> Photo:
        return reduced_photo(source.photo(view, recipe.illumination, exposure), recipe.reduce)

    main_photo, auxiliary_photo = read(*recipe.main), read(*recipe.auxiliary)
    if views[0] < views[1]:
        pair = StereoPair(main_photo, auxiliary_photo, "left")
    else:
        pair = StereoPair(auxiliary_photo, main_photo, "right")
    truth = _truth_of_views(source.disparities(), sorted(views), recipe.reduce)
    disparity_main, disparity_auxiliary = truth if pair.main == "left" else truth[::-1]

    if len(recipe.bracket) > 1:
        reference, clipped, response = bracket_reference([read(views[0], e) for e in recipe.bracket])
        origin = f"{len(recipe.bracket)} exposures of view {views[0]}"
    else:
        response = estimate_bracket_response([read(views[1], e) for e in recipe.auxiliary_bracket])
        reference = initial_radiance(main_photo, response, exposure=pair.exposures[0])
        clipped = any_channel_out_of_range(main_photo)
        origin = f"view {views[0]} itself, with the response of view {views[1]}"
    return EvaluationScene(
        name=name,
        pair=pair,
        reference=reference,
        reference_clipped=clipped,
        max_disparity=recipe.max_disparity,
        disparity_main=disparity_main,
        disparity_auxiliary=disparity_auxiliary,
        reference_response=response,
        description=f"Middlebury {source.folder.name}, views {views[0]} and {views[1]}; reference: {origin}",
    )


def _truth_of_views(
    truth: tuple[Values, Values], views: Sequence[int], factor: int
) -> tuple[Disparity, Disparity]:
    """Return the flagged disparities of a left and a right view out of 1 to 5, reduced by `factor`."""
    first, last = TRUTH_VIEWS
    share = (views[1] - views[0]) / (last - first)
    left, right = (
        reduced_disparity(disparity_between(*truth, (view - first) / (last - first)) * np.float32(share), factor)
        for view in views
    )
    flagged = known_disparities(left, right)
    assert flagged[0] is not None
    assert flagged[1] is not None
    return flagged[0], flagged[1]


def same_exposure_pair(folder: Path, *, name: str | None = None) -> SameExposurePair:
    """Read views 1 and 5 of a flat Middlebury 2005 or 2006 folder at one exposure.

    Parameters
    ----------
    folder
        Holds ``view1_<something>.png`` and ``view5_<the same>.png``, ``disp1.png`` and ``disp5.png``.
    name
        Name of the folder by default.

    Returns
    -------
    The pair; d_max is 240 full-size pixels, the range of all these sets.

    Raises
    ------
    FileFormatError
        The folder has no such pair.
    """
    tail = common_exposure(folder)
    if tail is None:
        raise FileFormatError(
            f"{folder}: has no view1_*.png and view5_*.png of one exposure with disp1.png and disp5.png; "
            f"give the folder of a Middlebury scene"
        )
    source = MiddleburyFolder(folder)
    left, right = (read_photo(folder / f"view{view}_{tail}.png") for view in TRUTH_VIEWS)
    disparity_left, disparity_right = source.disparities()
    return SameExposurePair(
        name or folder.name,
        left,
        right,
        disparity_left,
        disparity_right,
        LARGEST_DISPARITY // source.size_factor(),
    )


def common_exposure(folder: Path) -> str | None:
    """Return what follows ``view1_`` and ``view5_`` alike in a flat folder with ground truth, or None."""
    tails = [{path.stem.split("_", 1)[1] for path in folder.glob(f"view{view}_*.png")} for view in TRUTH_VIEWS]
    common = sorted(tails[0] & tails[1], key=lambda tail: (tail != "default", tail))
    complete = common and all(path.is_file() for path in MiddleburyFolder(folder).truth_paths())
    return common[0] if complete else None


def two_view_pair(folder: Path, *, name: str | None = None) -> SameExposurePair:
    """Read a pair of MiddEval3 or of the 2014 sets.

    Parameters
    ----------
    folder
        Holds ``im0.png`` (left), ``im1.png``, ``calib.txt``, and the ground truth ``disp0GT.pfm`` or
        ``disp0.pfm``; that of the right view (``disp1GT.pfm``, ``disp1.pfm``) where it is published.
    name
        Name of the folder by default.

    Returns
    -------
    The pair; d_max is ``ndisp`` of ``calib.txt``.

    Raises
    ------
    FileFormatError
        A file is missing or damaged.
    """
    calibration = folder / "calib.txt"
    try:
        text = calibration.read_text(encoding="utf-8", errors="replace")
    except OSError as error:
        raise FileFormatError(
            f"{calibration}: cannot be read ({error.strerror}); give the folder of a Middlebury pair"
        ) from error
    stated = re.search(r"^\s*ndisp\s*=\s*([0-9]+)\s*$", text, re.MULTILINE)
    if stated is None:
        raise FileFormatError(f"{calibration}: states no ndisp (number of disparities); get the file again")
    left, right = (read_photo(folder / f"im{view}.png") for view in (0, 1))
    truth = []
    for view in (0, 1):
        found = [path for stem in (f"disp{view}GT", f"disp{view}") if (path := folder / f"{stem}.pfm").is_file()]
        truth.append(read_disparity(found[0]) if found else None)
    if truth[0] is None:
        raise FileFormatError(f"{folder}: has no disp0GT.pfm or disp0.pfm; get the ground truth of the pair")
    return SameExposurePair(name or folder.name, left, right, truth[0], truth[1], int(stated[1]))


def _size_factor(path: Path, height: int) -> int:
    for factor in (1, 2, 3):
        if height == FULL_HEIGHT // factor:
            return factor
    raise FileFormatError(
        f"{path}: is {height} pixels high; the 2005 and 2006 sets are published with {FULL_HEIGHT}, "
        f"{FULL_HEIGHT // 2} and {FULL_HEIGHT // 3} (cropped or scaled images need a manifest)"
    )
