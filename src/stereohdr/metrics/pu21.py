"""PU21: a perceptually uniform encoding of absolute luminance, with PSNR and SSIM on it.

References
----------
Mantiuk and Azimi 2021, "PU21: A novel perceptually uniform encoding for adapting existing quality metrics for
HDR", Picture Coding Symposium, doi:10.1109/PCS50896.2021.9477471.
Wang, Bovik, Sheikh and Simoncelli 2004, "Image quality assessment: from error visibility to structural
similarity", doi:10.1109/TIP.2003.819861.
"""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from stereohdr.errors import ConfigError, InputError
from stereohdr.radiance import luminance

Variant = Literal["banding", "banding_glare", "peaks", "peaks_glare"]

COEFFICIENTS: dict[str, tuple[float, ...]] = {
    "banding": (1.070275272, 0.4088273932, 0.153224308, 0.2520326168, 1.063512885, 1.14115047, 521.4527484),
    "banding_glare": (
        0.353487901,
        0.3734658629,
        8.277049286e-05,
        0.9062562627,
        0.09150303166,
        0.9099517204,
        596.3148142,
    ),
    "peaks": (1.043882782, 0.6459495343, 0.3194584211, 0.374025247, 1.114783422, 1.095360363, 384.9217577),
    "peaks_glare": (
        816.885024,
        1479.463946,
        0.001253215609,
        0.9329636822,
        0.06746643971,
        1.573435413,
        419.6006374,
    ),
}
"""p1 to p7 of the encoding, as published with the paper."""

LUMINANCE_RANGE = (0.005, 10000.0)
"""cd/m2; luminance is clipped to it."""

PEAK = 256.0
"""PU21 of 100 cd/m2 by design of the encoding, the white of a standard display: the peak of PSNR and SSIM."""

SSIM_SIGMA = 1.5
"""Sigma of the SSIM window in pixels; the window is 11x11."""


def pu21_encode(luminance: NDArray[Any], *, variant: Variant = "banding_glare") -> NDArray[np.float64]:
    """Encode absolute luminance.

    Parameters
    ----------
    luminance
        cd/m2, any shape; clipped to 0.005..10000.
    variant
        Which published fit.

    Returns
    -------
    float64 of the same shape, 0 at 0.005 cd/m2, about 256 at 100 cd/m2.

    Notes
    -----
    Source: Mantiuk and Azimi 2021, equation 3:
    ``p7 (((p1 + p2 Y^p4) / (1 + p3 Y^p4))^p5 - p6)``, not below 0.
    """
    if variant not in get_args(Variant):
        raise ConfigError(f"unknown PU21 variant {variant!r}; use {', '.join(get_args(Variant))}")
    p1, p2, p3, p4, p5, p6, p7 = COEFFICIENTS[variant]
    power = np.clip(np.asarray(luminance, dtype=np.float64), *LUMINANCE_RANGE) ** p4
    return np.maximum(p7 * (((p1 + p2 * power) / (1 + p3 * power)) ** p5 - p6), 0.0)


def pu21_psnr(test: NDArray[Any], reference: NDArray[Any], *, variant: Variant = "banding_glare") -> float:
    """Return the PSNR of the PU21-encoded luminances in dB; infinite for equal ones.

    Parameters
    ----------
    test, reference
        ``(H, W, C)``, absolute, cd/m2; RGB with BT.709 primaries counts by its luminance.
    variant
        Which published fit.
    """
    _check_shapes(test, reference)
    encoded_test, encoded_reference = (_encoded_luminance(i, variant) for i in (test, reference))
    error = encoded_test - encoded_reference
    mean_square = float(np.mean(error**2))
    return float("inf") if mean_square == 0 else 10 * float(np.log10(PEAK**2 / mean_square))


def pu21_ssim(test: NDArray[Any], reference: NDArray[Any], *, variant: Variant = "banding_glare") -> float:
    """Return the mean SSIM of the PU21-encoded luminances, at most 1.

    Parameters
    ----------
    test, reference
        ``(H, W, C)``, absolute, cd/m2.
    variant
        Which published fit.

    Notes
    -----
    Source: Wang et al. 2004 with an 11x11 Gaussian window of sigma 1.5, K1 = 0.01, K2 = 0.03, dynamic range 256;
    the border of five pixels, where the window leaves the image, does not count in images larger than it.
    """
    _check_shapes(test, reference)
    x, y = (_encoded_luminance(image, variant) for image in (test, reference))

    def local_mean(image: NDArray[np.float64]) -> NDArray[np.float64]:
        return ndimage.gaussian_filter(image, SSIM_SIGMA, radius=5, mode="reflect")

    mean_x, mean_y = local_mean(x), local_mean(y)
    variance_x = local_mean(x * x) - mean_x**2
    variance_y = local_mean(y * y) - mean_y**2
    covariance = local_mean(x * y) - mean_x * mean_y
    c1, c2 = (0.01 * PEAK) ** 2, (0.03 * PEAK) ** 2
    similarity = ((2 * mean_x * mean_y + c1) * (2 * covariance + c2)) / (
        (mean_x**2 + mean_y**2 + c1) * (variance_x + variance_y + c2)
    )
    if min(x.shape[:2]) > 10:
        similarity = similarity[5:-5, 5:-5]
    return float(similarity.mean())


def _encoded_luminance(image: NDArray[Any], variant: Variant) -> NDArray[np.float64]:
    return pu21_encode(luminance(image), variant=variant)


def _check_shapes(test: NDArray[Any], reference: NDArray[Any]) -> None:
    if test.shape != reference.shape or test.ndim != 3:
        raise InputError(f"cannot compare images of shapes {test.shape} and {reference.shape}")
