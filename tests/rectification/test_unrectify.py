from dataclasses import replace

import numpy as np
import pytest
from stereo_rigs import photographed, rig

from stereohdr import ResponseCurve, SourceFlag, StereoPair, fuse
from stereohdr.errors import InputError
from stereohdr.model import DisparityFlag
from stereohdr.radiance import initial_radiance
from stereohdr.rectification import rectify_pair, unrectified

pytest.importorskip("cv2")

TURNED = {"left": (0.5, 1.0, -1.0), "right": (-0.5, -1.0, 1.0)}
SRGB = ResponseCurve.srgb()


@pytest.fixture(scope="module", params=["left", "right"])
def case(world, request):
    photos = photographed(world, **TURNED, times=(0.25, 0.0625))
    pair = rectify_pair(*photos, calibration=rig(**TURNED), main=request.param)
    result = fuse(StereoPair(pair.left, pair.right, request.param), "mv-only", response=SRGB, checks=False)
    return photos, pair, result


def main_photo(case):
    photos, _, result = case
    return photos[result.main == "right"]


def test_what_was_measured_is_the_photos_own(case):
    _, pair, result = case
    photo = main_photo(case)
    back = unrectified(result, pair.rectification, photo, response=SRGB)
    expected = initial_radiance(photo, SRGB, exposure=photo.exposure_time)
    np.testing.assert_array_equal(back.radiance, expected)
    assert back.source.shape == (photo.height, photo.width)
    assert set(np.unique(back.source)) <= {SourceFlag.MEASURED, SourceFlag.NO_INFORMATION}


def test_what_was_restored_lands_where_it_belongs(case, world):
    _, pair, result = case
    photo, view = main_photo(case), pair.rectification.view(result.main)
    marked = replace(
        result,
        radiance=result.radiance * 3,
        source=np.full_like(result.source, SourceFlag.AUXILIARY),
        weight=np.ones_like(result.weight),
    )
    back = unrectified(marked, pair.rectification, photo, response=SRGB)
    restored = back.source == SourceFlag.AUXILIARY
    assert 0.75 < restored.mean() < 1
    np.testing.assert_array_equal(back.weight[restored], 1)
    assert (back.weight[~restored] == 0).all()
    own = initial_radiance(photo, SRGB, exposure=photo.exposure_time)
    np.testing.assert_array_equal(back.radiance[~restored], own[~restored])
    usable = restored & (photo.codes < 240).all(axis=2) & (photo.codes > 20).all(axis=2)
    error = np.log2(back.radiance / own / 3)[usable]
    assert abs(np.median(error)) < 0.02
    assert np.median(np.abs(error)) < 0.1  # twice interpolated
    y, x = np.mgrid[: photo.height, : photo.width].astype(float)
    np.testing.assert_array_equal(
        restored, _inside(view.from_photo(np.stack([x, y], axis=-1)), pair.rectification.size)
    )


def _inside(at, size):
    return ((at >= -1e-5) & (at <= np.array(size) - 1 + 1e-5)).all(axis=-1)


def test_disparities_sit_at_the_pixels_of_the_photos(case, world):
    photos, pair, result = case
    other = "right" if result.main == "left" else "left"
    width, height = pair.rectification.size
    columns = np.tile(np.arange(width, dtype=np.float32), (height, 1))
    matched = np.full((height, width), DisparityFlag.MATCHED, np.uint8)
    marked = replace(
        result,
        disparity=replace(result.disparity, values=columns, flags=matched),
        main_disparity=replace(result.disparity, values=columns, flags=matched),
        confidence=np.ones((height, width), np.float32),
    )
    back = unrectified(marked, pair.rectification, main_photo(case), response=SRGB)
    for side, found in ((other, back.disparity), (result.main, back.main_disparity)):
        view = pair.rectification.view(side)
        photo = photos[side == "right"]
        pixels = np.stack(np.meshgrid(np.arange(photo.width), np.arange(photo.height)), axis=-1).astype(float)
        expected = view.from_photo(pixels)[..., 0]
        known = found.flags == DisparityFlag.MATCHED
        assert known.mean() > 0.75
        assert np.abs(found.values - expected)[known].max() <= 0.5
        assert (found.values[~known] == 0).all()
    assert back.confidence.shape == back.source.shape
    assert back.confidence.max() == 1


def test_results_know_how_they_were_rectified(case):
    photos, pair, result = case
    kept = pair.finished(result)
    assert kept.rectification is pair.rectification.report
    assert kept.radiance is result.radiance
    back = pair.finished(result, photos, response=SRGB)
    assert back.rectification is pair.rectification.report
    assert back.source.shape == photos[0].codes.shape[:2]


def test_linear_photos_get_their_white_balance_and_colours(world):
    matrix = np.array([[1.5, -0.4, -0.1], [-0.2, 1.4, -0.2], [0.0, -0.5, 1.5]])
    photos = [
        replace(
            photo,
            response=ResponseCurve.linear(3, white_level=4095),
            white_balance=(2.0, 1.0, 1.5),
            colour_matrix=matrix,
        )
        for photo in photographed(world, **TURNED, times=(0.25, 0.0625), bits=12)
    ]
    pair = rectify_pair(*photos, calibration=rig(**TURNED))
    result = fuse(StereoPair(pair.left, pair.right), "mv-only", checks=False)
    back = unrectified(result, pair.rectification, photos[0])
    plain = fuse(StereoPair(*photos), "mv-only", checks=False)
    np.testing.assert_allclose(back.radiance, plain.radiance, rtol=1e-6)


def test_another_photo(case):
    _, pair, result = case
    photo = main_photo(case)
    with pytest.raises(InputError, match="the result was rectified from 360x270"):
        unrectified(result, pair.rectification, replace(photo, codes=photo.codes[1:]))
    with pytest.raises(InputError, match="the result was rectified from"):
        unrectified(replace(result, source=result.source[1:]), pair.rectification, photo)
