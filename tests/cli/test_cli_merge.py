import imagecodecs
import numpy as np
import pytest
import typer
from PIL import Image

from stereohdr import ResponseCurve, read_hdr, read_photo, tonemap
from stereohdr.cli.merge import merge_command
from stereohdr.errors import ExposureError, FileFormatError, InputError
from stereohdr.io.exr import read_exr
from stereohdr.io.images import write_png
from stereohdr.merging import merge_bracket
from stereohdr.simulation import Camera, expose

TIMES = (0.25, 1.0, 4.0)


def run(*arguments):
    app = typer.Typer(pretty_exceptions_enable=False)
    app.command()(merge_command)
    app(args=[str(a) for a in arguments], standalone_mode=False)


@pytest.fixture
def files(tmp_path):
    """Write a.png, b.png, c.png, exposed at 1/4, 1 and 4 s; return their folder."""
    radiance = 2.0 ** -np.random.default_rng(2).uniform(0, 7, (60, 80, 3))
    for seed, (name, time) in enumerate(zip("abc", TIMES, strict=True)):
        write_png(tmp_path / f"{name}.png", expose(radiance, time, Camera(), seed).codes.astype(np.uint8))
    return tmp_path


def photos_of(folder):
    return [
        read_photo(folder / f"{name}.png", exposure_time=time) for name, time in zip("abc", TIMES, strict=True)
    ]


def images(folder):
    return [folder / f"{name}.png" for name in "abc"]


@pytest.mark.parametrize(
    "times", [["--exposures", "1/4,1,4"], ["--exposures", "250ms,1", "--exposures", "4"]], ids=["list", "repeated"]
)
def test_merges_as_the_function_does(files, times, capsys):
    out = files / "ref.exr"
    run(*images(files), "-o", out, *times)
    expected, clipped = merge_bracket(photos_of(files))
    np.testing.assert_array_equal(read_hdr(out), expected)
    summary = capsys.readouterr().out
    assert "3 photos, 1/4 s to 4 s, exposure ratio 16" in summary
    assert f"{100 * clipped.mean():.2f} % of the pixels in all photos" in summary
    assert str(out) in summary
    attributes = read_exr(out)[1]
    assert attributes["method"] == "merge"


def test_all_outputs(files):
    run(
        *images(files),
        *("-o", files / "ref.npy"),
        *("--exposures", "1/4,1,4"),
        *("--save-response", files / "curve.json"),
        *("--preview", files / "ref.png"),
        *("--clipped", files / "mask.png"),
        "-q",
    )
    curve = ResponseCurve.load(files / "curve.json")
    radiance, clipped = merge_bracket(photos_of(files), response=curve)
    np.testing.assert_array_equal(np.load(files / "ref.npy"), radiance)
    np.testing.assert_array_equal(np.asarray(Image.open(files / "ref.png")), tonemap(radiance))
    np.testing.assert_array_equal(np.asarray(Image.open(files / "mask.png")) > 0, clipped)


def test_a_given_response_is_used(files, capsys):
    ResponseCurve.gamma(2.2).save(files / "curve.json")
    run(*images(files), "-o", files / "r.npy", "--exposures", "1/4,1,4", "--response", files / "curve.json")
    expected, _ = merge_bracket(photos_of(files), response=ResponseCurve.gamma(2.2))
    np.testing.assert_array_equal(np.load(files / "r.npy"), expected)
    assert "curve.json" in capsys.readouterr().out


def test_times_come_from_exif(files):
    for name, time in zip("abc", TIMES, strict=True):
        exif = Image.Exif()
        exif.get_ifd(34665)[33434] = time
        Image.open(files / f"{name}.png").save(files / f"{name}.jpg", exif=exif, quality=98)
    run(*(files / f"{name}.jpg" for name in "abc"), "-o", files / "ref.npy", "-q")
    assert np.isfinite(np.load(files / "ref.npy")).all()


def test_white_level_reaches_the_photos(files):
    radiance = 2.0 ** -np.random.default_rng(2).uniform(0, 7, (60, 80, 1))
    for name, time in zip("abc", TIMES, strict=True):
        codes = expose(radiance, time, Camera(bits=12), 1).codes[..., 0]
        (files / f"{name}.png").write_bytes(imagecodecs.png_encode(codes))
    run(*images(files), "-o", files / "ref.npy", "--exposures", "1/4,1,4", "--white-level", 4095, "-q")
    error = np.log2(np.load(files / "ref.npy") / radiance)
    assert np.abs(error - np.median(error)).mean() < 0.1


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ("a.png b.png -o r.exr", ExposureError, "exposure time is not known"),
        ("a.png b.png -o r.exr --exposures 1,2,3", ExposureError, "3 times for 2 photos"),
        ("a.png b.png -o r.exr --exposures 4,1", ExposureError, "contradict"),
        ("a.png b.png -o r.exr --exposures 1,soon", ExposureError, "soon"),
        ("a.png -o r.exr --exposures 1", InputError, "two or more photos"),
        ("a.png b.png -o r.bmp --exposures 1,4", FileFormatError, "not an HDR format"),
        ("a.png b.png -o r.exr --exposures 1,4 --preview p.jpg", FileFormatError, "ends in .png"),
        ("a.png b.png -o r.exr --exposures 1,4 --preview a.png", InputError, "would overwrite"),
        ("a.png b.png -o r.exr --exposures 1,4 --preview p.png --clipped p.png", InputError, "would overwrite"),
        ("a.png none.png -o r.exr --exposures 1,4", FileFormatError, "no such file"),
        ("a.png b.png -o r.exr --exposures 1,4 --save-response no/c.json", FileFormatError, "does not exist"),
    ],
)
def test_refuses_and_writes_nothing(files, monkeypatch, arguments, error, words):
    monkeypatch.chdir(files)
    before = sorted(path.name for path in files.iterdir())
    with pytest.raises(error, match=words):
        run(*arguments.split())
    assert sorted(path.name for path in files.iterdir()) == before


def test_the_memorial_church(shared_data, tmp_path):
    folder = shared_data / "brackets" / "memorial"
    times = ",".join((folder / "shutter_times.txt").read_text().split())
    run(*sorted(folder.glob("*.png")), "-o", tmp_path / "ref.exr", "--exposures", times, "-q")
    radiance = read_hdr(tmp_path / "ref.exr")
    assert radiance.shape == (768, 512, 3)
    assert np.log2(np.percentile(radiance, 99.9) / np.percentile(radiance, 1)) > 12
