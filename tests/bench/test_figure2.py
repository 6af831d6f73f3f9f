import numpy as np
import pytest

from stereohdr.bench.figure2 import COLOURS, curve_errors, draw_curves, response_curves


def test_curves_are_compared_with_the_truth(small_scene):
    pytest.importorskip("skimage")
    curves, missing = response_curves(small_scene)
    assert "reference" in curves
    assert "cdf" in curves
    assert set(curves) | set(missing) == {"reference", "cdf", "sift"}
    errors = curve_errors(curves)
    assert 0 < errors["cdf"] < 1
    assert curve_errors({"cdf": curves["cdf"]}) == {}


def test_every_curve_is_drawn_in_every_panel(small_scene):
    truth = small_scene.response
    picture = draw_curves({"reference": truth}, "title")
    drawn = (picture == COLOURS["reference"]).all(axis=2)
    thirds = np.array_split(drawn, 3, axis=1)
    assert all(third.sum() > 200 for third in thirds)
