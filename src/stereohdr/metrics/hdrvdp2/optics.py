"""Scatter of light in the eye, and filtering in the frequency domain with a uniform surround."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

fft: Any = scipy.fft  # its functions are annotated with what they dispatch on, not with what they return

Transfer = Callable[[NDArray[np.float64]], NDArray[np.float64]]

_SCATTER_SHARES = (0.426, 0.574)
_WIDE_SHARE = 0.99727370023777070
_WIDE_SPLIT = 0.061466549455263
_SCATTER_TERMS = (
    (_SCATTER_SHARES[0] * _WIDE_SHARE, 0.028),
    (_SCATTER_SHARES[1] * _WIDE_SHARE, 0.37),
    ((1.0 - _WIDE_SHARE) * _WIDE_SPLIT, 37.0),
    ((1.0 - _WIDE_SHARE) * (1.0 - _WIDE_SPLIT), 360.0),
)
"""Amplitudes (their sum is 1) and decays in degrees."""

LUMINANCE_RANGE = (1e-5, 1e10)
"""What the retina image is clipped to, cd/m^2."""

_COLUMN_BLOCK = 32
"""Columns that are filtered together: few enough to stay in the processor's cache."""


def modulation_transfer(frequency: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the modulation transfer of the eye's optics at `frequency` in cycles per degree, 1 at 0."""
    total = np.zeros_like(frequency)
    for amplitude, decay in _SCATTER_TERMS:
        total += amplitude * np.exp(-decay * frequency)
    return total


@dataclass(frozen=True)
class SurroundFilter:
    """A filter for images of one size that stand in a uniform surround as large again."""

    spectrum: NDArray[np.float64]
    """Half spectrum (of `scipy.fft.rfft2`) of the kernel, real because the kernel is even."""
    columns: int
    """Columns of the Fourier transform that `spectrum` belongs to."""
    gain: float
    """Transfer of the frequency zero."""

    def apply(self, image: NDArray[np.float64], surround: float) -> NDArray[np.float64]:
        """Return the filtered image, ``(H, W)``; `surround` is the value around it."""
        height, width = image.shape
        # What differs from the surround is zero outside the image: only its own rows need a transform.
        half = fft.rfft(image - surround, n=self.columns, axis=1, overwrite_x=True)
        for start in range(0, half.shape[1], _COLUMN_BLOCK):
            block = slice(start, start + _COLUMN_BLOCK)
            spectrum = fft.fft(half[:, block], n=self.spectrum.shape[0], axis=0)
            spectrum *= self.spectrum[:, block]
            half[:, block] = fft.ifft(spectrum, axis=0, overwrite_x=True)[:height]
        filtered = fft.irfft(half, n=self.columns, axis=1, overwrite_x=True)[:, :width]
        return filtered + self.gain * surround


def surround_filter(shape: tuple[int, int], sampling: float, transfer: Transfer) -> SurroundFilter:
    """Make a filter from its transfer function.

    Parameters
    ----------
    shape
        Rows H and columns W of the images.
    sampling
        Samples per degree; the highest frequency is half of it.
    transfer
        Real gain at a frequency in cycles per degree.

    Notes
    -----
    The filter is defined as a product on the spectrum of a ``(2H, 2W)`` image with the surround in three of its
    quarters. That is a convolution in which no two distances within the image coincide, so its kernel can move
    to any transform of at least ``(2H - 1, 2W - 1)``, one whose lengths have small factors.
    """
    height, width = shape
    vertical = np.fft.fftfreq(2 * height, 1.0 / sampling)[:, None]
    horizontal = np.fft.rfftfreq(2 * width, 1.0 / sampling)[None, :]
    gains = transfer(np.hypot(vertical, horizontal))
    kernel = fft.irfft2(gains, s=(2 * height, 2 * width))
    rows, columns = (fft.next_fast_len(2 * size - 1, real=True) for size in shape)
    moved = np.zeros((rows, columns))
    for target_y, source_y in _distances(rows, 2 * height, height):
        for target_x, source_x in _distances(columns, 2 * width, width):
            moved[target_y, target_x] = kernel[source_y, source_x]
    return SurroundFilter(fft.rfft2(moved).real.copy(), columns, float(gains[0, 0]))


def _distances(target: int, source: int, size: int) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """Return where the distances 0 to size - 1, and those below 0, stand in periods of two lengths."""
    return (slice(size), slice(size)), (slice(target - size + 1, target), slice(source - size + 1, source))


@lru_cache(maxsize=2)
def scatter_filter(shape: tuple[int, int], pixels_per_degree: float) -> SurroundFilter:
    """Return the scatter of the eye for images of a size; the last two are kept, as scores come in series."""
    return surround_filter(shape, pixels_per_degree, modulation_transfer)


def scattered(image: NDArray[np.float64], pixels_per_degree: float, surround: float) -> NDArray[np.float64]:
    """Return the image on the retina, ``(H, W)`` in cd/m^2, of one linear channel."""
    height, width = image.shape
    retina = scatter_filter((height, width), pixels_per_degree).apply(image, surround)
    return np.clip(retina, *LUMINANCE_RANGE, out=retina)
