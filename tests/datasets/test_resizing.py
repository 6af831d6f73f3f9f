import numpy as np
import pytest

from stereohdr import Photo
from stereohdr.datasets.resizing import bayer_to_rgb, cropped_photo, reduced_photo
from stereohdr.errors import InputError


def test_reduction_averages_codes_and_keeps_the_settings():
    codes = np.array([[1, 2, 9], [3, 5, 9], [9, 9, 9]], np.uint16)
    photo = reduced_photo(Photo(codes, 0.5, 4095, iso=100, name="a"), 2)
    assert photo.codes[..., 0].tolist() == [[3]]  # 2.75; the odd row and column are cut
    assert (photo.exposure_time, photo.white, photo.iso, photo.name) == (0.5, 4095, 100, "a")
    with pytest.raises(InputError, match="a: 3x3 pixels cannot be reduced by 4"):
        reduced_photo(Photo(codes, name="a"), 4)


def test_crop():
    codes = np.arange(12, dtype=np.uint8).reshape(3, 4)
    assert cropped_photo(Photo(codes), (1, 0, 2, 2)).codes[..., 0].tolist() == [[1, 2], [5, 6]]
    for box in ((3, 0, 2, 1), (0, 0, 0, 1), (-1, 0, 2, 2)):
        with pytest.raises(InputError, match="must lie inside of 4x3 pixels"):
            cropped_photo(Photo(codes), box)


def test_bayer_cells_become_pixels():
    mosaic = np.array([[10, 20, 11, 4000, 7], [23, 30, 4094, 31, 7], [1, 1, 1, 1, 7]], np.uint16)
    photo = bayer_to_rgb(Photo(mosaic, 1.0, 4094))
    # Green is the mean of its two, rounded up; white as soon as one of them is.
    assert photo.codes.tolist() == [[[10, 22, 30], [11, 4094, 31]]]
    assert photo.white == 4094
    with pytest.raises(InputError, match="Bayer"):
        bayer_to_rgb(photo)
