import numpy as np
import pytest

from stereohdr import Photo, ResponseCurve, StereoHdrWarning, read_photo
from stereohdr.errors import ExposureError, ResponseError
from stereohdr.merging import merge_bracket
from stereohdr.response.bracket import USED_CODES
from stereohdr.simulation import Camera, expose, room

LINEAR = ResponseCurve.gamma(1.0, 1)  # X = z / 128


def merge(*columns, times=(1.0, 4.0)):
    """Merge pixels, each a tuple of one code per photo; padded so that the longer exposures are brighter."""
    rows = np.array([*columns, *[(10, 40, 160)[: len(times)]] * 50], np.uint8).T
    radiance, clipped = merge_bracket(
        [Photo(row[None], time) for row, time in zip(rows, times, strict=True)], response=LINEAR
    )
    return radiance[0, : len(columns), 0], clipped[0, : len(columns)].tolist()


def test_pixels_worked_by_hand():
    radiance, clipped = merge((40, 160), (50, 180), (100, 255), (0, 30))
    # w = 40 and 95: (40 * 40 + 95 * 160) / 128 / (40 * 1 + 95 * 4); w = 50 and 75 likewise
    expected = [131.25 / 420, (50 * 50 + 75 * 180) / 128 / 350, 100 / 128, 30 / 128 / 4]
    np.testing.assert_allclose(radiance, expected, rtol=1e-6)
    assert clipped == [False] * 4


def test_clipped_in_all_photos_takes_the_nearest_bound():
    radiance, clipped = merge((255, 255), (0, 0), (0, 255))
    brightest, darkest = 254 / 128, 1 / 128 / 4  # of the short and of the long photo
    np.testing.assert_allclose(radiance, [brightest, darkest, np.sqrt((254 / 128 / 4) * (1 / 128))], rtol=1e-6)
    assert clipped == [True] * 3


def test_contradicted_codes_are_left_out():
    low, high = USED_CODES
    # Compression leaves 254 in white areas, noise 1 in black ones.
    radiance, clipped = merge((high, 254), (255, 254), (1, low), (1, 0))
    np.testing.assert_allclose(radiance, [high / 128, 254 / 128, low / 128 / 4, 1 / 128 / 4], rtol=1e-6)
    assert clipped == [False, True, False, True]


def test_no_pixel_is_left_without_a_value():
    codes = [0, 1, 2, 3, 100, 249, 250, 254, 255]
    triples = [(a, b, c) for a in codes for b in codes for c in codes]
    radiance, _ = merge(*triples, times=(1.0, 4.0, 16.0))
    assert np.isfinite(radiance).all()
    assert (radiance > 0).all()


def test_a_pixel_is_flagged_when_one_channel_is_lost():
    short = np.full((1, 3, 3), 60, np.uint8)
    long = np.full((1, 3, 3), 120, np.uint8)
    short[0, 1, 2] = long[0, 1, 2] = 255
    radiance, clipped = merge_bracket([Photo(short, 1.0), Photo(long, 2.0)], response=ResponseCurve.gamma(1.0))
    assert clipped.tolist() == [[False, True, False]]
    np.testing.assert_allclose(radiance[0, 1], [60 / 128, 60 / 128, 254 / 128], rtol=1e-6)


def test_twelve_bits():
    codes = np.array([[400, 4095, 3000, 0]], np.uint16), np.array([[1600, 4095, 4095, 0]], np.uint16)
    photos = [Photo(c, t, 4095) for c, t in zip(codes, (1.0, 4.0), strict=True)]
    radiance, clipped = merge_bracket(photos, response=LINEAR)
    knot = 255 / 4095 / 128  # X of one code, from knot 1 on
    np.testing.assert_allclose(radiance[0, :3, 0], [400 * knot, 4094 * knot, 3000 * knot], rtol=1e-4)
    assert clipped.tolist() == [[False, True, False, True]]


@pytest.mark.parametrize("bits", [8, 14])
def test_a_simulated_bracket_gives_the_true_radiance(bits):
    truth = room(width=160, height=120).radiance_left
    truth = np.maximum(truth / np.percentile(truth, 90), 2e-3)
    camera = Camera(response="s-shaped", bits=bits)
    photos = [expose(truth, time, camera, seed) for seed, time in enumerate((0.0625, 0.25, 1.0, 4.0))]
    radiance, clipped = merge_bracket(photos, response=camera.response_curve())
    error = np.log2(radiance / truth)[~clipped]
    error -= np.median(error)
    assert np.sqrt((error**2).mean()) < 0.08
    # Nothing but the window is flagged, and its bound is below the truth.
    assert (truth.max(axis=2)[clipped] > 10).all()
    white = np.all([photo.codes == photo.white for photo in photos], axis=0)
    scale = np.median(radiance / truth)
    assert (radiance[white] <= 1.01 * scale * truth[white]).all()


def test_order_and_unit_of_time():
    truth = np.random.default_rng(0).uniform(0.01, 1, (20, 300, 1))
    photos = [expose(truth, time, Camera(), seed) for seed, time in enumerate((0.25, 1.0, 4.0))]
    radiance, clipped = merge_bracket(photos, response=LINEAR)
    for other in (photos[::-1], [photos[1], photos[2], photos[0]]):
        again = merge_bracket(other, response=LINEAR)
        np.testing.assert_array_equal(again[0], radiance)
        np.testing.assert_array_equal(again[1], clipped)
    thousand = [Photo(p.codes, 1000 * (p.exposure_time or 0)) for p in photos]
    np.testing.assert_allclose(1000 * merge_bracket(thousand, response=LINEAR)[0], radiance, rtol=1e-6)


def test_iso_counts_as_exposure():
    photos = [Photo(np.full((2, 2), z, np.uint8), 1.0, iso=iso) for z, iso in ((40, 100), (160, 400))]
    radiance, _ = merge_bracket(photos, response=LINEAR)
    np.testing.assert_allclose(radiance, 40 / 128)


def test_large_images_are_merged_in_parts_without_seams():
    rng = np.random.default_rng(1)
    codes = rng.integers(5, 120, (600, 7)).astype(np.uint8)
    photos = [Photo(codes, 1.0), Photo(2 * codes, 2.0)]
    radiance, _ = merge_bracket(photos, response=LINEAR)
    np.testing.assert_allclose(radiance[..., 0], codes / 128, rtol=1e-6)


def test_wrong_response_and_wrong_times_are_refused():
    photos = [Photo(np.full((2, 2), z, np.uint8), t) for z, t in ((40, 1.0), (160, 4.0))]
    with pytest.raises(ResponseError, match="3 channel"):
        merge_bracket(photos, response=ResponseCurve.srgb())
    with pytest.raises(ExposureError, match="contradict"):
        merge_bracket([Photo(photos[0].codes, 4.0), Photo(photos[1].codes, 1.0)], response=LINEAR)


def test_missing_white_level_is_warned_of():
    photos = [Photo(np.full((2, 2), z, np.uint16), t) for z, t in ((400, 1.0), (1600, 4.0))]
    with pytest.warns(StereoHdrWarning, match="give the white level 2047"):
        merge_bracket(photos, response=LINEAR)


def test_a_real_bracket_with_exif_times(shared_data):
    photos = [read_photo(path) for path in sorted((shared_data / "brackets" / "room").glob("*.jpg"))]
    radiance, clipped = merge_bracket(photos)
    assert np.isfinite(radiance).all()
    assert (radiance > 0).all()
    assert clipped.mean() < 1e-3
    # The lamp is 2^14 times as bright as the darkest corner, and smooth: no flecks of wrong exposures in it.
    assert 13 < np.log2(np.percentile(radiance, 99.9) / np.percentile(radiance, 0.1)) < 17
    lamp = np.log2(radiance[70:120, 125:160, 1])
    assert np.percentile(np.abs(np.diff(lamp, axis=0)), 99) < 2
