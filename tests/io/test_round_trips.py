"""Every format that is written, read back by another library than the one that wrote it.

``pytest tests/io/test_round_trips.py -s`` prints the table of docs/formats.md.
"""

import ast
import struct
import warnings

import imagecodecs
import numpy as np
import pytest

from stereohdr import write_hdr
from stereohdr.errors import StereoHdrWarning
from stereohdr.io.display import BT709_TO_BT2020, diffuse_white
from stereohdr.io.exr import read_exr_layers
from stereohdr.io.hdr import FORMATS
from stereohdr.simulation import room

ATTRIBUTES = {"method": "paper", "exposureTimeMain": 0.25, "software": "stereohdr"}


@pytest.fixture(scope="module")
def scene():
    """The room, 480x360, 25 stops, linear BT.709."""
    return room().radiance_left


@pytest.fixture(scope="module")
def table():
    """Lines that are printed at the end."""
    lines = [f"{'file':7}{'options':22}{'read by':13}{'kB':>6}{'median':>10}{'95 %':>10}{'compared':>10}"]
    yield lines
    print("\n\nrelative error of each value of the room (480x360, 25 stops)", *lines, sep="\n")


# --- readers of other libraries: path and scene to radiance in the scene's unit --------------------------------


def read_with_opencv(path):
    cv2 = pytest.importorskip("cv2")
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        pytest.skip(f"this build of OpenCV does not read {path.suffix}")
    return np.ascontiguousarray(image[..., ::-1])


def opencv(path, white):
    return read_with_opencv(path).astype(np.float64)


def opencv_pq(path, white):
    """AVIF codes to light, written down from SMPTE ST 2084 and BT.2408 once more."""
    codes = read_with_opencv(path)
    signal = codes / (4095 if codes.max() > 1023 else 1023)
    root = signal ** (32 / 2523)
    nits = 1e4 * (np.maximum(root - 0.8359375, 0) / (18.8515625 - 18.6875 * root)) ** (16384 / 2610)
    return nits @ np.linalg.inv(BT709_TO_BT2020).T * (white / 203)


def openimageio(path, white):
    oiio = pytest.importorskip("OpenImageIO")
    buffer = oiio.ImageBuf(str(path))
    assert not buffer.has_error, buffer.geterror()
    image = buffer.get_pixels(oiio.FLOAT)[..., :3].astype(np.float64)
    return image * (white if path.suffix == ".jxl" else 1)


def rgbe(path, white):
    return imagecodecs.rgbe_decode(path.read_bytes()).astype(np.float64)


def ffmpeg(path, white):
    """FFmpeg's own decoders, through PyAV (which is not among the test dependencies)."""
    av = pytest.importorskip("av")
    with av.open(str(path)) as container:
        frame = next(container.decode(video=0))
    assert frame.format.name == "gbrpf32le"
    green, blue, red = (np.frombuffer(plane, np.float32).reshape(frame.height, -1) for plane in frame.planes)
    return np.stack([red, green, blue], axis=-1)[:, : frame.width].astype(np.float64)


def libultrahdr(path, white):
    if not imagecodecs.ULTRAHDR.available:
        pytest.skip("this build of imagecodecs has no libultrahdr")
    return imagecodecs.ultrahdr_decode(path.read_bytes())[..., :3].astype(np.float64) * white


def by_hand(path, white):
    """NumPy's format without NumPy's reader: a magic word, a dictionary as text, the numbers."""
    data = path.read_bytes()
    assert data[:8] == b"\x93NUMPY\1\0"
    (length,) = struct.unpack("<H", data[8:10])
    header = ast.literal_eval(data[10 : 10 + length].decode())
    assert header["descr"] == "<f4"
    assert not header["fortran_order"]
    numbers = struct.unpack(f"<{np.prod(header['shape'])}f", data[10 + length :])
    return np.array(numbers).reshape(header["shape"])


# suffix, options, reader, largest median and largest 95th percentile of the relative error
CASES = [
    (".exr", {}, openimageio, 0, 0),
    (".exr", {}, ffmpeg, 0, 0),
    (".exr", {"half": True}, openimageio, 2.5e-4, 5e-4),
    (".hdr", {}, opencv, 4e-3, 1.5e-2),
    (".hdr", {}, rgbe, 4e-3, 1.5e-2),
    (".hdr", {}, openimageio, 4e-3, 1.5e-2),
    (".pfm", {}, opencv, 0, 0),
    (".npy", {}, by_hand, 0, 0),
    (".tif", {}, opencv, 0, 0),
    (".tif", {}, openimageio, 0, 0),
    (".jpg", {}, libultrahdr, 0.03, 0.4),
    (".jpg", {"quality": 100}, libultrahdr, 0.02, 0.3),
    (".avif", {}, opencv_pq, 0.03, 0.2),
    (".avif", {"quality": 100}, opencv_pq, 5e-3, 2e-2),
    (".avif", {"bits": 12, "quality": 100}, opencv_pq, 2e-3, 5e-3),
    (".jxl", {}, openimageio, 1e-7, 2e-7),
    (".jxl", {"half": True}, openimageio, 2.5e-4, 5e-4),
    (".jxl", {"quality": 90}, openimageio, 0.03, 0.4),
]


@pytest.mark.parametrize(
    ("suffix", "options", "reader", "median", "high"),
    CASES,
    ids=[
        f"{suffix[1:]}-{'-'.join(options) or 'plain'}-{reader.__name__}" for suffix, options, reader, *_ in CASES
    ],
)
def test_another_library_reads_the_same_radiance(tmp_path, table, scene, suffix, options, reader, median, high):
    path = tmp_path / f"room{suffix}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)  # of what is too bright, or too dark for half floats
        write_hdr(path, scene, attributes=ATTRIBUTES, **options)
    white = diffuse_white(scene)
    image = reader(path, white)
    assert image.shape == scene.shape
    peak = {".jpg": 16, ".avif": 10_000 / 203}.get(suffix, np.inf)
    kept = scene.max(axis=2) <= peak * white
    error = (np.abs(image - scene) / scene)[kept]
    label = " ".join(f"{name}={value}" for name, value in options.items())
    table.append(
        f"{suffix:7}{label:22}{reader.__name__:13}{path.stat().st_size / 1000:6.0f}{np.median(error):10.2g}"
        f"{np.percentile(error, 95):10.2g}{100 * kept.mean():8.1f} %"
    )
    assert np.median(error) <= median
    assert np.percentile(error, 95) <= high


def test_every_format_is_read_by_another_library():
    assert {suffix for suffix, *_ in CASES} == set(FORMATS) - {".tiff", ".jpeg"}


def test_another_library_reads_metadata_and_layers(tmp_path, scene):
    oiio = pytest.importorskip("OpenImageIO")
    rng = np.random.default_rng(1)
    layers = {
        "disparity.Z": rng.uniform(0, 50, scene.shape[:2]).astype(np.float32),
        "source.I": rng.integers(0, 6, scene.shape[:2]).astype(np.uint32),
    }
    write_hdr(tmp_path / "a.exr", scene, attributes=ATTRIBUTES, layers=layers)
    buffer = oiio.ImageBuf(str(tmp_path / "a.exr"))
    spec = buffer.spec()
    names = list(spec.channelnames)
    assert set(names) == {"R", "G", "B", *layers}
    assert names[:3] == ["R", "G", "B"]
    image = oiio.ImageInput.open(str(tmp_path / "a.exr"))
    for name, plane in layers.items():
        channel, kind = names.index(name), oiio.UINT if plane.dtype == np.uint32 else oiio.FLOAT
        read = image.read_image(0, 0, channel, channel + 1, kind)
        np.testing.assert_array_equal(read.reshape(plane.shape), plane)
        np.testing.assert_array_equal(read_exr_layers(tmp_path / "a.exr")[name], plane)
    image.close()
    assert spec.getattribute("method") == "paper"
    assert spec.getattribute("exposureTimeMain") == 0.25
    np.testing.assert_allclose(spec.getattribute("chromaticities")[:2], (0.64, 0.33), rtol=1e-6)
    write_hdr(tmp_path / "a.tif", scene, attributes=ATTRIBUTES)
    spec = oiio.ImageBuf(str(tmp_path / "a.tif")).spec()
    assert "paper" in spec.getattribute("ImageDescription")
    assert spec.getattribute("Software") == "stereohdr"


def test_ffmpeg_reads_the_tags_of_avif(tmp_path, scene):
    av = pytest.importorskip("av")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StereoHdrWarning)
        write_hdr(tmp_path / "a.avif", scene)
    with av.open(str(tmp_path / "a.avif")) as container:
        frame = next(container.decode(video=0))
    assert frame.format.name == "yuv444p10le"
    assert (frame.color_primaries, frame.color_trc, frame.colorspace, frame.color_range) == (9, 16, 9, 2)
