import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr.config import CensusConfig
from stereohdr.disparity import census_transform, similarity_volume

from reference import disparity as twin


def luminance_image(seed, height, width, flat=False):
    rng = np.random.default_rng(seed)
    values = np.full((height, width), 0.37) if flat else rng.uniform(0.5, 0.6, (height, width))
    values[rng.random((height, width)) < 0.1] = 0
    return values.astype(np.float32)


@given(
    height=st.integers(1, 12),
    width=st.integers(1, 20),
    window=st.sampled_from([3, 5, 7]),
    flat=st.booleans(),
    seed=st.integers(0, 100),
)
def test_planes_and_volume_equal_the_twins(height, width, window, flat, seed):
    radius, config = window // 2, CensusConfig(window=window)
    views, planes = [], []
    for s in (seed, seed + 1):
        views.append(luminance_image(s, height, width, flat))
        planes.append(census_transform(views[-1], config=config))
        expected = np.zeros((2, height, width), dtype=np.uint64)
        padded = np.pad(views[-1], radius, mode="edge")
        twin.census_planes(padded, radius, np.float32(0.08), 0, height, expected)
        np.testing.assert_array_equal(planes[-1], expected)
    reach = min(6, width - 1)
    got = similarity_volume(*planes, max_disparity=reach, config=config)
    expected = np.empty((height, width, reach + 1), dtype=np.uint8)
    twin.similarity_rows(*planes, window**2 - 1, 0, height, expected)
    np.testing.assert_array_equal(got, expected)
    # The similarity really is the number of equal four-valued codes.
    codes = [twin.census_codes(view, radius, np.float32(0.08)) for view in views]
    for d in range(reach + 1):
        equal = (codes[0][:, : width - d] == codes[1][:, d:]).sum(axis=-1)
        np.testing.assert_array_equal(got[:, : width - d, d], equal)


def test_codes_by_hand():
    # Centre 1.0, threshold 0.08: codes 0, 1, 2, 3 for 0.9, 0.95, 1.05, 1.2, and 2 for equal.
    image = np.array([[0.9, 0.95, 1.0], [1.05, 1.0, 1.2], [1.08001, 0.5, 2.0]], dtype=np.float32)
    codes = twin.census_codes(image, 1, np.float32(0.08))[1, 1]
    np.testing.assert_array_equal(codes, [0, 1, 2, 2, 3, 3, 0, 3])
    higher, near = census_transform(image, config=CensusConfig(window=3))[:, 1, 1]
    assert f"{int(higher):08b}"[::-1] == "00111101"
    assert f"{int(near):08b}"[::-1] == "01110000"


def test_similarity_of_a_shifted_copy_is_full_at_the_shift():
    rng = np.random.default_rng(0)
    scene = rng.uniform(0.1, 1, (20, 40)).astype(np.float32)
    main, auxiliary = scene[:, :30], scene[:, 4:34]  # x_main = x_auxiliary + 4
    volume = similarity_volume(census_transform(auxiliary), census_transform(main), max_disparity=8)
    inner = volume[3:-3, 3:20]
    assert (inner[..., 4] == 48).all()
    assert (inner.argmax(axis=-1) == 4).all()
    assert (volume[:, 28, 2:] == 0).all()  # partners 30 and beyond are outside


def test_a_common_factor_does_not_change_the_codes():
    image = luminance_image(1, 15, 15)
    np.testing.assert_array_equal(census_transform(image), census_transform(image * np.float32(0.25)))


def test_row_range_is_a_slice_of_the_whole():
    planes = census_transform(luminance_image(5, 20, 30))
    whole = similarity_volume(planes, planes, max_disparity=7)
    np.testing.assert_array_equal(similarity_volume(planes, planes, max_disparity=7, rows=(6, 13)), whole[6:13])


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_threads_do_not_change_the_codes(threads):
    image = luminance_image(7, 150, 30)
    np.testing.assert_array_equal(census_transform(image, threads=threads), census_transform(image, threads=1))
