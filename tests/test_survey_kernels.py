import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import survey
from stereohdr.survey import joint_counts

from conftest import smooth_codes
from reference import survey as twin


@given(
    seed=st.integers(0, 999),
    height=st.integers(1, 20),
    width=st.integers(1, 20),
    channels=st.sampled_from([1, 3]),
    smooth=st.booleans(),
)
def test_flat_places_are_those_of_the_twin(seed, height, width, channels, smooth):
    rng = np.random.default_rng(seed)
    codes = (
        smooth_codes(rng, height, width, channels) if smooth else rng.uniform(0, 255, (height, width, channels))
    )
    codes = codes.astype(np.float32)
    gradient = twin.log_gradient(codes)
    flat = survey._flat(codes, threads=1)
    clear = np.abs(gradient - survey.FLAT_GRADIENT) > 1e-5
    np.testing.assert_array_equal(flat[clear], (gradient < survey.FLAT_GRADIENT)[clear])


def test_strips_and_threads_do_not_change_what_is_flat(monkeypatch):
    codes = smooth_codes(np.random.default_rng(1), 50, 30).astype(np.float32)
    whole = survey._flat(codes, threads=1)
    monkeypatch.setattr(survey, "STRIP_ROWS", 7)
    np.testing.assert_array_equal(survey._flat(codes, threads=3), whole)
    assert 0 < whole.mean() < 1


@given(
    seed=st.integers(0, 999), height=st.integers(1, 4), width=st.integers(1, 12), channels=st.sampled_from([1, 3])
)
def test_joint_counts_equal_the_twin(seed, height, width, channels):
    rng = np.random.default_rng(seed)
    main, auxiliary = rng.choice(np.array([0, 3, 255], np.uint8), (2, height, width, channels))
    disparity = (rng.integers(-8, 24, (height, width)) / 4).astype(np.float32)
    used = rng.random((2, height, width)) < 0.8
    got = joint_counts(main, auxiliary, disparity, *used)
    np.testing.assert_array_equal(got, twin.joint_counts(main, auxiliary, disparity, *used))
