from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy import ndimage

from stereohdr.config import SemiGlobalConfig
from stereohdr.disparity import census_transform
from stereohdr.disparity.semiglobal import Bands, StripMatcher, match_semiglobal, semiglobal_bytes
from stereohdr.errors import ConfigError, InputError

from reference import semiglobal as twin

FIELDS = ("disparity", "cost", "margin", "matching_cost")


def texture(seed, height, width):
    """Smooth noise that can be sampled between pixels, positive."""
    rng = np.random.default_rng(seed)
    return np.exp(ndimage.gaussian_filter(rng.normal(size=(height, width)), (1.0, 1.5)) * 3)


def shifted_views(seed, height, width, disparity):
    """Views of a texture: the auxiliary view sees at x what the main view sees at x + disparity."""
    margin = 30
    scene = texture(seed, height, width + 2 * margin)
    y, x = np.mgrid[:height, margin : margin + width].astype(float)
    main = scene[:, margin : margin + width]
    auxiliary = ndimage.map_coordinates(scene, [y, x + disparity], order=3)
    return main.astype(np.float32), np.maximum(auxiliary, 1e-3).astype(np.float32)


def match(main, auxiliary, disparities, **settings):
    threads = settings.pop("threads", None)
    planes = [census_transform(view) for view in (main, auxiliary)]
    return match_semiglobal(
        *planes, np.log(main), disparities=disparities, config=SemiGlobalConfig(**settings), threads=threads
    )


def assert_equals_the_twin(planes, guide, disparities, config, bands=None):
    got = match_semiglobal(*planes, guide, disparities=disparities, config=config, bands=bands)
    expected = twin.match_semiglobal(*planes, guide, disparities=disparities, config=config, bands=bands)
    for view in range(2):
        for field, values in zip(FIELDS, expected[view], strict=True):
            result = getattr(got[view], field)
            assert result.dtype == values.dtype
            np.testing.assert_array_equal(result, values, err_msg=f"{field} of view {view}")


def random_bands(rng, block, height, width, disparities):
    shape = -(-height // block), -(-width // block)
    lowest = rng.integers(disparities[0], disparities[1] + 1, shape)
    return Bands(block, lowest, rng.integers(1, disparities[1] - lowest + 2, shape))


def match_in_strips(planes, guide, cuts, **settings):
    """Match the strips between the cuts, and put them together."""
    matcher = StripMatcher(guide.shape, **settings)
    strips = list(pairwise(cuts))

    def views(strip):
        rows = slice(*matcher.rows_around(strip))
        return planes[0][:, rows], planes[1][:, rows], guide[rows]

    for strip in strips[:0:-1]:
        matcher.prepare(strip, *views(strip))
    parts = [matcher.match(strip, *views(strip)) for strip in strips]
    return [[np.concatenate([getattr(part[v], field) for part in parts]) for field in FIELDS] for v in range(2)]


CONFIGS = [
    SemiGlobalConfig(),
    SemiGlobalConfig(paths=4),
    SemiGlobalConfig(small_penalty=0, large_penalty=1, outside_cost=48),
    SemiGlobalConfig(small_penalty=100, large_penalty=200, edge_factor=0.0, outside_cost=0),
    SemiGlobalConfig(small_penalty=5, large_penalty=150, edge_factor=2.0),
]


@given(
    height=st.integers(1, 7),
    width=st.integers(1, 12),
    lowest=st.integers(-14, 11),
    count=st.integers(1, 20),
    config=st.sampled_from(CONFIGS),
    kind=st.sampled_from(["related", "unrelated", "flat", "opposite"]),
    seed=st.integers(0, 100),
)
@example(height=1, width=12, lowest=0, count=5, config=CONFIGS[0], kind="related", seed=0)
@example(height=9, width=1, lowest=0, count=1, config=CONFIGS[2], kind="unrelated", seed=1)
@example(height=3, width=40, lowest=0, count=31, config=CONFIGS[0], kind="related", seed=2)
@example(height=3, width=40, lowest=-3, count=32, config=CONFIGS[1], kind="related", seed=3)
@example(height=3, width=40, lowest=2, count=33, config=CONFIGS[3], kind="related", seed=4)
@example(height=2, width=35, lowest=-32, count=64, config=CONFIGS[4], kind="unrelated", seed=5)
def test_maps_equal_the_twin(height, width, lowest, count, config, kind, seed):
    lowest = max(min(lowest, width - 1), 2 - width - count)  # some disparity has a partner
    rng = np.random.default_rng(seed)
    planes = rng.integers(0, 2**48, (2, 2, height, width)).astype(np.uint64)
    if kind == "related":
        planes = [census_transform(view) for view in shifted_views(seed, height, width, lowest + count // 2)]
    elif kind == "flat":
        planes[:] = 5
    elif kind == "opposite":  # all codes unequal: the largest costs
        planes[0] = 0
        planes[1] = 2**48 - 1
    guide = rng.choice([0.0, 0.01, 0.3], (height, width)).astype(np.float32)
    assert_equals_the_twin(planes, guide, (lowest, lowest + count - 1), config)


@given(
    height=st.integers(1, 9),
    width=st.integers(1, 14),
    block=st.integers(2, 6),
    count=st.integers(1, 70),
    config=st.sampled_from([*CONFIGS[:3], SemiGlobalConfig(small_penalty=100, large_penalty=103)]),
    seed=st.integers(0, 1000),
)
@example(height=7, width=45, block=2, count=90, config=CONFIGS[0], seed=3)
def test_bands_equal_the_twin(height, width, block, count, config, seed):
    rng = np.random.default_rng(seed)
    lowest = int(rng.integers(2 - width - count, width))
    disparities = lowest, lowest + count - 1
    planes = rng.integers(0, 2**48, (2, 2, height, width)).astype(np.uint64)
    guide = rng.choice([0.0, 0.01, 0.3], (height, width)).astype(np.float32)
    bands = random_bands(rng, block, height, width, disparities)
    assert_equals_the_twin(planes, guide, disparities, config, bands)


def test_a_band_that_holds_all_disparities_changes_nothing():
    main, auxiliary = shifted_views(13, 40, 70, 6)
    planes = [census_transform(view) for view in (main, auxiliary)]
    blocks = np.ones((5, 9), dtype=int)
    whole = match_semiglobal(*planes, np.log(main), disparities=(-2, 40))
    banded = match_semiglobal(
        *planes, np.log(main), disparities=(-2, 40), bands=Bands(8, -2 * blocks, 43 * blocks)
    )
    for one, other in zip(whole, banded, strict=True):
        for field in FIELDS:
            np.testing.assert_array_equal(getattr(one, field), getattr(other, field))


@given(
    height=st.integers(1, 40),
    width=st.integers(1, 24),
    count=st.integers(1, 66),
    cuts=st.sets(st.integers(1, 19)),
    block=st.sampled_from([None, 2, 4, 5, 8]),
    seed=st.integers(0, 1000),
)
@example(height=40, width=24, count=66, cuts={1, 2, 3, 19}, block=4, seed=0)
@example(height=40, width=24, count=66, cuts={1, 7}, block=None, seed=0)
def test_strips_equal_the_whole_image(height, width, count, cuts, block, seed):
    rng = np.random.default_rng(seed)
    lowest = int(rng.integers(2 - width - count, width))
    settings = {"disparities": (lowest, lowest + count - 1), "config": CONFIGS[seed % 2]}
    if block is not None:
        settings["bands"] = random_bands(rng, block, height, width, settings["disparities"])
    planes = rng.integers(0, 2**48, (2, 2, height, width)).astype(np.uint64)
    guide = rng.choice([0.0, 0.01, 0.3], (height, width)).astype(np.float32)
    whole = match_semiglobal(*planes, guide, **settings)
    rows = [0, *(2 * cut for cut in sorted(cuts) if 2 * cut < height), height]
    for view, parts in enumerate(match_in_strips(planes, guide, rows, **settings)):
        for field, values in zip(FIELDS, parts, strict=True):
            np.testing.assert_array_equal(values, getattr(whole[view], field), err_msg=f"{field} of view {view}")


def test_larger_images_equal_the_twin():
    main, auxiliary = shifted_views(6, 14, 60, 7)
    planes = [census_transform(view) for view in (main, auxiliary)]
    assert_equals_the_twin(planes, np.log(main), (0, 35), SemiGlobalConfig())


def test_one_row_by_hand():
    # Three pixels, disparities 0 and 1; 0, 10 or 30 unequal codes. Pixel 0 has no partner at disparity 1.
    codes = {0: 0, 10: 2**10 - 1, 30: 2**30 - 1}
    main = np.zeros((2, 1, 3), dtype=np.uint64)
    auxiliary = np.zeros((2, 1, 3), dtype=np.uint64)
    auxiliary[0, 0] = [codes[10], codes[30], codes[0]]
    config = SemiGlobalConfig(small_penalty=2, large_penalty=6, edge_factor=1.0, outside_cost=20, paths=4)
    guide = np.array([[0.0, 1.0, 1.0]], dtype=np.float32)
    got = match_semiglobal(main, auxiliary, guide, disparities=(0, 1), config=config)[0]
    # Cost at d = 0, of 10, 30, 0:      (10 + 30) / 2 = 20, 40 / 3 = 13, 30 / 2 = 15.
    # Cost at d = 1, of -, 10, 30:      outside 20,         40 / 2 = 20, 40 / 2 = 20.
    # To the right (P1 = 2, P2 irrelevant with two disparities):
    #   L0 = 20, 20;  L1 = 13, 20;  L2 = 15, 20 + 2 = 22 (7 more at d = 1, but only P1 to change).
    # To the left: L2 = 15, 20;  L1 = 13, 20 + 2 = 22;  L0 = 20, 20 + 2 = 22.
    # Vertical paths have one pixel each: the cost, twice.
    np.testing.assert_array_equal(got.cost, [[20 + 20 + 40, 13 + 13 + 26, 15 + 15 + 30]])
    np.testing.assert_array_equal(got.disparity, [[0, 0, 0]])
    np.testing.assert_array_equal(got.matching_cost, [[20, 13, 15]])
    np.testing.assert_array_equal(got.margin, 65535)


@pytest.mark.parametrize("disparity", [6, -4])
def test_a_shift_is_found_and_carried_on_where_the_other_view_ends(disparity):
    main, auxiliary = shifted_views(1, 30, 70, disparity)
    of_main, of_auxiliary = match(main, auxiliary, (-10, 12), outside_cost=4, edge_factor=0.0)
    np.testing.assert_allclose(of_main.disparity, disparity, atol=1.0)
    column = np.arange(70)
    partner_inside = (column + disparity >= 0) & (column + disparity < 70)
    np.testing.assert_allclose(of_auxiliary.disparity[:, partner_inside], disparity, atol=1.0)
    outside = (column - disparity < 0) | (column - disparity >= 70)
    assert (of_main.matching_cost[:, outside] == 4).all()


@pytest.mark.parametrize("paths", [4, 8])
def test_fractions_of_a_pixel_are_found(paths):
    # A strong P1 would pull a wall at one fractional disparity towards the whole number.
    for disparity in (4.25, 4.5, 4.75):
        main, auxiliary = shifted_views(2, 80, 90, disparity)
        of_main, of_auxiliary = match(main, auxiliary, (0, 12), paths=paths, small_penalty=1, edge_factor=0.0)
        assert np.median(of_main.disparity[4:-4, 20:-8]) == pytest.approx(disparity, abs=0.1)
        assert np.median(of_auxiliary.disparity[4:-4, 8:-20]) == pytest.approx(disparity, abs=0.1)


def test_disparity_follows_a_slanted_surface():
    height, width = 60, 120
    scene = texture(3, height, width + 40)
    y, x = np.mgrid[:height, :width].astype(float)
    truth = 3 + x / 20  # of the auxiliary view
    auxiliary = scene[:, :width]
    # Main pixel x + truth(x) sees what auxiliary pixel x sees: x = (x_main - 3) / 1.05.
    main = ndimage.map_coordinates(scene, [y, (x - 3) / 1.05], order=3, mode="nearest")
    _, of_auxiliary = match(np.maximum(main, 1e-3).astype(np.float32), auxiliary.astype(np.float32), (0, 15))
    error = (of_auxiliary.disparity - truth)[5:-5, 5:-15]
    assert np.abs(error).mean() < 0.12
    assert abs(error.mean()) < 0.05


def test_an_edge_of_the_guide_lets_the_disparity_jump():
    # A flat strip between two textured planes could belong to either; the guide says where the jump is.
    background, foreground = shifted_views(4, 40, 100, 2), shifted_views(5, 40, 100, 9)
    main, auxiliary = (view.copy() for view in background)
    main[:, 50:], auxiliary[:, 41:] = foreground[0][:, 50:], foreground[1][:, 41:]
    main[:, 44:56] = 1.0
    main_planes, auxiliary_planes = census_transform(main), census_transform(auxiliary)
    for edge in (46, 53):
        guide = np.zeros((40, 100), dtype=np.float32)
        guide[:, edge:] = 0.5
        of_main, _ = match_semiglobal(
            main_planes, auxiliary_planes, guide, disparities=(0, 15), config=SemiGlobalConfig(large_penalty=150)
        )
        jumps = np.argmax(of_main.disparity > 5.5, axis=1)
        assert abs(np.median(jumps) - edge) <= 2


def test_a_wrong_match_costs_more_and_a_sure_one_has_a_margin():
    main, auxiliary = shifted_views(7, 30, 60, 5)
    other = shifted_views(8, 30, 60, 5)[1]
    sure, _ = match(main, auxiliary, (0, 12))
    unsure, _ = match(main, other, (0, 12))
    inner = np.s_[4:-4, 16:-6]
    assert np.median(sure.matching_cost[inner]) <= 1
    assert np.median(unsure.matching_cost[inner]) > 15
    assert np.median(sure.margin[inner]) > 3 * np.median(unsure.margin[inner])


@pytest.mark.parametrize("threads", [2, 3, 4])
def test_threads_do_not_change_a_byte(threads):
    main, auxiliary = shifted_views(9, 41, 90, 6)
    for one, more in zip(
        match(main, auxiliary, (0, 40), threads=1), match(main, auxiliary, (0, 40), threads=threads), strict=True
    ):
        for field in FIELDS:
            assert getattr(one, field).tobytes() == getattr(more, field).tobytes()


def test_a_pair_seen_upside_down_gives_the_same_maps():
    main, auxiliary = shifted_views(10, 24, 50, 4)
    upright = match(main, auxiliary, (-2, 20))
    turned = match(main[::-1].copy(), auxiliary[::-1].copy(), (-2, 20))
    # The census of the upside-down image has the same codes in another order, so that even ties agree.
    for one, other in zip(upright, turned, strict=True):
        for field in FIELDS:
            np.testing.assert_array_equal(getattr(one, field), getattr(other, field)[::-1])


def test_a_mirrored_pair_gives_mirrored_maps_of_opposite_sign():
    main, auxiliary = shifted_views(11, 24, 50, 4)
    straight = match(main, auxiliary, (-3, 12))
    mirrored = match(main[:, ::-1].copy(), auxiliary[:, ::-1].copy(), (-12, 3))
    for one, other in zip(straight, mirrored, strict=True):
        # Sums are equal; of equal ones the smaller disparity wins, which is the larger of the mirror image.
        np.testing.assert_array_equal(one.cost, other.cost[:, ::-1])
        unique = one.margin > 0
        np.testing.assert_allclose(one.disparity[unique], -other.disparity[:, ::-1][unique], atol=1.01)
        assert (one.disparity == -other.disparity[:, ::-1])[unique].mean() > 0.99


@pytest.mark.parametrize("disparities", [(5, 4), (20, 25), (-30, -20), (0, 40_000)])
def test_ranges_without_a_match_are_refused(disparities):
    planes = np.zeros((2, 4, 20), dtype=np.uint64)
    with pytest.raises(InputError, match="disparities"):
        match_semiglobal(planes, planes, np.zeros((4, 20), np.float32), disparities=disparities)


def test_shapes_must_agree():
    planes = np.zeros((2, 4, 20), dtype=np.uint64)
    for main, auxiliary, guide in [
        (planes, planes[:, :3], (4, 20)),
        (planes, planes, (4, 19)),
        (planes[:, :0], planes[:, :0], (0, 20)),
    ]:
        with pytest.raises(InputError, match="census planes"):
            match_semiglobal(main, auxiliary, np.zeros(guide, np.float32), disparities=(0, 5))


def test_bands_must_fit_the_image_and_the_range():
    planes = np.zeros((2, 6, 20), dtype=np.uint64)
    guide = np.zeros((6, 20), np.float32)
    ones = np.ones((2, 5), dtype=int)
    for bands in (Bands(1, ones, ones), Bands(8, ones, ones), Bands(4, ones, ones[:1])):
        with pytest.raises(InputError, match=r"of a 20x6 image"):
            match_semiglobal(planes, planes, guide, disparities=(0, 9), bands=bands)
    for bands in (Bands(4, -ones, ones), Bands(4, ones, 0 * ones), Bands(4, 9 * ones, 2 * ones)):
        with pytest.raises(InputError, match="disparities 0 to 9"):
            match_semiglobal(planes, planes, guide, disparities=(0, 9), bands=bands)


def test_a_strip_comes_with_the_rows_around_it():
    planes = np.zeros((2, 12, 20), dtype=np.uint64)
    guide = np.zeros((12, 20), np.float32)
    matcher = StripMatcher((12, 20), disparities=(0, 9))
    assert matcher.rows_around((4, 8)) == (2, 10)
    assert matcher.rows_around((0, 12)) == (0, 12)
    with pytest.raises(InputError, match=r"\(8, 20\) rows and columns"):
        matcher.prepare((4, 8), planes[:, 4:8], planes[:, 4:8], guide[4:8])
    for strip in ((0, 8), (3, 12)):
        with pytest.raises(InputError, match=f"rows {strip[0]} to {strip[1]}: prepare"):
            matcher.match(strip, planes, planes, guide)


@pytest.mark.parametrize(
    "settings",
    [{"paths": 5}, {"large_penalty": 201}, {"small_penalty": 95}, {"outside_cost": 49}, {"edge_factor": -1.0}],
)
def test_settings_out_of_range_are_refused(settings):
    with pytest.raises(ConfigError, match="semiglobal"):
        SemiGlobalConfig(**settings)


def test_memory_is_mostly_the_volume():
    assert semiglobal_bytes(555, 695, (0, 119)) == pytest.approx(2 * 555 * 695 * 128, rel=0.2)
