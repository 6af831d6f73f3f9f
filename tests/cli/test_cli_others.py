import builtins
import json
from typing import get_args

import numpy as np
import pytest
from PIL import Image

from stereohdr import tonemap, write_hdr
from stereohdr.cli import demo
from stereohdr.cli.tonemap import OperatorName
from stereohdr.simulation import room
from stereohdr.tone_mapping import Operator

from command_line import run


def test_tonemap_writes_what_the_function_returns(tmp_path):
    radiance = np.random.default_rng(0).lognormal(size=(6, 8, 3)).astype(np.float32)
    write_hdr(tmp_path / "in.exr", radiance)
    for operator in OperatorName:
        assert run("tonemap", tmp_path / "in.exr", tmp_path / "out.png", "--operator", operator) == 0
        np.testing.assert_array_equal(
            np.asarray(Image.open(tmp_path / "out.png")), tonemap(radiance, operator.value)
        )
    options = {"exposure": -1.5, "key": 0.3, "white": 2.0, "bias": 0.7, "saturation": 0.5}
    given = [word for name, value in options.items() for word in (f"--{name}", value)]
    assert run("tonemap", tmp_path / "in.exr", tmp_path / "out.png", *given) == 0
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "out.png")), tonemap(radiance, **options))


def test_every_operator_can_be_chosen():
    assert [operator.value for operator in OperatorName] == list(get_args(Operator))


def test_tonemap_refuses_nan_and_other_suffixes(tmp_path, capsys):
    np.save(tmp_path / "nan.npy", np.full((3, 3, 3), np.nan, np.float32))
    assert run("tonemap", tmp_path / "nan.npy", tmp_path / "out.png") == 2
    assert "NaN" in capsys.readouterr().err
    np.save(tmp_path / "fine.npy", np.ones((3, 3, 3), np.float32))
    assert run("tonemap", tmp_path / "fine.npy", tmp_path / "out.jpg") == 2
    assert sorted(p.name for p in tmp_path.iterdir()) == ["fine.npy", "nan.npy"]


@pytest.fixture
def small_room(monkeypatch):
    import stereohdr.simulation

    monkeypatch.setattr(stereohdr.simulation, "room", lambda: room(width=120, height=90))


def test_demo_without_scikit_image_uses_the_room_and_says_so(tmp_path, capsys, monkeypatch, small_room):
    real_import = builtins.__import__

    def without_skimage(name, *args, **more):
        if name.startswith("skimage"):
            raise ImportError(name)
        return real_import(name, *args, **more)

    monkeypatch.setattr(builtins, "__import__", without_skimage)
    assert run("demo", "-o", tmp_path / "d") == 0
    captured = capsys.readouterr()
    assert "scikit-image is not installed" in captured.err
    assert "inside S" in captured.out
    assert sorted(p.name for p in (tmp_path / "d").iterdir()) == [
        "demo.json",
        "demo_contact_sheet.png",
        "demo_left.png",
        "demo_result.exr",
        "demo_result.png",
        "demo_right.png",
    ]
    scores = json.loads((tmp_path / "d" / "demo.json").read_text())["log2_rmse"]
    assert set(scores) == {"main view only", "result"}
    assert run("demo", "-o", tmp_path / "d", "--scene", "motorcycle") == 1
    assert "stereohdr[demo]" in capsys.readouterr().err


def test_demo_refuses_unknown_scenes_and_files_as_folders(tmp_path, capsys):
    assert run("demo", "-o", tmp_path / "d", "--scene", "moon") == 2
    assert not (tmp_path / "d").exists()
    (tmp_path / "file").write_text("x")
    assert run("demo", "-o", tmp_path / "file") == 2


def test_the_motorcycle_is_restored_inside_s(tmp_path):
    pytest.importorskip("skimage")
    truth = demo._motorcycle()
    assert truth.left.shape == (500, 741, 3)
    assert run("demo", "-o", tmp_path / "d", "--scene", "motorcycle") == 0
    scores = json.loads((tmp_path / "d" / "demo.json").read_text())["log2_rmse"]
    assert scores["result"]["inside_s"] < 0.7 * scores["main view only"]["inside_s"]
