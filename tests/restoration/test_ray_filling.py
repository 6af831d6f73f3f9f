import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereohdr.restoration import fill_holes
from stereohdr.restoration._kernels import fill_along_rays, fill_from_nearest

from reference import restoration as twin


@given(
    seed=st.integers(0, 500),
    height=st.integers(1, 9),
    width=st.integers(1, 9),
    segments=st.integers(1, 4),
    known=st.sampled_from([0.0, 0.1, 0.5, 1.0]),
)
def test_sources_equal_the_twins(seed, height, width, segments, known):
    rng = np.random.default_rng(seed)
    shape = (height, width)
    labels = np.sort(rng.integers(0, segments, shape), axis=1).astype(np.int32)
    valid = rng.random(shape) < known
    hole = ~valid & (rng.random(shape) < 0.8)
    luminance, guide = rng.random((2, *shape)).astype(np.float32)
    got, expected = np.empty(shape, np.int32), np.empty(shape, np.int32)
    fill_along_rays(labels, valid, luminance, guide, hole, got)
    twin.fill_along_rays(labels, valid, luminance, guide, hole, expected)
    np.testing.assert_array_equal(got, expected)
    fill_from_nearest(labels, valid, hole, got)
    twin.fill_from_nearest(labels, valid, hole, expected)
    np.testing.assert_array_equal(got, expected)


def fill_row(values, segments, main):
    warped = np.array(values, dtype=np.float32)[None, :, None]
    valid = warped[..., 0] > 0
    main = np.array(main, dtype=np.float32)[None, :, None]
    labels = np.array([segments], dtype=np.int32)
    return fill_holes(warped, valid, ~valid, main, labels)[0, :, 0]


def test_the_candidate_nearest_the_main_view_wins():
    np.testing.assert_array_equal(fill_row([2, 0, 0, 8], [0, 0, 0, 0], [9, 3, 7, 9]), [2, 2, 8, 8])


def test_rays_stop_at_the_border_of_the_segment():
    np.testing.assert_array_equal(fill_row([2, 0, 0, 8], [0, 0, 1, 1], [9, 9, 1, 9]), [2, 2, 8, 8])


def test_a_hole_off_every_ray_takes_the_nearest_valid_pixel_of_its_segment():
    # The only valid pixel of segment 0 is around the corner, diagonal to the hole.
    warped = np.zeros((2, 2, 1), dtype=np.float32)
    warped[1, 1] = 5
    valid = warped[..., 0] > 0
    segments = np.array([[0, 1], [1, 0]], dtype=np.int32)
    main = np.full((2, 2, 1), 3, dtype=np.float32)
    filled = fill_holes(warped, valid, ~valid, main, segments)[..., 0]
    np.testing.assert_array_equal(filled, [[5, 3], [3, 5]])  # segment 1 has nothing: the main view stays


def test_colours_are_copied_whole_and_valid_pixels_stay():
    rng = np.random.default_rng(0)
    warped = rng.random((6, 7, 3)).astype(np.float32)
    valid = rng.random((6, 7)) < 0.4
    holes = ~valid
    main = rng.random((6, 7, 3)).astype(np.float32)
    filled = fill_holes(warped, valid, holes, main, np.zeros((6, 7), dtype=np.int32))
    np.testing.assert_array_equal(filled[valid], warped[valid])
    known = {tuple(v) for v in warped[valid].tolist()}
    assert all(tuple(v) in known for v in filled[holes].tolist())
