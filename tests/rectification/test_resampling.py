from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stereo_rigs import camera

from stereohdr import Photo, ResponseCurve
from stereohdr.errors import ResponseError
from stereohdr.rectification._kernels import interpolate
from stereohdr.rectification.geometry import RectifiedView
from stereohdr.rectification.resampling import interpolated, largest_scale, resampled_photo

from reference.rectification import interpolate as slow_interpolate


def moved_by(x, y, size):
    """A view whose pixel (0, 0) lies at (x, y) of the photo."""
    model = camera(100.0, size=size, centre=(0.0, 0.0))
    return RectifiedView(model, np.linalg.inv(model.matrix), size).moved(x, y)


def resample(photo, x, y, size=None, **more):
    size = size or (photo.width, photo.height)
    return resampled_photo(photo, moved_by(x, y, (photo.width, photo.height)), size, **more)


@pytest.mark.parametrize(("dtype", "white", "scale"), [(np.uint8, 255, 256), (np.uint16, 4095, 16)])
def test_a_view_that_stays_keeps_every_code(dtype, white, scale):
    codes = np.random.default_rng(0).integers(0, white + 1, (20, 30, 3)).astype(dtype)
    photo = Photo(codes, 0.1, white, f_number=2.0, name="p")
    found, valid = resample(photo, 0, 0)
    np.testing.assert_array_equal(found.codes, codes.astype(np.uint16) * scale)
    assert valid.all()
    assert found.white == white * scale == white * largest_scale(photo)
    assert (found.exposure_time, found.f_number, found.name) == (0.1, 2.0, "p")


def test_whole_pixels_move_codes_and_leave_the_rest_empty():
    codes = np.random.default_rng(1).integers(0, 256, (12, 15, 3)).astype(np.uint8)
    found, valid = resample(Photo(codes), 4, -3)
    np.testing.assert_array_equal(found.codes[3:, :11], codes[:9, 4:].astype(np.uint16) * 256)
    assert valid[3:, :11].all()
    assert valid.sum() == 9 * 11
    assert (found.codes[~valid] == 0).all()


@pytest.mark.parametrize("shift", [(0.5, 0.0), (0.3, 0.7), (0.01, 0.99), (3.25, 2.5)])
def test_a_linear_ramp_is_resampled_exactly(shift):
    y, x = np.mgrid[:16, :20]
    codes = (100 + 32 * x + 48 * y).astype(np.uint16)  # linear codes: exposure is a plane
    found, valid = resample(Photo(codes, white_level=4095), *shift)
    x, y = x + shift[0], y + shift[1]
    expected = np.rint(16 * (100 + 32 * x + 48 * y))
    assert valid.sum() >= 15 * 12
    np.testing.assert_array_equal(valid, (x <= 19) & (y <= 15))
    assert np.abs(found.codes[..., 0] - expected)[valid].max() <= 1  # half a code, and the grid of positions


def test_a_ramp_of_light_is_exact_for_a_curved_response_too():
    response = ResponseCurve.gamma(2.2, channels=1)
    table = response.exposure_table(255)[0]
    light = np.linspace(table[20], table[230], 40)
    codes = np.rint(np.interp(light, table, np.arange(256))).astype(np.uint8)
    photo = Photo(np.tile(codes, (8, 1)))
    found, valid = resample(photo, 0.5, 0.0, response=response)
    values = table[codes]
    expected = (values[:-1] + values[1:]) / 2
    got = response.apply(found.codes, found.white)[4, :-1, 0]
    # Catmull-Rom differs from the mean of two by an eighth of the second differences that rounding left.
    np.testing.assert_allclose(got, expected, rtol=0.02)
    assert valid[:, :-1].all()


def test_a_clipped_neighbour_never_bleeds_into_a_valid_pixel():
    codes = np.full((9, 12, 1), 60, np.uint8)
    codes[:, 6:] = 255
    for share in (0.01, 0.2, 0.49, 0.51, 0.8, 0.99):
        found, _ = resample(Photo(codes), share, 0)
        row = found.codes[4, :, 0]
        assert set(row[:-1]) == {60 * 256, 255 * 256}
        assert (row[:-1] == 255 * 256).sum() == (6 if share > 0.5 else 5)


@given(st.integers(0, 10**6), st.floats(-2, 2), st.floats(-2, 2))
def test_every_pixel_is_made_of_clipped_pixels_or_of_valid_ones(seed, dx, dy):
    rng = np.random.default_rng(seed)
    codes = rng.integers(20, 200, (10, 12, 3)).astype(np.uint8)
    codes[rng.random((10, 12)) < 0.3] = 255
    one_channel = rng.random((10, 12)) < 0.2
    codes[..., 0][one_channel] = 250
    found, valid = resample(Photo(codes), dx, dy)
    for row, column in np.argwhere(valid):
        x, y = column + dx, row + dy
        y0, x0 = np.clip(int(np.floor(y)), 0, 8), np.clip(int(np.floor(x)), 0, 10)
        taps = codes[y0 : y0 + 2, x0 : x0 + 2].reshape(-1, 3)
        kinds = {tuple(kind) for kind in taps >= 248}
        value = found.codes[row, column] / 256
        kind = tuple(value >= 248)
        assert kind in kinds  # nothing between: valid, clipped, or clipped in red only
        same = taps[[tuple(tap) == kind for tap in taps >= 248]]
        assert (value >= same.min(axis=0) - 0.01).all()
        assert (value <= same.max(axis=0) + 0.01).all()


def test_channels_are_mixed_the_same_way_beside_a_clipped_one():
    codes = np.empty((6, 8, 3), np.uint8)
    codes[:, :4], codes[:, 4:] = (100, 100, 100), (255, 200, 150)  # an orange light on a grey wall
    found, _ = resample(Photo(codes), 0.4, 0)
    assert set(map(tuple, found.codes[3, :-1] // 256)) == {(100, 100, 100), (255, 200, 150)}


def test_nothing_overshoots_beside_a_light():
    codes = np.full((12, 12, 1), 30, np.uint16)
    codes[:, 6:] = 3000
    found, valid = resample(Photo(codes, white_level=4095), 0.3, 0.6)
    assert found.codes[valid].min() == 30 * 16
    assert found.codes[valid].max() == 3000 * 16


def test_a_texture_stays_sharper_than_by_linear_interpolation():
    x = np.arange(64)
    wave = 0.5 + 0.4 * np.sin(2 * np.pi * x / 8)
    photo = Photo(np.tile(np.rint(wave * 4095).astype(np.uint16), (8, 1)), white_level=4095)
    found, _ = resample(photo, 0.5, 0)
    expected = 0.5 + 0.4 * np.sin(2 * np.pi * (x + 0.5) / 8)
    inner = slice(4, 59)
    error = np.abs(found.codes[4, :, 0] / found.white - expected)[inner].max()
    linear = np.abs((wave[:-1] + wave[1:])[inner] / 2 - expected[inner]).max()
    assert error < 0.6 * linear


def test_one_scale_can_be_asked_for():
    found, _ = resample(Photo(np.full((4, 5), 1000, np.uint16), white_level=4095), 0, 0, scale=4)
    assert (found.white, found.codes[0, 0, 0]) == (16380, 4000)


def test_a_response_that_falls_is_not_used():
    curve = ResponseCurve.gamma(2.2, channels=1)
    log_exposure = curve.log_exposure.copy()
    log_exposure[0, 100] = log_exposure[0, 120]
    photo = Photo(np.random.default_rng(0).integers(0, 256, (9, 9)).astype(np.uint8))
    one, _ = resample(photo, 0.3, 0.3, response=replace(curve, log_exposure=log_exposure))
    other, _ = resample(photo, 0.3, 0.3)
    np.testing.assert_array_equal(one.codes, other.codes)


def test_the_response_that_a_photo_brings_is_used():
    codes = np.zeros((4, 8, 1), np.uint8)
    codes[:, 4:] = 200
    plain, bringing = Photo(codes), Photo(codes, response=ResponseCurve.linear(1))
    edge = (1, 3)
    assert abs(int(resample(bringing, 0.5, 0)[0].codes[edge][0]) - 100 * 256) < 300
    assert resample(plain, 0.5, 0)[0].codes[edge][0] > 140 * 256  # half of the light is more than half of the code


def test_a_response_for_other_channels():
    with pytest.raises(ResponseError, match=r"3 channel\(s\), grey.png has 1"):
        resample(Photo(np.zeros((4, 4), np.uint8), name="grey.png"), 0, 0, response=ResponseCurve.srgb())


@pytest.mark.parametrize("shape", [(1, 1), (1, 7), (7, 1), (2, 2), (3, 5), (9, 11)])
@pytest.mark.parametrize("channels", [1, 3])
def test_the_kernel_and_its_twin_agree(shape, channels):
    rng = np.random.default_rng(shape[1])
    image = rng.uniform(0, 5, (*shape, channels)).astype(np.float32)
    x, y = rng.uniform(-1, shape[1], 300), rng.uniform(-1, shape[0], 300)
    x[:50], y[25:75] = np.rint(x[:50]), np.rint(y[25:75])
    x[80], y[81] = np.nan, np.inf
    for pattern in (np.zeros(shape, np.uint8), rng.choice(np.array([0, 0, 0, 7, 1], np.uint8), shape)):
        results = []
        for function in (interpolate, slow_interpolate):
            out, inside = np.empty((300, channels), np.float32), np.empty(300, bool)
            function(image, pattern, x, y, 1e-6, out, inside)
            results.append((out, inside))
        np.testing.assert_array_equal(results[0][1], results[1][1])
        np.testing.assert_allclose(results[0][0], results[1][0], rtol=1e-6, atol=1e-6)


def test_positions_keep_their_shape():
    image = np.arange(12, dtype=np.float32).reshape(3, 4, 1)
    values, inside = interpolated(image, np.array([[[1.0, 1.0], [2.5, 0.0]], [[np.nan, 0], [3.1, 0]]]))
    assert values.shape == (2, 2, 1)
    assert inside.tolist() == [[True, True], [False, False]]
    assert values[0, :, 0].tolist() == [5.0, 2.5]
