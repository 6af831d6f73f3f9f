"""The steps of HDR-VDP-2 against published numbers and slow, direct definitions."""

import numpy as np
import pytest
from scipy import ndimage

from stereohdr.metrics.hdrvdp2 import HdrVdp2Options, pixels_per_degree
from stereohdr.metrics.hdrvdp2.contrast_sensitivity import neural_sensitivity, sensitivity_table
from stereohdr.metrics.hdrvdp2.encodings import linear_channels
from stereohdr.metrics.hdrvdp2.interpolation import UniformTable
from stereohdr.metrics.hdrvdp2.masking import (
    masked_difference,
    masking_signal,
    mutual_activity,
    neighbour_activity,
)
from stereohdr.metrics.hdrvdp2.optics import modulation_transfer, scattered, surround_filter
from stereohdr.metrics.hdrvdp2.receptors import log_luminance, response_tables
from stereohdr.metrics.hdrvdp2.resize import resized
from stereohdr.metrics.hdrvdp2.sp3_filters import BANDS, FIRST_HIGH_PASS, FIRST_LOW_PASS, LOW_PASS
from stereohdr.metrics.hdrvdp2.spectral import DISPLAYS, channel_responses
from stereohdr.metrics.hdrvdp2.steerable import level_shapes, steerable_pyramid


def test_modulation_transfer_at_published_frequencies():
    frequency = np.array([0.0, 1, 2, 5, 10, 20, 30, 60])
    expected = [1, 0.80850869, 0.67481827, 0.45934501, 0.33523872, 0.24302156, 0.18341594, 0.07917886]
    np.testing.assert_allclose(modulation_transfer(frequency), expected, atol=5e-9)


def test_receptor_responses_at_published_luminances():
    tables = response_tables(2.4, 0.0)
    log_l = np.array([-2.0, -1, 0, 1, 2, 3])
    cone = [1.368786, 2.015152, 5.968146, 44.741823, 104.489761, 164.622060]
    rod = [5.007750, 17.851714, 54.135378, 96.308011, 98.393735, 98.393741]
    np.testing.assert_allclose(tables.cone.at(log_l), cone, atol=1e-6)
    np.testing.assert_allclose(tables.rod.at(log_l), rod, atol=1e-6)
    assert tables.cone.at(np.array([-5.0, -9.0])).tolist() == [0, 0]


def test_peak_sensitivity_scales_the_responses():
    log_l = np.array([-1.0, 2.0])
    ratio = response_tables(3.4, 0.0).cone.at(log_l) / response_tables(2.4, 0.0).cone.at(log_l)
    np.testing.assert_allclose(ratio, 10.0)


def test_log_luminance_is_clipped():
    np.testing.assert_array_equal(log_luminance(np.array([-1.0, 0, 1, 1e9])), [-5, -5, 0, 5])


@pytest.mark.parametrize(
    ("luminance", "expected"),
    [
        (100, [0.158588, 0.349752, 0.752866, 1.3992, 1.63449, 1.1238, 0.485317, 0.173612]),
        (1, [0.29411, 0.540387, 0.979917, 1.46972, 0.925867, 0.321592, 0.0805005, 0.0175844]),
        (0.01, [0.587739, 0.889738, 1.11947, 0.761804, 0.346493, 0.13539, 0.0428773, 0.0123302]),
    ],
)
def test_contrast_sensitivity_at_published_points(luminance, expected):
    frequency = np.array([0.25, 0.5, 1, 2, 4, 8, 16, 32])
    np.testing.assert_allclose(neural_sensitivity(frequency, luminance), expected, rtol=5e-6)
    assert neural_sensitivity(0.0, luminance) == 0
    table = sensitivity_table(4.0).at(np.array([np.log10(luminance)]))
    np.testing.assert_allclose(table, expected[4], rtol=1e-3)


def test_uniform_table_interpolates_like_numpy():
    rng = np.random.default_rng(1)
    table = UniformTable(-2.0, 3.0, rng.normal(size=17))
    x = np.append(rng.uniform(-3, 4, 500), np.linspace(-2, 3, 17))
    np.testing.assert_allclose(table.at(x), np.interp(x, np.linspace(-2, 3, 17), table.values), atol=1e-13)


def test_spectral_sums_are_the_published_ones():
    assert channel_responses(1, None)[0, :2].sum() == pytest.approx(0.91856, abs=1e-5)
    np.testing.assert_allclose(
        channel_responses(3, None)[:, :2].sum(axis=1), [0.24000, 0.65969, 0.10440], atol=1e-5
    )
    for name in DISPLAYS:
        np.testing.assert_allclose(channel_responses(1, name)[0], channel_responses(3, name).sum(axis=0))


def test_encodings_by_hand():
    codes = np.array([[0.0, 0.04, 0.5, 1.0]])
    luma = linear_channels(codes, "luma-display", name="test")
    np.testing.assert_allclose(luma[0], 99 * codes**2.2 + 1)
    srgb = linear_channels(np.repeat(codes[..., None], 3, axis=2), "sRGB-display", name="test")
    expected = [1.0, 99 * 0.04 / 12.92 + 1, 99 * (0.555 / 1.055) ** 2.4 + 1, 100.0]
    np.testing.assert_allclose(srgb, np.tile(expected, (3, 1, 1)))
    white = np.array([[[0.9505, 1.0, 1.089]]]) * 80
    np.testing.assert_allclose(linear_channels(white, "XYZ", name="test").ravel(), [80, 80, 80], rtol=1e-3)
    rgb = np.arange(12.0).reshape(2, 2, 3)
    np.testing.assert_array_equal(linear_channels(rgb, "rgb-bt.709", name="test"), np.moveaxis(rgb, 2, 0))


def direct_surround_filter(image, sampling, transfer, surround):
    """Filter by definition: a canvas of twice the size, filled with the surround."""
    height, width = image.shape
    canvas = np.full((2 * height, 2 * width), surround)
    canvas[:height, :width] = image
    fy, fx = np.fft.fftfreq(2 * height) * sampling, np.fft.fftfreq(2 * width) * sampling
    gains = transfer(np.hypot(fy[:, None], fx))
    return np.fft.ifft2(np.fft.fft2(canvas) * gains).real[:height, :width]


@pytest.mark.parametrize("shape", [(9, 9), (17, 46), (37, 20), (64, 64), (1, 5)])
@pytest.mark.parametrize("surround", [1e-5, 30.0])
def test_surround_filter_equals_its_definition(shape, surround):
    image = np.random.default_rng(2).uniform(0, 100, shape)
    for transfer in (modulation_transfer, lambda rho: neural_sensitivity(rho, 3.0)):
        ours = surround_filter(shape, 25.0, transfer).apply(image, surround)
        np.testing.assert_allclose(ours, direct_surround_filter(image, 25.0, transfer, surround), atol=1e-11)


def test_scatter_keeps_a_field_like_its_surround_and_clips():
    flat = np.full((30, 41), 12.5)
    np.testing.assert_allclose(scattered(flat, 30.0, 12.5), flat, rtol=1e-12)
    spike = np.zeros((30, 41))
    spike[15, 20] = 1e6
    assert scattered(spike, 30.0, 1e-5).min() == 1e-5


def test_pyramid_kernels_have_the_published_sums():
    assert FIRST_LOW_PASS.shape == (9, 9)
    assert FIRST_HIGH_PASS.shape == (15, 15)
    assert LOW_PASS.shape == (17, 17)
    assert FIRST_LOW_PASS.sum() == pytest.approx(1.000000015, abs=1e-9)
    assert FIRST_HIGH_PASS.sum() == pytest.approx(1.36e-7, abs=1e-9)
    assert LOW_PASS.sum() == pytest.approx(1.999999762, abs=1e-9)
    for kernel in BANDS:
        assert kernel.shape == (9, 9)
        assert kernel.sum() == pytest.approx(0, abs=1e-12)
        np.testing.assert_array_equal(kernel, -kernel[::-1, ::-1])
    np.testing.assert_array_equal(BANDS[0], -BANDS[2].T)


def direct_build(image):
    """Build a pyramid by correlation, one plane after the other."""
    bands = [ndimage.correlate(image, FIRST_HIGH_PASS, mode="mirror")[None]]
    low = ndimage.correlate(image, FIRST_LOW_PASS, mode="mirror")
    height, width = image.shape
    while min(height, width) >= 17:
        bands.append(np.stack([ndimage.correlate(low, kernel, mode="mirror") for kernel in BANDS]))
        low = ndimage.correlate(low, LOW_PASS, mode="mirror")[::2, ::2]
        height, width = height // 2, width // 2
    return [*bands, low[None]]


def direct_collapse(bands):
    """Collapse a pyramid by convolution."""
    low = bands[-1][0]
    for planes in bands[-2:0:-1]:
        spread = np.zeros(planes.shape[1:])
        spread[::2, ::2] = low
        low = ndimage.convolve(spread, LOW_PASS, mode="mirror")
        for plane, kernel in zip(planes, BANDS, strict=True):
            low = low + ndimage.convolve(plane, kernel, mode="mirror")
    return ndimage.convolve(low, FIRST_LOW_PASS, mode="mirror") + ndimage.convolve(
        bands[0][0], FIRST_HIGH_PASS, mode="mirror"
    )


@pytest.mark.parametrize("shape", [(17, 17), (33, 18), (35, 70), (64, 64), (77, 101)])
def test_pyramid_equals_direct_filtering(shape):
    rng = np.random.default_rng(3)
    image = rng.normal(0, 50, shape)
    pyramid = steerable_pyramid(*shape)
    ours, direct = pyramid.build(image), direct_build(image)
    assert [band.shape for band in ours] == [band.shape for band in direct]
    assert [band.shape[1:] for band in ours[1:]] == level_shapes(*shape)
    for one, other in zip(ours, direct, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-10)
    noise = [rng.normal(size=band.shape) for band in ours]
    np.testing.assert_allclose(pyramid.collapse(noise), direct_collapse(noise), atol=1e-10)


def test_a_collapsed_pyramid_is_nearly_the_image():
    image = ndimage.gaussian_filter(np.random.default_rng(4).normal(size=(100, 120)), 1.5)
    pyramid = steerable_pyramid(100, 120)
    difference = pyramid.collapse(pyramid.build(image)) - image
    # Odd kernels do not fit mirrored borders, so only the inside is restored.
    assert np.abs(difference[20:-20, 20:-20]).max() < 0.04 * np.abs(image).max()


def test_pyramid_height_follows_the_halved_sides():
    assert level_shapes(17, 400) == [(17, 400), (9, 200)]
    assert level_shapes(33, 33) == [(33, 33), (17, 17)]
    assert level_shapes(34, 35) == [(34, 35), (17, 18), (9, 9)]
    assert len(level_shapes(555, 695)) == 7


def direct_resized_axis(values, new_size):
    """Resize one row, sample by sample, with one-based positions."""
    size = len(values)
    scale = new_size / size
    a = min(scale, 1.0)
    result = []
    for i in range(1, new_size + 1):
        u = i / scale + 0.5 * (1 - 1 / scale)
        total = weights = 0.0
        first = int(np.floor(u - 2 / a))
        for j in range(first, first + int(np.ceil(4 / a)) + 2):
            x = abs(a * (u - j))
            weight = 0.0
            if x <= 1:
                weight = 1.5 * x**3 - 2.5 * x**2 + 1
            elif x <= 2:
                weight = -0.5 * x**3 + 2.5 * x**2 - 4 * x + 2
            position = (j - 1) % (2 * size)
            total += weight * values[position if position < size else 2 * size - 1 - position]
            weights += weight
        result.append(total / weights)
    return np.array(result)


@pytest.mark.parametrize(("size", "new_size"), [(64, 33), (17, 34), (35, 18), (101, 3), (9, 17), (5, 64)])
def test_resize_equals_its_definition(size, new_size):
    row = np.random.default_rng(5).normal(size=size)
    expected = direct_resized_axis(row, new_size)
    image = row[None] * np.array([[1.0], [2.0]])
    np.testing.assert_allclose(resized(image, (2, new_size)), expected * [[1.0], [2.0]], atol=1e-12)
    np.testing.assert_allclose(resized(image.T, (new_size, 2)), (expected * [[1.0], [2.0]]).T, atol=1e-12)


def test_resize_keeps_constants_and_same_sizes():
    np.testing.assert_allclose(resized(np.full((20, 30), 2.5), (7, 61)), 2.5, rtol=1e-13)
    image = np.random.default_rng(6).normal(size=(4, 5))
    assert resized(image, (4, 5)) is image


def test_mutual_activity_is_a_box_with_zeros_outside():
    rng = np.random.default_rng(7)
    one, other = rng.normal(size=(2, 6, 9))
    both = np.minimum(np.abs(one), np.abs(other))
    expected = ndimage.convolve(both, np.full((3, 3), 1 / 9), mode="constant")
    np.testing.assert_allclose(mutual_activity(one, other), expected, atol=1e-14)


def test_masked_difference_equals_its_formula():
    rng = np.random.default_rng(8)
    test, reference = rng.normal(0, 5, (2, 8, 8))
    activity = [rng.uniform(0, 3, (n, 8, 8)) for n in (1, 4, 4, 1)]
    sensitivity = rng.uniform(0.01, 2, (8, 8))
    p, q = 10**0.544068, 10**0.49576
    gain, band, orientation = 2.0, 1, 2
    noise = 1 / sensitivity
    own = activity[1][2]
    crossed = activity[1].sum(axis=0) - own
    near = activity[0][0] / 1.0 + activity[2][2] / 4.0
    ex = gain * np.sign(test - reference) * np.abs((test - reference) / gain) ** p
    masking = gain * (
        10**0.189065 * (own / (noise * gain)) ** q
        + 10**0.449199 * (crossed / (noise * gain)) ** q
        + 10**1.52512 * (near / noise) ** q
    )
    neighbours = neighbour_activity(activity, band, orientation, gain=gain)
    np.testing.assert_allclose(neighbours, near)
    signal = masking_signal(own, activity[1].sum(axis=0), neighbours, gain=gain)
    ours = masked_difference(test, reference, sensitivity**p, signal * gain * sensitivity ** (p + q), gain=gain)
    np.testing.assert_allclose(ours, ex / np.sqrt(noise ** (2 * p) + masking**2), rtol=1e-12)
    unmasked = masked_difference(test, reference, sensitivity**p, None, gain=gain)
    np.testing.assert_allclose(unmasked, ex / noise**p, rtol=1e-12)


def test_the_base_band_masks_no_other():
    activity = [np.full((n, 4, 4), 5.0) for n in (1, 4, 1)]
    np.testing.assert_array_equal(neighbour_activity(activity, 0, 0, gain=1.0), np.full((4, 4), 2.5))
    np.testing.assert_array_equal(neighbour_activity(activity, 1, 3, gain=2.0), np.full((4, 4), 5.0))
    np.testing.assert_array_equal(neighbour_activity(activity, 2, 0, gain=4.0), np.full((4, 4), 2.5))


def test_pixels_per_degree_by_hand():
    # A square display of 1 m height, seen from 0.5 m, covers 90 degrees.
    assert pixels_per_degree(np.sqrt(2) * 1000 / 25.4, (900, 900), 0.5) == pytest.approx(10.0)


def test_options_know_their_surrounds():
    assert HdrVdp2Options().surrounds == (1e-5,)
    assert HdrVdp2Options(surround_l=(1.0, 2.0, 3.0)).surrounds == (1.0, 2.0, 3.0)
