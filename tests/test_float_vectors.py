import numpy as np
import pytest

from stereohdr import float_vectors as v
from stereohdr.kernels import kernel

ROWS = 11


@kernel
def use_all(values, out):
    """Write what the functions give for the first two vectors of `values`."""
    source, target = v.pointer(values, 0), v.pointer(out, 0)
    a, b = v.load(source, 0), v.load(source, v.LANES)
    results = (
        a + b,
        a - b,
        a * b,
        a / b,
        v.larger(a, b),
        v.where_positive(a, a, b),
        v.even_lanes(a, b),
        v.odd_lanes(a, b),
        v.first_zipped(a, b),
        v.last_zipped(a, b),
        v.splat(values[3]),
    )
    for row, result in enumerate(results):
        v.store(target, row * v.LANES, result)
    return v.total(a), v.largest(b)


@pytest.mark.parametrize("seed", range(5))
def test_every_function_equals_numpy(seed):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=2 * v.LANES).astype(np.float32)
    out = np.full((ROWS + 1) * v.LANES, 99, dtype=np.float32)
    total, largest = use_all(values, out)
    a, b = np.split(values, 2)
    both = np.concatenate([a, b])
    zipped = np.stack([a, b], axis=1).reshape(-1)
    expected = [a + b, a - b, a * b, a / b, np.maximum(a, b), np.where(a > 0, a, b), both[::2], both[1::2]]
    expected += [zipped[: v.LANES], zipped[v.LANES :], np.full(v.LANES, values[3])]
    for got, wanted in zip(out.reshape(-1, v.LANES), expected, strict=False):
        np.testing.assert_array_equal(got, wanted)
    assert (out[ROWS * v.LANES :] == 99).all()
    in_order = 0.0
    for value in a.astype(np.float64):
        in_order += value
    assert total == in_order
    assert largest == b.max()


def test_larger_takes_the_second_where_one_is_not_a_number():
    values = np.full(2 * v.LANES, np.nan, dtype=np.float32)
    values[v.LANES :] = 2
    out = np.zeros((ROWS + 1) * v.LANES, dtype=np.float32)
    use_all(values, out)
    assert (out.reshape(-1, v.LANES)[4] == 2).all()
    assert (out.reshape(-1, v.LANES)[5] == 2).all()  # a number that is not one is not positive
