import contextlib
import io
import struct
import warnings
import zlib

import imagecodecs
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageOps

from stereohdr.errors import ExposureError, FileFormatError, InputError, OutputError, StereoHdrWarning
from stereohdr.io import read_photo
from stereohdr.io.images import LARGEST_PIXELS, write_png

RNG = np.random.default_rng(20240521)
RGB8 = RNG.integers(0, 256, (11, 14, 3), np.uint8)
RGB16 = RNG.integers(0, 65536, (11, 14, 3), np.uint16)
ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))


def png(codes, *, interlaced=False, size=None, chunks=()):
    """Encode (H, W, S) codes as PNG by hand, so that no decoder checks itself."""

    def chunk(kind, body):
        return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))

    height, width, samples = codes.shape
    bits = codes.dtype.itemsize * 8
    passes = ADAM7 if interlaced else ((0, 0, 1, 1),)
    rows = [row for x, y, dx, dy in passes for row in codes[y::dy, x::dx] if row.size]
    lines = b"".join(b"\0" + row.astype(codes.dtype.newbyteorder(">")).tobytes() for row in rows)
    header = struct.pack(
        ">IIBBBBB", *(size or (width, height)), bits, {1: 0, 2: 4, 3: 2, 4: 6}[samples], 0, 0, int(interlaced)
    )
    body = b"".join(chunk(kind, content) for kind, content in chunks)
    body += chunk(b"IDAT", zlib.compress(lines)) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + body


def encoded(image, kind, **options):
    buffer = io.BytesIO()
    image.save(buffer, kind, **options)
    return buffer.getvalue()


def tiff(codes, **options):
    buffer = io.BytesIO()
    tifffile.imwrite(buffer, codes, **options)
    return buffer.getvalue()


@pytest.fixture
def stored(tmp_path):
    """Return a function that stores bytes under a name and returns the path."""

    def store(data, name="photo.png"):
        path = tmp_path / name
        path.write_bytes(data)
        return path

    return store


# --- PNG and JPEG ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("interlaced", [False, True])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("codes", [RGB8, RGB16], ids=["8bit", "16bit"])
def test_png_keeps_every_bit(stored, codes, channels, interlaced):
    path = stored(png(codes[..., :channels], interlaced=interlaced))
    photo = read_photo(path)
    assert photo.codes.dtype == codes.dtype
    np.testing.assert_array_equal(photo.codes, codes[..., :channels])
    assert photo.white == np.iinfo(codes.dtype).max
    assert photo.name == str(path)
    assert photo.exposure_time is None


@pytest.mark.parametrize("channels", [2, 4])
@pytest.mark.parametrize("codes", [RGB8, RGB16], ids=["8bit", "16bit"])
def test_alpha_is_dropped_with_a_notice_that_points_here(stored, codes, channels):
    with_alpha = np.dstack([codes[..., : channels - 1], codes[..., :1]])
    with pytest.warns(StereoHdrWarning, match=r"photo\.png: its alpha channel was dropped") as caught:
        photo = read_photo(stored(png(with_alpha)))
    np.testing.assert_array_equal(photo.codes, codes[..., : channels - 1])
    assert caught[0].filename == __file__


def test_palette_becomes_rgb(stored):
    image = Image.fromarray(RGB8).quantize(16)
    photo = read_photo(stored(encoded(image, "PNG")))
    np.testing.assert_array_equal(photo.codes, np.asarray(image.convert("RGB")))
    with_transparency = read_photo(stored(encoded(image, "PNG", transparency=b"\0\x80")))
    np.testing.assert_array_equal(with_transparency.codes, photo.codes)


def test_one_bit_becomes_grey(stored):
    bits = RNG.integers(0, 2, (5, 11)).astype(bool)
    photo = read_photo(stored(encoded(Image.fromarray(bits), "PNG")))
    np.testing.assert_array_equal(photo.codes[..., 0], bits * np.uint8(255))


@pytest.mark.parametrize("codes", [RGB8, RGB8[..., 0]], ids=["rgb", "grey"])
def test_jpeg_is_what_pillow_decodes(stored, codes):
    data = encoded(Image.fromarray(codes), "JPEG", quality=95)
    photo = read_photo(stored(data, "photo.jpg"))
    np.testing.assert_array_equal(photo.codes.squeeze(), np.asarray(Image.open(io.BytesIO(data))))


def test_multi_picture_jpeg_gives_the_first_picture(stored):
    first, second = Image.fromarray(RGB8), Image.fromarray(255 - RGB8)
    data = encoded(first, "MPO", save_all=True, append_images=[second])
    expected = np.asarray(Image.open(io.BytesIO(encoded(first, "JPEG"))))
    np.testing.assert_array_equal(read_photo(stored(data, "phone.jpg")).codes, expected)


def test_cmyk_jpeg_is_refused(stored):
    data = encoded(Image.fromarray(RGB8).convert("CMYK"), "JPEG")
    with pytest.raises(FileFormatError, match=r"photo\.jpg: CMYK images are not supported; convert"):
        read_photo(stored(data, "photo.jpg"))


def test_content_decides_not_the_suffix(stored):
    np.testing.assert_array_equal(read_photo(stored(png(RGB16), "wrong.jpg")).codes, RGB16)


# --- TIFF -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("codes", [RGB8, RGB16], ids=["8bit", "16bit"])
@pytest.mark.parametrize(
    "options",
    [
        {},
        {"byteorder": ">"},
        {"compression": "lzw"},
        {"compression": "lzw", "predictor": True},
        {"compression": "zlib", "rowsperstrip": 3},
        {"tile": (16, 16), "compression": "zstd"},
        {"bigtiff": True},
    ],
    ids=str,
)
def test_tiff_layouts(stored, codes, options):
    planar = np.moveaxis(codes, -1, 0)
    for photo in (
        read_photo(stored(tiff(codes, photometric="rgb", **options), "contiguous.tif")),
        read_photo(stored(tiff(planar, photometric="rgb", planarconfig="separate", **options), "planar.tif")),
    ):
        np.testing.assert_array_equal(photo.codes, codes)
        assert photo.codes.dtype == codes.dtype
        assert photo.codes.dtype.isnative
    grey = read_photo(stored(tiff(codes[..., 0], photometric="minisblack", **options), "grey.tif"))
    np.testing.assert_array_equal(grey.codes[..., 0], codes[..., 0])


@pytest.mark.parametrize("codes", [RGB8[..., 0], RGB16[..., 0]], ids=["8bit", "16bit"])
def test_tiff_min_is_white_is_inverted(stored, codes):
    photo = read_photo(stored(tiff(codes, photometric="miniswhite"), "a.tif"))
    np.testing.assert_array_equal(photo.codes[..., 0], np.iinfo(codes.dtype).max - codes)


def test_tiff_of_one_bit(stored):
    bits = RNG.integers(0, 2, (5, 11)).astype(bool)
    black = read_photo(stored(tiff(bits, photometric="minisblack"), "a.tif"))
    np.testing.assert_array_equal(black.codes[..., 0], bits * np.uint8(255))
    white = read_photo(stored(tiff(bits, photometric="miniswhite"), "b.tif"))
    np.testing.assert_array_equal(white.codes[..., 0], ~bits * np.uint8(255))


def test_tiff_of_twelve_bits_knows_its_white_level(stored):
    codes = np.array([[0, 1, 4095, 2048]], np.uint16)
    packed = b"".join(((a << 12) | b).to_bytes(3, "big") for a, b in codes.reshape(-1, 2).tolist())
    data = tiff(np.zeros((1, 6), np.uint8), photometric="minisblack")
    assert len(packed) == 6
    # Patch the tags of a 6-byte strip: width 4, 12 bits per sample.
    page = tifffile.TiffFile(io.BytesIO(data)).pages.first
    patched = bytearray(data)
    for tag, value in ((256, 4), (258, 12)):
        width = struct.calcsize(form := {3: "<H", 4: "<I"}[int(page.tags[tag].dtype)])
        patched[page.tags[tag].valueoffset : page.tags[tag].valueoffset + width] = struct.pack(form, value)
    patched[page.dataoffsets[0] : page.dataoffsets[0] + 6] = packed
    photo = read_photo(stored(bytes(patched), "deep.tif"))
    np.testing.assert_array_equal(photo.codes[..., 0], codes)
    assert photo.white == 4095


def test_tiff_palette_becomes_rgb(stored):
    colours = RNG.integers(0, 256, (3, 256)).astype(np.uint16)
    index = RNG.integers(0, 256, (7, 9)).astype(np.uint8)
    photo = read_photo(stored(tiff(index, photometric="palette", colormap=colours * 257), "a.tif"))
    np.testing.assert_array_equal(photo.codes, colours.astype(np.uint8).T[index])


@pytest.mark.parametrize("extra", [1, 2])
def test_tiff_extra_samples_are_dropped_with_a_notice(stored, extra):
    codes = np.dstack([RGB16, *[RGB16[..., 0]] * extra])
    data = tiff(codes, photometric="rgb", extrasamples=["unassalpha"] + ["unspecified"] * (extra - 1))
    with pytest.warns(StereoHdrWarning, match="alpha" if extra == 1 else "extra channels"):
        photo = read_photo(stored(data, "a.tif"))
    np.testing.assert_array_equal(photo.codes, RGB16)


def test_tiff_pages_beyond_the_first_are_mentioned(stored):
    data = tiff(np.stack([RGB16[..., 0], RGB16[..., 1]]), photometric="minisblack")
    with pytest.warns(StereoHdrWarning, match="only the first of its 2 pages was read"):
        photo = read_photo(stored(data, "a.tif"))
    np.testing.assert_array_equal(photo.codes[..., 0], RGB16[..., 0])


@pytest.mark.parametrize(
    ("codes", "options", "message"),
    [
        (RGB16.astype(np.float32), {"photometric": "rgb"}, "floating-point TIFF is not a photo in camera codes;"),
        (np.full((3, 4), np.nan, np.float32), {"photometric": "minisblack"}, "this one holds NaN; save it"),
        (RGB16.astype(np.int16), {"photometric": "rgb"}, "type int16 is not supported; save it as unsigned"),
        (RGB16.astype(np.uint32), {"photometric": "rgb"}, "type uint32 is not supported"),
        (np.dstack([RGB8, RGB8[..., :1]]), {"photometric": "separated"}, "SEPARATED with 4 channel"),
        (RGB8, {"photometric": "cielab"}, "CIELAB with 3 channel"),
        (RGB8, {"photometric": "minisblack", "planarconfig": "contig"}, "MINISBLACK with 3 channel"),
        (RGB8, {"photometric": "rgb", "subfiletype": 1}, "is a preview"),
        (np.zeros((16, 16, 16), np.uint8), {"volumetric": True, "photometric": "minisblack"}, "not a photo"),
    ],
)
def test_tiffs_that_are_no_photos(stored, codes, options, message):
    with pytest.raises(FileFormatError, match=message) as caught:
        read_photo(stored(tiff(codes, **options), "a.tif"))
    assert "a.tif" in str(caught.value)


def test_tiff_with_missing_strips_is_not_filled_with_black(stored):
    data = tiff(RGB16, photometric="rgb", rowsperstrip=3, compression="zlib")
    page = tifffile.TiffFile(io.BytesIO(data)).pages.first
    patched = bytearray(data)
    patched[page.tags[257].valueoffset : page.tags[257].valueoffset + 4] = struct.pack("<I", 30)
    with pytest.raises(FileFormatError, match="6 of its strips or tiles are missing"):
        read_photo(stored(bytes(patched), "a.tif"))


# --- exposure, white level, orientation -------------------------------------------------------------------------


def exif_block(orientation=1):
    exif = Image.Exif()
    exif[274] = orientation
    exif.get_ifd(34665).update({33434: 0.25, 33437: 4.0, 34855: 800})
    return exif.tobytes()


def every_route(codes, orientation):
    """Yield the same picture as every format, with the same EXIF block."""
    block = exif_block(orientation)
    yield "8.png", encoded(Image.fromarray(codes), "PNG", exif=block)
    yield "16.png", png(codes.astype(np.uint16) * 257, chunks=[(b"eXIf", block[6:])])
    yield "a.tif", encoded(Image.fromarray(codes), "TIFF", exif=block)
    yield "a.jpg", encoded(Image.fromarray(codes), "JPEG", exif=block, quality=100, subsampling=0)


@pytest.mark.parametrize("orientation", range(9))
def test_orientation_and_exposure_by_every_route(stored, orientation):
    codes = np.repeat(np.arange(0, 240, 2, dtype=np.uint8).reshape(10, 12, 1), 3, axis=-1)
    exif = Image.Exif()
    exif[274] = orientation
    image = Image.open(io.BytesIO(encoded(Image.fromarray(codes), "PNG", exif=exif)))
    expected = np.asarray(ImageOps.exif_transpose(image)).astype(int)
    for name, data in every_route(codes, orientation):
        photo = read_photo(stored(data, name))
        got = photo.codes.astype(int) // (257 if photo.codes.dtype == np.uint16 else 1)
        assert got.shape == expected.shape, name
        assert np.abs(got - expected).max() <= (8 if name == "a.jpg" else 0), name
        assert (photo.exposure_time, photo.f_number, photo.iso) == (0.25, 4.0, 800.0), name
        assert photo.codes.flags.c_contiguous


def test_arguments_win_over_exif(stored):
    for name, data in every_route(RGB8, 1):
        with pytest.warns(StereoHdrWarning) as caught:
            photo = read_photo(stored(data, name), exposure_time=2, f_number=8, iso=50)
        assert (photo.exposure_time, photo.f_number, photo.iso) == (2, 8, 50)
        assert photo.exposure_source == "given"
        told = [str(warning.message).partition(": ")[2] for warning in caught]
        assert told == [
            "the exposure time 2 s is given, EXIF says 0.25 s; the given one is used",
            "the f-number 8 is given, EXIF says 4; the given one is used",
            "the ISO 50 is given, EXIF says 800; the given one is used",
        ]


def test_times_that_differ_by_rounding_are_no_conflict(stored):
    assert read_photo(stored(next(every_route(RGB8, 1))[1]), exposure_time=1 / 4.2).exposure_time == 1 / 4.2


def test_white_level_clips(stored):
    photo = read_photo(stored(png(RGB16)), white_level=4095)
    np.testing.assert_array_equal(photo.codes, np.minimum(RGB16, 4095))
    assert photo.white == 4095


def test_bad_arguments(stored):
    path = stored(png(RGB8))
    with pytest.raises(ExposureError, match=r"exposure time must be a positive number of seconds .*got 0"):
        read_photo(path, exposure_time=0)
    with pytest.raises(InputError, match="white level must be 3 to 255"):
        read_photo(path, white_level=300)


# --- files that cannot be read ----------------------------------------------------------------------------------


def test_what_is_not_a_file(tmp_path):
    with pytest.raises(FileFormatError, match=r"missing\.png: no such file"):
        read_photo(tmp_path / "missing.png")
    with pytest.raises(FileFormatError, match="is a folder; give the name of a file"):
        read_photo(tmp_path)
    with pytest.raises(FileFormatError, match="cannot be read"):
        read_photo("a\0b.png")


def test_unreadable_file(stored, monkeypatch):
    def refuse(*arguments):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("stereohdr.io.metadata.open", refuse, raising=False)
    with pytest.raises(FileFormatError, match=r"cannot be read \(Permission denied\); check its permissions"):
        read_photo(stored(png(RGB8)))


@pytest.mark.parametrize(
    ("data", "message"),
    [(b"", "the file is empty"), (b"just some text", "not a PNG, JPEG, TIFF"), (b"GIF89a" * 9, "not a PNG")],
)
def test_other_content(stored, data, message):
    with pytest.raises(FileFormatError, match=rf"photo\.png: {message}"):
        read_photo(stored(data))


SAMPLES = {
    "8.png": png(RGB8),
    "16.png": png(RGB16),
    "a.jpg": encoded(Image.fromarray(RGB8), "JPEG"),
    "plain.tif": tiff(RGB16, photometric="rgb"),
    "strips.tif": tiff(RGB16, photometric="rgb", compression="lzw", rowsperstrip=2),
    "tiles.tif": tiff(RGB16, photometric="rgb", compression="zlib", tile=(16, 16)),
}


@pytest.mark.parametrize("name", SAMPLES)
@pytest.mark.parametrize("share", [0.01, 0.05, 0.1, 0.2, 0.4, 0.6, 0.8, 0.95])
def test_truncated_photos(stored, name, share):
    data = SAMPLES[name]
    path = stored(data[: int(share * len(data))], name)
    with pytest.raises(FileFormatError) as caught:
        read_photo(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "; " in message, "says what to do"
    assert "\n" not in message


@pytest.mark.parametrize("name", SAMPLES)
def test_flipped_bytes_never_escape_as_another_error(stored, name):
    rng = np.random.default_rng(len(name))
    for _ in range(25):
        data = bytearray(SAMPLES[name])
        for position in rng.integers(0, len(data), 4):
            data[position] = rng.integers(0, 256)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StereoHdrWarning)
            with contextlib.suppress(InputError):  # any other kind of error fails the test
                read_photo(stored(bytes(data), name))


@pytest.mark.parametrize("codes", [RGB8, RGB16], ids=["8bit", "16bit"])
def test_png_header_that_lies_about_its_size(stored, codes):
    with pytest.raises(
        FileFormatError, match=f"more than the {LARGEST_PIXELS // 10**6} million that are accepted"
    ):
        read_photo(stored(png(codes, size=(2_000_000_000, 2_000_000_000))))
    with pytest.raises(FileFormatError, match="damaged file: it claims 13000x13000 pixels in"):
        read_photo(stored(png(codes, size=(13000, 13000))))
    with pytest.raises(FileFormatError, match="the image is 0x4 pixels"):
        read_photo(stored(png(codes, size=(0, 4))))


def test_tiff_header_that_lies_about_its_tiles(stored):
    data = tiff(RGB16, photometric="rgb", tile=(16, 16), compression="zlib")
    page = tifffile.TiffFile(io.BytesIO(data)).pages.first
    patched = bytearray(data)
    for tag in (322, 323):
        form = {3: "<H", 4: "<I"}[int(page.tags[tag].dtype)]
        struct.pack_into(form, patched, page.tags[tag].valueoffset, 60000)
    with pytest.raises(FileFormatError, match="60000x60000 pixels"):
        read_photo(stored(bytes(patched), "a.tif"))


def test_large_images_are_not_mistaken_for_bombs(stored, monkeypatch):
    # 11 x 14 pixels are "too large" now: Pillow warns, and warnings are errors in these tests.
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 100)
    for name in ("8.png", "16.png", "a.jpg"):
        assert read_photo(stored(SAMPLES[name], name)).width == 14
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 10)  # beyond twice the limit Pillow raises
    with pytest.raises(FileFormatError, match="exceeds limit"):
        read_photo(stored(SAMPLES["8.png"]))


# --- writing PNG ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "array", [RGB8, RGB8[..., 0], RGB8[..., :1], RGB8[:, ::-1]], ids=["rgb", "2d", "grey", "strided"]
)
def test_written_png_holds_the_pixels(tmp_path, array):
    path = tmp_path / "out.PNG"
    write_png(path, array)
    np.testing.assert_array_equal(imagecodecs.png_decode(path.read_bytes()), array.squeeze())
    first = path.read_bytes()
    write_png(path, array)
    assert path.read_bytes() == first
    assert len(list(tmp_path.iterdir())) == 1


def test_png_writer_refuses_before_it_touches_the_disk(tmp_path):
    path = tmp_path / "out.png"
    for array in (RGB16, RGB8.astype(float), RGB8[..., :2], RGB8[:0], RGB8[0, 0]):
        with pytest.raises(InputError, match="uint8"):
            write_png(path, array)
    with pytest.raises(FileFormatError, match=r"ends in \.png"):
        write_png(tmp_path / "out.jpg", RGB8)
    with pytest.raises(FileFormatError, match="does not exist"):
        write_png(tmp_path / "no" / "out.png", RGB8)
    assert list(tmp_path.iterdir()) == []


def test_png_writer_is_atomic(tmp_path, monkeypatch):
    path = tmp_path / "out.png"
    path.write_bytes(b"old")

    def fail(self, target, **options):
        target.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Image.Image, "save", fail)
    with pytest.raises(OutputError, match="No space left"):
        write_png(path, RGB8)
    assert path.read_bytes() == b"old"
    assert len(list(tmp_path.iterdir())) == 1
