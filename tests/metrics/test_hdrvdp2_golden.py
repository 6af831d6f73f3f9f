"""HDR-VDP-2 against the scores and maps of the original."""

import functools
import json
from pathlib import Path

import numpy as np
import pytest

from stereohdr.metrics.hdrvdp2 import HdrVdp2Options, hdrvdp2, quality_213, quality_220

SMALL = Path(__file__).parent / "data" / "hdrvdp2"
SMALL_CASES = json.loads((SMALL / "golden_64.json").read_text(encoding="utf-8"))["cases"]

SHARED = Path(__file__).resolve().parents[3] / "shared" / "hdrvdp2" / "golden"


def shared_cases():
    file = SHARED / "golden.json"
    if not file.is_file():
        return [pytest.param(None, marks=pytest.mark.skip("the golden cases are not beside this checkout"))]
    cases = json.loads(file.read_text(encoding="utf-8"))["cases"]
    return [pytest.param(case, id=case["case"]) for case in cases if case["height"] != 64]


@functools.cache
def small_arrays():
    with np.load(SMALL / "golden_64.npz") as file:
        return dict(file)


def check_scores(result, q, p_det, c_max):
    assert result.q == pytest.approx(q, rel=0, abs=1e-6)
    assert result.c_max == pytest.approx(c_max, rel=1e-6, abs=0)
    assert result.p_det == pytest.approx(p_det, rel=0, abs=1e-6)
    assert result.c_map.max() == result.c_max
    assert result.p_map.max() == result.p_det
    for array in (result.c_map, result.p_map):
        assert array.dtype == np.float64
        assert np.isfinite(array).all()


def check_plane_errors(result, expected):
    errors = [plane.error for plane in result.plane_errors]
    # The original printed errors far below the floor of 1e-12, which Q adds to them, as zero.
    np.testing.assert_allclose(errors, expected, rtol=1e-6, atol=1e-15)


# Weak patterns on dark fields warn that the images may be relative.
pytestmark = pytest.mark.filterwarnings("ignore:the test image reaches only")


@pytest.mark.parametrize("case", SMALL_CASES, ids=[case["case"] for case in SMALL_CASES])
def test_small_cases(case):
    arrays = small_arrays()
    test, reference = arrays[case["test"]], arrays[case["reference"]]
    result = hdrvdp2(test, reference, encoding=case["encoding"], pixels_per_degree=case["pixels_per_degree"])
    check_scores(result, case["q"], case["p_det"], case["c_max"])
    check_plane_errors(result, case["plane_errors"])
    np.testing.assert_allclose(result.p_map, arrays["pmap_" + case["case"]], rtol=0, atol=1e-6)
    assert result.q_mos == pytest.approx(case["q_mos_220"], rel=0, abs=1e-6)
    assert quality_220(result.plane_errors) == pytest.approx((case["q_220"], case["q_mos_220"]), rel=0, abs=1e-6)


@pytest.mark.parametrize("case", shared_cases())
def test_all_other_cases(case):
    test, reference = np.load(SHARED / case["test"]), np.load(SHARED / case["reference"])
    given = dict(zip(case["options"][::2], case["options"][1::2], strict=True))
    compare = functools.partial(
        hdrvdp2,
        test,
        reference,
        encoding=case["color_encoding"],
        pixels_per_degree=case["pixels_per_degree"],
    )
    result = compare(options=HdrVdp2Options(**given))
    expected = case["expected"]
    check_scores(result, expected["Q"], expected["P_det"], expected["C_max"])
    check_plane_errors(result, [row[6] for row in case["intermediate"]["planes"]])
    if "P_map" in case:
        np.testing.assert_allclose(result.p_map, np.load(SHARED / case["P_map"]), rtol=0, atol=1e-6)
    for values, statistics in (
        (result.p_map, expected["P_map_stats"]),
        (result.c_map, expected["C_map_stats"]),
    ):
        tolerance = 1e-6 * max(1.0, statistics["max"])
        for name, value in statistics.items():
            ours = np.percentile(values, float(name[1:])) if name[1:].isdigit() else getattr(values, name)()
            assert ours == pytest.approx(value, rel=0, abs=tolerance), name
    older = case["other_versions"]
    assert quality_220(result.plane_errors) == pytest.approx(
        (older["2.2.0"]["Q"], older["2.2.0"]["Q_MOS"]), rel=0, abs=1e-6
    )
    if "2.1.3" in older:
        result = compare(options=HdrVdp2Options(surround_l=-1, **given))
        assert quality_213(result.plane_errors) == pytest.approx(
            (older["2.1.3"]["Q"], older["2.1.3"]["Q_MOS"]), rel=0, abs=1e-6
        )
        assert result.c_max == pytest.approx(older["2.1.3"]["C_max"], rel=1e-6)
