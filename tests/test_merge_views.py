import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Photo, SourceFlag
from stereohdr.fusion import BOUND_WEIGHT, NEGLIGIBLE_WEIGHT, code_weight, merge_flags, merge_views


def test_code_weights_by_hand():
    photo = Photo(np.array([[0, 1, 51, 204, 254, 255]], dtype=np.uint8), 1.0)
    longer, shorter = (code_weight(photo, shorter=flag)[0, :, 0] for flag in (False, True))
    inner = np.array([1, 51, 51, 1]) / 127.5
    np.testing.assert_allclose(longer, [BOUND_WEIGHT, *inner, 0], rtol=1e-6)
    np.testing.assert_allclose(shorter, [0, *inner, BOUND_WEIGHT], rtol=1e-6)
    deep = Photo(np.array([[0, 1023, 4095]], dtype=np.uint16), 1.0, 4095)
    np.testing.assert_allclose(code_weight(deep, shorter=False)[0, :, 0], [BOUND_WEIGHT, 1023 / 2047.5, 0])


def test_merge_by_hand():
    main = np.array([[[1.0], [1.0], [1.0], [1.0], [1.0]]], dtype=np.float32)
    auxiliary = np.array([[[4.0], [4.0], [4.0], [0.0], [4.0]]], dtype=np.float32)
    main_weight = np.array([[[1.0], [0.0], [0.75], [0.0], [1000.0]]], dtype=np.float32)
    auxiliary_weight = np.array([[[1.0], [0.1], [0.25], [0.0], [1.0]]], dtype=np.float32)
    merged, share = merge_views(main, auxiliary, main_weight, auxiliary_weight)
    np.testing.assert_allclose(share[0, :, 0], [0.5, 1, 0.25, 0, 0])
    # Geometric means; nothing known of the fourth; a negligible share leaves the fifth as it is.
    np.testing.assert_allclose(merged[0, :, 0], [2, 4, np.sqrt(2), 1, 1], rtol=1e-6)


@pytest.mark.parametrize("code", [0, 255])
@pytest.mark.parametrize("main_is_shorter", [True, False])
def test_of_two_clipped_codes_the_tighter_bound_counts(code, main_is_shorter):
    t_m, t_a = (1.0, 4.0) if main_is_shorter else (4.0, 1.0)
    photo = Photo(np.full((1, 1), code, np.uint8), 1.0)
    exposure = {0: 0.01, 255: 5.0}[code]
    views = [np.full((1, 1, 1), exposure / t, dtype=np.float32) for t in (t_m, t_a)]
    weights = [code_weight(photo, shorter=flag) for flag in (main_is_shorter, not main_is_shorter)]
    merged, _ = merge_views(*views, *weights)
    bounds = [view.item() for view in views]
    assert merged.item() == pytest.approx(max(bounds) if code else min(bounds))


@given(seed=st.integers(0, 100))
def test_a_merge_lies_between_the_views_and_keeps_the_main_view_without_a_share(seed):
    rng = np.random.default_rng(seed)
    main, auxiliary = np.exp(rng.uniform(-30, 30, (2, 3, 4, 3))).astype(np.float32)
    weights = (rng.random((2, 3, 4, 3)) * (rng.random((2, 3, 4, 3)) < 0.7)).astype(np.float32)
    merged, share = merge_views(main, auxiliary, *weights)
    kept = share == 0
    np.testing.assert_array_equal(merged[kept], main[kept])
    assert share[~kept].min(initial=1) >= NEGLIGIBLE_WEIGHT
    assert (merged >= np.minimum(main, auxiliary) * (1 - 1e-4))[~kept].all()
    assert (merged <= np.maximum(main, auxiliary) * (1 + 1e-4))[~kept].all()


def test_flags_by_hand():
    weight = np.array([[0.0, 0.0, 0.5, 1.0, 0.0]], dtype=np.float32)
    s = np.array([[False, True, False, True, True]])
    filled = np.array([[False, False, False, True, True]])
    expected = [
        SourceFlag.MEASURED,
        SourceFlag.NO_INFORMATION,
        SourceFlag.AUXILIARY,
        SourceFlag.FILLED_OCCLUDED,
        SourceFlag.NO_INFORMATION,
    ]
    np.testing.assert_array_equal(merge_flags(weight, exposure_map=s, filled=filled), [expected])
    assert merge_flags(weight, exposure_map=s)[0, 3] == SourceFlag.AUXILIARY
