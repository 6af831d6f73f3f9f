import numpy as np
import pytest
from PIL import Image, features

from stereohdr.errors import FileFormatError, MissingDependencyError
from stereohdr.io import read_photo

GREY = np.kron(np.arange(0, 240, 8, dtype=np.uint8).reshape(5, 6), np.ones((8, 8), np.uint8))
CODES = np.stack([GREY, GREY // 2 + 20, 255 - GREY], axis=-1)


def exif(orientation=1):
    block = Image.Exif()
    block[271], block[272], block[274] = "Acme", "Phone 3", orientation
    block.get_ifd(34665).update({33434: 0.25, 33437: 4.0, 34855: 800})
    return block


def heif(path, codes, orientation=1, **options):
    pillow_heif = pytest.importorskip("pillow_heif", reason="pillow-heif is not installed")
    image = pillow_heif.from_pillow(Image.fromarray(codes))
    image.save(path, quality=-1, chroma=444, exif=exif(orientation).tobytes(), **options)
    return path


def avif(path, codes, orientation=1, **options):
    if not features.check("avif"):
        pytest.skip("this Pillow cannot write AVIF")
    Image.fromarray(codes).save(path, quality=100, subsampling="4:4:4", exif=exif(orientation), **options)
    return path


@pytest.mark.parametrize(("write", "name"), [(heif, "a.heic"), (avif, "a.avif")])
@pytest.mark.parametrize(("orientation", "turns"), [(1, 0), (3, 2), (6, 3), (8, 1)])
def test_pictures_stand_upright_and_state_their_exposure(tmp_path, write, name, orientation, turns):
    photo = read_photo(write(tmp_path / name, CODES, orientation))
    expected = np.rot90(CODES, turns)
    assert photo.codes.shape == expected.shape
    assert np.abs(photo.codes.astype(int) - expected).max() <= 3  # lossless, but for the way through YCbCr
    assert (photo.exposure_time, photo.f_number, photo.iso) == (0.25, 4.0, 800.0)
    assert photo.camera == "Acme Phone 3"
    assert not photo.linear


def test_ten_bits_of_heic_stay_ten_bits(tmp_path):
    pillow_heif = pytest.importorskip("pillow_heif", reason="pillow-heif is not installed")
    deep = CODES.astype(np.uint16) * 257
    image = pillow_heif.from_bytes("RGB;16", (CODES.shape[1], CODES.shape[0]), deep.tobytes())
    image.save(tmp_path / "a.heic", quality=-1, chroma=444)
    photo = read_photo(tmp_path / "a.heic")
    assert photo.white in (1023, 4095)
    np.testing.assert_allclose(photo.codes / photo.white, CODES / 255, atol=0.02)
    assert photo.codes.max() > 255


@pytest.mark.parametrize(("bits", "white"), [(10, 1023), (12, 4095)])
def test_deep_avif_knows_its_white_level(tmp_path, bits, white):
    imagecodecs = pytest.importorskip("imagecodecs")
    deep = (CODES.astype(np.uint16) * 257) >> (16 - bits)
    (tmp_path / "a.avif").write_bytes(imagecodecs.avif_encode(deep, bitspersample=bits, level=100))
    photo = read_photo(tmp_path / "a.avif")
    assert photo.white == white
    np.testing.assert_allclose(photo.codes / white, CODES / 255, atol=0.02)


@pytest.mark.parametrize(("write", "name"), [(heif, "a.heic"), (avif, "a.avif")])
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_truncated_files_are_one_sentence(tmp_path, write, name, share):
    data = write(tmp_path / name, np.random.default_rng(0).integers(0, 255, (64, 64, 3), np.uint8)).read_bytes()
    (tmp_path / name).write_bytes(data[: int(share * len(data))])
    with pytest.raises(FileFormatError, match=r"damaged or unsupported (HEIF|AVIF) file") as caught:
        read_photo(tmp_path / name)
    assert "\n" not in str(caught.value)


def test_without_pillow_heif_the_extra_is_named(tmp_path, monkeypatch):
    import sys

    path = heif(tmp_path / "a.heic", CODES)
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(MissingDependencyError, match=r"stereohdr\[heif\]"):
        read_photo(path)
