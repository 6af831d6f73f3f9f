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


@kernel
def use_integers(numbers, labels, label, values, out):
    """Write the numbers from the second on, and the values where the labels from the second on are `label`."""
    target = v.pointer(out, 0)
    v.store(target, 0, v.load_bytes(v.pointer(numbers, 0), 1))
    kept = v.where_labelled(v.pointer(labels, 0), 1, label, v.load(v.pointer(values, 0), 0))
    v.store(target, v.LANES, kept)
    return v.any_positive(kept)


@pytest.mark.parametrize("label", [-1, 0, 2, 2**31 - 1])
def test_bytes_and_labels_equal_numpy(label):
    rng = np.random.default_rng(4)
    numbers = rng.permutation(np.arange(256, dtype=np.uint8))
    labels = rng.integers(-1, 3, v.LANES + 1).astype(np.int32)
    values = rng.normal(size=v.LANES).astype(np.float32)
    out = np.full(2 * v.LANES, np.nan, dtype=np.float32)
    found = use_integers(numbers, labels, np.int32(label), values, out)
    np.testing.assert_array_equal(out[: v.LANES], numbers[1 : v.LANES + 1])
    expected = np.where(labels[1:] == label, values, 0)
    np.testing.assert_array_equal(out[v.LANES :], expected)
    assert found == (expected > 0).any()
