import numpy as np
import pytest

from stereohdr import SourceFlag
from stereohdr.fusion import NEGLIGIBLE_WEIGHT, blend, source_flags, weight_map


def test_blend_by_hand():
    main = np.array([[[1.0], [1.0], [1.0], [1.0]]], dtype=np.float32)
    restored = np.array([[[3.0], [3.0], [-9.0], [np.nan]]], dtype=np.float32)
    weight = np.array([[0.25, 1.0, 1.0, 0.0]], dtype=np.float32)
    fused = blend(main, restored, weight, lowest=np.array([0.5], dtype=np.float32))
    # A quarter, all, raised to the lowest; and weight 0 keeps the main view whatever the restored value is.
    np.testing.assert_allclose(fused[0, :, 0], [1.5, 3.0, 0.5, 1.0])


def test_lowest_holds_per_channel_and_never_touches_measured_pixels():
    main = np.full((1, 2, 3), 0.1, dtype=np.float32)
    restored = np.zeros_like(main)
    lowest = np.array([0.2, 0.3, 0.4], dtype=np.float32)
    fused = blend(main, restored, np.array([[0.0, 1.0]], dtype=np.float32), lowest=lowest)
    np.testing.assert_array_equal(fused[0, 0], main[0, 0])
    np.testing.assert_array_equal(fused[0, 1], lowest)


def test_weight_is_s_where_the_guide_has_edges_and_spreads_where_it_is_flat():
    s = np.zeros((20, 40), dtype=bool)
    s[:, :20] = True
    edge = np.zeros((20, 40, 3), dtype=np.float32)
    edge[:, 20:] = 1.0
    np.testing.assert_allclose(weight_map(s, edge), s, atol=1e-6)
    flat = weight_map(s, np.zeros_like(edge))
    assert 0.3 < flat[10, 21] < flat[10, 18] < 1
    assert flat.max() <= 1


def test_negligible_weights_are_zero():
    s = np.zeros((1, 300), dtype=bool)
    s[0, 0] = True
    weight = weight_map(s, np.zeros((1, 300, 1), dtype=np.float32))
    assert weight[0, -1] == 0
    assert weight[weight > 0].min() >= NEGLIGIBLE_WEIGHT
    assert (weight > 0).sum() > 5


@pytest.mark.parametrize(
    ("weight", "wanted", "s", "valid", "rejected", "expected"),
    [
        (0.0, 0.0, False, False, False, SourceFlag.MEASURED),
        (0.0, 0.0, False, True, False, SourceFlag.MEASURED),
        (0.5, 0.5, False, True, False, SourceFlag.AUXILIARY),
        (1.0, 1.0, True, True, False, SourceFlag.AUXILIARY),
        (1.0, 1.0, True, False, True, SourceFlag.FILLED_REJECTED),
        (1.0, 1.0, True, False, False, SourceFlag.FILLED_OCCLUDED),
        (0.0, 1.0, True, False, False, SourceFlag.NO_INFORMATION),
        (0.0, 0.5, False, False, False, SourceFlag.WEIGHT_CUT),
        (0.0, 0.0, True, False, True, SourceFlag.NO_INFORMATION),
    ],
)
def test_each_flag(weight, wanted, s, valid, rejected, expected):
    def one(value, dtype):
        return np.array([[value]], dtype=dtype)

    flags = source_flags(
        weight=one(weight, np.float32),
        wanted_weight=one(wanted, np.float32),
        exposure_map=one(s, bool),
        valid=one(valid, bool),
        rejected=one(rejected, bool),
    )
    assert flags[0, 0] == expected
