import numpy as np
import pytest

from stereohdr.datasets import known_disparities, read_disparity, warped_by_truth
from stereohdr.datasets.ground_truth import disparity_between, reduced_disparity
from stereohdr.errors import FileFormatError, InputError
from stereohdr.io.images import write_png
from stereohdr.io.pfm import encode_pfm
from stereohdr.model import Disparity

UNKNOWN, SEEN, HIDDEN = 0, 1, 2


def row(*values):
    return np.array([values], np.float32)


def flags(left, right):
    found = known_disparities(left, right)
    return [None if d is None else d.flags[0].tolist() for d in found]


def test_png_values_are_scaled_and_zero_is_unknown(tmp_path):
    write_png(tmp_path / "d.png", np.array([[0, 3, 240]], np.uint8))
    np.testing.assert_allclose(read_disparity(tmp_path / "d.png", scale=3), [[0, 1, 80]])


def test_pfm_infinity_is_unknown(tmp_path):
    values = np.array([[np.inf, 2.5], [7.25, np.nan]], np.float32)
    (tmp_path / "d.pfm").write_bytes(encode_pfm(values[..., None]))
    np.testing.assert_array_equal(read_disparity(tmp_path / "d.pfm"), [[0, 2.5], [7.25, 0]])


def test_bad_disparity_files_are_refused(tmp_path):
    write_png(tmp_path / "rgb.png", np.zeros((2, 2, 3), np.uint8))
    with pytest.raises(FileFormatError, match="colour image"):
        read_disparity(tmp_path / "rgb.png")
    with pytest.raises(InputError, match="scale"):
        read_disparity(tmp_path / "rgb.png", scale=0)
    with pytest.raises(FileFormatError, match="no such file"):
        read_disparity(tmp_path / "none.pfm")


def test_a_foreground_hides_the_background_of_the_other_view():
    # Background at 1, a foreground of two pixels at 3: x_right = x_left - d.
    left = row(1, 1, 1, 1, 1, 3, 3, 1, 1)
    right = row(1, 1, 3, 3, 1, 1, 1, 1, 0)
    # Left pixel 0 leaves the frame; left 3 and 4 fall on 2 and 3, where the right view sees the foreground.
    assert flags(left, right) == [
        [HIDDEN, SEEN, SEEN, HIDDEN, HIDDEN, SEEN, SEEN, SEEN, SEEN],
        # Right 4 and 5 fall on left 5 and 6, the foreground; the last one is unknown.
        [SEEN, SEEN, SEEN, SEEN, HIDDEN, HIDDEN, SEEN, SEEN, UNKNOWN],
    ]
    # The same from one map alone: the foreground is projected in front of what it hides.
    assert flags(left, None)[0] == flags(left, right)[0]
    assert flags(None, right)[1] == flags(left, right)[1]
    # And where the other map does not know.
    assert flags(left, np.zeros_like(right))[0] == flags(left, right)[0]


def test_disagreement_counts_as_hidden():
    assert flags(row(0, 0, 2), row(4, 0, 0)) == [[UNKNOWN, UNKNOWN, HIDDEN], [HIDDEN, UNKNOWN, UNKNOWN]]
    assert flags(row(0, 0, 2), row(3, 0, 0))[0] == [UNKNOWN, UNKNOWN, SEEN]  # 1 px is tolerated


def test_reduction_takes_one_of_the_surfaces():
    values = np.array([[4, 4, 10, 10, 0, 0], [4, 20, 10, 0, 0, 8]], np.float32)
    # 4, 4, 4, 20 gives 4 (upper median), 0, 10, 10, 10 gives 10, three unknown give unknown; all halved.
    np.testing.assert_array_equal(reduced_disparity(values, 2), [[2, 5, 0]])
    np.testing.assert_array_equal(reduced_disparity(values[:, :5], 2), [[2, 5]])
    assert reduced_disparity(values, 1) is values


def test_the_view_in_between():
    # A foreground of two pixels at 6 in front of a background at 2. Halfway, the foreground is at columns 3 and 4;
    # columns 5 and 6 are hidden in the left view, and column 11 is outside of it: the right view knows them.
    left = row(2, 2, 2, 2, 2, 2, 6, 6, 2, 2, 2, 2)
    right = row(6, 6, 2, 2, 2, 2, 2, 2, 2, 2, 0, 0)
    expected = row(2, 2, 2, 6, 6, 2, 2, 2, 2, 2, 2, 0)
    np.testing.assert_array_equal(disparity_between(left, right, 0.5), expected)
    right[0, 10] = 2
    assert disparity_between(left, right, 0.5)[0, 11] == 2
    assert disparity_between(left, right, 0) is left
    assert disparity_between(left, right, 1) is right


def test_cracks_of_a_widening_surface_are_closed():
    # A surface with a steep slope (d falls by 0.5 per pixel): in between, its pixels are 1.25 apart.
    columns = np.arange(60, dtype=np.float32)
    left = np.tile(30 - 0.5 * columns, (3, 1)).astype(np.float32)
    between = disparity_between(left, np.zeros_like(left), 0.5)
    inside = between[:, 2:40]
    assert (inside > 0).all()


@pytest.mark.parametrize("main", ["left", "right"])
def test_warping_follows_the_sign_of_the_view(main):
    image = np.arange(8, dtype=np.float32)[None, :, None]
    truth = Disparity(np.full((1, 8), 1.5, np.float32), np.ones((1, 8), np.uint8))
    warped = warped_by_truth(image, truth, main=main)[0, :, 0]
    shift = -1.5 if main == "left" else 1.5
    np.testing.assert_allclose(warped[2:6], np.arange(2, 6) + shift)
