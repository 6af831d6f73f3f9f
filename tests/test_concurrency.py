"""Several Python threads may fuse at the same time."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from stereohdr import fuse

from conftest import make_pair

THREADS, RUNS = 4, 20


def fused(number):
    """Fuse one of two small pairs, highlights or shadows; return all bytes of the result."""
    times = ((0.64, 0.04), (0.04, 0.64))[number % 2]
    result = fuse(make_pair(36, 60, times=times), METHODS[number % 3], threads=1 + number % 2)
    return result.radiance.tobytes() + result.source.tobytes() + result.weight.tobytes()


METHODS = ("robust", "paper", "robust")
CASES = 6


@pytest.mark.filterwarnings("ignore::stereohdr.StereoHdrWarning")
def test_concurrent_calls_give_the_same_bytes():
    expected = [fused(number) for number in range(CASES)]
    assert len(set(expected)) == 4
    numbers = [(thread + run) % CASES for run in range(RUNS) for thread in range(THREADS)]
    with ThreadPoolExecutor(THREADS) as pool:
        for number, result in zip(numbers, pool.map(fused, numbers), strict=True):
            assert result == expected[number], number
