import json

import imagecodecs
import numpy as np
import pytest
from camera_files import bayer_mosaic, write_bayer_tiff, write_dng
from PIL import Image

from stereohdr import ResponseCurve
from stereohdr.simulation import Camera, expose, room

from command_line import run


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    folder = tmp_path_factory.mktemp("pair")
    scene = room(width=160, height=120)
    scale = np.float32(np.percentile(scene.radiance_left, 75))
    for name, view, time in (("l", scene.radiance_left, 0.5), ("r", scene.radiance_right, 0.125)):
        exif = Image.Exif()
        exif[271], exif[272] = "Acme", "One"
        exif.get_ifd(34665).update({33434: time, 33437: 4.0, 34855: 200})
        codes = np.array(expose(view / scale, time, Camera(), 0).codes)
        Image.fromarray(codes).save(folder / f"{name}.jpg", exif=exif, quality=98)
    return folder


def test_a_usable_pair(pair, capsys):
    assert run("info", pair / "l.jpg", pair / "r.jpg") == 0
    text = capsys.readouterr().out
    for expected in (
        "size      160x120 RGB",
        "codes     8 bits, white level 255",
        "camera    Acme One",
        "exposure  1/8 s (EXIF), f/4, ISO 200, EV 6.0",
        "ratio     4 (the photos alone say",
        "usable    yes",
    ):
        assert expected in text


def test_json_holds_the_same(pair, capsys):
    assert run("info", pair / "l.jpg", pair / "r.jpg", "--json", "--exposures", "1/2,1/8") == 0
    content = json.loads(capsys.readouterr().out)
    assert [photo["exposure_source"] for photo in content["photos"]] == ["given", "given"]
    assert content["pair"]["usable"] is True
    assert content["pair"]["exposure_ratio"] == pytest.approx(4)
    assert 0 <= content["photos"][0]["white_share"] < 1


def test_one_or_three_photos_are_no_pair(pair, capsys):
    for count in (1, 3):
        assert run("info", *[pair / "l.jpg"] * count, "--json") == 0
        content = json.loads(capsys.readouterr().out)
        assert len(content["photos"]) == count
        assert content["pair"] is None


def test_why_a_pair_is_not_usable(pair, capsys):
    assert run("info", pair / "l.jpg", pair / "r.jpg", "--exposures", "1/8,1/2") == 0
    captured = capsys.readouterr()
    assert "problem   the exposures contradict the photos" in captured.out
    assert "usable    no" in captured.out
    assert "the exposure time 0.125 s is given, EXIF says 0.5 s" in captured.err


def test_camera_raw(tmp_path, capsys):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    mosaic = bayer_mosaic(np.random.default_rng(0).integers(200, 3000, (40, 60, 3)).astype(np.uint16), "RGGB")
    assert run("info", write_dng(tmp_path / "a.dng", mosaic, black=64)) == 0
    text = capsys.readouterr().out
    assert "response  linear (camera raw)" in text
    assert "codes     12 bits, white level 4031" in text
    assert "exposure  1/60 s (EXIF), f/2.8, ISO 200, EV 7.9" in text


# --- bad input: one sentence each, exit status 2 ----------------------------------------------------------------


def refused(capsys, *arguments, status=2):
    assert run(*arguments) == status
    captured = capsys.readouterr()
    errors = [line for line in captured.err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert "; " in errors[0], "says what to do"
    assert "Traceback" not in captured.err
    return errors[0]


def test_corrupt_raw(tmp_path, capsys):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    path = write_dng(tmp_path / "a.dng", np.zeros((40, 60), np.uint16))
    path.write_bytes(path.read_bytes()[:900])
    assert "a.dng: damaged or unsupported camera raw file" in refused(capsys, "info", path)


def test_raw_of_two_different_cameras(tmp_path, capsys):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    mosaic = np.random.default_rng(0).integers(200, 3000, (40, 60)).astype(np.uint16)
    left = write_dng(tmp_path / "l.dng", mosaic, camera=("Acme", "One"), exposure=(1, 60))
    right = write_dng(tmp_path / "r.dng", mosaic // 4, camera=("Acme", "Two"), exposure=(1, 240))
    error = refused(capsys, "fuse", left, right, "-o", tmp_path / "o.exr", "-q")
    assert "l.dng comes from Acme One" in error
    assert "r.dng from Acme Two" in error
    assert not (tmp_path / "o.exr").exists()


def test_exif_without_exposure(tmp_path, capsys):
    exif = Image.Exif()
    exif.get_ifd(34665)[33437] = 4.0  # an f-number, but no time
    for name in ("l", "r"):
        Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(tmp_path / f"{name}.jpg", exif=exif)
    error = refused(capsys, "fuse", tmp_path / "l.jpg", tmp_path / "r.jpg", "-o", tmp_path / "o.exr", "-q")
    assert "l.jpg: the exposure time is not known; give both times" in error


def test_unknown_bayer_pattern(tmp_path, capsys):
    path = write_bayer_tiff(tmp_path / "m.tif", np.zeros((8, 8), np.uint16), None)
    assert "holds a sensor mosaic of unknown pattern; give it" in refused(capsys, "info", path)
    assert "'RGBX' is not a Bayer pattern; give" in refused(capsys, "info", path, "--bayer", "RGBX")


def test_a_missing_extra_is_not_the_users_input(tmp_path, capsys, monkeypatch):
    import sys

    path = write_dng(tmp_path / "a.dng", np.zeros((40, 60), np.uint16))
    monkeypatch.setitem(sys.modules, "rawpy", None)
    assert "install stereohdr[raw]" in refused(capsys, "info", path, status=1)


def test_times_that_do_not_fit(pair, capsys):
    assert "gives 3 times for 2 photos" in refused(
        capsys, "info", pair / "l.jpg", pair / "r.jpg", "--exposures", "1,2,3"
    )


# --- the options on fuse and merge ------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def mosaics(tmp_path_factory):
    """A linear 12-bit Bayer pair with a pedestal, disparity 6, and its radiance."""
    folder = tmp_path_factory.mktemp("mosaics")
    scene = room(width=160, height=120)
    scale = np.float32(np.percentile(scene.radiance_left, 75))
    for name, view, time in (("l", scene.radiance_left, 0.5), ("r", scene.radiance_right, 0.125)):
        codes = np.rint(np.clip(view / scale * time, 0, 1) * 4031) + 64
        mosaic = bayer_mosaic(codes.astype(np.uint16), "GRBG")
        (folder / f"{name}.png").write_bytes(imagecodecs.png_encode(mosaic))
    return folder, scene.radiance_left / scale


def fused(folder, tmp_path, *options):
    arguments = ("--bayer", "GRBG", "--black-level", "64", "--white", "4095", "--method", "mv-only", "-q")
    status = run(
        "fuse", folder / "l.png", folder / "r.png", *arguments, *options, "-o", tmp_path / "o.npy", "--no-checks"
    )
    assert status == 0
    return np.load(tmp_path / "o.npy")


def test_mosaics_with_a_pedestal_are_fused_with_a_linear_response(mosaics, tmp_path):
    folder, truth = mosaics
    radiance = fused(folder, tmp_path, "--exposures", "1/2", "1/8", "--response", "linear")
    well = (truth * 0.5 < 0.9).all(axis=-1) & (truth > 0.02).all(axis=-1)
    ratio = (radiance / truth)[well]
    assert np.median(np.abs(ratio / np.median(ratio) - 1)) < 0.05


def test_a_response_table_of_one_column_serves_three_channels(mosaics, tmp_path):
    folder, _ = mosaics
    curve = ResponseCurve.linear(1).log_exposure[0]
    (tmp_path / "pcalib.txt").write_text(" ".join(f"{value:.12g}" for value in np.exp(curve)))
    from_table = fused(folder, tmp_path, "--exposures", "1/2", "1/8", "--response", tmp_path / "pcalib.txt")
    by_name = fused(folder, tmp_path, "--exposures", "1/2", "1/8", "--response", "linear")
    bright = by_name > np.quantile(by_name, 0.5)
    np.testing.assert_allclose(from_table[bright], by_name[bright], rtol=0.01)


def test_an_estimated_ratio_is_asked_for_announced_and_reported(mosaics, tmp_path, capsys):
    folder, _ = mosaics
    report = tmp_path / "o.json"
    fused(folder, tmp_path, "--estimate-ratio", "--response", "linear", "--json", report)
    assert "was estimated from the photos" in capsys.readouterr().err
    content = json.loads(report.read_text())
    # Looser than for full-colour photos: at this size many pixels touch an edge of clipping and become white.
    assert content["exposure_ratio"] == pytest.approx(4, rel=0.12)
    assert any("was estimated" in sentence for sentence in content["warnings"])
    error = refused(
        capsys, "fuse", folder / "l.png", folder / "r.png", "-o", tmp_path / "p.npy", "--estimate-ratio",
        "--exposures", "1", "2",
    )  # fmt: skip
    assert "--estimate-ratio takes the place of --exposures; give one" in error


def test_a_raw_bracket_is_merged_without_an_estimate(tmp_path, capsys):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    light = np.random.default_rng(0).uniform(100, 3900, (40, 60, 3))
    paths = [
        write_dng(tmp_path / f"{n}.dng", bayer_mosaic((light / n).astype(np.uint16), "RGGB"), exposure=(1, 60 * n))
        for n in (1, 4)
    ]
    assert run("merge", *paths, "-o", tmp_path / "o.npy") == 0
    assert "response   linear, as the camera raw files state" in capsys.readouterr().out
    radiance = np.load(tmp_path / "o.npy")
    assert np.isfinite(radiance).all()
    assert (radiance > 0).all()
