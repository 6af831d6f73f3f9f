import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from stereohdr.restoration import poisson_edit

from reference import restoration as twin


@given(
    seed=st.integers(0, 200), height=st.integers(2, 7), width=st.integers(2, 7), channels=st.sampled_from([1, 3])
)
def test_equals_a_dense_solve_of_the_definition(seed, height, width, channels):
    rng = np.random.default_rng(seed)
    kind = rng.integers(0, 3, (height, width))  # hole, valid, neither
    holes, valid = kind == 0, kind == 1
    main, filled = rng.random((2, height, width, channels)).astype(np.float32)
    got, unbounded = poisson_edit(filled, valid, holes, main)
    np.testing.assert_array_equal(got[unbounded], main[unbounded])
    assert not (unbounded & ~holes).any()
    solved = holes & ~unbounded
    expected = twin.poisson_edit(filled, valid, solved, main)
    np.testing.assert_allclose(got[solved], expected[solved], rtol=1e-4, atol=1e-5)
    rest = ~holes
    np.testing.assert_array_equal(got[rest], filled[rest])


def large_case(channels):
    """Views with ragged holes; radiance over four decades."""
    rng = np.random.default_rng(1)
    noise = ndimage.gaussian_filter(rng.standard_normal((40, 50)), 2)
    holes = noise > np.quantile(noise, 0.4)
    valid = ~holes & (rng.random(holes.shape) < 0.7)
    main, filled = (10 ** rng.uniform(-2, 2, (2, 40, 50, channels))).astype(np.float32)
    return filled, valid, holes, main


def test_a_large_hole_equals_a_dense_solve_to_rounding():
    filled, valid, holes, main = large_case(2)
    got, unbounded = poisson_edit(filled, valid, holes, main)
    solved = holes & ~unbounded
    assert solved.sum() > 1000
    expected = twin.poisson_edit(filled, valid, solved, main)
    largest = np.abs(filled - main)[valid].max()
    np.testing.assert_allclose(got[solved], expected[solved], rtol=1e-6, atol=2e-7 * largest)


def test_the_same_bytes_for_any_number_of_threads():
    case = large_case(3)
    one = poisson_edit(*case, threads=1)[0]
    for threads in (2, 3, None):
        assert one.tobytes() == poisson_edit(*case, threads=threads)[0].tobytes()


def test_an_offset_of_the_boundary_moves_the_main_views_texture():
    rng = np.random.default_rng(0)
    main = rng.random((12, 12, 3)).astype(np.float32)
    holes = np.zeros((12, 12), dtype=bool)
    holes[3:9, 3:9] = True
    edited, unbounded = poisson_edit(main + np.float32(2), ~holes, holes, main)
    np.testing.assert_allclose(edited, main + 2, atol=1e-5)
    assert not unbounded.any()


def test_a_flat_main_view_gives_a_membrane():
    filled = np.tile(np.linspace(0, 1, 9, dtype=np.float32)[None, :, None], (9, 1, 1))
    holes = np.zeros((9, 9), dtype=bool)
    holes[2:7, 2:7] = True
    broken = np.where(holes[..., None], np.float32(99), filled)
    edited, _ = poisson_edit(broken, ~holes, holes, np.zeros_like(filled))
    np.testing.assert_allclose(edited, filled, atol=1e-6)  # a linear ramp is its own membrane


def test_a_component_without_boundary_keeps_the_main_view():
    main = np.full((5, 9, 1), 0.3, dtype=np.float32)
    filled = np.ones_like(main)
    holes = np.zeros((5, 9), dtype=bool)
    holes[1:3, 1:3] = holes[:, 6:] = True
    valid = np.zeros_like(holes)
    valid[0, 1] = True
    edited, unbounded = poisson_edit(filled, valid, holes, main)
    assert unbounded[:, 6:].all()
    assert not unbounded[:, :6].any()
    np.testing.assert_array_equal(edited[:, 6:], main[:, 6:])
    np.testing.assert_allclose(edited[1:3, 1:3], 1.0, atol=1e-6)


def test_without_holes_nothing_changes():
    filled = np.random.default_rng(0).random((4, 4, 3)).astype(np.float32)
    none = np.zeros((4, 4), dtype=bool)
    edited, unbounded = poisson_edit(filled, ~none, none, filled * 2)
    np.testing.assert_array_equal(edited, filled)
    assert not unbounded.any()
