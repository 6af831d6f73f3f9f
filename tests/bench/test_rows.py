import json
from dataclasses import fields, replace

import numpy as np
import pytest

from stereohdr.bench.contenders import run_contender
from stereohdr.bench.rows import Row, _gap_closed, _seen_from_auxiliary, as_json, peak_mib, score
from stereohdr.datasets.scene import channel_mask, luminance_mask, visible_in_auxiliary
from stereohdr.metrics import log2_error, log2_rmse
from stereohdr.metrics.evaluation import evaluate
from stereohdr.metrics.protocol import Protocol

COLUMNS = (
    *("scene", "method", "q", "qv", "q_mos", "pu21_psnr", "pu21_ssim", "log2_rmse", "log2_rmse_s"),
    *("log2_rmse_sx_visible", "bad1", "bad2", "bad2_sx", "response_rmse", "gap_closed_q", "gap_closed_pu"),
    *("seconds", "peak_mib"),
)


@pytest.fixture(scope="module")
def row(small_scene):
    return score(small_scene, "paper")


def test_every_column_is_there_and_finite(row):
    assert set(COLUMNS) <= {field.name for field in fields(Row)}
    content = json.loads(json.dumps(as_json(row), allow_nan=False))
    for name in COLUMNS:
        assert content[name] is not None, name
    assert Row.from_json({**content, "unknown": 1}) == row


def test_scores_are_those_of_evaluate(row, small_scene):
    radiance = run_contender(small_scene, "paper").radiance
    expected = evaluate(radiance, small_scene.reference, main=small_scene.pair.main_photo)
    assert row.q == expected.scores["hdrvdp2"]["q"]
    assert row.q_mos == expected.scores["hdrvdp2"]["q_mos"]
    assert row.pu21_psnr == expected.scores["pu21_psnr"]
    assert row.log2_rmse == expected.scores["log2_rmse"]
    assert row.protocol == expected.report
    shown, reference, _ = Protocol().show(radiance, small_scene.reference, main=small_scene.pair.main_photo)
    error = log2_error(shown, reference)
    assert row.log2_rmse_s == log2_rmse(error, luminance_mask(small_scene))
    region = channel_mask(small_scene) & visible_in_auxiliary(small_scene)
    assert row.log2_rmse_sx_visible == log2_rmse(error, region)


def test_the_main_view_closes_no_gap_and_perfect_stereo_all_of_it(small_scene):
    alone, perfect = score(small_scene, "mv-only"), score(small_scene, "C3")
    assert alone.q == alone.mv_only_q
    assert alone.gap_closed_pu == pytest.approx(0, abs=1e-9)
    assert perfect.gap_closed_pu == pytest.approx(1)
    assert perfect.log2_rmse_sx_visible < 0.01 < alone.log2_rmse_sx_visible
    assert alone.bad2 is None  # no disparity


def test_small_gaps_are_not_divided_by():
    assert _gap_closed(50, 49, 49.9, 1.0) is None
    assert _gap_closed(50, 49, 51, 1.0) == 0.5
    assert _gap_closed(50, 49, float("inf"), 1.0) is None


def test_without_truth_only_its_scores_are_missing(small_scene):
    blind = replace(small_scene, disparity_main=None, disparity_auxiliary=None, response=None)
    row = score(blind, "mv-only")
    missing = {name for name in COLUMNS if getattr(row, name) is None}
    assert missing == {
        "qv",
        "log2_rmse_sx_visible",
        "bad1",
        "bad2",
        "bad2_sx",
        "response_rmse",
        "gap_closed_q",
        "gap_closed_pu",
    }


def test_the_mask_seen_from_the_auxiliary_view_follows_the_true_disparity(small_scene):
    mask = channel_mask(small_scene)
    seen = _seen_from_auxiliary(small_scene, mask)
    d = small_scene.disparity_auxiliary.values
    for y, x in ((10, 20), (45, 60), (80, 100)):
        partner = round(x + float(d[y, x]))
        assert seen[y, x] == (partner < 120 and mask[y, min(partner, 119)])
    mirrored = replace(
        small_scene,
        pair=small_scene.pair.mirrored(),
        reference=small_scene.reference[:, ::-1],
        disparity_auxiliary=small_scene.disparity_auxiliary.mirrored(),
    )
    np.testing.assert_array_equal(_seen_from_auxiliary(mirrored, mask[:, ::-1]), seen[:, ::-1])


def test_a_picture_is_drawn_on_request(small_scene, tmp_path):
    score(small_scene, "mv-only", pictures=tmp_path)
    assert [p.name for p in tmp_path.iterdir()] == ["small-room_mv-only.png"]


def test_the_process_tells_its_peak_memory():
    peak = peak_mib()
    assert peak is None or 20 < peak < 1e6
