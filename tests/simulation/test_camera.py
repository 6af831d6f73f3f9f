from itertools import pairwise

import numpy as np
import pytest

from stereohdr.errors import ExposureError, InputError
from stereohdr.model import MID_KNOT, ResponseCurve
from stereohdr.simulation.camera import Camera, expose, expose_pair, reexpose_codes

RESPONSES = ["linear", "gamma", "srgb", "s-shaped"]


def row(*values, channels=1):
    """One row of radiance, the same in every channel."""
    return np.repeat(np.array(values, np.float64)[None, :, None], channels, axis=2)


def codes_of(camera, *values, time=1.0):
    return expose(row(*values), time, camera, seed=0).codes[0, :, 0].tolist()


# Worked by hand: code = floor(255 f(X) + 1/2) for X = 0, 1/4, 1/2, 1, and 2, which saturates.
@pytest.mark.parametrize(
    ("response", "gamma", "expected"),
    [
        ("linear", 2.2, [0, 64, 128, 255, 255]),  # 63.75, 127.5
        ("gamma", 2.0, [0, 128, 180, 255, 255]),  # 255 * 0.5 = 127.5, 255 * 0.70711 = 180.31
        ("srgb", 2.2, [0, 137, 188, 255, 255]),  # 255 * 0.53710 = 136.96, 255 * 0.73536 = 187.52
        ("s-shaped", 1.0, [0, 45, 128, 255, 255]),  # 255 * 0.14359 / (0.14359 + 0.66848) = 45.09, 127.5
    ],
)
def test_codes_without_noise(response, gamma, expected):
    camera = Camera(response=response, gamma=gamma, noise=False)
    assert codes_of(camera, 0.0, 0.25, 0.5, 1.0, 2.0) == expected


def test_exposure_is_radiance_times_time():
    camera = Camera(response="linear", noise=False)
    assert codes_of(camera, 2.0, 3.0, 1e300, time=0.125) == [64, 96, 255]  # X = 0.25, 0.375


def test_deeper_codes_have_their_white_level():
    photo = expose(row(0.5, 1.0, 9.0), 1.0, Camera(response="linear", bits=12, noise=False), seed=0)
    assert photo.codes.dtype == np.uint16
    assert photo.white_level == 4095
    assert photo.codes[0, :, 0].tolist() == [2048, 4095, 4095]
    assert expose(row(0.5), 1.0, Camera(bits=8), seed=0).codes.dtype == np.uint8
    assert expose(row(7.0), 1.0, Camera(bits=16, noise=False), seed=0).codes[0, 0, 0] == 65535


def test_photo_carries_time_and_name():
    photo = expose(row(0.5), 0.25, Camera(), seed=0, name="near")
    assert (photo.exposure_time, photo.name) == (0.25, "near")


def test_codes_carry_the_pedestal():
    camera = Camera(response="linear", bits=12, black_level=64, noise=False)
    assert codes_of(camera, 0.0, 0.5, 1.0, 5.0) == [64, 2080, 4095, 4095]  # 64 + 4031 / 2 = 2079.5


@pytest.mark.parametrize("response", RESPONSES)
def test_noise_below_zero_survives_on_the_pedestal_only(response):
    dark = np.zeros((60, 60, 1))
    on_pedestal = expose(dark, 1.0, Camera(response=response, bits=12, black_level=500), seed=1).codes
    below, above = (on_pedestal < 500).mean(), (on_pedestal > 500).mean()
    assert below > 0.3
    assert abs(below - above) < 4 / 60  # four standard errors
    without = expose(dark, 1.0, Camera(response=response, bits=12), seed=1).codes
    assert (without == 0).mean() > 0.4


def test_response_per_channel():
    camera = Camera(response=("linear", "gamma", "srgb"), gamma=(1.0, 2.0, 1.0), noise=False)
    photo = expose(row(0.25, channels=3), 1.0, camera, seed=0)
    assert photo.codes[0, 0].tolist() == [64, 128, 137]
    curve = camera.response_curve(3).log_exposure
    np.testing.assert_allclose(curve[1], ResponseCurve.gamma(2.0, 1).log_exposure[0])
    np.testing.assert_allclose(curve[2], ResponseCurve.srgb(1).log_exposure[0])


@pytest.mark.parametrize("exposure", [0.002, 0.05, 0.5])
def test_noise_has_the_mean_and_variance_of_poisson_plus_gaussian(exposure):
    side, full_well, read_noise = 300, 12000.0, 4.0
    camera = Camera(response="linear", bits=16, black_level=1000, full_well=full_well, read_noise=read_noise)
    codes = expose(np.full((side, side, 1), exposure), 1.0, camera, seed=11).codes.astype(np.float64)
    electrons = (codes - 1000) / (65535 - 1000) * full_well
    expected_mean = exposure * full_well
    expected_variance = expected_mean + read_noise**2
    n = side * side
    assert abs(electrons.mean() - expected_mean) < 4 * np.sqrt(expected_variance / n)
    # standard error of a variance: v sqrt(2 / n), a little more for Poisson
    assert abs(electrons.var() - expected_variance) < 4.5 * expected_variance * np.sqrt(2 / n)


def test_noise_is_independent_between_pixels_and_channels():
    codes = expose(np.full((200, 200, 3), 0.3), 1.0, Camera(response="linear", bits=12), seed=5).codes
    residual = codes - codes.mean(axis=(0, 1))
    for one, two in (
        (residual[..., 0], residual[..., 1]),
        (residual[..., 1], residual[..., 2]),
        (residual[:, 1:], residual[:, :-1]),
    ):
        assert abs(np.corrcoef(one.ravel(), two.ravel())[0, 1]) < 0.03  # 1 / sqrt(40000) = 0.005


@pytest.mark.parametrize("response", RESPONSES)
def test_codes_grow_with_exposure(response):
    radiance = np.random.default_rng(2).gamma(1.0, 1.0, (20, 30, 3))
    camera = Camera(response=response, bits=10, noise=False)
    shots = [expose(radiance, t, camera, seed=0).codes.astype(int) for t in (0.01, 0.1, 0.3, 1.0, 4.0)]
    for shorter, longer in pairwise(shots):
        assert (longer >= shorter).all()
        assert (longer > shorter).mean() > 0.3


def test_same_seed_same_bytes():
    radiance = np.random.default_rng(3).random((20, 30, 3))
    first, again, other = (expose(radiance, 0.5, Camera(), seed=s).codes for s in (7, 7, 8))
    assert first.tobytes() == again.tobytes()
    assert (first != other).mean() > 0.2


def test_without_noise_the_seed_does_not_matter():
    radiance = np.random.default_rng(3).random((20, 30, 3))
    first, other = (expose(radiance, 0.5, Camera(noise=False), seed=s).codes for s in (7, 8))
    assert (first == other).all()


@pytest.mark.parametrize("response", RESPONSES)
@pytest.mark.parametrize(("bits", "black_level"), [(8, 0), (12, 0), (12, 256), (8, 5)])
def test_true_curve_undoes_the_camera(response, bits, black_level):
    camera = Camera(response=response, bits=bits, black_level=black_level, noise=False)
    exposure = np.geomspace(0.01, 0.95, 4000)
    photo = expose(row(*exposure, channels=3), 1.0, camera, seed=0)
    curve = camera.response_curve(3)
    assert curve.is_monotone
    assert (curve.log_exposure[:, MID_KNOT] == 0).all()
    estimate = curve.apply(photo.codes, photo.white)[0, :, 1].astype(np.float64)
    error = np.log(estimate / exposure)
    error -= np.median(error)
    # half a code of error in z is half a step of g, plus what interpolation between 256 knots costs
    step = np.gradient(np.log(curve.exposure_table(photo.white)[1]))[photo.codes[0, :, 1]]
    assert (np.abs(error) <= 0.65 * step + (0 if bits == 8 else 2e-3)).all()
    assert np.abs(error).max() > 0  # the bound is a bound on something


def test_true_curve_is_the_named_curve():
    for camera, expected in (
        (Camera(response="linear"), ResponseCurve.gamma(1.0)),
        (Camera(response="gamma", gamma=2.4), ResponseCurve.gamma(2.4)),
        (Camera(response="srgb"), ResponseCurve.srgb()),
        (Camera(response="srgb", bits=12), ResponseCurve.srgb()),
    ):
        np.testing.assert_allclose(camera.response_curve(3).log_exposure, expected.log_exposure, atol=1e-12)
    assert Camera().response_curve(1).channels == 1


def test_pair_has_its_own_noise_per_view():
    radiance = np.full((40, 50, 3), 0.2)
    # a quarter of the radiance for four times as long: the same exposure X in both views
    pair = expose_pair(radiance, radiance / 4, (1.0, 4.0), Camera(response="linear"), seed=3)
    assert (pair.left.codes != pair.right.codes).mean() > 0.3
    again = expose_pair(radiance, radiance / 4, (1.0, 4.0), Camera(response="linear"), seed=3)
    assert (pair.left.codes == again.left.codes).all()
    assert (pair.right.codes == again.right.codes).all()


def test_pair_puts_the_main_view_on_its_side():
    main, auxiliary = np.full((4, 5, 1), 0.8), np.full((4, 5, 1), 0.1)
    camera = Camera(response="linear", noise=False)
    pair = expose_pair(main, auxiliary, (0.5, 2.0), camera, seed=0, main="right")
    assert pair.main == "right"
    assert pair.main_photo is pair.right
    assert pair.exposures == (0.5, 2.0)
    assert int(pair.right.codes[0, 0, 0]) == 102  # 255 * 0.8 * 0.5
    assert int(pair.left.codes[0, 0, 0]) == 51  # 255 * 0.1 * 2
    assert (pair.left.name, pair.right.name) == ("left", "right")


def test_reexposed_codes_come_back():
    codes = np.random.default_rng(4).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    codes[0, :, 0], codes[1, :, 0] = 0, 255
    radiance = reexpose_codes(codes, seed=9)
    assert radiance.dtype == np.float32
    assert radiance.min() >= 0
    assert radiance.max() <= 1
    again = expose(radiance, 1.0, Camera(response="gamma", gamma=2.2, noise=False), seed=0).codes
    assert (again == codes).all()
    # and the dither fills the whole code: mean 0, standard deviation 1 / sqrt(12)
    dither = (255.0 * radiance.astype(np.float64) ** (1 / 2.2) - codes)[(codes > 0) & (codes < 255)]
    assert abs(dither.mean()) < 0.02
    assert abs(dither.std() - 12**-0.5) < 0.01


def test_reexpose_is_seeded_and_takes_its_gamma():
    codes = np.full((8, 8), 100, np.uint8)
    first, again, other = (reexpose_codes(codes, seed=s) for s in (1, 1, 2))
    assert first.shape == (8, 8, 1)
    assert (first == again).all()
    assert (first != other).any()
    np.testing.assert_allclose(reexpose_codes(codes, gamma=1.0, seed=1), 100 / 255, atol=0.5 / 255)


@pytest.mark.parametrize(
    ("settings", "match"),
    [
        ({"response": "log"}, "linear, gamma, srgb, s-shaped, got 'log'"),
        ({"response": ("srgb", "odd", "srgb")}, "'odd'"),
        ({"gamma": 0.0}, "gamma"),
        ({"gamma": float("nan")}, "gamma"),
        ({"full_well": 0.0}, "full_well"),
        ({"read_noise": -1.0}, "read_noise"),
        ({"bits": 7}, "bits must be 8 to 16, got 7"),
        ({"bits": 17}, "bits"),
        ({"bits": 9.5}, "bits"),
        ({"black_level": -1}, "black_level"),
        ({"black_level": 255}, "black_level must be a whole code from 0 to 254"),
    ],
)
def test_bad_cameras_are_refused(settings, match):
    with pytest.raises(InputError, match=match):
        Camera(**settings)


@pytest.mark.parametrize(
    ("radiance", "match"),
    [
        (np.full((4, 4, 1), np.nan), "NaN"),
        (np.full((4, 4, 1), np.inf), "infinity"),
        (np.full((4, 4, 1), -0.5), "smallest value is -0.5"),
        (np.ones((4, 4)), "shape"),
        (np.ones((4, 4, 2)), "shape"),
        (np.ones((0, 4, 3)), "shape"),
        (np.ones((4, 4, 3), np.uint8), "floating point"),
    ],
)
def test_bad_radiance_is_refused(radiance, match):
    with pytest.raises(InputError, match=match):
        expose(radiance, 1.0, Camera(), seed=0)


def test_bad_arguments_are_refused():
    image = np.ones((4, 4, 3))
    for time in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ExposureError, match="exposure time"):
            expose(image, time, Camera(), seed=0)
    with pytest.raises(InputError, match="seed"):
        expose(image, 1.0, Camera(), seed=-1)
    with pytest.raises(InputError, match="2 channel"):
        expose(image, 1.0, Camera(response=("srgb", "srgb")), seed=0)
    with pytest.raises(InputError, match="1 or 3 channels"):
        Camera().response_curve(2)
    with pytest.raises(InputError, match="main view"):
        expose_pair(image, image, (1.0, 2.0), Camera(), seed=0, main="top")  # type: ignore[arg-type]
    with pytest.raises(ExposureError, match="same exposure"):
        expose_pair(image, image, (1.0, 1.0), Camera(), seed=0)
    with pytest.raises(InputError, match="size"):
        expose_pair(image, image[:, :3], (1.0, 2.0), Camera(), seed=0)
    with pytest.raises(InputError, match="uint8"):
        reexpose_codes(np.zeros((4, 4), np.uint16), seed=0)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="gamma"):
        reexpose_codes(np.zeros((4, 4), np.uint8), gamma=0.0, seed=0)
