import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr.demosaicing import bayer_pattern, demosaic
from stereohdr.demosaicing._kernels import interpolate_colours
from stereohdr.errors import ConfigError, InputError

from reference import demosaicing as twin

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
CHANNEL = {"R": 0, "G": 1, "B": 2}


def cell(pattern):
    return np.array([CHANNEL[letter] for letter in pattern]).reshape(2, 2)


def mosaic_of(rgb, pattern):
    """Sample (H, W, 3) the way a Bayer sensor does."""
    height, width, _ = rgb.shape
    channel = np.tile(cell(pattern), (height // 2 + 1, width // 2 + 1))[:height, :width]
    return np.take_along_axis(rgb, channel[..., None], axis=2)[..., 0]


@given(
    height=st.integers(2, 9),
    width=st.integers(2, 11),
    pattern=st.sampled_from(PATTERNS),
    clipped=st.sampled_from([0.0, 0.05, 0.6, 1.0]),
    seed=st.integers(0, 99),
)
def test_kernel_equals_its_twin(height, width, pattern, clipped, seed):
    rng = np.random.default_rng(seed)
    mosaic = rng.integers(0, 4095, (height, width)).astype(np.uint16)
    mosaic[rng.random(mosaic.shape) < clipped] = 4095
    strength = rng.uniform(0.3, 3, (3, 3))
    results = []
    for interpolate in (interpolate_colours, twin.interpolate_colours):
        rgb = np.empty((height, width, 3), np.uint16)
        interpolate(mosaic, cell(pattern), 4095, strength, rgb)
        results.append(rgb.astype(int))
    # A mean of two roundings of the same sum may fall on either side of one half.
    assert np.abs(results[0] - results[1]).max() <= 1
    assert (results[0] != results[1]).mean() < 0.02


def test_a_cell_by_hand():
    mosaic = np.array([[100, 40, 110, 60], [50, 20, 70, 30], [120, 80, 130, 90], [10, 28, 90, 26]], np.uint16)
    # At the blue pixel (1, 1): red is the mean of 100, 110, 120 and 130, green that of 40, 50, 70 and 80.
    rgb = demosaic(mosaic, "RGGB", white_level=4095, method="bilinear")
    assert rgb[1, 1].tolist() == [115, 60, 20]
    # Mean codes: red 115, green 430 / 8 = 53.75, blue 26. Blue two pixels away, mirrored at the border: 20, 20, 28
    # and 30. So 4 * 20 - 98 = -18 for green, and 6 * 20 - 1.5 * 98 = -27 for red.
    sharpened = demosaic(mosaic, "RGGB", white_level=4095)
    assert sharpened[1, 1, 1] == round(60 - 18 / 8 * 53.75 / 26)
    assert sharpened[1, 1, 0] == round(115 - 27 / 8 * 115 / 26)


@pytest.mark.parametrize("method", ["malvar2004", "bilinear"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_one_colour_is_kept_exactly(pattern, method):
    colour = np.array([200, 900, 450], np.uint16)
    rgb = np.tile(colour, (7, 6, 1))
    got = demosaic(mosaic_of(rgb, pattern), pattern, white_level=4095, method=method)
    np.testing.assert_array_equal(got, rgb)


@pytest.mark.parametrize("pattern", PATTERNS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_bilinear_is_what_opencv_computes(pattern, dtype):
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed")
    white = np.iinfo(dtype).max
    mosaic = np.random.default_rng(4).integers(0, white, (12, 14)).astype(dtype)
    expected = cv2.cvtColor(mosaic, getattr(cv2, f"COLOR_Bayer{pattern}2RGB"))
    got = demosaic(mosaic, pattern, white_level=white, method="bilinear")
    np.testing.assert_array_equal(got[1:-1, 1:-1], expected[1:-1, 1:-1])


def smooth_colours(height=60, width=80, *, cast=(1, 1, 1)):
    y, x = np.mgrid[:height, :width] / 10.0
    grey = 1.2 + np.sin(2.1 * x) * np.cos(1.3 * y) * np.cos(0.4 * x * y / 6)
    tint = np.stack([1 + 0.2 * np.sin(x / 3), np.ones_like(x), 1 - 0.2 * np.cos(y / 3)], axis=-1)
    return np.rint(1000 * grey[..., None] * tint * cast).astype(np.uint16)


@pytest.mark.parametrize("cast", [(1, 1, 1), (0.5, 1, 0.6)], ids=["balanced", "greenish"])
@pytest.mark.parametrize("pattern", PATTERNS)
def test_sharpening_beats_plain_means_whatever_the_white_balance(pattern, cast):
    rgb = smooth_colours(cast=cast)
    mosaic = mosaic_of(rgb, pattern)
    errors = {}
    for method in ("malvar2004", "bilinear"):
        got = demosaic(mosaic, pattern, white_level=65535, method=method)
        ratio = np.log2(got[3:-3, 3:-3] / rgb[3:-3, 3:-3])
        errors[method] = np.sqrt((ratio**2).mean())
    assert errors["malvar2004"] < 0.7 * errors["bilinear"]


@given(st.integers(0, 99), st.sampled_from(PATTERNS), st.sampled_from(["malvar2004", "bilinear"]))
def test_clipped_samples_stay_recognisable_and_nothing_else_looks_clipped(seed, pattern, method):
    rng = np.random.default_rng(seed)
    white = 1023
    mosaic = rng.choice([[0, 1, 500, 1021, 1022], [520, 700, 900, 1021, 1022]][seed % 2], (9, 8)).astype(np.uint16)
    mosaic[rng.random(mosaic.shape) < 0.08] = white
    rgb = demosaic(mosaic, pattern, white_level=white, method=method)
    channel = np.tile(cell(pattern), (5, 4))[:9]
    padded = np.pad(mosaic, 1, mode="reflect")
    colours = np.pad(channel, 1, mode="reflect")
    for y in range(9):
        for x in range(8):
            window, kinds = padded[y : y + 3, x : x + 3], colours[y : y + 3, x : x + 3]
            samples = [window[1:2, 1:2] if c == channel[y, x] else window[kinds == c] for c in range(3)]
            if any((s == white).any() and s.min() < white / 2 for s in samples):
                assert (rgb[y, x] == white).all()
                continue
            for c in range(3):
                assert (rgb[y, x, c] == white) == (samples[c] == white).any()
                assert samples[c].min() <= rgb[y, x, c] <= samples[c].max()


@pytest.mark.parametrize("pattern", PATTERNS)
def test_the_edge_of_a_highlight_shows_no_coloured_dots(pattern):
    rgb = np.full((12, 14, 3), 200, np.uint16)
    rgb[:, 7:] = 1023
    got = demosaic(mosaic_of(rgb, pattern), pattern, white_level=1023)
    np.testing.assert_array_equal(got.min(axis=-1), got.max(axis=-1))


def test_a_soft_edge_keeps_what_the_other_channels_measured():
    rgb = np.full((10, 12, 3), (700, 950, 600), np.uint16)
    rgb[:, 6:, 1] = 1023
    got = demosaic(mosaic_of(rgb, "RGGB"), "RGGB", white_level=1023, method="bilinear")
    np.testing.assert_array_equal(got[..., 0], 700)
    np.testing.assert_array_equal(got[..., 2], 600)


def test_a_highlight_does_not_darken_its_surroundings():
    # Plain Malvar undershoots to 0 beside an edge of 40:1; radiance would be off by many stops.
    rgb = np.full((12, 12, 3), 100, np.uint16)
    rgb[:, 6:] = 4000
    got = demosaic(mosaic_of(rgb, "GBRG"), "GBRG", white_level=4095)
    assert got.min() == 100


@pytest.mark.parametrize("text", ["", "RGB", "RGBG", "RRGB", "xtrans", "CYGM"])
def test_other_patterns_are_refused_with_those_that_there_are(text):
    with pytest.raises(ConfigError, match=r"RGGB, BGGR, GRBG, GBRG"):
        bayer_pattern(text)
    assert bayer_pattern(" grbg ") == "GRBG"


def test_what_is_no_mosaic_is_refused():
    for array in (np.zeros((4, 4, 3), np.uint8), np.zeros((1, 4), np.uint8), np.zeros((4, 4))):
        with pytest.raises(InputError, match="a Bayer mosaic is grey, at least 2x2"):
            demosaic(array, "RGGB", white_level=255)
    with pytest.raises(ConfigError, match="method must be one of"):
        demosaic(np.zeros((4, 4), np.uint8), "RGGB", white_level=255, method="best")
