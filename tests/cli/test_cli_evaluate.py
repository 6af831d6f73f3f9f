import json

import numpy as np
import pytest
from PIL import Image

from stereohdr import write_hdr
from stereohdr.metrics.evaluation import evaluate

from command_line import run


@pytest.fixture
def files(tmp_path):
    rng = np.random.default_rng(1)
    reference = rng.lognormal(0, 1, (32, 40, 3)).astype(np.float32)
    write_hdr(tmp_path / "reference.exr", reference)
    write_hdr(tmp_path / "test.pfm", reference * rng.lognormal(0, 0.2, reference.shape).astype(np.float32))
    return tmp_path


def test_scores_map_and_json(files, capsys):
    status = run(
        "evaluate",
        files / "test.pfm",
        files / "reference.exr",
        "--json",
        files / "s.json",
        "--map",
        files / "m.png",
    )
    assert status == 0
    out = capsys.readouterr().out
    for word in ("HDR-VDP-2", "Q_MOS", "PU21", "stops", "protocol", "30 pixels per degree"):
        assert word in out
    scores = json.loads((files / "s.json").read_text())
    assert set(scores) == {
        "hdrvdp2",
        "pu21_psnr",
        "pu21_ssim",
        "log2_rmse",
        "share_off_third_stop",
        "protocol",
    }
    assert set(scores["hdrvdp2"]) == {"q", "q_mos", "p_det", "c_max"}
    with Image.open(files / "m.png") as picture:
        assert picture.size == (40, 72)


def test_options_reach_the_protocol(files):
    run(
        *("evaluate", files / "test.pfm", files / "reference.exr", "--metric", "pu21", "--ppd", "47"),
        *("--no-align", "--peak", "0", "--encoding", "rgb-bt.709", "--json", files / "s.json"),
    )
    scores = json.loads((files / "s.json").read_text())
    assert set(scores) == {"pu21_psnr", "pu21_ssim", "protocol"}
    assert scores["protocol"]["pixels_per_degree"] == 47
    assert scores["protocol"]["align"] is False
    assert scores["protocol"]["peak_luminance"] == 0


def test_the_main_photo_aligns(files):
    from stereohdr import Photo, read_hdr

    codes = np.zeros((32, 40, 3), np.uint8)
    codes[:4] = 128
    Image.fromarray(codes).save(files / "photo.png")
    run(
        *("evaluate", files / "test.pfm", files / "reference.exr", "--metric", "log2"),
        *("--main-photo", files / "photo.png", "--json", files / "s.json"),
    )
    images = read_hdr(files / "test.pfm"), read_hdr(files / "reference.exr")
    expected = evaluate(*images, metrics=["log2"], main=Photo(codes)).scores["log2_rmse"]
    assert json.loads((files / "s.json").read_text())["log2_rmse"] == expected


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("test.pfm", "none.exr"), ("none.exr",)),
        (("test.pfm", "small.npy"), ("40x32", "20x20")),
        (("nan.npy", "nan.npy"), ("NaN",)),
        (("test.pfm", "reference.exr", "--metric", "best"), ("unknown metric best",)),
        (("test.pfm", "reference.exr", "--ppd", "0"), ("pixels per degree",)),
        (("test.pfm", "reference.exr", "--encoding", "magic"), ("magic",)),
        (("test.pfm", "reference.exr", "--map", "m.jpg"), (".png",)),
        (("test.pfm", "reference.exr", "--map", "m.png", "--metric", "pu21"), ("hdrvdp2",)),
        (("test.pfm", "reference.exr", "--json", "test.pfm"), ("overwrite",)),
    ],
)
def test_bad_input_is_one_sentence(files, capsys, monkeypatch, arguments, words):
    monkeypatch.chdir(files)
    np.save(files / "small.npy", np.ones((20, 20, 3), np.float32))
    np.save(files / "nan.npy", np.full((20, 20, 3), np.nan, np.float32))
    before = sorted(p.name for p in files.iterdir())
    assert run("evaluate", *arguments) == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("error: ")
    for word in words:
        assert word in message
    assert sorted(p.name for p in files.iterdir()) == before
