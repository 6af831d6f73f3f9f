import tracemalloc
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import (
    Disparity,
    DisparityFlag,
    FuseConfig,
    InputError,
    PaperConfig,
    Photo,
    ResponseCurve,
    SourceFlag,
    StereoHdrWarning,
    StereoPair,
    fuse,
    pipeline,
)
from stereohdr.checks import check_exposure_order, check_views, doubtful_white_level
from stereohdr.errors import ConfigError, ExposureError, MemoryLimitError, ResponseError
from stereohdr.memory import PROCESS_BYTES
from stereohdr.methods import available_methods, get_method

from conftest import make_pair

CONFIG = PaperConfig(max_disparity=12)


def clipped_pair(**options):
    """Return a pair whose main view is over-exposed in places that the auxiliary view codes well."""
    return make_pair(60, 90, times=(0.64, 0.04), disparity=5, **options)


def with_codes(pair, *, left=None, right=None):
    return StereoPair(
        pair.left if left is None else replace(pair.left, codes=left),
        pair.right if right is None else replace(pair.right, codes=right),
        main=pair.main,
    )


def test_a_result_says_everything_about_itself(pair):
    result = fuse(pair, "paper", CONFIG)
    assert result.radiance.shape == (40, 64, 3)
    assert result.radiance.dtype == np.float32
    assert np.isfinite(result.radiance).all()
    assert (result.radiance > 0).all()
    assert result.source.dtype == np.uint8
    assert result.method == "paper"
    assert result.config is CONFIG
    assert result.exposures == (0.04, 0.16)
    assert list(result.seconds) == [
        "checks",
        "response",
        "radiance",
        "exposure map",
        "segmentation",
        "interest region",
        "disparity",
        "warping",
        "rejection",
        "filling",
        "edge-preserving filter",
        "Poisson editing",
        "fusion",
    ]
    assert set(result.versions) >= {"stereohdr", "numpy", "scipy", "numba", "python"}
    assert not result.stages
    assert not result.warnings


def test_stages_are_kept_on_request_in_order():
    stages = fuse(clipped_pair(), "paper", CONFIG, keep_stages=True).stages
    assert list(stages) == [
        "main_radiance",
        "auxiliary_radiance",
        "exposure_map",
        "main_superpixels",
        "auxiliary_superpixels",
        "main_segments",
        "auxiliary_segments",
        "main_interest",
        "auxiliary_interest",
        "auxiliary_disparity",
        "warped",
        "arrived",
        "rejected",
        "holes",
        "filled",
        "filtered",
        "restored",
        "smoothed_exposure_map",
        "weight",
    ]
    assert all(array.shape[:2] == (60, 90) for array in stages.values())


def test_clipped_pixels_get_the_radiance_that_the_auxiliary_view_measured():
    pair = clipped_pair()
    result = fuse(pair, "paper", CONFIG, response=ResponseCurve.gamma(2.2), keep_stages=True)
    s = result.stages["exposure_map"]
    assert s.mean() > 0.2
    # The truth inside S: the auxiliary view at disparity 5, where it is there and not clipped.
    truth = np.full_like(result.radiance, np.nan)
    truth[:, 5:] = result.stages["auxiliary_radiance"][:, :-5]
    inner = s.copy()
    inner[:, :20] = False
    error = np.log2(result.radiance[inner] / truth[inner])
    before = np.log2(result.stages["main_radiance"][inner] / truth[inner])
    assert np.sqrt((error**2).mean()) < 0.65 * np.sqrt((before**2).mean())  # texture becomes a membrane


def test_flags_agree_with_weight_and_radiance():
    result = fuse(clipped_pair(), "paper", CONFIG, keep_stages=True)
    main, s, weight = result.stages["main_radiance"], result.stages["exposure_map"], result.weight
    kept = np.isin(result.source, (SourceFlag.MEASURED, SourceFlag.NO_INFORMATION, SourceFlag.WEIGHT_CUT))
    np.testing.assert_array_equal(kept, weight == 0)
    np.testing.assert_array_equal(result.radiance[kept], main[kept])
    assert not (s & (result.source == SourceFlag.MEASURED)).any()
    assert not (~s & (result.source == SourceFlag.NO_INFORMATION)).any()
    rejected = result.stages["rejected"]
    assert rejected[result.source == SourceFlag.FILLED_REJECTED].all()
    assert not rejected[result.source == SourceFlag.AUXILIARY].any()
    assert weight.min() >= 0
    assert weight.max() <= 1
    assert {SourceFlag.MEASURED, SourceFlag.AUXILIARY} <= set(result.source.ravel())


@pytest.mark.parametrize("channels", [1, 3])
def test_a_mirrored_pair_gives_the_mirrored_result(channels):
    pair = clipped_pair(channels=channels)
    result = fuse(pair, "paper", CONFIG, keep_stages=True)
    mirrored = fuse(pair.mirrored(), "paper", CONFIG, keep_stages=True)
    assert (result.main, mirrored.main) == ("left", "right")
    np.testing.assert_array_equal(mirrored.radiance, result.radiance[:, ::-1])
    np.testing.assert_array_equal(mirrored.source, result.source[:, ::-1])
    np.testing.assert_array_equal(mirrored.disparity.values, result.disparity.values[:, ::-1])
    for name, array in result.stages.items():
        np.testing.assert_array_equal(mirrored.stages[name], array[:, ::-1], err_msg=name)


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_do_not_change_a_byte(threads):
    pair = clipped_pair()
    one, many = (fuse(pair, "paper", CONFIG, threads=n) for n in (1, threads))
    assert one.radiance.tobytes() == many.radiance.tobytes()
    assert one.source.tobytes() == many.source.tobytes()
    assert one.disparity.values.tobytes() == many.disparity.values.tobytes()


def test_the_same_pair_twice_gives_the_same_bytes():
    one, other = (fuse(clipped_pair(), "paper") for _ in range(2))
    assert one.radiance.tobytes() == other.radiance.tobytes()


@pytest.mark.parametrize(("dtype", "white"), [(np.uint16, 4095), (np.uint16, 65535)])
def test_deep_codes_give_nearly_the_same_result_as_8_bits(dtype, white):
    response = ResponseCurve.gamma(2.2)
    shallow = fuse(clipped_pair(), "paper", CONFIG, response=response)
    deep = fuse(clipped_pair(dtype=dtype, white=white), "paper", CONFIG, response=response)
    ratio = np.abs(np.log2(deep.radiance / shallow.radiance))
    assert np.median(ratio) < 0.02
    assert (deep.source == shallow.source).mean() > 0.8


def test_a_given_response_is_used_and_returned(pair):
    response = ResponseCurve.gamma(1.8)
    assert fuse(pair, "paper", CONFIG, response=response).response is response
    with pytest.raises(ResponseError, match="1 channel"):
        fuse(pair, "paper", CONFIG, response=ResponseCurve.gamma(1.8, 1))


def test_ablations_change_the_result():
    pair = clipped_pair()
    full = fuse(pair, "paper", CONFIG).radiance
    without_rejection = replace(CONFIG, rejection=replace(CONFIG.rejection, enabled=False))
    without_poisson = replace(CONFIG, poisson=replace(CONFIG.poisson, enabled=False))
    results = [fuse(pair, "paper", config).radiance for config in (without_rejection, without_poisson)]
    assert not np.array_equal(results[0], full)
    assert not np.array_equal(results[1], full)
    assert not np.array_equal(results[0], results[1])


@given(
    height=st.integers(1, 14),
    width=st.integers(1, 30),
    channels=st.sampled_from([1, 3]),
    main=st.sampled_from(["left", "right"]),
    seed=st.integers(0, 10_000),
)
def test_any_size_and_any_noise_gives_a_finite_positive_result(height, width, channels, main, seed):
    rng = np.random.default_rng(seed)
    left = rng.choice([0, 3, 60, 128, 200, 255], (height, width, channels)).astype(np.uint8)
    right = np.minimum(left.astype(int) + rng.integers(1, 200), 255).astype(np.uint8)
    pair = StereoPair(Photo(left, 0.01), Photo(right, 0.08), main=main)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)
        result = fuse(pair, "paper", response=ResponseCurve.srgb(channels), checks=False)
    assert result.radiance.shape == (height, width, channels)
    assert np.isfinite(result.radiance).all()
    assert (result.radiance > 0).all()


@pytest.mark.parametrize("size", [(1, 1), (1, 50), (50, 1), (2, 3), (200, 2)])
@pytest.mark.parametrize("method", ["robust", "paper"])
def test_tiny_and_thin_pairs_work(size, method):
    pair = make_pair(*size, disparity=0, times=(0.04, 0.16))
    result = fuse(pair, method, response=ResponseCurve.gamma(2.2))
    assert result.radiance.shape == (*size, 3)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(("code", "word"), [(0, "black"), (255, "white")])
def test_a_view_without_a_usable_pixel_gives_the_main_view_and_a_warning(pair, side, code, word):
    flat = np.full_like(pair.left.codes, code)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        result = fuse(with_codes(pair, **{side: flat}), "paper", CONFIG)
    assert [str(w.message) for w in caught] == list(result.warnings)
    assert all(w.category is StereoHdrWarning and w.filename == __file__ for w in caught)
    assert f"{side}: every pixel is {word}" in result.warnings[0]
    assert "sRGB curve is assumed" in result.warnings[1]
    assert result.method == "mv-only"
    assert np.isfinite(result.radiance).all()
    assert (result.weight == 0).all()
    expected = SourceFlag.NO_INFORMATION if side == "left" else SourceFlag.MEASURED
    assert (result.source == expected).mean() > 0.9


def test_swapped_exposure_times_are_noticed(pair):
    swapped = StereoPair(replace(pair.left, exposure_time=0.16), replace(pair.right, exposure_time=0.04))
    with pytest.raises(ExposureError, match="left should be the brighter one"):
        fuse(swapped)
    check_exposure_order(pair)


def test_identical_photos_at_different_times_are_noticed(pair):
    same = StereoPair(pair.left, replace(pair.left, exposure_time=0.16, name="copy"))
    with pytest.raises(ExposureError, match="left and copy hold the same picture"):
        fuse(same)


def test_checks_can_be_switched_off(pair):
    swapped = StereoPair(replace(pair.left, exposure_time=0.16), replace(pair.right, exposure_time=0.04))
    response = ResponseCurve.gamma(2.2)
    assert np.isfinite(fuse(swapped, "paper", CONFIG, response=response, checks=False).radiance).all()


def test_a_small_exposure_ratio_may_be_outweighed_by_the_view():
    pair = make_pair(60, 160, times=(0.04, 0.042), disparity=0)
    darker = (pair.right.codes * 0.97).astype(np.uint8)
    check_exposure_order(with_codes(pair, right=darker))
    with pytest.raises(ExposureError, match="contradict"):
        check_exposure_order(with_codes(pair, right=(pair.right.codes * 0.7).astype(np.uint8)))


def test_12_bit_codes_without_their_white_level_are_doubted():
    pair = make_pair(dtype=np.uint16, white=4095)
    wrong = StereoPair(replace(pair.left, white_level=65535), replace(pair.right, white_level=65535))
    assert "white level 4095" in (doubtful_white_level([wrong.left, wrong.right]) or "")
    assert doubtful_white_level([pair.left, pair.right]) is None
    assert doubtful_white_level([make_pair(dtype=np.uint16).left]) is None


def test_a_curve_that_falls_is_warned_of(pair):
    falling = ResponseCurve(-ResponseCurve.srgb().log_exposure)
    with pytest.warns(StereoHdrWarning, match="does not rise"):
        fuse(pair, "paper", CONFIG, response=falling)


def test_half_a_black_view_is_no_reason_to_doubt_the_rest():
    pair = make_pair(60, 200, disparity=8)
    codes = pair.left.codes.copy()
    codes[:, :100] = 0
    assert check_views(with_codes(pair, left=codes)) is None


@pytest.mark.parametrize("wrong", [None, "pair", (1, 2)])
def test_fuse_wants_a_pair(wrong):
    with pytest.raises(InputError, match="takes a StereoPair"):
        fuse(wrong)


@pytest.mark.parametrize("threads", [0, -2, 1.5, "2"])
def test_threads_are_counted_from_one(pair, threads):
    with pytest.raises(ConfigError, match="threads"):
        fuse(pair, threads=threads)


def test_a_response_is_an_object_not_a_file_name(pair):
    with pytest.raises(ResponseError, match=r"ResponseCurve\.load"):
        fuse(pair, response="camera.json")


def test_a_method_is_a_name(pair):
    with pytest.raises(ConfigError, match="given by its name, got a PaperConfig"):
        fuse(pair, PaperConfig())


def test_mv_only_is_the_initial_radiance(pair):
    alone = fuse(pair, "mv-only")
    np.testing.assert_array_equal(alone.radiance, fuse(pair, "paper", keep_stages=True).stages["main_radiance"])
    assert alone.method == "mv-only"


def test_exposure_times_in_other_units_change_the_weight_map_only():
    """The edge-preserving filter's sigma_r is absolute: see docs/method.md."""
    pair = clipped_pair()
    scaled = StereoPair(
        replace(pair.left, exposure_time=pair.left.exposure_time * 1000),
        replace(pair.right, exposure_time=pair.right.exposure_time * 1000),
    )
    one, other = (fuse(p, "paper", CONFIG, keep_stages=True) for p in (pair, scaled))
    np.testing.assert_allclose(other.response.log_exposure, one.response.log_exposure, atol=2e-6)
    np.testing.assert_allclose(other.stages["main_radiance"] * 1000, one.stages["main_radiance"], rtol=1e-5)
    np.testing.assert_array_equal(other.disparity.values, one.disparity.values)
    assert np.abs(other.weight - one.weight).max() > 0.1


def test_a_disparity_range_as_wide_as_the_image_is_refused(pair):
    with pytest.raises(ConfigError, match="below the image width 64"):
        fuse(pair, "paper", PaperConfig(max_disparity=64))


def test_unknown_methods_and_foreign_configs_are_refused(pair):
    with pytest.raises(ConfigError, match="unknown method 'magic'; known are robust, paper"):
        fuse(pair, "magic")
    with pytest.raises(ConfigError, match="takes a PaperConfig, got a FuseConfig"):
        fuse(pair, "paper", FuseConfig())


@pytest.mark.parametrize("name", ["paper", "mv-only", "opencv", "lin2009", "sun2010", "baetz2014", "oracle"])
def test_methods_that_cannot_plan_state_their_need(name):
    if name == "opencv":
        pytest.importorskip("cv2")
    pair = make_pair(300, 400, times=(0.64, 0.04), disparity=9)
    known = Disparity(np.full((300, 400), 9, np.float32), np.ones((300, 400), np.uint8))
    options = {
        "config": get_method(name).config_type(max_disparity=60),
        "response": ResponseCurve.gamma(2.2),
        "disparity": known if name == "oracle" else None,
    }
    fuse(pair, name, **options)  # compiles, imports, and fills caches
    tracemalloc.start()
    fuse(pair, name, **options)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    method = get_method(name)
    need = 300 * 400 * max(method.pixel_bytes, method.cell_bytes * 61)
    assert 0.4 * need < peak < 1.05 * need
    photos = pair.left.codes.nbytes + pair.right.codes.nbytes
    enough = PROCESS_BYTES + photos + need
    fuse(pair, name, memory=enough, **options)
    with pytest.raises(MemoryLimitError, match=rf"^left and right need about .*most of it for method {name}"):
        fuse(pair, name, memory=enough - 1, **options)


def test_the_need_of_a_method_from_elsewhere_may_be_unknown(monkeypatch, pair):
    unknown = replace(get_method("mv-only"), pixel_bytes=0)
    monkeypatch.setattr(pipeline, "get_method", lambda name: unknown)
    assert fuse(pair, "mv-only", memory="1MiB").method == "mv-only"


@pytest.mark.parametrize("wrong", ["4 apples", 12, "", True])
def test_a_memory_limit_is_a_size(pair, wrong):
    with pytest.raises(ConfigError, match="memory limit"):
        fuse(pair, memory=wrong)


def test_methods_are_found_by_name():
    assert available_methods()[:2] == ("robust", "paper")
    assert fuse(make_pair(60, 90, times=(0.64, 0.04))).method == "robust"
    method = get_method("paper")
    assert method.config_type is PaperConfig
    assert callable(method.load())


def test_progress_names_the_stages_as_they_start(pair):
    seen = []
    result = fuse(pair, "paper", CONFIG, progress=seen.append)
    assert seen == list(result.seconds)


def test_exchanged_photos_are_noticed_even_with_their_own_exposures():
    pair = make_pair(60, 160, disparity=12)
    fuse(pair)
    exchanged = StereoPair(replace(pair.right, name="right.png"), replace(pair.left, name="left.png"))
    with pytest.raises(InputError, match=r"right\.png and left\.png look exchanged"):
        fuse(exchanged)
    with pytest.raises(InputError, match="look exchanged"):
        fuse(replace(exchanged, main="right"))
    fuse(replace(pair, main="right"))


def test_a_pair_at_infinity_is_in_order():
    assert check_views(make_pair(60, 160, disparity=0)) is None


def test_unrelated_photos_are_fused_with_a_warning():
    left, right = make_pair(60, 160, seed=1).left, make_pair(60, 160, seed=2).right
    with pytest.warns(StereoHdrWarning, match="hardly match"):
        fuse(StereoPair(left, right), "paper", CONFIG)


@pytest.mark.parametrize("main", ["left", "right"])
def test_a_known_disparity_replaces_the_estimate(main):
    pair = replace(clipped_pair(), main=main)
    values = np.full((60, 90), 5, dtype=np.float32)
    known = Disparity(values, np.full((60, 90), DisparityFlag.MATCHED, np.uint8))
    result = fuse(pair, "paper", CONFIG, disparity=known, checks=False, keep_stages=True)
    np.testing.assert_array_equal(result.disparity.values, values)
    short = fuse(pair, "paper", PaperConfig(max_disparity=3), disparity=known, checks=False)
    assert short.statistics["disparity_min"] == 5  # even beyond the range that would have been searched
    landed = result.stages["arrived"]
    assert landed[:, 5:].all() if main == "left" else landed[:, :-5].all()
    with pytest.raises(InputError, match=r"shape \(3, 3\)"):
        fuse(pair, disparity=Disparity(np.zeros((3, 3), np.float32), np.zeros((3, 3), np.uint8)))
