import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from stereohdr.restoration import _highlights_kernels as kernels
from stereohdr.restoration import highlights
from stereohdr.restoration.highlights import Evidence, restore_highlights

from reference import highlights as twin


def views_of(rng, height, width, channels, clipped_share):
    shape = (height, width, channels)
    logs = rng.normal(0, 1, (2, *shape)).astype(np.float32)
    return kernels.Views(
        main=logs[0],
        clipped=rng.random(shape) < clipped_share,
        auxiliary=logs[1],
        source=rng.integers(0, 3, shape).astype(np.uint8),
    )


@given(
    seed=st.integers(0, 999),
    height=st.integers(1, 9),
    width=st.integers(1, 9),
    channels=st.sampled_from([1, 3]),
    clipped_share=st.sampled_from([0.0, 0.3, 0.9, 1.0]),
)
def test_kernels_equal_their_twins(seed, height, width, channels, clipped_share):
    rng = np.random.default_rng(seed)
    views = views_of(rng, height, width, channels, clipped_share)
    channel = int(rng.integers(channels))
    domain = views.clipped[..., channel]
    limits = np.array([2, 9])
    rows, classes = np.empty((2, height, width), np.uint8)
    kernels.fill_classes(views.clipped, channel, limits, rows, classes)
    np.testing.assert_array_equal(classes[domain], twin.classes(views.clipped, channel, limits)[domain])

    sums = np.zeros((4 * 3, 3))
    kernels.sum_excess(views, channel, classes, sums)
    np.testing.assert_allclose(sums, twin.sum_excess(views, channel, classes, len(sums)), rtol=1e-5, atol=1e-6)

    weights = kernels.Weights(*np.float32([1, 2, 3, 4, 5, 6]))
    prior, prior_weight = rng.random((2, len(sums))).astype(np.float32)
    terms = kernels.Terms(*(np.full((*more, height, width), np.nan, np.float32) for more in [(), (), (2,), (2,)]))
    images = (views, channel, classes, prior, prior_weight, weights)
    for start in range(height):
        kernels.fill_terms(*images, start, start + 1, terms)
    for got, expected in zip(terms, twin.terms(*images), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-5, atol=1e-6)


def test_classes_are_those_of_the_distance_in_pixels():
    rng = np.random.default_rng(2)
    clipped = ndimage.gaussian_filter(rng.standard_normal((90, 120)), 12) > -0.01
    distance = ndimage.distance_transform_edt(clipped)
    assert distance.max() > 26
    expected = np.digitize(distance, highlights.DISTANCE_CLASSES) + 5
    found = highlights._classes(clipped[..., None], 0)
    np.testing.assert_array_equal(found[clipped], expected[clipped])


def test_a_frame_around_the_clipped_area_changes_nothing():
    rng = np.random.default_rng(3)
    main = rng.uniform(0.5, 1.0, (20, 24, 3)).astype(np.float32)
    clipped = np.zeros(main.shape, bool)
    clipped[5:12, 6:15] = rng.random((7, 9, 3)) < 0.7
    seen = (main * rng.uniform(1, 3, main.shape)).astype(np.float32)
    usable = rng.random((2, *main.shape)) < 0.5
    whole = restore_highlights(main, clipped, Evidence(seen, usable[0]), Evidence(seen, usable[1]))
    part = np.s_[4:13, 5:16]
    inner = restore_highlights(
        main[part], clipped[part], Evidence(seen[part], usable[0][part]), Evidence(seen[part], usable[1][part])
    )
    np.testing.assert_array_equal(whole[part], inner)
    outside = np.ones(main.shape, bool)
    outside[part] = False
    np.testing.assert_array_equal(whole[outside], main[outside])
