import io
import struct
import xml.etree.ElementTree as ElementTree

import imagecodecs
import numpy as np
import pytest
from PIL import Image

from stereohdr import read_photo, tonemap
from stereohdr.errors import FileFormatError, InputError, StereoHdrWarning
from stereohdr.io.ultra_hdr import ISO_NAME, MPF_NAME, XMP_NAME, decode_ultra_hdr, encode_ultra_hdr

RNG = np.random.default_rng(8)
SMOOTH = np.exp(np.add.outer(np.linspace(-3, 2, 60), np.linspace(0, 2.5, 90)))[..., None]
SCENE = (SMOOTH * [1.0, 0.7, 0.5] * RNG.uniform(0.9, 1.1, (60, 90, 1))).astype(np.float32)
WHITE = float(SCENE.max()) / 10

HDRGM = "{http://ns.adobe.com/hdr-gain-map/1.0/}"
CONTAINER = "{http://ns.google.com/photos/1.0/container/}"
ITEM = "{http://ns.google.com/photos/1.0/container/item/}"


def segments_of(jpeg):
    """Return (marker, content) of the segments before the scan, read without the module's own reader."""
    position, found = 2, []
    while jpeg[position + 1] != 0xDA:
        assert jpeg[position] == 0xFF
        length = struct.unpack(">H", jpeg[position + 2 : position + 4])[0]
        found.append((jpeg[position + 1], jpeg[position + 4 : position + 2 + length]))
        position += 2 + length
    return found


def content(jpeg, name):
    (found,) = [data for _, data in segments_of(jpeg) if data.startswith(name)]
    return found[len(name) :]


def xmp_root(jpeg):
    text = content(jpeg, XMP_NAME).decode()
    return ElementTree.fromstring(text.split("?>", 1)[1].rsplit("<?", 1)[0])


def split(data):
    """Return base and gain map, cut where the XMP directory says that the gain map begins."""
    items = xmp_root(data).findall(f".//{CONTAINER}Item")
    assert [item.get(f"{ITEM}Semantic") for item in items] == ["Primary", "GainMap"]
    length = int(items[1].get(f"{ITEM}Length"))
    return data[:-length], data[-length:]


# --- what is in the file ----------------------------------------------------------------------------------------


def test_the_base_is_the_tone_mapped_picture():
    data = encode_ultra_hdr(SCENE, white=WHITE, operator="mai", quality=100)
    with Image.open(io.BytesIO(data)) as image:
        assert image.format == "JPEG"  # Pillow knows that the second picture is a gain map
        base = np.asarray(image).astype(int)
    difference = np.abs(base - tonemap(SCENE, "mai"))
    assert difference.max() <= 6
    assert difference.mean() < 0.5


def test_both_images_are_whole_jpegs():
    base, second = split(encode_ultra_hdr(SCENE, white=WHITE))
    for jpeg in (base, second):
        assert jpeg.startswith(b"\xff\xd8\xff\xe0")
        assert jpeg[6:10] == b"JFIF"
        assert jpeg.endswith(b"\xff\xd9")
        with Image.open(io.BytesIO(jpeg), formats=["JPEG", "MPO"]) as image:
            image.load()


def test_the_multi_picture_index_points_to_both_images():
    data = encode_ultra_hdr(SCENE, white=WHITE)
    base, second = split(data)
    index = content(data, MPF_NAME)
    header = data.index(MPF_NAME + b"MM\0*") + 4
    assert index[:10] == b"MM\0*\0\0\0\x08\0\x03"
    entries = struct.unpack(">IIIHHIIIHH", index[50:82])
    assert entries == (0x030000, len(base), 0, 0, 0, 0, len(second), len(base) - header, 0, 0)


def test_iso_and_xmp_say_the_same():
    data = encode_ultra_hdr(SCENE, white=WHITE)
    base, second = split(data)
    assert content(base, ISO_NAME) == bytes(4)  # minimum and writer version
    metadata = content(second, ISO_NAME)
    assert metadata[:5] == b"\0\0\0\0\xc0"
    assert len(metadata) == 5 + 2 * 8 + 3 * 5 * 8
    numbers = np.array([n / d for n, d in struct.iter_unpack(">iI", metadata[5:])])
    base_headroom, headroom = numbers[:2]
    low, high, gamma, offset_sdr, offset_hdr = numbers[2:7]
    np.testing.assert_array_equal(numbers[2:].reshape(3, 5), np.tile(numbers[2:7], (3, 1)))
    description = xmp_root(second).find(".//*[@{http://ns.adobe.com/hdr-gain-map/1.0/}GainMapMax]")
    stated = {name.removeprefix(HDRGM): value for name, value in description.attrib.items()}
    assert stated["Version"] == "1.0"
    assert stated["BaseRenditionIsHDR"] == "False"
    for key, value in (
        ("GainMapMin", low),
        ("GainMapMax", high),
        ("Gamma", gamma),
        ("OffsetSDR", offset_sdr),
        ("OffsetHDR", offset_hdr),
        ("HDRCapacityMin", base_headroom),
        ("HDRCapacityMax", headroom),
    ):
        assert float(stated[key]) == pytest.approx(value, abs=2e-6)
    assert (base_headroom, gamma, offset_sdr, offset_hdr) == (0, 1, 1 / 64, 1 / 64)
    assert headroom == pytest.approx(np.log2(SCENE.max() / WHITE), abs=1e-5)


def test_the_headroom_is_limited_and_at_least_one_stop():
    def headroom(**options):
        metadata = content(split(encode_ultra_hdr(SCENE, **options))[1], ISO_NAME)
        numerator, denominator = struct.unpack(">iI", metadata[13:21])
        return numerator / denominator

    peak = float(SCENE.max())
    assert headroom(white=peak / 10) == pytest.approx(np.log2(10), abs=1e-5)
    assert headroom(white=peak * 3) == 1
    with pytest.warns(UserWarning, match="brighter than 8 times diffuse white"):
        assert headroom(white=peak / 10, headroom=3.0) == 3


# --- the image that comes back ----------------------------------------------------------------------------------


@pytest.mark.parametrize("operator", ["reinhard", "mai", "filmic", "linear"])
def test_ours_and_libultrahdr_decode_the_same(operator):
    if not imagecodecs.ULTRAHDR.available:
        pytest.skip("this build of imagecodecs has no libultrahdr")
    data = encode_ultra_hdr(SCENE, white=WHITE, operator=operator)
    theirs = imagecodecs.ultrahdr_decode(data)[..., :3].astype(np.float64) * WHITE
    ours = decode_ultra_hdr(data)[0]
    assert np.median(np.abs(theirs - SCENE) / SCENE) < 0.03
    assert np.median(np.abs(ours - SCENE) / SCENE) < 0.03
    assert np.percentile(np.abs(ours - theirs) / SCENE, 99) < 0.05  # libultrahdr works with tables and half floats
    assert np.median(np.abs(ours - theirs) / SCENE) < 0.01


def test_a_slow_reader_decodes_the_same():
    data = encode_ultra_hdr(SCENE, white=WHITE)
    base, second = split(data)
    low, _, _, offset, _ = struct.unpack(">iIiIi", content(second, ISO_NAME)[21:41])
    high = offset and struct.unpack(">i", content(second, ISO_NAME)[29:33])[0]
    low, high = low / 2**20, high / 2**20
    codes = [np.asarray(Image.open(io.BytesIO(jpeg)).convert("RGB"))[30, 40] / 255 for jpeg in (base, second)]
    expected = []
    for code, gain in zip(*codes, strict=True):
        light = code / 12.92 if code <= 0.04045 else ((code + 0.055) / 1.055) ** 2.4
        expected.append(WHITE * ((light + 1 / 64) * 2 ** (low + gain * (high - low)) - 1 / 64))
    np.testing.assert_allclose(decode_ultra_hdr(data)[0][30, 40], expected, rtol=1e-5)


@pytest.mark.parametrize("scale", [1, 2, 3])
def test_files_of_libultrahdr(scale):
    if not imagecodecs.ULTRAHDR.available:
        pytest.skip("this build of imagecodecs has no libultrahdr")
    rgba = np.ones((60, 90, 4), np.float16)
    rgba[..., :3] = SMOOTH * [1.0, 0.7, 0.5] / SMOOTH.max() * 6
    p3 = imagecodecs.ULTRAHDR.CG.DISPLAY_P3
    data = imagecodecs.ultrahdr_encode(rgba, 98, gamut=p3, nits=1600, scale=scale)
    theirs = imagecodecs.ultrahdr_decode(data)[..., :3].astype(np.float64)
    with pytest.warns(StereoHdrWarning, match="its colour profile was not applied"):
        ours, attributes = decode_ultra_hdr(data)
    assert np.median(np.abs(ours - theirs) / theirs) < 0.03
    assert np.percentile(np.abs(ours - theirs) / theirs, 90) < 0.1  # small maps are enlarged in different ways
    assert attributes == {}


def test_photos_are_read_from_the_base(tmp_path):
    (tmp_path / "a.jpg").write_bytes(encode_ultra_hdr(SCENE, white=WHITE))
    assert read_photo(tmp_path / "a.jpg", exposure_time=1.0).codes.shape == (60, 90, 3)


# --- refusals ---------------------------------------------------------------------------------------------------


def test_ordinary_jpegs_and_other_files_are_refused():
    plain = io.BytesIO()
    Image.fromarray(tonemap(SCENE)).save(plain, "JPEG")
    for data, message in (
        (plain.getvalue(), "a JPEG without a gain map is no HDR image"),
        (b"\x89PNG\r\n", "not a JPEG image"),
        (b"", "not a JPEG image"),
        (b"\xff\xd8\xff\xe0\0\x10JFIF", "its header is broken off"),
    ):
        with pytest.raises(FileFormatError, match=message):
            decode_ultra_hdr(data)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"\0\0\0\0\xc0", b"\0\1\0\0\xc0", "description of its gain map is not valid"),  # a later version
        (b"\0\0\0\0\xc0", b"\0\0\0\0\x80", "description of its gain map is not valid"),  # another colour space
        (b"\0\0\0\0\xc0", b"\0\0\0\0\x40", "description of its gain map is not valid"),  # one channel
        (b"\xc0\0\0\0\0\0\x10", b"\xc0\0\0\0\1\0\x10", "description of its gain map"),  # an HDR base
        (b"\xc0\0\0\0\0\0\x10\0\0", b"\xc0\0\0\0\0\0\0\0\0", "description of its gain map"),  # over zero
        (ISO_NAME + b"\0\0\0\0\xc0", b"x" * 28 + b"\0\0\0\0\xc0", "no gain map as ISO 21496-1 describes it"),
        (b"MPF\0MM\0*\0\0\0\x08", b"MPF\0MM\0*\0\1\0\0", "its index of pictures is broken"),
    ],
)
def test_damaged_descriptions(old, new, message):
    data = encode_ultra_hdr(SCENE, white=WHITE)
    assert data.count(old) == 1
    with pytest.raises(FileFormatError, match=f"a: .*{message}"):
        decode_ultra_hdr(data.replace(old, new), "a")


def test_what_does_not_fit_into_a_jpeg():
    with pytest.raises(InputError, match="at most 65535 pixels a side"):
        encode_ultra_hdr(np.ones((1, 65_536, 1), np.float32))
    with pytest.raises(InputError, match=r"the attributes do not fit into a JPEG \(\d+ bytes\); give fewer"):
        encode_ultra_hdr(SCENE, {"text": "x" * 70_000}, white=WHITE)
