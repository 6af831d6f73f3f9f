import sys
from dataclasses import replace

import numpy as np
import pytest
from dataset_folders import Wall, write_art, write_deep_png, write_official
from stereo_rigs import World, photographed

from stereohdr import write_hdr
from stereohdr.datasets import benchmark_scenes, load_scene, procedural_scene
from stereohdr.datasets.simulated import PROCEDURAL
from stereohdr.errors import FileFormatError, InputError, MissingDependencyError
from stereohdr.io.images import write_png
from stereohdr.radiance import initial_radiance
from stereohdr.simulation import SCENES

SETTINGS = ["normal-long", "short-long", "long-short", "short-dark"]
PROCEDURAL_NAMES = ["room", "street-night"]


def in_all_settings(*scenes):
    return [f"{scene}-{setting}" for scene in scenes for setting in SETTINGS]


def write_flat(folder, height=370, tail="default"):
    wall = Wall(height, 100, 12)
    folder.mkdir(parents=True)
    for view in (1, 5):
        write_png(folder / f"view{view}_{tail}.png", wall.codes((view - 1) / 4, 0.4))
    wall.write_truth(folder, 1110 // height)


def write_manifest(folder, name=None):
    folder.mkdir(parents=True)
    wall = Wall(20, 30, 3)
    write_png(folder / "l.png", wall.codes(0, 0.25))
    write_png(folder / "r.png", wall.codes(1, 1.0))
    write_hdr(folder / "ref.exr", wall.radiance(0))
    text = 'left = "l.png"\nright = "r.png"\nexposures = [0.25, 1]\nmax_disparity = 5\nreference = "ref.exr"\n'
    (folder / "scene.toml").write_text(text + (f'name = "{name}"\n' if name else ""))


def test_procedural_scenes_need_no_data(tmp_path):
    assert list(benchmark_scenes()) == PROCEDURAL_NAMES
    assert list(benchmark_scenes(tmp_path)) == PROCEDURAL_NAMES


def test_real_pairs(tmp_path):
    folder = write_art(tmp_path)
    names = ["R1", "R1-half", "R2", "R2-half", "R3", "R3-half", *PROCEDURAL_NAMES]
    assert list(benchmark_scenes(tmp_path)) == names
    (folder / "view2_Illum1_Exp2_4000ms.png").unlink()
    assert list(benchmark_scenes(tmp_path)) == ["R1", "R1-half", *PROCEDURAL_NAMES]
    (folder / "disp5.png").unlink()
    assert list(benchmark_scenes(tmp_path)) == PROCEDURAL_NAMES


def test_recipes_of_the_real_pairs(tmp_path):
    write_art(tmp_path)  # 24 px between views 1 and 5 at full size
    for name, main, exposures, reach, disparity in (
        ("R1", "left", (0.25, 1.0), 240, 24),
        ("R1-half", "left", (0.25, 1.0), 120, 12),
        ("R2", "left", (0.25, 4.0), 60, 6),
        ("R2-half", "left", (0.25, 4.0), 30, 3),
        ("R3", "right", (4.0, 0.25), 60, 6),
        ("R3-half", "right", (4.0, 0.25), 30, 3),
    ):
        scene = load_scene(name, tmp_path)
        assert scene.name == name
        assert (scene.pair.main, scene.pair.exposures, scene.max_disparity) == (main, exposures, reach)
        assert scene.disparity_main is not None
        assert scene.disparity_main.values.max() == disparity
        assert scene.reference_response is not None
        assert (scene.kind, scene.response) == ("real", None)


def test_reexposed_scenes_have_the_papers_first(tmp_path):
    for name in ("Moebius", "Aloe", "Baby1"):
        write_flat(tmp_path / "middlebury_third" / name)
    write_flat(tmp_path / "middlebury2006_half" / "Aloe", 555)
    (tmp_path / "middlebury_third" / "Empty").mkdir()
    expected = in_all_settings("Aloe", "Moebius", "Baby1", "Aloe-half")
    assert list(benchmark_scenes(tmp_path)) == [*expected, *PROCEDURAL_NAMES]
    scene = load_scene("Baby1-short-dark", tmp_path)
    assert (scene.name, scene.kind) == ("Baby1-short-dark", "re-exposed")
    assert scene.pair.exposures == (1 / 16, 1.0)


def test_the_papers_inputs_from_full_sets(tmp_path):
    write_official(tmp_path / "Full" / "Art", Wall(1110, 250, 24), 1, illumination=2)
    write_official(tmp_path / "Moebius", Wall(555, 130, 12), 2, illumination=3)  # not the paper's illumination
    names = ["Art-paper-normal-long", "Art-paper-short-long"]
    assert list(benchmark_scenes(tmp_path)) == [*PROCEDURAL_NAMES, *names]
    scene = load_scene("Art-paper-short-long", tmp_path)
    assert (scene.pair.exposures, scene.max_disparity) == ((0.25, 4.0), 120)
    assert scene.reference.shape == (555, 125, 3)  # halved, as in the paper
    assert load_scene("Art-paper-normal-long", tmp_path).pair.exposures == (1.0, 4.0)
    write_official(tmp_path / "ThirdSize" / "Aloe", Wall(370, 80, 8), 3, illumination=3, times=(0.125, 0.5, 2.0))
    scene = load_scene("Aloe-paper-normal-long", tmp_path)
    assert (scene.pair.exposures, scene.max_disparity) == ((0.5, 2.0), 67)


def test_pairs_that_are_rectified_first(tmp_path, monkeypatch):
    pytest.importorskip("cv2")
    world, turned = World(), {"left": (0.5, 1.0, -1.0), "right": (-0.5, -1.0, 1.0)}
    for ms in (64, 256, 1024):
        # 14 codes of pedestal, as the cameras of POLAR have.
        for photo in photographed(world, **turned, times=(ms / 4000, ms / 4000), bits=12):
            side = photo.name.removesuffix(".png")
            codes = np.minimum(photo.codes[..., 0] + 14, 4094)
            (tmp_path / "polar").mkdir(exist_ok=True)
            write_deep_png(tmp_path / "polar" / f"{side}_{ms:04}ms.png", codes)
    assert list(benchmark_scenes(tmp_path)) == ["R6", "R7", *PROCEDURAL_NAMES]
    scene = load_scene("R7", tmp_path)
    assert (scene.pair.main, scene.pair.exposures, scene.name) == ("left", (1.024, 0.064), "R7")
    assert scene.pair.main_photo.white == 4094 * 16
    assert scene.reference.shape[:2] == (scene.pair.left.height, scene.pair.left.width)
    assert 30 <= scene.max_disparity < 60
    assert scene.response is not None
    # The reference is the bracket of the same, rectified view.
    own = initial_radiance(scene.pair.left, scene.response, exposure=1.024)
    codes = scene.pair.left.codes / scene.pair.left.white
    usable = (codes > 0.05) & (codes < 0.9)
    error = np.log2(own / scene.reference)[usable]
    assert np.percentile(np.abs(error), 90) < 0.1
    monkeypatch.setitem(sys.modules, "cv2", None)
    monkeypatch.setattr("stereohdr.datasets.registry.find_spec", lambda name: None)
    assert list(benchmark_scenes(tmp_path)) == PROCEDURAL_NAMES
    with pytest.raises(MissingDependencyError, match="rectifying scene R6 needs OpenCV"):
        load_scene("R6", tmp_path)


def test_manifests_are_found_and_names_must_differ(tmp_path):
    write_manifest(tmp_path / "mine")
    write_manifest(tmp_path / "sets" / "other", "Other")
    assert list(benchmark_scenes(tmp_path)) == [*PROCEDURAL_NAMES, "mine", "Other"]
    assert load_scene("Other", tmp_path).max_disparity == 5
    (tmp_path / "mine" / "scene.toml").write_text("nonsense")
    assert "mine" in benchmark_scenes(tmp_path)
    with pytest.raises(FileFormatError, match="not valid TOML"):
        load_scene("mine", tmp_path)
    write_manifest(tmp_path / "again", "Other")
    with pytest.raises(InputError, match="two scenes are called 'Other'"):
        benchmark_scenes(tmp_path)


def test_scenes_that_are_not_there(tmp_path):
    with pytest.raises(InputError, match=r"scene 'R1' is not there \(its images are not in .*nearest names are"):
        load_scene("R1", tmp_path)
    with pytest.raises(InputError, match="no data folder was given"):
        load_scene("R1")
    with pytest.raises(InputError, match=r"scene 'R6' is not there"):
        load_scene("R6", tmp_path)
    with pytest.raises(InputError, match="is not a folder"):
        benchmark_scenes(tmp_path / "none")
    with pytest.raises(InputError, match="known are room, street-night"):
        procedural_scene("moon")


@pytest.mark.parametrize("name", PROCEDURAL_NAMES)
def test_procedural_scenes(name, monkeypatch):
    recipe = PROCEDURAL[name]
    small = {name: replace(recipe, scene=lambda: recipe.scene(width=120, height=90))}
    monkeypatch.setattr("stereohdr.datasets.simulated.PROCEDURAL", small)
    scene = procedural_scene(name)
    assert scene.kind == "procedural"
    assert scene.pair.exposure_ratio == pytest.approx(16)
    assert recipe.scene is SCENES[name.replace("-", "_")]
    truth = scene.disparity_main
    assert truth is not None
    assert set(np.unique(truth.flags)) == {1, 2}
    assert scene.response is not None
