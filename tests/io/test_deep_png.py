import numpy as np
import pytest

from stereohdr import Photo, read_photo
from stereohdr.errors import FileFormatError
from stereohdr.io.deep_png import write_photo


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, 255), (np.uint16, 4095), (np.uint16, 65280)])
def test_photos_come_back_with_white_at_65535(tmp_path, channels, dtype, white):
    codes = np.random.default_rng(0).integers(0, white + 1, (12, 17, channels)).astype(dtype)
    codes[0, 0] = white
    write_photo(tmp_path / "p.png", Photo(codes, 1 / 60, white, f_number=2.8, iso=400))
    found = read_photo(tmp_path / "p.png")
    assert found.codes.dtype == np.uint16
    assert found.white == found.codes.max() == 65535
    np.testing.assert_array_equal(found.codes, np.rint(codes * (65535 / white)))
    assert found.exposure_time == pytest.approx(1 / 60, rel=1e-5)
    assert (found.f_number, found.iso) == (2.8, 400)


@pytest.mark.parametrize("time", [1 / 8000, 30.0, 0.064, 1e-8, 1e9])
def test_exposure_times_of_any_length(tmp_path, time):
    write_photo(tmp_path / "p.png", Photo(np.zeros((3, 3), np.uint8), time))
    assert read_photo(tmp_path / "p.png").exposure_time == pytest.approx(time, rel=1e-3)


def test_unknown_exposures_stay_unknown(tmp_path):
    write_photo(tmp_path / "p.png", Photo(np.zeros((3, 3), np.uint8)))
    found = read_photo(tmp_path / "p.png")
    assert (found.exposure_time, found.f_number, found.iso) == (None, None, None)


def test_other_readers_take_it(tmp_path):
    from PIL import Image

    codes = np.arange(12, dtype=np.uint16).reshape(3, 4) * 5000
    write_photo(tmp_path / "p.png", Photo(codes, 0.25))
    with Image.open(tmp_path / "p.png") as image:
        np.testing.assert_array_equal(np.asarray(image), codes)
        assert float(image.getexif().get_ifd(0x8769)[33434]) == 0.25


def test_names_and_folders_that_do_not_work(tmp_path):
    photo = Photo(np.zeros((3, 3), np.uint8))
    with pytest.raises(FileFormatError, match=r"ends in .png"):
        write_photo(tmp_path / "p.tif", photo)
    with pytest.raises(FileFormatError, match="does not exist"):
        write_photo(tmp_path / "none" / "p.png", photo)
    assert list(tmp_path.iterdir()) == []
