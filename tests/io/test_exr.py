import math

import numpy as np
import OpenEXR
import pytest

from stereohdr.errors import FileFormatError, InputError, StereoHdrWarning
from stereohdr.io.exr import read_exr, read_exr_layers, write_exr

RNG = np.random.default_rng(7)
RGB = RNG.lognormal(0, 4, (33, 21, 3)).astype(np.float32)


def write_raw(path, channels, **header):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage} | header
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))
    return path


@pytest.mark.parametrize(
    "image", [RGB, RGB[..., :1], RGB[:1, :1], RGB[::-1, ::2]], ids=["rgb", "grey", "1x1", "strided"]
)
def test_round_trip_keeps_every_bit(tmp_path, image):
    path = tmp_path / "a.exr"
    write_exr(path, image)
    back, attributes = read_exr(path)
    assert back.dtype == np.float32
    np.testing.assert_array_equal(back, image)
    assert attributes == {}


def test_how_it_is_stored(tmp_path):
    for channels, names in ((1, ["Y"]), (3, ["B", "G", "R"])):
        write_exr(tmp_path / "a.exr", RGB[..., :channels])
        with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
            assert sorted(file.channels()) == names
            assert all(channel.pixels.dtype == np.float32 for channel in file.channels().values())
            assert file.header()["compression"] == OpenEXR.ZIP_COMPRESSION


def test_same_input_same_bytes(tmp_path):
    attributes = {"method": "paper", "exposures": (1 / 60, 0.25)}
    write_exr(tmp_path / "a.exr", RGB, attributes)
    write_exr(tmp_path / "b.exr", RGB, dict(reversed(attributes.items())))
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


def test_attributes_come_back(tmp_path):
    given = {
        "text": "übung\nzwei",
        "empty": "",
        "number": 0.25,
        "numpy": np.float32(1.5),
        "count": 7,
        "flag": True,
        "huge": 2**40,
        "pair": (1.0, 2.0),
        "triple": [1, 2, 3],
        "array": np.arange(5) / 4,
        "names": ["left", "right"],
        "chromaticities": (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, 0.3127, 0.329),
        "expTime": 0.125,
        "n" * 40: "long name",
    }
    write_exr(tmp_path / "a.exr", RGB, given)
    with pytest.warns(StereoHdrWarning, match="its primaries are not those of BT.709"):
        got = read_exr(tmp_path / "a.exr")[1]
    assert got.keys() == given.keys()
    assert got["text"] == "übung\nzwei"
    assert got["empty"] == ""
    assert got["number"] == 0.25
    assert got["numpy"] == 1.5
    assert got["count"] == 7
    assert got["flag"] == 1
    assert got["huge"] == str(2**40)
    assert got["pair"] == (1.0, 2.0)
    assert got["triple"] == (1.0, 2.0, 3.0)
    assert got["array"] == (0.0, 0.25, 0.5, 0.75, 1.0)
    assert got["names"] == ("left", "right")
    assert got["chromaticities"] == pytest.approx(given["chromaticities"], rel=1e-6)
    assert got["expTime"] == 0.125
    assert got["n" * 40] == "long name"


def test_colour_images_state_the_primaries_of_bt709(tmp_path):
    write_exr(tmp_path / "a.exr", RGB)
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        stated = file.header()["chromaticities"]
    assert stated == pytest.approx((0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329), rel=1e-6)
    assert read_exr(tmp_path / "a.exr")[1] == {}
    write_exr(tmp_path / "a.exr", RGB[..., :1])
    with OpenEXR.File(str(tmp_path / "a.exr")) as file:
        assert "chromaticities" not in file.header()


def test_half_floats_keep_eleven_bits(tmp_path):
    image = RGB.clip(1e-3, 6e4)
    write_exr(tmp_path / "a.exr", image, half=True)
    with OpenEXR.File(str(tmp_path / "a.exr"), separate_channels=True) as file:
        assert {channel.pixels.dtype for channel in file.channels().values()} == {np.dtype(np.float16)}
    back = read_exr(tmp_path / "a.exr")[0]
    np.testing.assert_array_equal(back, image.astype(np.float16).astype(np.float32))
    assert (np.abs(back - image) / image).max() <= 2**-11


def test_half_floats_never_become_infinite(tmp_path):
    image = np.full((5, 8, 3), 2.0, np.float32)
    image[2, 3] = [7e4, 65520.0, 1.0]  # 65520 is the first number that rounds to infinity
    with pytest.warns(StereoHdrWarning, match=r"1\.67 % of the values are above 65504 and were stored as that"):
        write_exr(tmp_path / "a.exr", image, half=True)
    np.testing.assert_array_equal(read_exr(tmp_path / "a.exr")[0][2, 3], [65504, 65504, 1])
    with pytest.warns(StereoHdrWarning, match=r"100 % of the values are below 6e-05 and lost precision"):
        write_exr(tmp_path / "a.exr", np.full((2, 2, 1), 1e-6, np.float32), half=True)


def test_layers_are_further_channels(tmp_path):
    rng = np.random.default_rng(5)
    layers = {
        "disparity.Z": rng.uniform(0, 90, RGB.shape[:2]).astype(np.float32),
        "source.I": rng.integers(0, 6, RGB.shape[:2]).astype(np.uint8),
        "confidence.Y": rng.uniform(size=RGB.shape[:2]),
    }
    for half in (False, True):
        write_exr(tmp_path / "a.exr", RGB.clip(1e-3, 6e4), {"method": "x"}, layers=layers, half=half)
        back = read_exr_layers(tmp_path / "a.exr")
        assert back.keys() == layers.keys()
        np.testing.assert_array_equal(back["disparity.Z"], layers["disparity.Z"])
        np.testing.assert_array_equal(back["source.I"], layers["source.I"])
        np.testing.assert_array_equal(back["confidence.Y"], layers["confidence.Y"].astype(np.float32))
        assert [back[name].dtype for name in layers] == [np.float32, np.uint32, np.float32]
    write_exr(tmp_path / "a.exr", RGB, layers=layers)
    image, attributes = read_exr(tmp_path / "a.exr")  # without a notice
    np.testing.assert_array_equal(image, RGB)
    assert attributes == {}
    write_exr(tmp_path / "b.exr", RGB[..., :1], layers=layers)
    np.testing.assert_array_equal(read_exr(tmp_path / "b.exr")[0], RGB[..., :1])
    write_exr(tmp_path / "c.exr", RGB)
    assert read_exr_layers(tmp_path / "c.exr") == {}


@pytest.mark.parametrize(
    ("name", "plane", "message"),
    [
        ("disparity", RGB[..., 0], "the name must be layer.channel"),
        (".Z", RGB[..., 0], "the name must be layer.channel"),
        ("a.", RGB[..., 0], "the name must be layer.channel"),
        ("ä.Z", RGB[..., 0], "the name must be layer.channel"),
        ("a.Z", RGB[:5, :, 0], "of the image's shape"),
        ("a.Z", RGB, "of the image's shape"),
        ("a.Z", RGB[..., 0] > 1, "floats or unsigned integers"),
        ("a.Z", RGB[..., 0].astype(np.int32), "floats or unsigned integers"),
    ],
)
def test_layers_that_cannot_be_stored(tmp_path, name, plane, message):
    with pytest.raises(InputError, match=message):
        write_exr(tmp_path / "a.exr", RGB, layers={name: plane})
    assert list(tmp_path.iterdir()) == []


def test_floats_are_stored_in_32_bits(tmp_path):
    write_exr(tmp_path / "a.exr", RGB, {"third": 1 / 3})
    assert read_exr(tmp_path / "a.exr")[1]["third"] == float(np.float32(1 / 3))


@pytest.mark.parametrize("value", [None, {"a": 1}, [], [1.0, "a"], [[1.0]], np.zeros((2, 2)), 1j, object()])
def test_attributes_of_other_types_are_refused(tmp_path, value):
    with pytest.raises(InputError, match="EXR attribute 'x' must be"):
        write_exr(tmp_path / "a.exr", RGB, {"x": value})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["", "x" * 256, "channels", "compression", "dataWindow", "type", "a\0b", "a\nb"])
def test_attribute_names_that_openexr_would_lose_are_refused(tmp_path, name):
    with pytest.raises(InputError, match="choose another"):
        write_exr(tmp_path / "a.exr", RGB, {name: "value"})


@pytest.mark.parametrize("compression", ["NO", "RLE", "ZIPS", "PIZ"])
def test_half_floats_of_other_programs(tmp_path, compression):
    half = RGB.clip(0, 6e4).astype(np.float16)
    path = write_raw(tmp_path / "a.exr", {"RGB": half}, compression=getattr(OpenEXR, f"{compression}_COMPRESSION"))
    np.testing.assert_array_equal(read_exr(path)[0], half.astype(np.float32))


def test_tiles_and_any_single_channel(tmp_path):
    path = write_raw(
        tmp_path / "a.exr", {"depth": RGB[..., 0].copy()}, type=OpenEXR.tiledimage, tiles=OpenEXR.TileDescription()
    )
    np.testing.assert_array_equal(read_exr(path)[0], RGB[..., :1])


def test_alpha_is_dropped_with_a_notice(tmp_path):
    path = write_raw(tmp_path / "a.exr", {"RGBA": np.dstack([RGB, RGB[..., :1]])})
    with pytest.warns(StereoHdrWarning, match=r"a\.exr: its alpha channel was dropped"):
        image, _ = read_exr(path)
    np.testing.assert_array_equal(image, RGB)


def test_only_the_first_part_is_read_with_a_notice(tmp_path):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    parts = [OpenEXR.Part(header | {"name": str(n)}, {"RGB": RGB * n}) for n in (1, 2)]
    with OpenEXR.File(parts) as file:
        file.write(str(tmp_path / "a.exr"))
    with pytest.warns(StereoHdrWarning, match="only the first of its 2 parts was read"):
        image, _ = read_exr(tmp_path / "a.exr")
    np.testing.assert_array_equal(image, RGB)


def test_other_channels_are_listed(tmp_path):
    plane = RGB[..., 0].copy()
    path = write_raw(tmp_path / "a.exr", {"left.R": plane, "left.G": plane, "left.B": plane})
    with pytest.raises(FileFormatError, match=r"found left\.B, left\.G, left\.R; save one layer as RGB"):
        read_exr(path)


def test_subsampled_and_deep_files_are_refused(tmp_path):
    plane = np.ones((2, 2), np.float32)
    channels = {name: OpenEXR.Channel(name, plane, 2, 2) for name in "RGB"}
    window = (np.array([0, 0], np.int32), np.array([3, 3], np.int32))
    with pytest.raises(FileFormatError, match="subsampled channels are not supported"):
        read_exr(write_raw(tmp_path / "a.exr", channels, dataWindow=window))
    deep = np.empty((3, 4), object)
    for position in np.ndindex(deep.shape):
        deep[position] = np.ones(2, np.float32)
    header = {"compression": OpenEXR.ZIPS_COMPRESSION, "type": OpenEXR.deepscanline}
    with pytest.raises(FileFormatError, match="deep OpenEXR files are not supported"):
        read_exr(write_raw(tmp_path / "b.exr", {"Z": deep}, **header))


def test_what_is_not_an_exr_file(tmp_path):
    path = tmp_path / "a.exr"
    with pytest.raises(FileFormatError, match="no such file"):
        read_exr(path)
    with pytest.raises(FileFormatError, match="is a folder"):
        read_exr(tmp_path)
    for content in (b"", b"v/1", b"some text"):
        path.write_bytes(content)
        with pytest.raises(FileFormatError, match=r"a\.exr: not an OpenEXR file; "):
            read_exr(path)


@pytest.mark.parametrize("share", [0.005, 0.01, 0.05, 0.1, 0.3, 0.7, 0.99])
def test_truncated(tmp_path, share):
    path = tmp_path / "a.exr"
    write_exr(path, RGB)
    data = path.read_bytes()
    path.write_bytes(data[: math.ceil(share * len(data))])
    with pytest.raises(FileFormatError, match=r"a\.exr: damaged OpenEXR file"):
        read_exr(path)


@pytest.mark.parametrize("kind", [OpenEXR.scanlineimage, OpenEXR.tiledimage])
def test_headers_that_lie_about_sizes(tmp_path, kind):
    tiled = kind == OpenEXR.tiledimage
    header = {"tiles": OpenEXR.TileDescription()} if tiled else {}
    path = write_raw(tmp_path / "a.exr", {"RGB": RGB}, type=kind, **header)
    data = bytearray(path.read_bytes())
    field = b"tiles\0tiledesc\0" if tiled else b"dataWindow\0box2i\0"
    position = data.index(field) + len(field) + 4
    offset, size = (0, 60000) if tiled else (8, 59999)
    data[position + offset : position + offset + 8] = size.to_bytes(4, "little") * 2
    path.write_bytes(data)
    with pytest.raises(FileFormatError, match="the image is 60000x60000 pixels, more than"):
        read_exr(path)


def test_writing_to_nowhere(tmp_path):
    with pytest.raises(FileFormatError, match="does not exist"):
        write_exr(tmp_path / "no" / "a.exr", RGB)
