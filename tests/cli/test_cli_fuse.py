import json
import re

import numpy as np
import pytest

from stereohdr import ResponseCurve, __version__, fuse, read_hdr
from stereohdr.io.exr import read_exr, read_exr_layers
from stereohdr.io.images import write_png

from command_line import run
from conftest import make_pair


@pytest.fixture
def files(tmp_path):
    """Write left.png and right.png, 64x40, exposures 1:4; return their folder."""
    pair = make_pair()
    write_png(tmp_path / "left.png", pair.left.codes)
    write_png(tmp_path / "right.png", pair.right.codes)
    return tmp_path


def run_fuse(folder, *more, left="left.png", right="right.png", out="out.exr", times=("1/25", "0.16")):
    exposures = ["--exposures", *times] if times else []
    return run("fuse", folder / left, folder / right, "-o", folder / out, *exposures, *more)


def stages(errors):
    """Return the lines on standard error, without what is said where kernels were not compiled yet."""
    return [line for line in errors.splitlines() if not line.startswith("compiling kernels")]


def names(folder):
    return sorted(p.name for p in folder.iterdir())


def assert_refused(capsys, folder, status, *words, untouched=None):
    """Check for exit status 2, one sentence on standard error, and no new file."""
    assert status == 2
    errors = capsys.readouterr().err.strip().splitlines()
    message = errors[-1]
    assert message.startswith("error: ")
    for word in words:
        assert word in message
    assert "Traceback" not in "".join(errors)
    assert names(folder) == (untouched or ["left.png", "right.png"])


@pytest.mark.parametrize("suffix", [".exr", ".hdr", ".pfm", ".npy", ".tif"])
def test_every_output_format_holds_the_same_radiance(files, suffix):
    assert run_fuse(files, "-q", out=f"a{suffix}") == 0
    assert run_fuse(files, "-q", out="b.npy") == 0
    got, expected = read_hdr(files / f"a{suffix}"), np.load(files / "b.npy")
    peak = expected.max(axis=2, keepdims=True)
    tolerance = 0.01 if suffix == ".hdr" else 0
    assert (np.abs(got - expected) / peak).max() <= tolerance


def test_exr_says_what_made_it(files):
    run_fuse(files, "-q", "--main", "right")
    attributes = read_exr(files / "out.exr")[1]
    assert attributes["software"] == f"stereohdr {__version__}"
    assert attributes["method"] == "robust"
    assert attributes["mainView"] == "right"
    assert attributes["exposureTimeMain"] == pytest.approx(0.16)
    assert attributes["exposureTimeAuxiliary"] == pytest.approx(0.04)


def test_plain_progress_summary_preview_and_json(files, capsys):
    status = run_fuse(files, "--preview", files / "p.png", "--json", files / "r.json", "--max-disparity", 9)
    assert status == 0
    captured = capsys.readouterr()
    assert stages(captured.err)[:3] == ["reading", "checks", "survey"]
    assert "\x1b" not in captured.err
    for word in ("clipped", "disparity", "searched 0 to 9", "matched", "seconds", "64x40", "1/25 s", "out.exr"):
        assert word in captured.out
    document = json.loads((files / "r.json").read_text())
    assert document["config"]["max_disparity"] == 9
    assert document["statistics"]["disparity_searched"] == 9
    assert document["exposure_times"] == {"main": 0.04, "auxiliary": 0.16}
    assert sum(document["source_shares"].values()) == pytest.approx(1)
    assert np.shape(document["response"]) == (3, 256)
    assert names(files) == ["left.png", "out.exr", "p.png", "r.json", "right.png"]


def test_the_summary_of_the_paper_counts_segments_and_holes(files, capsys):
    assert run_fuse(files, "--method", "paper") == 0
    captured = capsys.readouterr()
    assert stages(captured.err)[:3] == ["reading", "checks", "response"]
    for word in ("method     paper", "clipped", "interest", "searched 0 to 11", "holes"):
        assert word in captured.out


def test_stages_are_numbered_pictures_and_arrays(files):
    assert run_fuse(files, "-q", "--save-stages", files / "stages", "--method", "paper") == 0
    written = names(files / "stages")
    assert written[:4] == [
        "01_main_radiance.npy",
        "01_main_radiance.png",
        "02_auxiliary_radiance.npy",
        "02_auxiliary_radiance.png",
    ]
    assert "20_result.png" in written
    assert "21_source.png" in written
    assert ResponseCurve.load(files / "stages" / "response.json").channels == 3
    np.testing.assert_array_equal(np.load(files / "stages" / "20_result.npy"), read_hdr(files / "out.exr"))


def test_response_and_config_files_are_used(files):
    ResponseCurve.gamma(2.2).save(files / "camera.json")
    (files / "c.toml").write_text("max_disparity = 11\n[exposure_map]\nover_threshold = 200\n")
    more = ("-q", "--response", files / "camera.json", "--config", files / "c.toml", "--json", files / "r.json")
    assert run_fuse(files, *more) == 0
    document = json.loads((files / "r.json").read_text())
    assert document["config"]["exposure_map"]["over_threshold"] == 200
    assert document["config"]["max_disparity"] == 11
    np.testing.assert_allclose(document["response"], ResponseCurve.gamma(2.2).log_exposure)
    assert run_fuse(files, *more, "--max-disparity", 8) == 0  # the option wins over the file
    assert json.loads((files / "r.json").read_text())["config"]["max_disparity"] == 8


def test_a_memory_limit_that_suffices_changes_nothing_but_is_kept(files):
    assert run_fuse(files, "-q") == 0
    assert run_fuse(files, "-q", "--memory", "900MB", "--json", files / "r.json", out="limited.exr") == 0
    assert (files / "out.exr").read_bytes() == (files / "limited.exr").read_bytes()
    statistics = json.loads((files / "r.json").read_text())["statistics"]
    assert 2**28 < statistics["memory_estimate"] < 900e6
    assert statistics["matching_strips"] == 1
    assert statistics["coarse_to_fine"] == 0


def test_strips_are_said_and_write_the_same_bytes(tmp_path, capsys):
    pair = make_pair(160, 200)
    for photo in (pair.left, pair.right):
        write_png(tmp_path / f"{photo.name}.png", photo.codes)
    options = ("--max-disparity", 120, "--json", tmp_path / "r.json")
    assert run_fuse(tmp_path, *options) == 0
    assert "memory  " not in capsys.readouterr().out
    limit = int(json.loads((tmp_path / "r.json").read_text())["statistics"]["memory_estimate"] - 4e6)
    assert run_fuse(tmp_path, *options, "--memory", limit, out="strips.exr") == 0
    assert re.search(r"\nmemory     about 2\d\dMiB at most; matched in [2-5] strips\n", capsys.readouterr().out)
    assert (tmp_path / "out.exr").read_bytes() == (tmp_path / "strips.exr").read_bytes()
    assert run_fuse(tmp_path, "-q", "--both", "--memory", "500MiB", out="both.exr") == 0


@pytest.mark.parametrize("method", ["robust", "paper"])
def test_photos_that_need_more_than_the_limit_are_refused(files, capsys, method):
    status = run_fuse(files, "--memory", "2MiB", "--method", method)
    assert_refused(capsys, files, status, "left.png and ", "right.png need about 2", "limit is 2MiB", "--memory 2")


@pytest.mark.parametrize("limit", ["4 apples", "12", "-1GiB"])
def test_a_memory_limit_is_a_size(files, capsys, limit):
    status = run_fuse(files, "--memory", limit)
    assert_refused(capsys, files, status, "such as 4GiB", limit)


def test_the_same_command_writes_the_same_bytes(files):
    for out in ("a.exr", "b.exr"):
        run_fuse(files, "-q", out=out)
    assert (files / "a.exr").read_bytes() == (files / "b.exr").read_bytes()


def test_exposures_come_from_exif(files):
    from PIL import Image

    for name, time in (("left.png", 0.04), ("right.png", 0.16)):
        image = Image.open(files / name)
        exif = image.getexif()
        exif[0x8769] = {33434: time}
        image.save(files / name, exif=exif)
    assert run_fuse(files, "-q", times=None) == 0
    assert read_exr(files / "out.exr")[1]["exposureTimeMain"] == pytest.approx(0.04)


def test_missing_exposures_are_asked_for(files, capsys):
    assert_refused(capsys, files, run_fuse(files, times=None), "left.png", "--exposures 1/60 1/15")


@pytest.mark.parametrize(
    ("times", "words"),
    [
        (("0.16", "1/25"), ("contradict", "left.png")),
        (("0.1", "0.1"), ("same exposure",)),
        (("fast", "0.1"), ("fast",)),
        (("0", "0.1"), ("0",)),
        (("-1", "0.1"), ("-1",)),
        (("1/0", "0.1"), ("1/0",)),
    ],
)
def test_exposures_that_make_no_sense(files, capsys, times, words):
    assert_refused(capsys, files, run_fuse(files, times=times), *words)


def test_different_sizes_and_channels(files, capsys):
    pair = make_pair()
    write_png(files / "right.png", pair.right.codes[:-1])
    assert_refused(capsys, files, run_fuse(files), "differ in size", "64x40", "64x39")
    write_png(files / "right.png", pair.right.codes[..., 0])
    assert_refused(capsys, files, run_fuse(files), "differ in channels")


@pytest.mark.parametrize("keep", [0, 4, 30, 500])
def test_truncated_files(files, capsys, keep):
    path = files / "right.png"
    path.write_bytes(path.read_bytes()[:keep])
    assert_refused(capsys, files, run_fuse(files), "right.png")


def test_swapped_files(files, capsys):
    pair = make_pair(60, 160, disparity=12)
    write_png(files / "left.png", pair.right.codes)
    write_png(files / "right.png", pair.left.codes)
    assert_refused(capsys, files, run_fuse(files), "contradict")
    assert_refused(capsys, files, run_fuse(files, times=("0.16", "0.04")), "look exchanged")


def test_missing_files(files, capsys):
    assert_refused(capsys, files, run_fuse(files, right="nothing.png"), "nothing.png")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--max-disparity", "64"), ("below the image width 64",)),
        (("--max-disparity", "-1"), ("max_disparity",)),
        (("--method", "magic"), ("unknown method 'magic'",)),
        (("--white-level", "256"), ("white level",)),
        (("--response", "none.json"), ("none.json", "no such file")),
        (("--config", "none.toml"), ("none.toml", "cannot read")),
        (("--preview", "p.jpg"), ("p.jpg", ".png")),
        (("--json", "no/folder/r.json"), ("no/folder", "does not exist")),
    ],
)
def test_options_that_cannot_work(files, capsys, options, words):
    assert_refused(capsys, files, run_fuse(files, *options), *words)


@pytest.mark.parametrize("out", ["out.png", "out", "no/folder/out.exr"])
def test_outputs_that_cannot_be_written(files, capsys, out):
    assert_refused(capsys, files, run_fuse(files, out=out), "out")


@pytest.mark.parametrize(("option", "suffix"), [("--half", ".hdr"), ("--layers", ".tif"), ("--layers", ".jpg")])
def test_options_that_the_format_does_not_take(files, capsys, option, suffix):
    status = run_fuse(files, option, out=f"out{suffix}")
    assert_refused(capsys, files, status, f"out{suffix}", "have no option", "or write .exr")


def test_half_floats_and_layers(files):
    assert run_fuse(files, "-q", "--half", "--layers", "--method", "paper") == 0
    assert run_fuse(files, "-q", "--method", "paper", out="b.npy") == 0
    np.testing.assert_allclose(read_hdr(files / "out.exr"), np.load(files / "b.npy"), rtol=2**-11)
    layers = read_exr_layers(files / "out.exr")
    result = fuse(make_pair(), "paper")
    np.testing.assert_array_equal(layers["disparity.Z"], result.disparity.values)
    np.testing.assert_array_equal(layers["source.I"], result.source)
    attributes = read_exr(files / "out.exr")[1]
    assert attributes["disparityView"] == "right"  # the paper's disparity is that of the auxiliary view
    assert "relative" in attributes["radianceScale"]
    assert f"numpy {np.__version__}" in attributes["versions"]


@pytest.mark.parametrize("suffix", [".jpg", ".avif", ".jxl"])
def test_formats_for_display_hold_the_same_radiance(files, suffix):
    assert run_fuse(files, "-q", "--method", "paper", out=f"a{suffix}") == 0
    assert run_fuse(files, "-q", "--method", "paper", out="b.npy") == 0
    got, expected = read_hdr(files / f"a{suffix}"), np.load(files / "b.npy")
    assert np.median(np.abs(got - expected) / expected) < 0.1  # this wall is colour noise, the hardest there is


@pytest.mark.parametrize("option", ["--json", "--preview"])
def test_a_folder_is_no_output_file(files, capsys, option):
    (files / "d.png").mkdir()
    status = run_fuse(files, option, files / "d.png")
    assert_refused(capsys, files, status, "d.png", "folder", untouched=["d.png", "left.png", "right.png"])


@pytest.mark.parametrize("folder", ["left.png", "left.png/stages"])
def test_a_file_is_no_folder_for_stages(files, capsys, folder):
    assert_refused(capsys, files, run_fuse(files, "--save-stages", files / folder), folder)


def test_stages_never_replace_an_input_or_another_output(files, capsys):
    (files / "s").mkdir()
    photo = files / "s" / "01_main_radiance.png"
    photo.write_bytes((files / "left.png").read_bytes())
    before = photo.read_bytes()
    status = run_fuse(files, "--save-stages", files / "s", left="s/01_main_radiance.png")
    assert_refused(
        capsys, files, status, "01_main_radiance.png", "inside", untouched=["left.png", "right.png", "s"]
    )
    assert photo.read_bytes() == before
    status = run_fuse(files, "--save-stages", files / "s", "--json", files / "s" / "r.json")
    assert_refused(capsys, files, status, "r.json", "inside", untouched=["left.png", "right.png", "s"])


def test_names_that_no_file_can_have(files, capsys):
    name = "x" * 300 + ".exr"
    assert_refused(capsys, files, run_fuse(files, out=name), "cannot be written")
    assert_refused(capsys, files, run_fuse(files, left=name), "cannot be read")


def test_long_and_foreign_names_work(files):
    for out in ("y" * 240 + ".exr", "größe 中.exr"):
        assert run_fuse(files, "-q", out=out) == 0
        assert (files / out).exists()


def test_checks_can_be_switched_off(files):
    assert run_fuse(files, "-q", times=("0.16", "0.04")) == 2
    assert run_fuse(files, "-q", "--no-checks", times=("0.16", "0.04")) == 0


def test_nobody_reading_the_progress_costs_no_result(files, monkeypatch):
    class Closed:
        def write(self, text):
            raise BrokenPipeError

        def flush(self):
            raise BrokenPipeError

        def isatty(self):
            return False

    monkeypatch.setattr("sys.stderr", Closed())
    run_fuse(files)
    assert (files / "out.exr").exists()


def test_an_input_is_never_overwritten(files, capsys):
    before = (files / "left.png").read_bytes()
    status = run_fuse(files, "--preview", files / "." / "left.png")
    assert_refused(capsys, files, status, "left.png", "overwrite")
    assert (files / "left.png").read_bytes() == before


def test_alpha_is_dropped_with_a_notice(files, capsys):
    codes = make_pair().left.codes
    from PIL import Image

    rgba = np.concatenate([codes, np.full((*codes.shape[:2], 1), 200, np.uint8)], axis=2)
    Image.fromarray(rgba).save(files / "left.png")
    assert run_fuse(files) == 0
    assert "warning: " in (err := capsys.readouterr().err)
    assert "alpha" in err


def test_a_black_view_gives_the_main_view_and_a_warning(files, capsys):
    write_png(files / "right.png", np.zeros((40, 64, 3), np.uint8))
    assert run_fuse(files) == 0
    captured = capsys.readouterr()
    assert "every pixel is black" in captured.err
    assert "mv-only" in captured.out
    assert np.isfinite(read_hdr(files / "out.exr")).all()


def test_16_bit_grey_files_with_a_white_level(files):
    from PIL import Image

    pair = make_pair(channels=1, dtype=np.uint16, white=4095)
    for photo in (pair.left, pair.right):
        Image.fromarray(photo.codes[..., 0]).save(files / f"{photo.name}.png")
    assert run_fuse(files, "-q", "--white-level", 4095) == 0
    assert read_hdr(files / "out.exr").shape == (40, 64, 1)


def test_version_and_help(capsys):
    assert run("--version") == 0
    assert capsys.readouterr().out.strip() == f"stereohdr {__version__}"
    assert run("fuse", "--help") == 0
    assert "--save-stages" in capsys.readouterr().out
