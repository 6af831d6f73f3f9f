from dataclasses import replace

import numpy as np
import pytest
from calibration_boards import CHARUCO, CHESSBOARD, SIZE, board_rig, corners_of, pictures, poses

from stereohdr import Photo
from stereohdr.errors import InputError
from stereohdr.rectification import Board, calibrate_stereo, find_board
from stereohdr.rectification.geometry import rotation_angle
from stereohdr.rectification.pictures import coverage_picture

pytest.importorskip("cv2")


def photographed(board, rig, count=8):
    return [pictures(rig, board, *pose, name=f"{n:02}") for n, pose in enumerate(poses(count))]


def found_in(pairs, board):
    return [tuple(find_board(photo, board) for photo in pair) for pair in pairs]


def all_corners(rig, count=9, noise=0.05, **more):
    return [
        corners_of(rig, CHESSBOARD, *pose, name=f"{n:02}", noise=noise, seed=n)
        for n, pose in enumerate(poses(count, **more))
    ]


@pytest.fixture(scope="module")
def rig():
    return board_rig()


@pytest.fixture(scope="module")
def pairs(rig):
    return photographed(CHESSBOARD, rig)


@pytest.fixture(scope="module")
def views(pairs):
    return found_in(pairs, CHESSBOARD)


def assert_the_same(found, truth, angle=0.004, length=0.01):
    baseline, expected = found.baseline, truth.baseline
    assert np.linalg.norm(baseline - expected) < length * np.linalg.norm(expected)
    assert rotation_angle(found.rotation @ truth.rotation.T) < angle


def test_corners_are_found_to_a_fraction_of_a_pixel(rig, views):
    for view_pair, pose in zip(views, poses(), strict=True):
        truth = corners_of(rig, CHESSBOARD, *pose, name="")
        for view, expected in zip(view_pair, truth, strict=True):
            assert view.found
            error = np.abs(view.corners - expected.corners)
            assert error.max() < 0.4
            assert error.mean() < 0.1
            assert view.size == SIZE


def test_a_chessboard_calibrates_the_rig(rig, views):
    result = calibrate_stereo(views, CHESSBOARD)
    assert result.calibration.rms < 0.15
    assert_the_same(result.calibration, rig)
    assert result.calibration.left.focal == pytest.approx(420, rel=0.01)
    assert result.dy_median < 0.05
    assert result.dy_p95 < 0.2
    assert result.errors.shape == (8, 2)
    assert (result.errors < 0.2).all()
    assert result.warnings == ()
    picture = coverage_picture(result)
    assert picture.dtype == np.uint8
    assert (picture[..., 1] > picture[..., 0] + 60).mean() > 0.01  # green dots


def test_charuco_boards_may_be_seen_in_part(rig):
    pairs = photographed(CHARUCO, rig, 8)
    hidden = pairs[0][0].codes.copy()
    hidden[:, : SIZE[0] // 3] = 128
    pairs[0] = (replace(pairs[0][0], codes=hidden), pairs[0][1])
    views = found_in(pairs, CHARUCO)
    assert 8 <= len(views[0][0].ids) < len(views[0][1].ids) <= 35
    result = calibrate_stereo(views, CHARUCO)
    assert result.calibration.rms < 0.3
    assert_the_same(result.calibration, rig, angle=0.015, length=0.02)


@pytest.mark.parametrize("lens", ["rational", "fisheye"])
def test_other_lens_models(lens):
    rig = board_rig("fisheye" if lens == "fisheye" else "plumb-bob")
    result = calibrate_stereo(all_corners(rig, 12), CHESSBOARD, lens=lens)
    assert result.calibration.left.lens == lens
    assert result.calibration.rms < 0.12
    assert_the_same(result.calibration, rig, angle=0.004, length=0.02)


def test_a_board_that_looks_the_same_upside_down(rig):
    board = Board(6, 6, 0.03)
    views = []
    for n, pose in enumerate(poses(8)):
        left, right = corners_of(rig, board, *pose, name=f"{n}")
        if n % 2:  # the detector began at the other end
            right = replace(right, corners=right.corners[::-1].copy())
        views.append((left, right))
    assert calibrate_stereo(views, board).calibration.rms < 0.01


def test_pairs_without_a_board_are_left_out_and_said(views):
    blank = replace(views[2][1], ids=np.empty(0, np.intp), corners=np.empty((0, 2)))
    result = calibrate_stereo([*views[:2], (views[2][0], blank), *views[3:]], CHESSBOARD)
    assert result.left_out == ("left02.png", "right02.png")
    assert "left02.png, right02.png" in result.warnings[0]
    assert len(result.pairs) == 7


def test_a_photo_without_a_board():
    rng = np.random.default_rng(0)
    photo = Photo(rng.integers(0, 256, (120, 160, 3)).astype(np.uint8), name="wall.png")
    assert not find_board(photo, CHESSBOARD).found
    assert not find_board(photo, CHARUCO).found
    black = Photo(np.zeros((120, 160), np.uint8))
    assert not find_board(black, CHESSBOARD).found


def test_the_wrong_board_is_told(pairs):
    board = Board(9, 6, 0.03)
    with pytest.raises(InputError, match=r"9x6 inner corners.*in 0 of 5 pairs.*not found in left00.png.*--board"):
        calibrate_stereo(found_in(pairs[:5], board), board)


def test_too_few_pairs(views):
    with pytest.raises(InputError, match=r"in 4 of 4 pairs, at least 5 are needed; take more$"):
        calibrate_stereo(views[:4], CHESSBOARD)
    with pytest.raises(InputError, match="none was given"):
        calibrate_stereo([], CHESSBOARD)


def test_a_board_that_is_never_tilted(rig):
    with pytest.raises(InputError, match=r"leave the focal length open.*tilted|do not determine"):
        calibrate_stereo(all_corners(rig, 9, noise=0.3, tilt=0.01), CHESSBOARD)


def test_photos_in_another_order(views):
    lefts, rights = zip(*views, strict=True)
    exchanged = list(zip(lefts, rights[3:] + rights[:3], strict=True))
    with pytest.raises(InputError, match=r"reprojection error is .* px, at most 1 .*worst photo"):
        calibrate_stereo(exchanged, CHESSBOARD)


def test_left_and_right_exchanged(views):
    with pytest.raises(InputError, match="stands to the left of the left one"):
        calibrate_stereo([pair[::-1] for pair in views], CHESSBOARD)


def test_a_board_in_one_corner_only_is_warned_of(rig):
    views = [
        corners_of(rig, Board(7, 5, 0.012), *pose, name=f"{n:02}", noise=0.02, seed=n)
        for n, pose in enumerate(poses(14))
    ]
    result = calibrate_stereo(views, Board(7, 5, 0.012))
    assert min(result.coverage) < 0.3
    assert "reach around only" in result.warnings[0]


def test_photos_of_different_size(views):
    other = replace(views[1][0], size=(800, 600))
    with pytest.raises(
        InputError, match=r"left camera differ in size: left00.png is 400x300, left01.png is 800x600"
    ):
        calibrate_stereo([views[0], (other, views[1][1]), *views[2:]], CHESSBOARD)


def test_large_photos_are_searched_reduced(rig, pairs, views, monkeypatch):
    monkeypatch.setattr("stereohdr.rectification.calibration.DETECTION_PIXELS", SIZE[0] * SIZE[1] // 2)
    again = find_board(pairs[0][0], CHESSBOARD).corners
    before = views[0][0].corners  # a board of 8 x 6 squares may be numbered from either end
    assert min(np.abs(again - before).max(), np.abs(again[::-1] - before).max()) < 0.1


def test_photos_of_12_bits(pairs, views):
    photo = pairs[0][0]
    deep = Photo(photo.codes.astype(np.uint16) * 4, white_level=4095)  # a quarter of the range
    np.testing.assert_allclose(find_board(deep, CHESSBOARD).corners, views[0][0].corners, atol=0.05)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"columns": 2}, "3 to 100 inner corners"),
        ({"square": 0.0}, "0.1 mm to 10 m"),
        ({"square": 25.0}, "0.1 mm to 10 m"),
        ({"kind": "circles"}, "chessboard or charuco"),
        ({"marker": 0.04}, "smaller than its squares"),
    ],
)
def test_boards_that_are_none(values, words):
    with pytest.raises(InputError, match=words):
        replace(CHESSBOARD, **values)


def test_an_unknown_dictionary():
    with pytest.raises(InputError, match="dictionary 'ABC' is not known"):
        find_board(Photo(np.zeros((50, 50), np.uint8)), replace(CHARUCO, dictionary="ABC"))
