import struct

import numpy as np
import pytest
import tifffile
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from stereohdr.errors import ExposureError, FileFormatError
from stereohdr.io.metadata import Exposure, exposure_from_tags, parse_exposure_time, read_exposure

CODES = np.zeros((4, 6, 3), np.uint8)


def exif_with(time=None, f_number=None, iso=None):
    exif = Image.Exif()
    folder = exif.get_ifd(34665)
    for tag, value in ((33434, time), (33437, f_number), (34855, iso)):
        if value is not None:
            folder[tag] = value
    return exif


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("0.25", 0.25),
        ("1/60", 1 / 60),
        ("2", 2.0),
        ("1/60 s", 1 / 60),
        ("250ms", 0.25),
        ("250 ms", 0.25),
        (" .5s ", 0.5),
        ("5.", 5.0),
        ("1e-3", 1e-3),
        ("1.5 / 3", 0.5),
        ("1/2ms", 0.0005),
        ("3S", 3.0),
    ],
)
def test_exposure_times_as_people_write_them(text, seconds):
    assert parse_exposure_time(text) == pytest.approx(seconds, rel=1e-12)


@pytest.mark.parametrize(
    "text",
    [
        "1e-300/1e300",
        "",
        " ",
        "abc",
        "1/0",
        "0/5",
        "0",
        "0.0",
        "-1",
        "-1/60",
        "1/-60",
        "nan",
        "inf",
        "1e999",
        "1e-999",
        "1/2/3",
        "0,25",
        "1//2",
        "1/",
        "/2",
        "5 min",
        "1e",
        ".",
        "1 2",
        "0x10",
        "1_0",
        "٣",
        "1/1e999",
    ],
)
def test_anything_else_is_refused_with_what_is_accepted(text):
    with pytest.raises(ExposureError, match=r"0\.25, 2, 1/60") as caught:
        parse_exposure_time(text)
    assert repr(text) in str(caught.value)


@given(st.floats(min_value=1e-6, max_value=1e6))
def test_every_float_survives_being_written(seconds):
    assert parse_exposure_time(repr(seconds)) == seconds
    assert parse_exposure_time(f"{seconds!r} s") == seconds


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif"])
def test_exposure_is_read_from_every_format(tmp_path, name):
    exif = exif_with(time=IFDRational(1, 60), f_number=2.8, iso=400)
    Image.fromarray(CODES).save(tmp_path / name, exif=exif.tobytes())
    exposure = read_exposure(tmp_path / name)
    assert exposure.time == pytest.approx(1 / 60, rel=1e-6)
    assert exposure.f_number == pytest.approx(2.8, rel=1e-6)
    assert exposure.iso == 400


def test_tiff_tags_beside_the_image_tags_count_too(tmp_path):
    tags = [(33434, 5, 1, (1, 8), True), (33437, 5, 1, (4, 1), True), (34855, 3, 1, 200, True)]
    tifffile.imwrite(tmp_path / "ep.tif", CODES, photometric="rgb", extratags=tags)
    assert read_exposure(tmp_path / "ep.tif") == Exposure(time=0.125, f_number=4.0, iso=200.0)


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif"])
def test_no_exif_is_an_empty_exposure(tmp_path, name):
    Image.fromarray(CODES).save(tmp_path / name)
    assert read_exposure(tmp_path / name) == Exposure(None, None, None)


@pytest.mark.parametrize("name", ["a.jpg", "a.png", "a.tif"])
@pytest.mark.parametrize("broken", [(0, 0), (0, 1), (1, 0)])
def test_broken_rationals_count_as_absent(tmp_path, name, broken):
    exif = exif_with(time=IFDRational(*broken), f_number=IFDRational(*broken), iso=0)
    Image.fromarray(CODES).save(tmp_path / name, exif=exif.tobytes())
    assert read_exposure(tmp_path / name) == Exposure(None, None, None)


def test_one_broken_rational_does_not_hide_the_others(tmp_path):
    exif = exif_with(time=IFDRational(0, 0), f_number=IFDRational(8, 1), iso=100)
    Image.fromarray(CODES).save(tmp_path / "a.jpg", exif=exif)
    assert read_exposure(tmp_path / "a.jpg") == Exposure(time=None, f_number=8.0, iso=100.0)


@pytest.mark.parametrize(
    ("iso", "expected"),
    [
        *((100, 100.0), ((100,), 100.0), ((100, 200), 100.0), ([400, 0], 400.0)),
        *((65535, None), ("many", None), ((), None), (float("nan"), None), (-5, None)),
    ],
)
def test_iso_values_as_found_in_the_wild(iso, expected):
    assert exposure_from_tags({34855: iso}).iso == expected


def test_damaged_exif_block_counts_as_absent(tmp_path):
    exif = exif_with(time=IFDRational(1, 60)).tobytes()
    damaged = exif[:14] + b"\xff" * (len(exif) - 14)
    Image.fromarray(CODES).save(tmp_path / "a.jpg", exif=damaged)
    assert read_exposure(tmp_path / "a.jpg") == Exposure()


def test_orientation_survives_a_broken_exif_folder(tmp_path):
    from stereohdr.io.metadata import read_tags

    # One directory: orientation 6, and an EXIF folder that lies outside of the block.
    entries = struct.pack("<HHII", 274, 3, 1, 6) + struct.pack("<HHII", 34665, 4, 1, 99999)
    exif = b"Exif\0\0II*\0" + struct.pack("<IH", 8, 2) + entries + struct.pack("<I", 0)
    Image.fromarray(CODES).save(tmp_path / "a.jpg", exif=exif)
    assert read_tags(tmp_path / "a.jpg") == {274: 6}


def test_other_files_are_refused(tmp_path):
    (tmp_path / "a.jpg").write_text("not a photo")
    with pytest.raises(FileFormatError, match=r"a\.jpg: not a PNG, JPEG, TIFF, HEIC, AVIF"):
        read_exposure(tmp_path / "a.jpg")
    with pytest.raises(FileFormatError, match="no such file"):
        read_exposure(tmp_path / "missing.jpg")
