"""HDR-VDP-2 as a whole: invariants, options, encodings, bad input, memory."""

import tracemalloc

import numpy as np
import pytest

from stereohdr.errors import ConfigError, InputError, StereoHdrWarning
from stereohdr.metrics.hdrvdp2 import ENCODINGS, HdrVdp2Options, hdrvdp2, pixels_per_degree
from stereohdr.metrics.hdrvdp2.spectral import DAYLIGHT, DISPLAYS


def scene(height=48, width=70, channels=None, seed=1):
    """Return a reference between 1 and 300 cd/m^2, and a noisy test image."""
    rng = np.random.default_rng(seed)
    shape = (height, width) if channels is None else (height, width, channels)
    ramp = np.linspace(1, 200, width)[:, None] if channels else np.linspace(1, 200, width)
    reference = ramp * rng.uniform(0.7, 1.4, shape)
    test = reference * np.exp(rng.normal(0, 0.05, shape))
    return test, reference


def score(test, reference, encoding="luminance", ppd=30.0, threads=None, **options):
    return hdrvdp2(
        test,
        reference,
        encoding=encoding,
        pixels_per_degree=ppd,
        options=HdrVdp2Options(**options),
        threads=threads,
    )


def test_identical_images_are_perfect():
    _, reference = scene(channels=3)
    result = score(reference, reference.copy(), "rgb-bt.709")
    assert (result.q, result.p_det, result.c_max) == (100.0, 0.0, 0.0)
    assert result.q_mos > 99.9
    assert not result.p_map.any()


def test_more_noise_is_worse():
    _, reference = scene()
    noise = np.random.default_rng(9).normal(size=reference.shape)
    results = [score(reference * np.exp(sigma * noise), reference) for sigma in (0.01, 0.05, 0.2)]
    assert np.all(np.diff([result.q for result in results]) < 0)
    assert np.all(np.diff([result.c_max for result in results]) > 0)
    assert np.all(np.diff([result.q_mos for result in results]) < 0)


def test_a_local_error_is_seen_where_it_is():
    reference = np.full((64, 80), 100.0)
    test = reference.copy()
    test[40:44, 20:24] *= 1.5
    result = score(test, reference)
    y, x = np.unravel_index(result.c_map.argmax(), result.c_map.shape)
    assert 38 <= y <= 45
    assert 18 <= x <= 25
    assert result.p_map[:20, 50:].max() < 0.01


def test_mirrored_images_give_mirrored_maps():
    # An odd width keeps every other sample at the same places when mirrored.
    test, reference = scene(height=49, width=65)
    ours = score(test, reference)
    mirrored = score(test[:, ::-1], reference[:, ::-1])
    # The diagonal bands change places; everything else is the same up to rounding.
    np.testing.assert_allclose(mirrored.p_map[:, ::-1], ours.p_map, atol=1e-9)
    assert mirrored.q == pytest.approx(ours.q, abs=1e-9)


@pytest.mark.parametrize("channels", [None, 3])
def test_threads_do_not_change_a_bit(channels):
    test, reference = scene(130, 150, channels)
    encoding = "rgb-bt.709" if channels else "luminance"
    results = [score(test, reference, encoding, threads=threads) for threads in (1, 2, 5)]
    for other in results[1:]:
        assert (other.p_map.tobytes(), other.q, other.c_max) == (
            results[0].p_map.tobytes(),
            results[0].q,
            results[0].c_max,
        )


def test_inputs_are_left_alone_and_other_types_are_taken():
    test, reference = scene()
    test, reference = np.rint(test), np.rint(reference)
    kept = test.copy(), reference.copy()
    test.setflags(write=False)
    expected = score(test, reference)
    np.testing.assert_array_equal(test, kept[0])
    np.testing.assert_array_equal(reference, kept[1])
    for kind in (np.float32, np.uint16):
        assert score(test.astype(kind), reference.astype(kind)).q == expected.q
    assert score(test[..., None], reference[..., None]).q == expected.q
    strided = np.asfortranarray(test)
    np.testing.assert_array_equal(score(strided, reference).p_map, expected.p_map)


def test_encodings_of_the_same_light_agree():
    rng = np.random.default_rng(11)
    codes = rng.uniform(0, 1, (2, 40, 50))
    display = score(codes[0], codes[1], "luma-display")
    light = 99 * codes**2.2 + 1
    assert score(light[0], light[1]).q == display.q
    rgb = rng.uniform(0, 1, (2, 40, 50, 3))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4) * 99 + 1
    assert score(*rgb, "sRGB-display").q == pytest.approx(score(*linear, "rgb-bt.709").q, abs=1e-9)
    from_xyz = np.array(
        [[3.240708, -1.537259, -0.498570], [-0.969257, 1.875995, 0.041555], [0.055636, -0.203996, 1.057069]]
    )
    xyz = np.einsum("ij,nyxj->nyxi", np.linalg.inv(from_xyz), linear)
    assert score(*xyz, "XYZ").q == pytest.approx(score(*linear, "rgb-bt.709").q, abs=1e-6)
    np.testing.assert_array_equal(
        score(*linear, "generic", spectral_responses=DISPLAYS["crt"]).p_map,
        score(*linear, "rgb-bt.709", rgb_display="crt").p_map,
    )
    np.testing.assert_array_equal(score(*light, "generic", spectral_responses=DAYLIGHT).p_map, score(*light).p_map)
    two = np.moveaxis(np.stack([light / 2, light / 2]), 0, 3)
    assert score(*two, "generic", spectral_responses=DAYLIGHT * 2).q == pytest.approx(score(*light).q, abs=1e-6)


def test_every_option_does_what_it_says():
    test, reference = scene()
    default = score(test, reference)
    assert score(test, reference, do_masking=False).c_max > default.c_max
    assert score(test, reference, do_mtf=False).q < default.q
    plain = score(test, reference, do_spatial_pooling=False)
    assert plain.q == default.q
    np.testing.assert_allclose(default.c_map, plain.c_map * plain.c_map.sum() / plain.c_max, rtol=1e-9)
    assert score(test, reference, peak_sensitivity=2.0).q > default.q
    assert score(test, reference, rod_sensitivity=-1.0).q != default.q
    displays = [score(test, reference, rgb_display=name).q for name in DISPLAYS]
    assert len({default.q, *displays}) == 4
    assert score(test, reference, surround_l=1e-5).q == default.q
    mean = float(np.exp(np.log(reference).mean()))
    assert score(test, reference, surround_l=-1).q == pytest.approx(score(test, reference, surround_l=mean).q)
    assert score(test, reference, surround_l=mean).q != default.q


def test_surrounds_per_channel():
    test, reference = scene(channels=3)
    one = score(test, reference, "rgb-bt.709", surround_l=20.0)
    three = score(test, reference, "rgb-bt.709", surround_l=(20.0, 20.0, 20.0))
    other = score(test, reference, "rgb-bt.709", surround_l=[20.0, 1.0, -1.0])
    assert one.q == three.q
    assert other.q != one.q
    with pytest.raises(ConfigError, match="surround_l must have 1 or 3 numbers"):
        score(test, reference, "rgb-bt.709", surround_l=(1.0, 2.0))


@pytest.mark.parametrize("shape", [(17, 17), (17, 300), (33, 18), (100, 41)])
def test_awkward_sizes(shape):
    test, reference = scene(*shape)
    result = score(test, reference)
    assert result.p_map.shape == shape
    assert np.isfinite(result.p_map).all()
    assert result.q < 100


@pytest.mark.parametrize("ppd", [0.5, 5, 200, 4000.0])
def test_extreme_angular_resolutions_stay_finite(ppd):
    test, reference = scene()
    result = score(test, reference, ppd=ppd)
    assert np.isfinite([result.q, result.q_mos, result.p_det, result.c_max]).all()


@pytest.mark.parametrize("options", [{}, {"do_mtf": False}, {"surround_l": -1}, {"do_masking": False}])
@pytest.mark.parametrize("peak", [1e4, 1e9])
def test_black_and_blinding_pixels_stay_finite(options, peak):
    reference = np.zeros((40, 60))
    reference[10:20, 10:30] = peak
    test = reference.copy()
    test[30:, 40:] = 0.01 * peak
    result = score(test, reference, **options)
    for value in (result.q, result.q_mos, result.p_det, result.c_max):
        assert np.isfinite(value)
    assert np.isfinite(result.p_map).all()
    # Above 1e5 cd/m^2 the receptors are saturated: nothing is seen beside the glare.
    assert result.q < 100 or peak > 1e6


def test_nan_counts_as_dark_and_warns():
    test, reference = scene()
    dark = test.copy()
    dark[5, 6] = 1e-5
    test[5, 6] = np.nan
    with pytest.warns(StereoHdrWarning, match="the test image is NaN at 1 pixels"):
        result = score(test, reference)
    assert np.isnan(test[5, 6])
    assert result.q == score(dark, reference).q


def test_relative_values_warn():
    test, reference = scene()
    with pytest.warns(StereoHdrWarning, match="needs absolute luminance"):
        score(test / test.max(), reference / test.max())


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"test": np.ones((48, 71))}, InputError, r"same shape, got test \(48, 71\) and reference \(48, 70\)"),
        ({"encoding": "rgb-bt.709"}, InputError, r"must have the shape \(H, W, 3\)"),
        ({"encoding": "rgb"}, ConfigError, "encoding must be one of luminance"),
        ({"ppd": 0}, ConfigError, "pixels_per_degree must be > 0, got 0"),
        ({"ppd": -30}, ConfigError, "pixels_per_degree"),
        ({"ppd": float("nan")}, ConfigError, "pixels_per_degree"),
        ({"test": np.full((48, 70), -0.5)}, InputError, "the test image must not be negative .* got -0.5"),
        ({"reference": np.full((48, 70), np.inf)}, InputError, "the reference image must be finite"),
        ({"encoding": "luma-display"}, InputError, "the test image must be 0 to 1"),
        ({"test": np.ones((48, 70), dtype=complex)}, InputError, "must hold real numbers"),
        (
            {"test": np.ones((16, 70)), "reference": np.ones((16, 70))},
            InputError,
            "at least 17 x 17 pixels, got 16",
        ),
        ({"test": np.ones(70), "reference": np.ones(70)}, InputError, "must have the shape"),
        ({"encoding": "generic"}, ConfigError, "needs spectral_responses"),
        ({"spectral_responses": DAYLIGHT}, ConfigError, "spectral_responses belongs to the encoding 'generic'"),
        ({"spectral_responses": ((1.0, 2.0),)}, ConfigError, "three numbers"),
        ({"surround_l": 0.0}, ConfigError, "surround_l must be > 0"),
        ({"surround_l": "bright"}, ConfigError, "surround_l must be > 0"),
        ({"rgb_display": "oled"}, ConfigError, "rgb_display must be one of ccfl-lcd, crt, led-lcd, got 'oled'"),
        ({"peak_sensitivity": float("inf")}, ConfigError, "peak_sensitivity must be finite"),
        ({"do_si_gauss": True}, ConfigError, "do_si_gauss must be False"),
    ],
)
@pytest.mark.filterwarnings("ignore:the test image reaches only")
def test_bad_input_is_refused_in_one_sentence(change, error, message):
    test, reference = scene()
    with pytest.raises(error, match=message) as caught:
        score(**{"test": test, "reference": reference, **change})
    assert "\n" not in str(caught.value)


def test_bad_displays_are_refused():
    for arguments in ((0, (1920, 1080), 0.6), (24, (0, 1080), 0.6), (24, (1920, 1080), -1)):
        with pytest.raises(InputError, match="must be > 0"):
            pixels_per_degree(*arguments)


def test_a_named_reference_geometric_mean_needs_positive_channels():
    # Saturated green is outside BT.709.
    xyz = np.full((20, 20, 3), (10.0, 60.0, 5.0))
    with pytest.raises(InputError, match="inside the gamut"):
        score(xyz, xyz, "XYZ", surround_l=-1)
    assert score(xyz, xyz, "XYZ").q == 100.0


def test_every_encoding_is_accepted():
    for encoding, channels in ENCODINGS.items():
        codes = np.random.default_rng(3).uniform(0.1, 1, (20, 24, channels or 2))
        options = {"spectral_responses": DAYLIGHT * 2} if encoding == "generic" else {}
        scale = 1 if encoding.endswith("display") else 100
        assert score(scale * codes, scale * codes, encoding, **options).q == 100


def test_speed(benchmark):
    """Run with ``--benchmark-enable`` for the time of a picture of the usual size."""
    test, reference = scene(555, 695, 3)
    result = benchmark(score, test, reference, "rgb-bt.709")
    assert result.q < 100


def test_memory():
    test, reference = scene(555, 695, 3)
    score(test, reference, "rgb-bt.709")
    tracemalloc.start()
    score(test, reference, "rgb-bt.709", threads=2)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 25 * test.nbytes
