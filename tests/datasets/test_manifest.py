import numpy as np
import pytest
from dataset_folders import Wall, write_deep_png

from stereohdr import ResponseCurve, write_hdr
from stereohdr.datasets import manifest_scene, visible_in_auxiliary
from stereohdr.errors import ExposureError, FileFormatError, InputError
from stereohdr.io.images import write_png

DISPARITY = 6


@pytest.fixture
def folder(tmp_path):
    """A wall of 60x40 pixels: left at 1/16 and 1/4 s, right at 1 s, reference, ground truth of the left view."""
    wall = Wall(40, 60, DISPARITY)
    for name, shift, time in (("l16", 0, 0.0625), ("l4", 0, 0.25), ("r1", 1, 1.0)):
        write_png(tmp_path / f"{name}.png", wall.codes(shift, time))
    write_hdr(tmp_path / "ref.exr", wall.radiance(0))
    write_png(tmp_path / "disp.png", np.full((40, 60), 4 * DISPARITY, np.uint8))
    return tmp_path


MINIMAL = """
left = "l4.png"
right = "r1.png"
exposures = ["1/4", 1]
max_disparity = 10
reference = "ref.exr"
"""


def scene_of(folder, text):
    (folder / "scene.toml").write_text(text)
    return manifest_scene(folder)


def test_minimal(folder):
    scene = scene_of(folder, MINIMAL)
    assert (scene.name, scene.max_disparity) == (folder.name, 10)
    assert (scene.pair.main, scene.pair.exposures) == ("left", (0.25, 1.0))
    np.testing.assert_array_equal(scene.reference, Wall(40, 60, DISPARITY).radiance(0).astype(np.float32))
    assert not scene.reference_clipped.any()
    assert visible_in_auxiliary(scene) is None
    assert scene.response is None
    assert scene.reference_response is None


def test_reduced_and_cropped_alike(folder):
    scene = scene_of(
        folder,
        MINIMAL + 'name = "Jumble"\nreduce = 2\ncrop = [3, 2, 24, 16]\ndisparity_left = "disp.png"\n'
        "disparity_scale = 4\n",
    )
    assert scene.name == "Jumble"
    assert scene.pair.left.codes.shape == (16, 24, 3)
    full = Wall(40, 60, DISPARITY)
    halved = full.radiance(0).reshape(20, 2, 30, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(scene.reference, halved[2:18, 3:27], rtol=1e-5)
    codes = full.codes(0, 0.25).reshape(20, 2, 30, 2, 3).mean(axis=(1, 3))
    np.testing.assert_array_equal(scene.pair.left.codes, np.rint(codes[2:18, 3:27]))
    assert scene.disparity_main is not None
    assert np.unique(scene.disparity_main.values).tolist() == [DISPARITY / 2]
    assert scene.disparity_main.flags[0].tolist() == [2] * 3 + [1] * 21


def test_a_bracket_is_merged_and_the_right_view_may_be_the_main_one(folder):
    ResponseCurve.gamma(2.2).save(folder / "curve.json")
    text = """
left = "r1.png"   # exchanged on purpose: only the keys say which is which
right = "l4.png"
main = "right"
exposures = ["1s", "250ms"]
max_disparity = 10
bracket = ["l16.png", "l4.png"]
bracket_exposures = [0.0625, 0.25]
disparity_right = "disp.png"
disparity_scale = 4
"""
    for known in (False, True):
        scene = scene_of(folder, text + ('response = "curve.json"\n' if known else ""))
        error = np.log2(scene.reference / Wall(40, 60, DISPARITY).radiance(0))[~scene.reference_clipped]
        assert np.abs(error - np.median(error)).mean() < (0.05 if known else 0.2)
        assert (scene.response is not None) == known
        assert (scene.reference_response is None) == known
        assert scene.pair.main == "right"
        assert scene.disparity_main is not None
        assert scene.disparity_auxiliary is None


def test_deep_codes(folder):
    for name in ("l4", "r1"):
        codes = np.full((40, 60), 3000 if name == "l4" else 4090)
        write_deep_png(folder / f"{name}.png", codes)
    write_hdr(folder / "ref.exr", np.ones((40, 60), np.float32))
    scene = scene_of(folder, MINIMAL + "white_level = 4000")
    assert scene.pair.left.white == 4000
    assert scene.pair.right.codes.max() == 4000


def test_black_in_the_reference_becomes_its_smallest_radiance(folder):
    radiance = Wall(40, 60, DISPARITY).radiance(0).copy()
    least = radiance.min()
    radiance[0, 0] = 0
    write_hdr(folder / "ref.exr", radiance)
    np.testing.assert_allclose(scene_of(folder, MINIMAL).reference[0, 0], least)


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        ("colour = 1", FileFormatError, r"scene\.toml: unknown key 'colour'; known are bracket"),
        ("reduce = 1.5", FileFormatError, "reduce must be a whole number"),
        ("reduce = 0", FileFormatError, "reduce must be 1 or more"),
        ("name = 3", FileFormatError, "name must be text"),
        ("crop = [0, 0, 5]", FileFormatError, "crop must be"),
        ("crop = [0, 0, 500, 5]", InputError, r"scene\.toml: .*must lie inside of 60x40"),
        ('main = "top"', InputError, r"scene\.toml: main view"),
        ('bracket = ["l4.png"]', FileFormatError, "either reference .* or bracket"),
        ('disparity_left = "none.png"', FileFormatError, r"none\.png: no such file"),
        ('response = "none.json"', FileFormatError, r"none\.json: cannot read"),
        ("name = ", FileFormatError, r"scene\.toml: not valid TOML"),
        ("white_level = 300", InputError, "white level"),
    ],
)
def test_wrong_manifests_are_refused(folder, change, error, words):
    with pytest.raises(error, match=words):
        scene_of(folder, MINIMAL + change)


@pytest.mark.parametrize(
    ("old", "new", "error", "words"),
    [
        ('left = "l4.png"', "", FileFormatError, "does not say left"),
        ("max_disparity = 10", "max_disparity = 60", InputError, "1 to 59"),
        ('reference = "ref.exr"', "", FileFormatError, "either reference"),
        ('exposures = ["1/4", 1]', "", ExposureError, r"scene\.toml: .*exposure time is not known"),
        ('exposures = ["1/4", 1]', "exposures = [1]", FileFormatError, "gives 1 times for 2 photos"),
        ('exposures = ["1/4", 1]', 'exposures = ["soon", 1]', FileFormatError, "soon"),
        ('exposures = ["1/4", 1]', "exposures = [true, 1]", FileFormatError, "holds True"),
        ('exposures = ["1/4", 1]', "exposures = [1, 1]", ExposureError, "the same exposure"),
        ('reference = "ref.exr"', 'reference = "small.npy"', FileFormatError, "of the size of the photos"),
        ('reference = "ref.exr"', "bracket = [1, 2]", FileFormatError, "list of file names"),
        ('reference = "ref.exr"', 'bracket = ["l4.png"]\nbracket_exposures = [1]', InputError, "got 1"),
    ],
)
def test_wrong_values_are_refused(folder, old, new, error, words):
    np.save(folder / "small.npy", np.ones((4, 4), np.float32))
    with pytest.raises(error, match=words):
        scene_of(folder, MINIMAL.replace(old, new))


def test_no_manifest(tmp_path):
    with pytest.raises(FileFormatError, match=r"scene\.toml: cannot read the manifest"):
        manifest_scene(tmp_path)
