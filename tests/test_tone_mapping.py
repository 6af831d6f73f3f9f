import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from stereohdr.errors import ConfigError, InputError
from stereohdr.radiance import REC709
from stereohdr.tone_mapping import srgb_encode, tonemap

OPERATORS = ("reinhard", "log", "linear")
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


def test_log_is_drago_equation_4():
    scene = np.array([[0.1, 1.0, 10.0, 40.0]])
    adapted = scene / np.exp(np.log(scene).mean())
    largest = adapted.max()
    power = np.log(0.7) / np.log(0.5)
    expected = np.log(adapted + 1) / np.log(2 + (adapted / largest) ** power * 8) / np.log10(largest + 1)
    np.testing.assert_array_equal(tonemap(scene, "log", bias=0.7)[..., 0], codes_of(expected))


def test_a_smaller_bias_brightens_the_dark_parts():
    scene = np.geomspace(1e-2, 1e2, 100).reshape(10, 10)
    assert tonemap(scene, "log", bias=0.7).mean() > tonemap(scene, "log", bias=0.9).mean() + 5


def test_linear_is_exposure_and_clip():
    expected = codes_of(np.clip(SCENE * 0.25, 0, 1))
    np.testing.assert_array_equal(tonemap(SCENE, "linear", exposure=0.25), expected)


@pytest.mark.parametrize("operator", ["reinhard", "log"])
def test_colours_brighter_than_white_keep_their_hue(operator):
    scene = np.array([[[0.1, 0.1, 0.1], [30.0, 60.0, 90.0], [3000.0, 6000.0, 9000.0]]])
    codes = tonemap(scene, operator, white=1.0)
    pixel = scene[0, 1]
    np.testing.assert_array_equal(codes[0, 1], codes_of(pixel / (pixel @ REC709)))
    np.testing.assert_array_equal(codes[0, 2], codes[0, 1])


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


@pytest.mark.parametrize("operator", OPERATORS)
def test_the_largest_luminance_is_white_and_brighter_is_not_darker(operator):
    scene = np.geomspace(1e-8, 1e8, 5000).reshape(50, 100)
    codes = tonemap(scene, operator)[..., 0].ravel().astype(int)
    assert codes[-1] == 255
    assert (np.diff(codes) >= 0).all()


@pytest.mark.parametrize("operator", ["reinhard", "log"])
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
)
def test_every_finite_radiance_gives_codes_without_a_numeric_warning(radiance, operator, extreme):
    codes = tonemap(radiance, operator, white=extreme, exposure=extreme)
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
        ({"operator": "durand"}, "unknown tone mapping operator 'durand'; use reinhard, log, linear"),
        ({"key": 0}, "key must be above 0"),
        ({"key": 1.5}, "key must be above 0 and at most 1"),
        ({"key": float("nan")}, "key must be"),
        ({"white": 0}, "white must be a positive number"),
        ({"white": float("inf")}, "white must be"),
        ({"exposure": -1}, "exposure must be"),
        ({"exposure": 1e-300}, "exposure must be"),
        ({"bias": 1}, "bias must be above 0 and below 1"),
        ({"saturation": -0.1}, "saturation must be"),
        ({"saturation": float("nan")}, "saturation must be"),
    ],
)
def test_bad_parameters(parameters, message):
    with pytest.raises(ConfigError, match=message):
        tonemap(SCENE, **parameters)
