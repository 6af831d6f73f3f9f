import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Disparity, InputError, Photo, ResponseCurve, StereoPair
from stereohdr.errors import ExposureError, FileFormatError, ResponseError


def photo(time=1.0, shape=(4, 6, 3), dtype=np.uint8, **more):
    return Photo(np.zeros(shape, dtype), time, **more)


def test_grey_gets_a_channel_axis_and_deep_codes_are_cut_at_the_white_level():
    assert photo(shape=(4, 6)).codes.shape == (4, 6, 1)
    deep = Photo(np.array([[100, 5000]], dtype=np.uint16), 1.0, 4095)
    np.testing.assert_array_equal(deep.codes[..., 0], [[100, 4095]])
    assert photo().white == 255
    assert photo(dtype=np.uint16).white == 65535


@pytest.mark.parametrize(
    ("codes", "message"),
    [
        (np.zeros((4, 6)), "uint8 or uint16"),
        (np.full((4, 6), np.nan, np.float32), "uint8 or uint16"),
        (np.zeros((4, 6, 4), np.uint8), r"shape \(4, 6, 4\)|got \(4, 6, 4\)"),
        (np.zeros((0, 6), np.uint8), "empty"),
        (np.zeros(6, np.uint8), "got"),
    ],
)
def test_unusable_codes_are_refused(codes, message):
    with pytest.raises(InputError, match=message):
        Photo(codes, 1.0)


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf"), "fast", [1.0, 2.0]])
@pytest.mark.parametrize("name", ["exposure_time", "f_number", "iso"])
def test_exposure_values_must_be_positive_numbers(name, value):
    with pytest.raises(ExposureError, match=r"positive|must be a number"):
        Photo(np.zeros((2, 2), np.uint8), **{name: value})


@pytest.mark.parametrize("white", [0, -5, 256, 200.5, "200"])
def test_white_level_must_fit_the_type(white):
    with pytest.raises(InputError, match="white level"):
        Photo(np.zeros((2, 2), np.uint8), 1.0, white)


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (photo(), photo(2.0, (4, 7, 3)), "differ in size: .* 6x4, .* 7x4"),
        (photo(), photo(2.0, (4, 6)), "differ in channels: .* 3, .* 1"),
        (photo(), photo(None), "exposure time is not known"),
        (photo(), photo(1.0), "same exposure"),
        (photo(), photo(1.005), "same exposure"),
    ],
)
def test_pairs_that_make_no_sense_are_refused(left, right, message):
    with pytest.raises(InputError, match=message):
        StereoPair(left, right)


def test_main_and_auxiliary_follow_the_main_view():
    left, right = photo(1.0), photo(4.0)
    assert StereoPair(left, right).main_photo is left
    assert StereoPair(left, right, main="right").main_photo is right
    assert StereoPair(left, right).exposures == (1.0, 4.0)
    assert StereoPair(left, right, main="right").exposures == (4.0, 1.0)
    assert StereoPair(left, right).exposure_ratio == 4.0
    with pytest.raises(InputError, match="'left' or 'right'"):
        StereoPair(left, right, main="middle")


def test_exposure_value_counts_iso_and_aperture_when_both_photos_state_them():
    left = photo(0.5, f_number=4.0, iso=100)
    right = photo(0.5, f_number=8.0, iso=1600)
    assert StereoPair(left, right).exposures == (0.5, 0.5 * 16 / 4)
    # Only one states its ISO: ignored.
    pair = StereoPair(photo(0.5), photo(1.0, iso=400))
    assert pair.exposures == (0.5, 1.0)


def test_mirroring_twice_is_the_identity():
    rng = np.random.default_rng(0)
    left = Photo(rng.integers(0, 256, (3, 5, 3)).astype(np.uint8), 1.0)
    right = Photo(rng.integers(0, 256, (3, 5, 3)).astype(np.uint8), 4.0)
    once = StereoPair(left, right).mirrored()
    assert once.main == "right"
    np.testing.assert_array_equal(once.main_photo.codes, left.codes[:, ::-1])
    np.testing.assert_array_equal(once.mirrored().right.codes, right.codes)


@pytest.mark.parametrize("curve", [ResponseCurve.srgb(3), ResponseCurve.gamma(2.2, 1), ResponseCurve.gamma(1.0)])
def test_known_curves_are_monotone_and_zero_at_the_mid_code(curve):
    assert curve.is_monotone
    np.testing.assert_array_equal(curve.log_exposure[:, 128], 0)


def test_a_curve_with_a_dent_is_not_monotone():
    g = ResponseCurve.srgb(3).log_exposure.copy()
    g[1, 100] = g[1, 99]
    assert not ResponseCurve(g).is_monotone


def test_deep_codes_interpolate_the_exposure_linearly():
    linear = ResponseCurve.gamma(1.0, 1)
    table = linear.exposure_table(4095)[0]
    assert table.shape == (4096,)
    codes = np.arange(17, 4096)
    np.testing.assert_allclose(table[codes], codes / 4095 * 255 / 128, rtol=1e-12)
    assert (np.diff(table) > 0).all()
    np.testing.assert_array_equal(linear.exposure_table(255), np.exp(linear.log_exposure))


@given(white=st.sampled_from([255, 1023, 4095, 65535]), seed=st.integers(0, 20))
def test_apply_is_monotone_in_the_code(white, seed):
    dtype = np.uint8 if white == 255 else np.uint16
    codes = np.sort(np.random.default_rng(seed).integers(0, white + 1, 50)).astype(dtype)
    exposure = ResponseCurve.srgb(1).apply(codes[None, :, None], white)[0, :, 0]
    assert exposure.dtype == np.float32
    assert (np.diff(exposure) >= 0).all()
    assert (exposure > 0).all()


def test_curve_round_trip_through_json(tmp_path):
    curve = ResponseCurve(ResponseCurve.srgb(3).log_exposure * np.array([[1.0], [1.1], [0.9]]))
    curve.save(tmp_path / "camera.json")
    np.testing.assert_array_equal(ResponseCurve.load(tmp_path / "camera.json").log_exposure, curve.log_exposure)
    assert [p.name for p in tmp_path.iterdir()] == ["camera.json"]


@pytest.mark.parametrize(
    "text",
    [
        "",
        "{",
        "[1, 2]",
        '{"format": "else"}',
        '{"format": "stereohdr response"}',
        json.dumps({"format": "stereohdr response", "log_exposure": [[0.0] * 255]}),
        json.dumps({"format": "stereohdr response", "log_exposure": [[float("nan")] * 256]}),
        json.dumps({"format": "stereohdr response", "log_exposure": [["x"] * 256]}),
        json.dumps({"format": "stereohdr response", "log_exposure": [[10**400] * 256]}),
        "[" * 200_000,
    ],
)
def test_files_that_are_no_curve_are_refused(tmp_path, text):
    path = tmp_path / "bad.json"
    path.write_text(text)
    with pytest.raises(FileFormatError, match=r"bad\.json"):
        ResponseCurve.load(path)


def test_a_missing_curve_file_is_said(tmp_path):
    with pytest.raises(FileFormatError, match="cannot read"):
        ResponseCurve.load(tmp_path / "none.json")


@pytest.mark.parametrize("shape", [(256,), (2, 256), (3, 255)])
def test_curves_of_wrong_shape_are_refused(shape):
    with pytest.raises(ResponseError, match="shape"):
        ResponseCurve(np.zeros(shape))


def test_disparity_validity_and_mirror():
    disparity = Disparity(np.array([[1, 2]], np.float32), np.array([[0, 1]], np.uint8))
    np.testing.assert_array_equal(disparity.valid, [[False, True]])
    np.testing.assert_array_equal(disparity.mirrored().values, [[2, 1]])


@pytest.mark.parametrize("time", [1e-12, 1e12])
def test_absurd_exposure_times_are_refused(time):
    with pytest.raises(ExposureError, match="from 1e-09 to 1e\\+09"):
        photo(time)


def test_a_photo_keeps_its_own_copy_in_native_byte_order():
    codes = np.full((2, 3), 300, dtype=">u2")
    own = Photo(codes, 1.0)
    codes[:] = 0
    assert own.codes.dtype == np.uint16
    assert (own.codes == 300).all()
    with pytest.raises(ValueError, match="read-only"):
        own.codes[0, 0] = 1


def test_codes_in_any_order_become_contiguous_and_read_only():
    for codes in (np.zeros((3, 2, 4), np.uint8).transpose(1, 2, 0), np.zeros((4, 6), np.uint8)[::2, ::-1]):
        own = Photo(codes, 1.0).codes
        assert own.flags.c_contiguous
        assert not own.flags.writeable


def test_another_exposure_shares_the_codes():
    photo = Photo(np.zeros((2, 3), np.uint8), 0.5, iso=100, f_number=8, name="x")
    other = photo.with_exposure(4.0)
    assert other.codes is photo.codes
    assert (other.exposure_time, other.iso, other.f_number, other.name) == (4.0, None, None, "x")
    assert (photo.exposure_time, photo.iso, photo.f_number) == (0.5, 100, 8)


def test_rows_share_the_codes():
    photo = Photo(np.arange(24, dtype=np.uint8).reshape(4, 6), 0.5, name="x")
    some = photo.rows(slice(1, 3))
    assert np.shares_memory(some.codes, photo.codes)
    np.testing.assert_array_equal(some.codes[..., 0], [range(6, 12), range(12, 18)])
    assert (some.exposure_time, some.name, photo.height) == (0.5, "x", 4)


def test_a_pair_is_made_of_photos():
    with pytest.raises(InputError, match="two Photo objects, got a ndarray"):
        StereoPair(photo(), np.zeros((4, 6, 3)))


def test_representations_are_short():
    assert repr(photo(0.25, name="a.png")) == "Photo('a.png', 6x4x3, white 255, 0.25 s)"


@pytest.mark.parametrize("exponent", [-1.0, 0.0, 1e6, float("nan")])
def test_gamma_curves_need_a_sensible_exponent(exponent):
    with pytest.raises(ResponseError, match="exponent"):
        ResponseCurve.gamma(exponent)


def test_curves_beyond_float32_are_refused():
    with pytest.raises(ResponseError, match="within"):
        ResponseCurve(ResponseCurve.srgb().log_exposure * 1000)
