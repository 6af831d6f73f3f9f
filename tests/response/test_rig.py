import numpy as np
import pytest

from stereohdr import Photo, ResponseCurve, StereoPair
from stereohdr.errors import InputError, ResponseError
from stereohdr.response import solve_response
from stereohdr.response.rig import estimate_rig_response, estimate_view_response
from stereohdr.simulation import Camera, expose, expose_pair, poles, room, street_night


@pytest.fixture(scope="module")
def scenes():
    scaled = []
    for make in (room, street_night, poles):
        scene = make(width=200, height=150)
        scale = np.float32(np.percentile(scene.radiance_left, 75))
        scaled.append((scene.radiance_left / scale, scene.radiance_right / scale))
    return scaled


def pairs_of(scenes, camera):
    exposures = ((0.5, 0.125), (2.0, 0.25))
    return [
        expose_pair(left, right, times, camera, 2 * number + which)
        for number, (left, right) in enumerate(scenes)
        for which, times in enumerate(exposures)
    ]


def rms(curve, truth):
    return np.sqrt(((curve.log_exposure - truth.log_exposure)[:, 5:251] ** 2).mean())


@pytest.mark.parametrize("name", ["linear", "gamma", "srgb", "s-shaped"])
def test_many_pairs_together_beat_most_of_them_alone(scenes, name):
    camera = Camera(response=name)
    truth, pairs = camera.response_curve(3), pairs_of(scenes, camera)
    together = estimate_rig_response(pairs)
    alone = [rms(estimate_rig_response([pair]).curve, truth) for pair in pairs]
    assert rms(together.curve, truth) < 0.06
    assert rms(together.curve, truth) < np.median(alone)
    assert together.curve.is_monotone
    assert together.residuals.shape == (6, 3)
    assert len(together.labels) == 6


def test_residuals_are_those_of_the_curve(scenes):
    result = estimate_rig_response(pairs_of(scenes, Camera())[:2])
    g, rows = result.curve.log_exposure[1], result.samples[1]
    own = rows[rows[:, 4] == 1]
    error = np.interp(own[:, 0], range(256), g) - np.interp(own[:, 1], range(256), g) - own[:, 3]
    codes = own[:, :2]
    hat = np.minimum(codes + 1, 256 - codes).min(axis=1)
    assert result.residuals[1, 1] == pytest.approx(np.sqrt((hat * error**2).sum() / hat.sum()))


def test_an_exposure_that_was_stated_wrongly_shows_in_the_residual(scenes):
    pairs = pairs_of(scenes, Camera())[:3]
    longer = Photo(pairs[2].right.codes, 1.6 * (pairs[2].right.exposure_time or 1), name="right")
    wrong = StereoPair(pairs[2].left, longer)
    right, off = (estimate_rig_response([*pairs[:2], last]).residual for last in (pairs[2], wrong))
    assert off > 2 * right


def test_a_bracket_gives_the_curve_of_debevec_with_residuals(scenes):
    camera = Camera()
    photos = [expose(scenes[0][0], time, camera, seed) for seed, time in enumerate((0.1, 0.4, 1.6))]
    result = estimate_view_response(photos)
    assert rms(result.curve, camera.response_curve(3)) < 0.03
    assert result.residual < 0.03
    assert result.labels == ("0.1 s, 0.4 s", "0.1 s, 1.6 s", "0.4 s, 1.6 s")


def test_pairs_that_do_not_belong_together_are_refused(scenes):
    one = pairs_of(scenes, Camera())[0]
    other = pairs_of(scenes, Camera(bits=12))[0]
    with pytest.raises(InputError, match=r"white level 4095, .* has 3 and 255; give photos of one camera model"):
        estimate_rig_response([one, other])
    with pytest.raises(InputError, match="at least one pair"):
        estimate_rig_response([])
    dark = StereoPair(Photo(np.zeros((9, 9), np.uint8), 1.0), Photo(np.zeros((9, 9), np.uint8), 2.0))
    with pytest.raises(ResponseError, match="hardly any radiance is well exposed in both"):
        estimate_rig_response([dark])


def opencv_samples(photos, count):
    """Return codes (N, photos) of each channel at the grid of pixels that calibrateDebevec takes."""
    height, width = photos[0].height, photos[0].width
    columns = int(np.sqrt(count * width / height))
    rows = count // columns
    step_x, step_y = width // columns, height // rows
    points = [(step_y // 2 + j * step_y, step_x // 2 + i * step_x) for i in range(columns) for j in range(rows)]
    points = [(y, x) for y, x in points if y < height and x < width]
    return [np.array([[p.codes[y, x, c] for p in photos] for y, x in points], int) for c in range(3)]


@pytest.mark.parametrize("smoothness", [10.0, 20.0])
def test_debevec_agrees_with_opencv_on_the_memorial_church(shared_data, smoothness, capsys):
    cv2 = pytest.importorskip("cv2", reason="OpenCV is not installed")
    if not hasattr(cv2, "createCalibrateDebevec"):
        pytest.skip("this OpenCV has no calibrateDebevec")
    from stereohdr.io import read_photo
    from stereohdr.io.metadata import parse_exposure_time

    folder = shared_data / "brackets" / "memorial"
    times = [parse_exposure_time(line) for line in (folder / "shutter_times.txt").read_text().split()]
    paths = sorted(folder.glob("*.png"))
    photos = [read_photo(path, exposure_time=t) for path, t in zip(paths, times, strict=True)]
    calibrate = cv2.createCalibrateDebevec(samples=70, lambda_=smoothness, random=False)
    theirs = np.log(
        calibrate.process([np.array(photo.codes) for photo in photos], np.array(times, np.float32))
    ).reshape(256, 3)
    raw, aligned = [], []
    for channel, samples in enumerate(opencv_samples(photos, 70)):
        ours = solve_response(samples, times, smoothness=smoothness)
        difference = (ours - theirs[:, channel])[20:236]
        raw.append(float(np.sqrt((difference**2).mean())))
        # OpenCV solves in single precision and misses its own equation g(128) = 0, by a constant that changes with
        # lambda and channel. The scale of an exposure is free, so both curves are compared with g(128) = 0.
        aligned.append(float(np.sqrt(((difference + theirs[128, channel]) ** 2).mean())))
    with capsys.disabled():
        print(f"\nmemorial, lambda {smoothness:g}: RMS of ln X against OpenCV over codes 20..235, RGB:")
        print(f"  both with g(128) = 0: {np.round(aligned, 4)}")
        print(f"  as OpenCV returns it: {np.round(raw, 4)}, its g(128): {np.round(theirs[128], 4)}")
    assert max(aligned) < 0.02


def test_linear_and_grey_curves():
    curve = ResponseCurve.linear(3, white_level=4095)
    x = curve.exposure_table(4095)
    np.testing.assert_allclose(x[1, 17:] / x[1, 4000], np.arange(17, 4096) / 4000, rtol=1e-9)
    assert ResponseCurve.linear(1).with_channels(3).channels == 3
    assert curve.with_channels(3).channels == 3
    with pytest.raises(ResponseError, match="has 3 channels, the photos have 1"):
        curve.with_channels(1)
