import json
from pathlib import Path

import numpy as np
import pytest
from calibration_boards import CHARUCO, CHESSBOARD, board_rig, pictures, poses

from stereohdr import read_photo
from stereohdr.cli.calibrate import length, paired
from stereohdr.errors import InputError
from stereohdr.io.images import write_png
from stereohdr.rectification import read_calibration

from command_line import run

pytest.importorskip("cv2")

BOARD = ("--board", "7x5", "--square", "30mm")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Photos left00.png, right00.png, ... of a chessboard, and c_left00.png, ... of a ChArUco board."""
    folder = tmp_path_factory.mktemp("boards")
    rig = board_rig()
    for number, pose in enumerate(poses(7)):
        for kind, board in (("", CHESSBOARD), ("c_", CHARUCO)):
            for photo in pictures(rig, board, *pose, name=f"{number:02}"):
                write_png(folder / f"{kind}{photo.name}", photo.codes)
    return folder


def refused(capsys, status, *words):
    assert status == 2
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert message.startswith("error: ")
    for word in words:
        assert word in message


def both(folder, kind=""):
    return [*sorted(folder.glob(f"{kind}left*.png")), *sorted(folder.glob(f"{kind}right*.png"))]


def test_a_chessboard_from_files_to_a_calibration(folder, tmp_path, capsys):
    more = ("--coverage", tmp_path / "c.png", "--json", tmp_path / "c.json")
    assert run("calibrate", *both(folder), *BOARD, "-o", tmp_path / "rig.toml", *more) == 0
    captured = capsys.readouterr()
    for words in (
        "left00.png",
        "right06.png",
        "root mean square of all), 7 pairs",
        "baseline   ",
        "rows       agree",
    ):
        assert words in captured.out
    assert captured.err.splitlines()[:2] == ["pair 1 of 7", "pair 2 of 7"]
    found = read_calibration(tmp_path / "rig.toml")
    assert np.linalg.norm(found.translation) == pytest.approx(0.1, rel=0.02)
    assert found.left.focal == pytest.approx(420, rel=0.02)
    document = json.loads((tmp_path / "c.json").read_text())
    assert document["rms"] == found.rms
    assert len(document["pairs"]) == 7
    assert document["pairs"][0]["error_left"] < 0.3
    assert read_photo(tmp_path / "c.png").channels == 3


def test_charuco_and_quoted_patterns(folder, tmp_path):
    patterns = (folder / "c_left*.png", folder / "c_right*.png")
    options = ("--charuco", "--dictionary", "4X4_50", "--marker", "22.5mm", "-q")
    assert run("calibrate", *patterns, *BOARD, "-o", tmp_path / "rig.toml", *options) == 0
    assert read_calibration(tmp_path / "rig.toml").rms < 0.4


def test_pairs_without_a_board_are_warned_of(folder, tmp_path, capsys):
    blank = tmp_path / "right02.png"
    write_png(blank, np.full((300, 400), 120, np.uint8))
    files = [blank if path.name == "right02.png" else path for path in both(folder)]
    assert run("calibrate", *files, *BOARD, "-o", tmp_path / "rig.toml", "-q") == 0
    assert "warning: these photos were not used" in (err := capsys.readouterr().err)
    assert "right02.png" in err


def test_sets_that_do_not_do(folder, tmp_path, capsys):
    files, out = both(folder), ("-o", tmp_path / "rig.toml")

    def calibrate(*arguments):
        return run("calibrate", *arguments, "-q")

    refused(capsys, calibrate(*files[:-1], *BOARD, *out), "13 photos are no pairs")
    refused(
        capsys,
        calibrate(*files[:3], *files[7:10], *BOARD, *out),
        "in 3 of 3 pairs",
        "; take more",
    )
    refused(capsys, calibrate(*files, "--board", "9x6", "--square", "30mm", *out), "not found in", "--board")
    alternating = sorted(files, key=lambda path: path.stem[-2:])
    refused(capsys, calibrate(*alternating, *BOARD, *out), "would be paired with", "left camera, then")
    refused(capsys, calibrate(*files[7:], *files[:7], *BOARD, *out), "to the left of the left one")
    refused(capsys, calibrate(folder / "none*.png", *BOARD, *out), "no file matches")
    refused(capsys, calibrate(*files, "--board", "seven", "--square", "30mm", *out), "'seven' is not a board")
    refused(capsys, calibrate(*files, "--board", "7x5", "--square", "30", *out), "'30' is not a length", "unit")
    refused(capsys, calibrate(*files, *BOARD, "-o", tmp_path / "rig.yml"), "written as TOML")
    refused(capsys, calibrate(*files, *BOARD, *out, "--coverage", tmp_path / "c.jpg"), "c.jpg")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "metres"), [("25mm", 0.025), (" 2.5 cm", 0.025), ("0.025m", 0.025), ("1in", 0.0254), (".5m", 0.5)]
)
def test_lengths(text, metres):
    assert length(text) == pytest.approx(metres)


@pytest.mark.parametrize("text", ["25", "mm", "0mm", "-3mm", "1e3mm", "25 km", "25mm 3"])
def test_what_is_no_length(text):
    with pytest.raises(InputError, match="is not a length"):
        length(text)


def test_pairs_are_the_two_halves(tmp_path):
    lefts = [Path(f"l{n}.png") for n in (1, 2, 10)]
    rights = [Path(f"r{n:03}.png") for n in (1, 2, 10)]
    assert paired(lefts + rights) == list(zip(lefts, rights, strict=True))
    plain = [Path(name) for name in ("one.png", "two.png")]
    assert paired(plain) == [(plain[0], plain[1])]
    with pytest.raises(InputError, match=r"l2\.png would be paired with r001\.png"):
        paired([lefts[1], rights[0]])
    with pytest.raises(InputError, match=r"l1\.png would be paired with l1\.png"):
        paired([lefts[0], lefts[0]])
    for name in ("b2.png", "b1.png", "a1.png", "a2.png"):
        (tmp_path / name).touch()
    found = paired([tmp_path / "a?.png", tmp_path / "b?.png"])
    assert [(left.name, right.name) for left, right in found] == [("a1.png", "b1.png"), ("a2.png", "b2.png")]
