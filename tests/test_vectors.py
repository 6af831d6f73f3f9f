import numba
import numpy as np
import pytest

from stereohdr import vectors
from stereohdr.vectors import (
    choose,
    count_bits,
    first_lane,
    lane_numbers,
    less,
    load,
    narrow,
    smallest,
    splat,
    store,
)
from stereohdr.vectors import widen as widen_lanes

LANES = vectors.LANES


def numbers(dtype, seed=0):
    """Random numbers, many of them extreme or equal."""
    rng = np.random.default_rng(seed)
    top = np.iinfo(dtype).max
    values = rng.integers(0, top, LANES, dtype=dtype, endpoint=True)
    values[rng.random(LANES) < 0.3] = rng.choice(np.array([0, 1, 7, top], dtype))
    return values


def of_two(operation):
    @numba.njit
    def apply(a, b, out):
        store(out, 0, operation(load(a, 0), load(b, 0)))

    return apply


OPERATIONS = {
    "add": np.add,
    "subtract": np.subtract,
    "multiply": np.multiply,
    "bit_and": np.bitwise_and,
    "bit_or": np.bitwise_or,
    "bit_xor": np.bitwise_xor,
    "minimum": np.minimum,
    "add_saturating": lambda a, b: np.minimum(a.astype(int) + b, np.iinfo(a.dtype).max).astype(a.dtype),
}


@pytest.mark.parametrize("name", OPERATIONS)
def test_operations_of_two_vectors_equal_numpy(name):
    function = of_two(getattr(vectors, name))
    for dtype in (np.uint8, np.uint16):
        a, b = numbers(dtype, 1), numbers(dtype, 2)
        out = np.empty_like(a)
        function(a, b, out)
        np.testing.assert_array_equal(out, OPERATIONS[name](a, b))


def test_shifts_equal_numpy():
    a = numbers(np.uint16)
    by = (np.arange(LANES) % 16).astype(np.uint16)
    out = np.empty_like(a)
    of_two(vectors.shift_left)(a, by, out)
    np.testing.assert_array_equal(out, a << by)
    of_two(vectors.shift_right)(a, by, out)
    np.testing.assert_array_equal(out, a >> by)


@numba.njit
def everything_else(small, words, index, wide, narrow_words, bits, chosen):
    store(wide, 0, widen_lanes(load(small, 0)))
    store(narrow_words, 0, narrow(load(words, 0)))
    store(bits, 0, narrow(count_bits(load(words, 0))))
    lanes = lane_numbers()
    limit = splat(np.uint16(index))
    store(chosen, 0, choose(less(lanes, limit), lanes, limit))
    return smallest(load(small, 0)), first_lane(less(limit, lanes))


@pytest.mark.parametrize("index", [0, 5, 30, 31])
def test_conversions_selections_and_reductions(index):
    small, words = numbers(np.uint8) | 2, numbers(np.uint64)
    wide, chosen = np.empty((2, LANES), np.uint16)
    narrow_words, bits = np.empty((2, LANES), np.uint8)
    least, first = everything_else(small, words, index, wide, narrow_words, bits, chosen)
    np.testing.assert_array_equal(wide, small)
    np.testing.assert_array_equal(narrow_words, words & 255)
    np.testing.assert_array_equal(bits, [int(word).bit_count() for word in words])
    np.testing.assert_array_equal(chosen, np.minimum(np.arange(LANES), index))
    assert least == small.min()
    assert first == (index + 1 if index < LANES - 1 else LANES)


def test_load_and_store_begin_at_any_element():
    @numba.njit
    def copy(source, target):
        store(target, 5, load(source, 3))

    source = np.arange(40, dtype=np.uint8)
    target = np.zeros(40, dtype=np.uint8)
    copy(source, target)
    np.testing.assert_array_equal(target, [0] * 5 + list(range(3, 35)) + [0] * 3)
