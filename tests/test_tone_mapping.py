from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from stereohdr.errors import ConfigError, InputError
from stereohdr.tone_mapping import Operator, srgb_decode, srgb_encode, tonemap

OPERATORS = get_args(Operator)
GLOBAL = tuple(operator for operator in OPERATORS if operator != "reinhard-local")
COMPRESSING = tuple(operator for operator in OPERATORS if operator != "linear")
RNG = np.random.default_rng(3)
SCENE = RNG.lognormal(0, 3, (40, 30, 3)).astype(np.float32)


def codes_of(linear):
    return np.rint(255 * srgb_encode(linear)).astype(np.uint8)


# --- formulas ---------------------------------------------------------------------------------------------------


def test_srgb_encode_at_known_points():
    np.testing.assert_allclose(
        srgb_encode(np.array([-1, 0, 0.0031308, 0.2140411, 0.5, 1, 7])),
        [0, 0, 0.04045, 0.5, 0.735357, 1, 1],
        atol=1e-5,
    )


def test_srgb_decode_undoes_srgb_encode():
    light = np.linspace(0, 1, 1001)
    np.testing.assert_allclose(srgb_decode(srgb_encode(light)), light, atol=1e-12)
    np.testing.assert_array_equal(srgb_decode(np.array([-0.5, 1.5])), [0, 1])


def test_reinhard_is_equation_4():
    scene = np.array([[0.1, 1.0, 10.0, 40.0]])
    scaled = 0.18 / np.exp(np.log(scene).mean()) * scene
    white = scaled.max()
    expected = scaled * (1 + scaled / white**2) / (1 + scaled)
    np.testing.assert_array_equal(tonemap(scene)[..., 0], codes_of(expected))
    white = 0.36 / np.exp(np.log(scene).mean()) * 20
    scaled *= 2
    expected = scaled * (1 + scaled / white**2) / (1 + scaled)
    np.testing.assert_array_equal(tonemap(scene, key=0.36, white=20)[..., 0], codes_of(expected))


def test_reinhard_local_is_the_global_operator_where_nothing_changes():
    scene = np.full((40, 60), 0.1)
    scene[:, 30:] = 10.0  # an edge: the surroundings do not reach across it
    expected = 0.18 / np.exp(np.log(scene).mean()) * scene
    expected = (expected + (scene / 10.0) ** 2) / (1 + expected)
    codes = tonemap(scene, "reinhard-local")[..., 0].astype(int)
    assert np.abs(codes[:, [0, 20, 40, 59]] - codes_of(expected)[:, [0, 20, 40, 59]]).max() <= 1


def test_reinhard_local_keeps_the_contrast_of_details():
    y, x = np.mgrid[:60, :60]
    scene = np.where((x + y) % 2, 10.0, 8.0)  # a fine texture in a bright part
    scene[:, :20] = 0.01
    contrast = {}
    for operator in ("reinhard", "reinhard-local"):
        light = srgb_decode(tonemap(scene, operator, white=1e4) / 255)[20:40, 40:55, 0]
        contrast[operator] = light.max() / light.min()
    assert contrast["reinhard"] < 1.12
    assert contrast["reinhard-local"] > 1.2


def test_mai_slopes_go_with_the_cube_root_of_the_histogram():
    # 8 pixels in the first bin, 1 in the last, nothing between: slopes 2 : 0 : 1; bins are centred on the ends.
    scene = np.array([[10.0] * 8 + [100.0]])
    codes = tonemap(scene, "mai")[..., 0].ravel()
    np.testing.assert_array_equal(codes, [round(255 * 1.0 / 2.5)] * 8 + [255])


def test_mai_spends_its_codes_where_the_pixels_are():
    rng = np.random.default_rng(4)
    scene = np.concatenate([rng.uniform(0.1, 1, (20, 100)), rng.uniform(1, 10, (2, 100))])
    codes = tonemap(scene, "mai")[..., 0].astype(int)
    assert np.ptp(codes[:20]) > 1.5 * np.ptp(codes[20:])


def test_filmic_at_known_points():
    # With log-average 1 and key 0.18 the curve sees x = 0.108 L: 0.18 -> 0.1400 by hand for L = 1.
    scene = np.array([[1.0, 1e-3, 1e3]])
    x = 0.108 * scene
    expected = np.minimum(x * (2.51 * x + 0.03) / (x * (2.43 * x + 0.59) + 0.14), 1)
    np.testing.assert_array_equal(tonemap(scene, "filmic")[..., 0], codes_of(expected))
    assert expected[0, 0] == pytest.approx(0.1400, abs=1e-3)


def test_log_is_the_logarithm_of_one_plus_the_adapted_luminance():
    scene = np.array([[0.5, 1.0, 2.0, 1.0]])
    expected = np.log(1 + scene) / np.log(3)
    np.testing.assert_array_equal(tonemap(scene, "log")[..., 0], codes_of(expected))


def test_drago_is_equation_4():
    scene = np.array([[0.1, 1.0, 10.0, 40.0]])
    adapted = scene / np.exp(np.log(scene).mean())
    largest = adapted.max()
    power = np.log(0.7) / np.log(0.5)
    expected = np.log(adapted + 1) / np.log(2 + (adapted / largest) ** power * 8) / np.log10(largest + 1)
    np.testing.assert_array_equal(tonemap(scene, "drago", bias=0.7)[..., 0], codes_of(expected))


def test_a_smaller_bias_brightens_the_dark_parts():
    scene = np.geomspace(1e-2, 1e2, 100).reshape(10, 10)
    assert tonemap(scene, "drago", bias=0.7).mean() > tonemap(scene, "drago", bias=0.9).mean() + 5


def test_linear_is_a_factor():
    grey = SCENE[..., 0]
    np.testing.assert_array_equal(tonemap(grey, "linear", white=4)[..., 0], codes_of(np.clip(grey / 4, 0, 1)))
    np.testing.assert_array_equal(
        tonemap(grey, "linear", white=4, exposure=-3), tonemap(grey, "linear", white=32, exposure=0)
    )


@pytest.mark.parametrize("operator", OPERATORS)
def test_colours_that_do_not_fit_keep_hue_and_saturation(operator):
    scene = np.full((20, 20, 3), 0.1)
    scene[:, 10:] = np.array([90.0, 60.0, 30.0])
    codes = tonemap(scene, operator, white=1.0, exposure=2.0)
    np.testing.assert_array_equal(codes[10, 15], codes_of(np.array([1, 2 / 3, 1 / 3])))


@pytest.mark.parametrize("operator", OPERATORS)
def test_hue_is_kept_everywhere(operator):
    codes = tonemap(SCENE, operator)
    light = srgb_decode(codes / 255)
    bright = codes.max(axis=-1) > 60
    wanted = SCENE[bright] / SCENE[bright].max(axis=-1, keepdims=True)
    got = light[bright] / light[bright].max(axis=-1, keepdims=True)
    assert len(got) > 20
    np.testing.assert_allclose(got, wanted, atol=0.03)


@pytest.mark.parametrize("operator", OPERATORS)
def test_more_exposure_is_brighter(operator):
    means = [tonemap(SCENE, operator, exposure=stops).mean() for stops in (-2, 0, 2)]
    assert means[0] + 5 < means[1] < means[2] - 5


def test_a_stop_more_is_a_factor_of_two_before_the_curve():
    np.testing.assert_array_equal(tonemap(SCENE, "reinhard", exposure=1), tonemap(SCENE, "reinhard", key=0.36))
    mai = [srgb_decode(tonemap(SCENE, "mai", exposure=stops) / 255) for stops in (0, -1)]
    fits = (mai[0].max(axis=-1) > 0.2) & (mai[0].max(axis=-1) < 1)
    np.testing.assert_allclose(mai[1][fits], mai[0][fits] / 2, atol=0.006)


def test_linear_of_a_scene_that_is_nearly_all_black():
    scene = np.zeros((20, 20))
    scene[3, 4] = 1e-4
    codes = tonemap(scene, "linear")
    assert codes[3, 4] == 255
    assert np.count_nonzero(codes) == 1


def test_linear_shows_the_99th_percentile_as_white():
    scene = np.arange(1.0, 1001.0).reshape(20, 50)
    codes = tonemap(scene, "linear")[..., 0]
    assert (codes[scene >= 991] == 255).all()
    assert codes[scene == 980] < 255


# --- properties -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("operator", GLOBAL)
def test_the_largest_luminance_is_white_and_brighter_is_not_darker(operator):
    scene = np.geomspace(1e-8, 1e8, 5000).reshape(50, 100)
    codes = tonemap(scene, operator)[..., 0].ravel().astype(int)
    assert codes[-1] == 255
    assert (np.diff(codes) >= 0).all()


@pytest.mark.parametrize("operator", COMPRESSING)
def test_dynamic_range_is_compressed(operator):
    scene = np.geomspace(1e-2, 1e2, 1000).reshape(10, 100)
    assert np.median(tonemap(scene, "linear")) < 40
    assert 80 < np.median(tonemap(scene, operator)) < 200


@pytest.mark.parametrize("operator", OPERATORS)
@pytest.mark.parametrize("factor", [2.0**-60, 2.0**-3, 2.0**70])
def test_the_scale_of_the_radiance_does_not_matter(operator, factor):
    difference = tonemap(SCENE, operator).astype(int) - tonemap(SCENE * np.float32(factor), operator)
    assert np.abs(difference).max() <= 1  # rounding of the log-average may move a value over a code's border
    assert np.mean(difference != 0) < 1e-3


@pytest.mark.parametrize("operator", OPERATORS)
def test_mirrored_input_gives_mirrored_output(operator):
    difference = tonemap(SCENE[:, ::-1], operator).astype(int) - tonemap(SCENE, operator)[:, ::-1]
    assert np.abs(difference).max() <= 1
    assert np.mean(difference != 0) < 1e-3


@pytest.mark.parametrize("operator", OPERATORS)
def test_grey_rgb_and_grey_agree(operator):
    grey = SCENE[..., :1]
    colour = tonemap(np.repeat(grey, 3, axis=-1), operator)
    assert colour.shape == (40, 30, 3)
    assert (np.ptp(colour.astype(int), axis=-1) <= 1).all()
    one = tonemap(grey, operator)
    assert one.shape == (40, 30, 1)
    assert np.abs(colour - one.astype(int)).max() <= 1
    np.testing.assert_array_equal(tonemap(grey[..., 0], operator), one)


@pytest.mark.parametrize("operator", OPERATORS)
def test_row_blocks_do_not_show(operator, monkeypatch):
    whole = tonemap(SCENE, operator)
    monkeypatch.setattr("stereohdr.tone_mapping._ROWS", 7)
    np.testing.assert_array_equal(tonemap(SCENE, operator), whole)


def test_saturation_keeps_or_removes_colour():
    scene = np.array([[[0.4, 0.2, 0.1], [4.0, 4.0, 4.0]]])
    grey = tonemap(scene, saturation=0.0)
    assert (np.ptp(grey, axis=-1) == 0).all()
    spread = [int(np.ptp(tonemap(scene, saturation=s)[0, 0].astype(int))) for s in (0.0, 0.5, 1.0)]
    assert spread == sorted(spread)
    assert spread[2] > spread[1] > 0


@pytest.mark.parametrize("operator", OPERATORS)
@pytest.mark.parametrize("saturation", [0.0, 0.5, 1.0])
def test_black_stays_black(operator, saturation):
    assert not tonemap(np.zeros((3, 4, 3)), operator, saturation=saturation).any()
    scene = np.array([[[0, 0, 0], [0, 0, 1.0]]])
    assert not tonemap(scene, operator, saturation=saturation)[0, 0].any()


@pytest.mark.parametrize("operator", OPERATORS)
@pytest.mark.parametrize("constant", [1e-45, 1e-8, 1.0, 1e8, 3e38])
@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 1, 3), (3, 5, 3)])
def test_constant_images_are_constant(operator, constant, shape):
    codes = tonemap(np.full(shape, constant, np.float32), operator)
    assert codes.dtype == np.uint8
    assert codes.shape == shape
    assert len(np.unique(codes)) == 1
    assert codes.min() > 0


@given(
    hnp.arrays(
        np.float32,
        st.tuples(st.integers(1, 5), st.integers(1, 5), st.sampled_from([1, 3])),
        elements=st.floats(0, width=32, allow_nan=False, allow_infinity=False),
    ),
    st.sampled_from(OPERATORS),
    st.one_of(st.none(), st.sampled_from([1.2e-38, 1e-8, 1.0, 3e38])),
    st.sampled_from([-30.0, 0.0, 30.0]),
)
def test_every_finite_radiance_gives_codes_without_a_numeric_warning(radiance, operator, white, exposure):
    codes = tonemap(radiance, operator, white=white, exposure=exposure)
    assert codes.shape == radiance.shape
    assert not codes[radiance.max(axis=-1) == 0].any()


# --- refusals ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e-20, 1e300])
def test_bad_values_are_located(bad):
    scene = SCENE.astype(np.float64)
    scene[3, 4, 2] = bad
    with pytest.raises(InputError, match=r"1 of 3600 values are not.* at row 3, column 4, channel 2"):
        tonemap(scene)


@pytest.mark.parametrize("scene", [SCENE[..., :2], SCENE[0, 0], SCENE[:0], SCENE * 1j, SCENE > 1, SCENE[None]])
def test_bad_shapes_and_types(scene):
    with pytest.raises(InputError, match="real numbers of shape"):
        tonemap(scene)


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"operator": "durand"}, "unknown tone mapping operator 'durand'; use reinhard, reinhard-local"),
        ({"key": 0}, "key must be above 0"),
        ({"key": 1.5}, "key must be above 0 and at most 1"),
        ({"key": float("nan")}, "key must be"),
        ({"white": 0}, "white must be a positive number"),
        ({"white": float("inf")}, "white must be"),
        ({"exposure": 31}, "exposure is in stops, -30 to 30, got 31"),
        ({"exposure": float("nan")}, "exposure is in stops"),
        ({"bias": 1}, "bias must be above 0 and below 1"),
        ({"saturation": -0.1}, "saturation must be"),
        ({"saturation": float("nan")}, "saturation must be"),
    ],
)
def test_bad_parameters(parameters, message):
    with pytest.raises(ConfigError, match=message):
        tonemap(SCENE, **parameters)
