"""Steerable pyramid with four orientations, built and collapsed.

Source: Simoncelli and Freeman (ICIP 1995), as matlabPyrTools' buildSpyr and reconSpyr: images mirrored without
their border pixel ("reflect1"), low-pass halved by taking every other sample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from stereohdr.metrics.hdrvdp2.sp3_filters import BANDS, FIRST_HIGH_PASS, FIRST_LOW_PASS, LOW_PASS

fft: Any = scipy.fft  # its functions are annotated with what they dispatch on, not with what they return

ORIENTATIONS = len(BANDS)

SMALLEST_SIDE = LOW_PASS.shape[0]
"""An image is split while both sides are at least this long."""

_MARGIN = LOW_PASS.shape[0] // 2
"""Mirrored pixels on each side: the reach of the largest kernel."""

Mapper = Callable[[Callable[..., Any], Iterable[Any]], Iterable[Any]]
"""`map`, or that of a pool of threads."""


def level_shapes(height: int, width: int) -> list[tuple[int, int]]:
    """Return the sizes of the oriented levels, finest first, and last that of the base band."""
    shapes = [(height, width)]
    remaining = (height, width)
    while min(remaining) >= SMALLEST_SIDE:
        remaining = (remaining[0] // 2, remaining[1] // 2)
        shapes.append((-(-shapes[-1][0] // 2), -(-shapes[-1][1] // 2)))
    return shapes


@dataclass(frozen=True)
class _LevelFilters:
    """Spectra of the kernels at the size of one level.

    The low- and high-pass kernels are even about their centre and the band kernels odd, so the former spectra
    are real and the latter imaginary; of these the arrays hold the imaginary part.
    """

    shape: tuple[int, int]
    padded: tuple[int, int]
    low_pass: NDArray[np.float64]
    bands: tuple[NDArray[np.float64], ...]

    def transform(self, plane: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the spectrum of the mirrored plane."""
        return fft.rfft2(np.pad(plane, _MARGIN, mode="reflect"), s=self.padded)

    def restore(self, spectrum: NDArray[np.complex128]) -> NDArray[np.float64]:
        """Return the plane of a spectrum, without the margin."""
        height, width = self.shape
        plane = fft.irfft2(spectrum, s=self.padded, overwrite_x=True)
        return plane[_MARGIN : _MARGIN + height, _MARGIN : _MARGIN + width]


@dataclass(frozen=True)
class SteerablePyramid:
    """Builds and collapses pyramids of images of one size.

    A pyramid is a list of bands, ``(planes, rows, columns)``: the high-pass residual (one plane), the oriented
    levels from fine to coarse (four planes each), the base band (one plane).
    """

    levels: tuple[_LevelFilters, ...]
    first_high_pass: NDArray[np.float64]
    first_low_pass: NDArray[np.float64]

    def build(self, image: NDArray[np.float64]) -> list[NDArray[np.float64]]:
        """Return the bands of an image."""
        finest = self.levels[0]
        spectrum = finest.transform(image)
        bands = [finest.restore(spectrum * self.first_high_pass)[None]]
        low = finest.restore(spectrum * self.first_low_pass)
        for level in self.levels:
            spectrum = level.transform(low)
            low = level.restore(spectrum * level.low_pass)[::2, ::2]
            spectrum *= -1j  # correlation: the conjugate of an imaginary spectrum
            bands.append(np.empty((ORIENTATIONS, *level.shape)))
            product = np.empty_like(spectrum)
            for plane, kernel in zip(bands[-1], level.bands, strict=True):
                plane[:] = level.restore(np.multiply(spectrum, kernel, out=product))
        bands.append(low[None].copy())
        return bands

    def collapse(self, bands: list[NDArray[np.float64]], *, map_planes: Mapper = map) -> NDArray[np.float64]:
        """Return the image of a pyramid; `map_planes` may transform planes in parallel."""
        low = bands[-1][0]
        for level, planes in zip(self.levels[::-1], bands[-2:0:-1], strict=True):
            spread = np.zeros(level.shape)
            spread[::2, ::2] = low
            spectra = list(map_planes(level.transform, [spread, *planes]))
            total = np.zeros_like(spectra[0])
            for spectrum, kernel in zip(spectra[1:], level.bands, strict=True):
                spectrum *= kernel
                total += spectrum
            total *= 1j
            spectra[0] *= level.low_pass
            total += spectra[0]
            low = level.restore(total)
        finest = self.levels[0]
        low_spectrum, high_spectrum = map_planes(finest.transform, [low, bands[0][0]])
        low_spectrum *= self.first_low_pass
        high_spectrum *= self.first_high_pass
        low_spectrum += high_spectrum
        return finest.restore(low_spectrum)


@lru_cache(maxsize=2)
def steerable_pyramid(height: int, width: int) -> SteerablePyramid:
    """Return the filters for images of a size, both sides at least `SMALLEST_SIDE`.

    The last two are kept, as scores come in series.
    """
    levels = []
    for shape in level_shapes(height, width)[:-1]:
        padded = _padded_shape(shape)
        bands = tuple(_centred_spectrum(kernel, padded).imag.copy() for kernel in BANDS)
        levels.append(_LevelFilters(shape, padded, _centred_spectrum(LOW_PASS, padded).real.copy(), bands))
    padded = _padded_shape((height, width))
    return SteerablePyramid(
        tuple(levels),
        _centred_spectrum(FIRST_HIGH_PASS, padded).real.copy(),
        _centred_spectrum(FIRST_LOW_PASS, padded).real.copy(),
    )


def _padded_shape(shape: tuple[int, int]) -> tuple[int, int]:
    height, width = (fft.next_fast_len(size + 2 * _MARGIN, real=True) for size in shape)
    return height, width


def _centred_spectrum(kernel: NDArray[np.float64], shape: tuple[int, int]) -> NDArray[np.complex128]:
    """Return the half spectrum of a kernel whose centre stands at the origin of a period of `shape`."""
    period = np.zeros(shape)
    period[: kernel.shape[0], : kernel.shape[1]] = kernel
    shift = (-(kernel.shape[0] // 2), -(kernel.shape[1] // 2))
    return fft.rfft2(np.roll(period, shift, axis=(0, 1)))
