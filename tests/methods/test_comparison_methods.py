"""The methods that are compared with the paper's: each on walls and rooms whose truth is known."""

import sys
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import (
    Disparity,
    DisparityFlag,
    Photo,
    ResponseCurve,
    SourceFlag,
    StereoHdrWarning,
    StereoPair,
    fuse,
)
from stereohdr.config import PaperConfig, RejectionConfig, ResponseConfig
from stereohdr.disparity import match_windows
from stereohdr.errors import ConfigError, MissingDependencyError, ResponseError
from stereohdr.methods import BUILT_IN, get_method
from stereohdr.metrics import aligning_scale, log2_error, log2_rmse
from stereohdr.radiance import exposure_map, luminance
from stereohdr.response import estimate_response
from stereohdr.simulation import Camera, expose_pair, room

from conftest import make_pair

STEREO = ("opencv", "lin2009", "sun2010", "baetz2014")
ALL = (*STEREO, "oracle")
GAMMA = ResponseCurve.gamma(2.2)


def run(pair, method, max_disparity=12, **options):
    if method == "opencv":
        pytest.importorskip("cv2")
    if "response" not in options:
        options["response"] = ResponseCurve.gamma(2.2, pair.left.channels)
    if method == "oracle" and "disparity" not in options:
        shape = (pair.left.height, pair.left.width)
        options["disparity"] = Disparity(
            np.full(shape, min(5, shape[1] - 1), np.float32), np.full(shape, DisparityFlag.MATCHED, np.uint8)
        )
    config = get_method(method).config_type(max_disparity=max_disparity)
    return fuse(pair, method, config, **options)


def clipped_wall(**options):
    """Return a wall at disparity 5, over-exposed in places that the auxiliary view codes well."""
    return make_pair(60, 90, times=(0.64, 0.04), disparity=5, **options)


@pytest.fixture(scope="module")
def small_room():
    scene = room(width=120, height=90)
    scale = np.float32(np.percentile(scene.radiance_left, 75))
    pair = expose_pair(scene.radiance_left / scale, scene.radiance_right / scale, (2.0, 0.125), Camera(), 3)
    return scene, pair


def check(result, pair):
    radiance, main, s = result.radiance, result.stages["main_radiance"], result.stages["exposure_map"]
    assert radiance.dtype == np.float32
    assert radiance.shape == pair.left.codes.shape
    assert np.isfinite(radiance).all()
    assert (radiance > 0).all()
    assert result.weight.dtype == np.float32
    assert result.weight.min() >= 0
    assert result.weight.max() <= 1
    kept = result.weight == 0
    np.testing.assert_array_equal(radiance[kept], main[kept])
    unused = np.isin(result.source, (SourceFlag.MEASURED, SourceFlag.NO_INFORMATION, SourceFlag.WEIGHT_CUT))
    np.testing.assert_array_equal(unused, kept)
    assert not (s & (result.source == SourceFlag.MEASURED)).any()
    assert not (~s & (result.source == SourceFlag.NO_INFORMATION)).any()
    assert result.disparity.values.min() >= 0


@pytest.mark.parametrize("method", STEREO)
def test_a_room_gets_a_consistent_result(method, small_room):
    _, pair = small_room
    response = estimate_response(pair)
    result = run(pair, method, 18, response=response, keep_stages=True)
    check(result, pair)
    assert result.method == method
    assert result.config.max_disparity == 18
    assert result.response is response
    assert {"clipped_share", "occluded_share", "no_information_share", "disparity_max"} <= set(result.statistics)
    assert result.disparity.values.max() <= 18
    assert not result.warnings


@pytest.mark.parametrize("method", ALL)
def test_the_true_disparity_brings_the_room_nearer_to_the_truth(method, small_room):
    scene, pair = small_room
    truth = scene.radiance_left
    response = estimate_response(pair)
    result = run(pair, method, 18, response=response, disparity=scene.disparity_right, keep_stages=True)
    check(result, pair)
    before, after = (
        log2_rmse(log2_error(image, truth, scale=aligning_scale(image, truth, pair.left)), exposure_map(pair.left))
        for image in (result.stages["main_radiance"], result.radiance)
    )
    assert after < 0.85 * before
    np.testing.assert_array_equal(result.disparity.values, scene.disparity_right.values)


@pytest.mark.parametrize("method", ALL)
def test_the_clipped_wall_gets_the_radiance_of_the_auxiliary_view(method):
    pair = clipped_wall()
    result = run(pair, method, keep_stages=True)
    check(result, pair)
    s = result.stages["exposure_map"]
    assert s.mean() > 0.2
    auxiliary = GAMMA.apply(pair.right.codes, 255) / np.float32(0.04)
    truth = np.full_like(auxiliary, np.nan)
    truth[:, 5:] = auxiliary[:, :-5]
    inner = s.copy()
    inner[:, :8] = False
    error, before = (
        np.sqrt((np.log2(image[inner] / truth[inner]) ** 2).mean())
        for image in (result.radiance, result.stages["main_radiance"])
    )
    # Clipped windows hardly match: lin2009 and sun2010 fill nothing where the left-right check fails.
    assert error < (0.9 if method in ("lin2009", "sun2010") else 0.5) * before
    matched = result.disparity.flags == DisparityFlag.MATCHED
    assert (np.abs(result.disparity.values[matched] - 5) <= 1).mean() > 0.7


@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize("channels", [1, 3])
def test_a_mirrored_pair_gives_the_mirrored_result(method, channels):
    pair = clipped_wall(channels=channels)
    result = run(pair, method, keep_stages=True)
    mirrored = run(pair.mirrored(), method, keep_stages=True)
    assert mirrored.main == "right"
    np.testing.assert_array_equal(mirrored.radiance, result.radiance[:, ::-1])
    np.testing.assert_array_equal(mirrored.source, result.source[:, ::-1])
    np.testing.assert_array_equal(mirrored.disparity.values, result.disparity.values[:, ::-1])
    for name, array in result.stages.items():
        np.testing.assert_array_equal(mirrored.stages[name], array[:, ::-1], err_msg=name)


@pytest.mark.parametrize("method", ALL)
def test_threads_do_not_change_a_byte(method):
    one, two = (run(clipped_wall(), method, threads=n) for n in (1, 2))
    assert one.radiance.tobytes() == two.radiance.tobytes()
    assert one.disparity.values.tobytes() == two.disparity.values.tobytes()


@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize("white", [4095, 65535])
def test_deep_codes_give_nearly_the_result_of_8_bits(method, white):
    shallow = run(clipped_wall(), method)
    deep = run(clipped_wall(dtype=np.uint16, white=white), method)
    assert np.median(np.abs(np.log2(deep.radiance / shallow.radiance))) < 0.02


@pytest.mark.parametrize("method", ALL)
@given(
    height=st.integers(1, 9),
    width=st.integers(1, 20),
    channels=st.sampled_from([1, 3]),
    main=st.sampled_from(["left", "right"]),
    seed=st.integers(0, 10_000),
)
def test_any_size_and_any_noise_gives_a_consistent_result(method, height, width, channels, main, seed):
    rng = np.random.default_rng(seed)
    left = rng.choice([0, 3, 60, 128, 200, 255], (height, width, channels)).astype(np.uint8)
    right = np.minimum(left.astype(int) + rng.integers(1, 200), 255).astype(np.uint8)
    pair = StereoPair(Photo(left, 0.01), Photo(right, 0.08), main=main)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)
        result = run(pair, method, min(7, width - 1), checks=False, keep_stages=True)
    check(result, pair)


@pytest.mark.parametrize("method", ALL)
@pytest.mark.parametrize("size", [(1, 1), (1, 50), (50, 1), (2, 3), (200, 2)])
def test_tiny_and_thin_pairs_work(method, size):
    pair = make_pair(*size, disparity=0)
    result = run(pair, method, None, keep_stages=True)
    assert result.radiance.shape == (*size, 3)


def test_lin2009_matches_on_the_luminance_of_radiance():
    result = run(clipped_wall(), "lin2009", keep_stages=True)
    views = (luminance(result.stages[f"{view}_radiance"]) for view in ("auxiliary", "main"))
    expected = match_windows(*views, max_disparity=12)
    np.testing.assert_array_equal(result.stages["main_disparity"], expected[0].values)
    np.testing.assert_array_equal(result.disparity.values, expected[1].values)
    np.testing.assert_array_equal(result.disparity.flags, expected[1].flags)


@pytest.mark.parametrize("method", ["lin2009", "sun2010", "opencv"])
def test_both_views_count_everywhere_by_their_codes(method):
    pair = make_pair(60, 90, times=(0.04, 0.16))
    result = run(pair, method)
    assert (result.source == SourceFlag.AUXILIARY).mean() > 0.7
    assert 0.2 < np.median(result.weight[:, 10:-10]) < 0.9


def test_baetz2014_leaves_well_exposed_pixels_alone_and_fills_from_the_background():
    result = run(clipped_wall(), "baetz2014", keep_stages=True)
    s = result.stages["exposure_map"]
    np.testing.assert_array_equal(result.source[~s], SourceFlag.MEASURED)
    assert (result.source[s & ~result.stages["holes"]] == SourceFlag.AUXILIARY).all()
    assert (result.source[result.stages["holes"]] == SourceFlag.FILLED_OCCLUDED).all()
    assert result.stages["holes"].any()


def test_baetz2014_asks_for_a_calibrated_response():
    with pytest.warns(StereoHdrWarning, match="expects a calibrated response"):
        run(clipped_wall(), "baetz2014", response=None)


def test_of_two_clipped_views_the_shorter_one_bounds_the_highlight():
    """Otherwise a lamp that both views clip becomes a dark spot in what the shorter exposure measured."""
    pair = clipped_wall()
    left, right = pair.left.codes.copy(), pair.right.codes.copy()
    left[20:40, 40:60] = 255
    right[20:40, 35:55] = 255
    pair = StereoPair(replace(pair.left, codes=left), replace(pair.right, codes=right))
    known = Disparity(np.full((60, 90), 5, np.float32), np.full((60, 90), DisparityFlag.MATCHED, np.uint8))
    for method in STEREO[1:]:
        result = run(pair, method, disparity=known)
        lamp = result.radiance[22:38, 42:58]
        assert (lamp > 0.99 * GAMMA.exposure_table(255)[:, 255] / 0.04).all(), method


def test_lin2009_estimates_its_response_from_sift():
    pytest.importorskip("skimage")
    pair = make_pair(120, 160, times=(0.02, 0.08))
    config = get_method("lin2009").config_type(max_disparity=18)
    result = fuse(pair, "lin2009", config)
    expected = estimate_response(pair, config=config.response, max_disparity=18)
    np.testing.assert_array_equal(result.response.log_exposure, expected.log_exposure)
    with pytest.raises(ResponseError, match="SIFT"):
        fuse(make_pair(12, 12), "lin2009")


def test_the_paper_runs_with_the_conventional_response():
    pytest.importorskip("skimage")
    pair = make_pair(120, 160, times=(0.02, 0.08))
    sift = ResponseConfig(samples="sift")
    result = fuse(pair, "paper", PaperConfig(max_disparity=12, response=sift))
    expected = estimate_response(pair, config=sift)
    np.testing.assert_array_equal(result.response.log_exposure, expected.log_exposure)
    assert (result.response.log_exposure != estimate_response(pair).log_exposure).any()


def test_sun2010_finds_the_response_from_its_first_matches():
    result = run(make_pair(120, 160, times=(0.02, 0.08)), "sun2010", response=None, keep_stages=True)
    assert "first_disparity" in result.stages
    assert list(result.seconds)[1:4] == ["first disparity", "response", "radiance"]
    codes = np.arange(15, 230)
    error = (result.response.log_exposure - GAMMA.log_exposure)[:, codes]
    assert np.sqrt((error**2).mean()) < 0.08
    with pytest.warns(StereoHdrWarning, match="assumed gamma curve is kept"):
        few = run(make_pair(2, 2, disparity=0), "sun2010", None, response=None, checks=False)
    np.testing.assert_array_equal(few.response.log_exposure, GAMMA.log_exposure)


def test_opencv_merges_as_the_debevec_equation_says():
    pytest.importorskip("cv2")
    pair = clipped_wall()
    known = Disparity(np.full((60, 90), 5, np.float32), np.full((60, 90), DisparityFlag.MATCHED, np.uint8))
    result = run(pair, "opencv", disparity=known)
    main, auxiliary = pair.left.codes[:, 5:], pair.right.codes[:, :-5]
    weights = [np.minimum(z, 255 - z).mean(axis=2, keepdims=True) + 1e-6 for z in (main, auxiliary)]
    logs = [
        np.log(GAMMA.apply(z, 255).astype(float) / t) for z, t in zip((main, auxiliary), (0.64, 0.04), strict=True)
    ]
    expected = np.exp((weights[0] * logs[0] + weights[1] * logs[1]) / (weights[0] + weights[1]))
    share = (weights[1] / (weights[0] + weights[1]))[..., 0]
    used = share >= 1 / 256
    assert used.mean() > 0.95
    np.testing.assert_allclose(result.radiance[:, 5:][used], expected[used], rtol=1e-4)
    np.testing.assert_allclose(result.weight[:, 5:], np.where(used, share, 0), rtol=1e-5)
    assert (result.weight[:, :5] == 0).all()


def test_a_missing_opencv_is_said(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MissingDependencyError, match=r"stereohdr\[opencv\]"):
        fuse(clipped_wall(), "opencv")


def test_the_oracle_is_the_papers_fusion_without_rejection():
    pair = clipped_wall()
    known = Disparity(np.full((60, 90), 5, np.float32), np.full((60, 90), DisparityFlag.MATCHED, np.uint8))
    result = run(pair, "oracle", disparity=known)
    config = PaperConfig(max_disparity=12, rejection=RejectionConfig(enabled=False))
    expected = fuse(pair, "paper", config, response=GAMMA, disparity=known)
    np.testing.assert_array_equal(result.radiance, expected.radiance)
    assert result.method == "oracle"
    assert not result.config.rejection.enabled


@pytest.mark.parametrize("method", ALL)
def test_what_the_main_view_does_not_see_is_not_warped_into_it(method):
    """As behind a nearer surface that the auxiliary view has outside of its frame."""
    flags = np.full((60, 90), DisparityFlag.MATCHED, np.uint8)
    flags[:, 20:40] = DisparityFlag.OCCLUDED
    known = Disparity(np.full((60, 90), 5, np.float32), flags)
    result = run(clipped_wall(), method, disparity=known, keep_stages=True)
    np.testing.assert_array_equal(result.stages["arrived"][:, 5:], flags[:, :-5] == DisparityFlag.MATCHED)
    np.testing.assert_array_equal(result.disparity.flags, flags)


def test_the_oracle_says_what_it_needs():
    with pytest.raises(ConfigError, match="'oracle' needs the true disparity of the auxiliary view"):
        fuse(clipped_wall(), "oracle", response=GAMMA)
    with pytest.warns(StereoHdrWarning, match="expects the true response"):
        run(clipped_wall(), "oracle", response=None)


def test_stand_ins_say_so():
    for name in ("lin2009", "sun2010", "baetz2014"):
        assert "stand-in: the original's inner details are not public" in BUILT_IN[name].summary
        module = sys.modules[get_method(name).load().__module__]
        text = " ".join((module.__doc__ or "").split())
        assert "stand-in: the original's inner details are not public" in text
        assert "Known:" in text
        assert "Chosen here:" in text
