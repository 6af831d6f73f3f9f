"""Interest regions: where the main view needs help, and where the auxiliary view may give it (Figure 6)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def main_interest(segments: NDArray[np.int32], exposure_map: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return all pixels of the main view's segments that contain a pixel of S, ``(H, W)`` bool."""
    touched = np.zeros(int(segments.max()) + 1, dtype=bool)
    touched[segments[exposure_map]] = True
    return touched[segments]


def auxiliary_interest(main: NDArray[np.bool_], *, max_disparity: int) -> NDArray[np.bool_]:
    """Return the auxiliary pixels that can correspond to an interest pixel of the main view.

    Parameters
    ----------
    main
        ``(H, W)`` bool, interest region of the main view.
    max_disparity
        d_max in pixels: ``x_auxiliary = x_main - d`` with ``0 <= d <= d_max``.

    Returns
    -------
    ``(H, W)`` bool: `main` widened to the left by `max_disparity`.
    """
    before = np.zeros((main.shape[0], main.shape[1] + 1), dtype=np.int32)
    np.cumsum(main, axis=1, out=before[:, 1:])
    last = np.minimum(np.arange(main.shape[1]) + max_disparity + 1, main.shape[1])
    return before[:, last] > before[:, :-1]
