import json

import numpy as np
import pytest
from camera_files import write_dng
from PIL import Image

from stereohdr import ResponseCurve
from stereohdr.io.images import write_png
from stereohdr.io.response_files import read_response
from stereohdr.simulation import Camera, expose, poles, room

from command_line import run

CAMERA = Camera(response="s-shaped")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rig")
    for name, make in (("a", room), ("b", poles)):
        scene = make(width=160, height=120)
        scale = np.float32(np.percentile(scene.radiance_left, 75))
        write_png(folder / f"{name}l.png", np.array(expose(scene.radiance_left / scale, 0.5, CAMERA, 1).codes))
        write_png(folder / f"{name}r.png", np.array(expose(scene.radiance_right / scale, 0.125, CAMERA, 2).codes))
    for n, time in enumerate((0.1, 0.4, 1.6)):
        write_png(folder / f"bracket{n}.png", np.array(expose(scene.radiance_left / scale, time, CAMERA, n).codes))
    return folder


def rms(curve):
    return np.sqrt(((curve.log_exposure - CAMERA.response_curve(3).log_exposure)[:, 5:251] ** 2).mean())


def pairs(folder):
    return [folder / name for name in ("al.png", "ar.png", "bl.png", "br.png")]


@pytest.mark.parametrize("times", ["1/2,1/8", "1/2,1/8,1/2,1/8"])
def test_one_curve_from_two_pairs_that_fuse_can_use(folder, tmp_path, capsys, times):
    out = tmp_path / "camera.json"
    options = ("--plot", tmp_path / "curves.png", "--json", tmp_path / "fit.json")
    assert run("response", *pairs(folder), "--exposures", times, "-o", out, *options) == 0
    text = capsys.readouterr().out
    assert "photos     2 pair(s)" in text
    assert "monotone   yes" in text
    assert rms(ResponseCurve.load(out)) < 0.08
    fit = json.loads((tmp_path / "fit.json").read_text())
    assert fit["monotone"] is True
    assert len(fit["residuals"]) == 2
    assert f"residual   {fit['residual']:.4f}" in text
    with Image.open(tmp_path / "curves.png") as picture:
        assert picture.width > 1000
    fused = (
        "fuse",
        *pairs(folder)[:2],
        "--exposures",
        "1/2",
        "1/8",
        "--response",
        out,
        "--method",
        "mv-only",
        "-q",
    )
    assert run(*fused, "--no-checks", "-o", tmp_path / "o.npy") == 0


def test_a_bracket_as_csv(folder, tmp_path, capsys):
    photos = [folder / f"bracket{n}.png" for n in range(3)]
    arguments = ("--bracket", "--exposures", "0.1,0.4,1.6", "-o", tmp_path / "camera.csv")
    assert run("response", *photos, *arguments) == 0
    assert "0.1 s, 0.4 s" in capsys.readouterr().out
    assert rms(read_response(tmp_path / "camera.csv", channels=3)) < 0.03


def test_the_same_photos_give_the_same_bytes(folder, tmp_path):
    for name in ("1.json", "2.json"):
        run("response", *pairs(folder), "--exposures", "1/2,1/8", "-o", tmp_path / name)
    assert (tmp_path / "1.json").read_bytes() == (tmp_path / "2.json").read_bytes()


@pytest.mark.parametrize(
    ("photos", "options", "message"),
    [
        (("al", "ar", "bl"), ("-o", "c.json", "--exposures", "1/2,1/8,1/2"), "3 photos are no pairs"),
        (("al", "ar"), ("-o", "c.txt", "--exposures", "1/2,1/8"), "a response is written as .json or .csv"),
        (("al", "ar"), ("-o", "c.json", "--plot", "c.jpg"), "the plot is a PNG"),
        (("al", "ar"), ("-o", "c.json"), "the exposure time is not known"),
        (("al", "ar"), ("-o", "c.json", "--exposures", "1/8,1/2"), "the exposures contradict the photos"),
        (("al", "ar"), ("-o", "c.json", "--exposures", "fast,1/2"), "'fast' is not an exposure time"),
    ],
)
def test_bad_input_is_one_sentence_and_writes_nothing(
    folder, tmp_path, monkeypatch, capsys, photos, options, message
):
    monkeypatch.chdir(tmp_path)
    assert run("response", *(folder / f"{name}.png" for name in photos), *options) == 2
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
    assert len(errors) == 1
    assert message in errors[0]
    assert list(tmp_path.iterdir()) == []


def test_camera_raw_needs_no_response(tmp_path, capsys):
    pytest.importorskip("rawpy", reason="rawpy is not installed")
    rng = np.random.default_rng(0)
    paths = [
        write_dng(tmp_path / f"{n}.dng", rng.integers(100, 3000, (40, 60)).astype(np.uint16), exposure=(1, n))
        for n in (1, 4)
    ]
    assert run("response", *paths, "-o", tmp_path / "c.json") == 2
    assert "camera raw files are linear: there is no response to estimate" in capsys.readouterr().err
