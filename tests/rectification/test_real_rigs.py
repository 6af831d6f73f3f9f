"""The numbers that real cameras must reach; skipped where the data are absent. Run with -s to see them."""

from dataclasses import replace

import numpy as np
import pytest

from stereohdr import fuse, read_photo
from stereohdr.datasets.boreal import WHITE_LEVEL
from stereohdr.datasets.registry import load_scene
from stereohdr.methods import get_method
from stereohdr.metrics.radiometric import aligning_scale, log2_error, log2_rmse
from stereohdr.radiance import code_luma
from stereohdr.rectification import (
    Board,
    calibrate_stereo,
    find_board,
    read_calibration,
    rectify_pair,
)
from stereohdr.rectification.features import match_features
from stereohdr.rectification.uncalibrated import differences

pytest.importorskip("cv2")


def folder_of(shared_data, name):
    folder = shared_data / name
    if not folder.is_dir():
        pytest.skip(f"{name} is not in the data folder")
    return folder


def told(name, report):
    print(
        f"\n{name}: rows differ by {report['dy_median']:.3f} px (median), {report['dy_p95']:.3f} px (95 %) at "
        f"{report['held_out']} matches held out of the fit to {report['inliers']}"
    )
    return report


def test_polar_across_sixteen_times_the_exposure(shared_data):
    folder = folder_of(shared_data, "polar")
    photos = [read_photo(folder / name, white_level=4095) for name in ("left_0064ms.png", "right_1024ms.png")]
    report = told("POLAR", rectify_pair(*photos).rectification.report)
    assert report["dy_median"] <= 0.4
    assert report["dy_p95"] <= 1.0
    assert report["held_out"] >= 300
    # Before, x_left - x_right is 120 to 230 px, y_left - y_right 12 to 20.
    assert 0 < report["disparity_min"] < 20
    assert 105 < report["disparity_max"] < 140


def test_polar_from_files_to_a_picture(shared_data):
    folder_of(shared_data, "polar")
    scene = load_scene("R6", shared_data)  # 64 and 1024 ms; the reference are all exposures of the left view
    codes = code_luma(scene.pair.left)
    inside = (codes < 5) | (codes > 250)
    stops = {}
    for method in ("robust", "mv-only"):
        config = replace(get_method(method).config_type(), max_disparity=scene.max_disparity)
        radiance = fuse(scene.pair, method, config).radiance
        scale = aligning_scale(radiance, scene.reference, scene.pair.left)
        stops[method] = log2_rmse(log2_error(radiance, scene.reference, scale=scale), inside)
    print(
        f"\nPOLAR: log2 RMSE inside S ({inside.mean():.0%} of the view) {stops['robust']:.3f} stops, "
        f"main view only {stops['mv-only']:.3f}"
    )
    assert 0.2 < inside.mean() < 0.5
    assert stops["robust"] <= 0.5 * stops["mv-only"]


def boreal(folder, side, ms):
    return read_photo(folder / "cycle00" / f"{side}_{ms}ms.png", white_level=WHITE_LEVEL, bayer="RGGB")


def test_boreal_demosaiced(shared_data):
    folder = folder_of(shared_data, "boreal")
    photos = boreal(folder, "left", "01.0"), boreal(folder, "right", "32.0")
    report = told("Boreal", rectify_pair(*photos).rectification.report)
    assert report["dy_median"] <= 0.5
    assert report["held_out"] >= 150


def test_boreal_with_its_lenses(shared_data):
    folder = folder_of(shared_data, "boreal")
    lenses = read_calibration(*(folder / "calibration" / f"{side}.yaml" for side in ("left", "right")))
    assert not lenses.has_pose
    assert lenses.left.size == (1920, 1200)
    photos = boreal(folder, "left", "01.0"), boreal(folder, "right", "32.0")
    found = rectify_pair(*photos, calibration=lenses, pose_from_pictures=True)
    report = told("Boreal, lenses known", found.rectification.report)
    assert report["dy_median"] <= 0.5


def test_the_sample_rig_of_opencv(shared_data):
    folder = folder_of(shared_data, "calibration/opencv_chessboard")
    board = Board(9, 6, 0.025)
    pairs = [
        (read_photo(left), read_photo(folder / left.name.replace("left", "right")))
        for left in sorted(folder.glob("left[0-9]*.jpg"))
    ]
    assert len(pairs) == 13
    result = calibrate_stereo([tuple(find_board(photo, board) for photo in pair) for pair in pairs], board)
    rows = []
    for pair in pairs:
        matches = match_features(*pair)
        rows.append(differences(result.calibration, matches, focal=result.calibration.left.focal)[:, 1])
    features = np.abs(np.concatenate(rows))
    features = features[features < 3]  # others are wrong matches: the squares of a board all look alike
    print(
        f"\nOpenCV's pairs: reprojection error {result.calibration.rms:.3f} px, rows differ by "
        f"{result.dy_median:.3f} px at corners, {np.median(features):.3f} px at {len(features)} SIFT features "
        f"(medians)"
    )
    assert result.calibration.rms <= 0.5
    assert result.dy_median <= 0.3
    assert np.median(features) <= 0.3
    assert result.calibration.left.focal == pytest.approx(535.9, rel=0.01)  # as OpenCV's own file says
    assert np.linalg.norm(result.calibration.translation) == pytest.approx(0.083, abs=0.001)
    assert not result.left_out
