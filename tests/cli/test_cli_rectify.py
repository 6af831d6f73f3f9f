import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from camera_files import bayer_mosaic, write_dng
from stereo_rigs import HEIGHT, WIDTH, World, camera, photographed, rig

from stereohdr import read_hdr, read_photo
from stereohdr.io.exr import read_exr
from stereohdr.io.images import write_png
from stereohdr.rectification import StereoCalibration, read_calibration, write_calibration

from command_line import run

pytest.importorskip("cv2")
pytest.importorskip("yaml")

TURNED = {"left": (0.5, 1.0, -1.0), "right": (-0.5, -1.0, 1.0)}
TIMES = ("--exposures", "1/4", "1/32")


@pytest.fixture(scope="module")
def originals():
    return photographed(World(), **TURNED, times=(1 / 4, 1 / 32))


@pytest.fixture
def files(tmp_path, originals):
    """Write left.png and right.png, turned against each other, and rig.toml; return their folder."""
    for photo in originals:
        write_png(tmp_path / photo.name, photo.codes)
    write_calibration(tmp_path / "rig.toml", rig(**TURNED))
    return tmp_path


def fuse(files, *more):
    pair = (files / "left.png", files / "right.png")
    return run("fuse", *pair, "-o", files / "out.exr", *TIMES, "--method", "mv-only", *more)


def rectify(files, *more, out="rectified"):
    return run("rectify", files / "left.png", files / "right.png", "-o", files / out, *more)


def refused(capsys, status, *words):
    assert status == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("error: ")
    for word in words:
        assert word in message


def test_fuse_rectifies_by_the_pictures(files, capsys):
    assert fuse(files, "--rectify", "auto", "--json", files / "r.json") == 0
    captured = capsys.readouterr()
    assert "rectification" in captured.err.splitlines()
    assert "rectified  from the pictures; rows agree to 0." in captured.out
    document = json.loads((files / "r.json").read_text())
    report = document["rectification"]
    assert {"dy_median", "dy_p95", "inliers", "disparity_min", "disparity_max"} <= report.keys()
    assert report["dy_median"] < 0.15
    assert document["size"] == report["size"]
    assert document["config"]["max_disparity"] >= report["disparity_max"]
    radiance = read_hdr(files / "out.exr")
    assert list(radiance.shape[:2]) == report["size"][::-1]
    attributes = read_exr(files / "out.exr")[1]
    assert attributes["rectifiedFrom"] == "pictures"
    assert attributes["disparityOffset"] == report["disparity_offset"]


def test_a_given_search_range_wins(files):
    options = ("-q", "--rectify", "auto", "--json", files / "r.json", "--max-disparity", 50)
    assert fuse(files, *options) == 0
    assert json.loads((files / "r.json").read_text())["config"]["max_disparity"] == 50


def test_fuse_rectifies_by_a_calibration_and_back(files):
    assert fuse(files, "-q", "--calib", files / "rig.toml", "--unrectify", "--json", files / "r.json") == 0
    document = json.loads((files / "r.json").read_text())
    assert document["rectification"]["source"] == "calibration"
    assert document["size"] == [WIDTH, HEIGHT]
    assert read_hdr(files / "out.exr").shape == (HEIGHT, WIDTH, 3)


def test_fuse_takes_only_the_lenses_of_a_calibration(files):
    write_calibration(files / "lenses.toml", StereoCalibration(camera(), camera()))
    more = ("--calib", files / "lenses.toml", "--rectify", "auto", "--json", files / "r.json")
    assert fuse(files, "-q", *more) == 0
    assert json.loads((files / "r.json").read_text())["rectification"]["source"] == "calibration and pictures"


def test_without_rectification_there_is_no_report(files):
    assert fuse(files, "-q", "--no-checks", "--json", files / "r.json") == 0
    assert json.loads((files / "r.json").read_text())["rectification"] is None


def test_options_of_fuse_that_cannot_work(files, capsys):
    refused(capsys, fuse(files, "--unrectify"), "--unrectify undoes a rectification")
    refused(capsys, fuse(files, "--calib", files / "none.toml"), "none.toml: no such file")
    write_calibration(files / "other.toml", rig(cameras=(camera(size=(640, 480)), camera(size=(640, 480)))))
    refused(capsys, fuse(files, "--calib", files / "other.toml"), "left.png: is 360x270", "is for 640x480")
    write_calibration(files / "lenses.toml", StereoCalibration(camera(), camera()))
    refused(capsys, fuse(files, "--calib", files / "lenses.toml"), "how they stand", "--rectify auto")
    write_calibration(files / "wide.toml", rig((0, 9, 0), (0, -9, 0)))
    refused(capsys, fuse(files, "--calib", files / "wide.toml"), "18 degrees apart")
    write_png(files / "right.png", read_photo(files / "left.png").codes)
    refused(capsys, fuse(files, "--rectify", "auto"), "same picture")
    write_png(files / "right.png", np.full((HEIGHT, WIDTH, 3), 80, np.uint8))
    refused(capsys, fuse(files, "--rectify", "auto"), "only 0 points of the two photos match")
    assert not (files / "out.exr").exists()


def test_rectify_writes_photos_that_fuse_reads_as_rectified(files, capsys):
    more = ("--exposures", "1/4", "1/32", "--preview", files / "rows.png", "--json", files / "r.json")
    assert rectify(files, *more, "--save-calib", files / "own.toml") == 0
    out = capsys.readouterr().out
    for words in ("rectified  from the pictures", "model      pose and lens", "degrees apart", "own.toml"):
        assert words in out
    report = json.loads((files / "r.json").read_text())["rectification"]
    left, right = (read_photo(files / "rectified" / f"{side}.png") for side in ("left", "right"))
    assert [left.width, left.height] == report["size"] == [right.width, right.height]
    assert (left.exposure_time, right.exposure_time) == (0.25, 0.03125)
    assert (left.white, left.codes.dtype) == (65535, np.uint16)
    assert read_photo(files / "rows.png").width > 2 * left.width
    assert run("rectify", files / "rectified/left.png", files / "rectified/right.png", "-o", files / "again") == 0
    assert "as it is" in capsys.readouterr().out
    again = read_photo(files / "again" / "left.png")
    assert np.abs(again.codes.astype(int) - left.codes.astype(int)).max() <= 1
    # The geometry that was found serves other pairs of the same cameras.
    assert read_calibration(files / "own.toml").has_pose
    assert rectify(files, "--calib", files / "own.toml", out="third") == 0
    assert "rectified  by calibration; rows agree to 0." in capsys.readouterr().out


def test_rectify_by_a_calibration_keeping_everything(files):
    assert rectify(files, "--calib", files / "rig.toml", "--full") == 0
    names = sorted(path.name for path in (files / "rectified").iterdir())
    assert names == ["left.png", "left_mask.png", "right.png", "right_mask.png"]
    left = read_photo(files / "rectified" / "left.png")
    mask = read_photo(files / "rectified" / "left_mask.png")
    assert set(np.unique(mask.codes)) == {0, 255}
    assert (left.codes[mask.codes[..., 0] == 0] == 0).all()
    assert left.width >= WIDTH


def test_a_calibration_that_does_not_fit_any_more_is_warned_of(files, capsys):
    turned = rig((0.9, 1.0, -1.0), TURNED["right"])
    write_calibration(files / "old.toml", turned)
    assert rectify(files, "--calib", files / "old.toml") == 0
    assert "warning: after rectification the rows of the two views differ" in capsys.readouterr().err


def test_options_of_rectify_that_cannot_work(files, capsys):
    refused(capsys, rectify(files, "--preview", files / "p.jpg"), "p.jpg")
    refused(capsys, rectify(files, "--save-calib", files / "c.yml"), "c.yml")
    refused(capsys, rectify(files, out="."), "would overwrite", "left.png")
    refused(capsys, rectify(files, out="left.png"), "is a file")
    refused(capsys, rectify(files, "--calib", files / "none.toml", out="a/b"), "none.toml: no such file")
    assert not (files / "a").exists()


def test_a_missing_opencv_is_said(files, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    assert rectify(files) == 1
    assert "needs OpenCV; install stereohdr[calib]" in capsys.readouterr().err


def test_differing_sizes_are_brought_to_one(files, capsys):
    _, right = photographed(World(), **TURNED, cameras=(camera(), camera(320.0, size=(320, 240))))
    write_png(files / "right.png", replace(right).codes)
    assert rectify(files) == 0
    sizes = [read_photo(files / "rectified" / f"{side}.png") for side in ("left", "right")]
    assert sizes[0].codes.shape == sizes[1].codes.shape


def test_what_a_png_cannot_say_of_raw_files_is_warned_of(tmp_path, capsys):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    for photo in photographed(World(), **TURNED, bits=12):
        mosaic = bayer_mosaic(photo.codes, "RGGB")
        write_dng(tmp_path / photo.name.replace("png", "dng"), mosaic, exposure=(1, 4))
    assert run("rectify", tmp_path / "left.dng", tmp_path / "right.dng", "-o", tmp_path / "rectified") == 0
    assert "a PNG cannot say so; fuse them with --response linear" in capsys.readouterr().err
