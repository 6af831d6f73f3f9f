import numpy as np
import pytest

from stereohdr.errors import StereoHdrWarning
from stereohdr.io.display import (
    BT709_TO_BT2020,
    diffuse_white,
    pq_decode,
    pq_encode,
    relative_to_white,
)


def test_pq_at_known_points():
    # SMPTE ST 2084; BT.2408 puts diffuse white, 203 cd/m², at 58 % of the signal.
    np.testing.assert_allclose(
        pq_encode(np.array([0, 0.1, 1, 100, 203, 1000, 10_000, 20_000])),
        [0.0, 0.062, 0.150, 0.508, 0.581, 0.752, 1.0, 1.0],
        atol=5e-4,
    )


def test_pq_decode_undoes_pq_encode():
    luminance = np.geomspace(1e-4, 1e4, 500)
    np.testing.assert_allclose(pq_decode(pq_encode(luminance)), luminance, rtol=1e-9)
    assert pq_decode(np.array([-0.1]))[0] == 0
    assert pq_decode(np.array([1.1]))[0] == pytest.approx(10_000)


def test_white_stays_white_in_bt2020_and_red_has_its_known_coordinates():
    np.testing.assert_allclose(BT709_TO_BT2020.sum(axis=1), 1, atol=1e-8)
    # BT.709 red is (0.64, 0.33) in xy; BT.2020's primaries give that back from the first column.
    primaries = np.array([[0.708, 0.292], [0.170, 0.797], [0.131, 0.046]])
    white = np.array([0.3127, 0.3290])
    xyz = np.column_stack([primaries / primaries[:, 1:], (1 - primaries.sum(axis=1)) / primaries[:, 1]]).T
    white_xyz = np.array([white[0] / white[1], 1, (1 - white.sum()) / white[1]])
    red = xyz @ (np.linalg.solve(xyz, white_xyz) * BT709_TO_BT2020[:, 0])
    np.testing.assert_allclose(red[:2] / red.sum(), [0.64, 0.33], atol=1e-4)


def test_diffuse_white_puts_the_log_average_at_18_percent():
    image = np.array([[[1.0], [100.0]], [[0.0], [10.0]]], np.float32)
    assert diffuse_white(image) == pytest.approx(10 / 0.18)
    assert diffuse_white(np.zeros((2, 2, 3), np.float32)) == pytest.approx(1)
    assert diffuse_white(np.full((2, 2, 3), 1e-38, np.float32)) == pytest.approx(1e-30)


def test_relative_to_white_darkens_what_does_not_fit():
    image = np.array([[[2.0, 1.0, 0.0], [80.0, 40.0, 20.0]]], np.float32)
    with pytest.warns(StereoHdrWarning, match=r"x: 50 % of the pixels are brighter than 10 times diffuse white"):
        relative = relative_to_white(image, 2.0, 10.0, name="x")
    np.testing.assert_allclose(relative, [[[1, 0.5, 0], [10, 5, 2.5]]], rtol=1e-6)
    np.testing.assert_array_equal(relative_to_white(image, 2.0, 100.0, name="x"), image / 2)
    np.testing.assert_array_equal(relative_to_white(image, 2.0, 1e38, name="x"), image / 2)
