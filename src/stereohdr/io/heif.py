"""HEIC and AVIF, the formats of phones."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import MissingDependencyError

_AV1_DEPTHS = {0x40: 10, 0x60: 12}
"""Bits per sample by the flags ``high_bitdepth`` and ``twelve_bit`` of the AV1 configuration property."""


def read_heif(path: str | Path) -> tuple[NDArray[Any], int]:
    """Decode the primary picture of a HEIC file; return ``(H, W)`` or ``(H, W, S)`` codes, and their white level.

    The decoder has turned the picture upright.

    Raises
    ------
    MissingDependencyError
        pillow-heif is not installed.
    """
    # 10 and 12 bits stay as they are instead of being stretched to 16.
    image = _pillow_heif().open_heif(path, convert_hdr_to_8bit=False, hdr_to_16bit=False)
    # A copy: a view would outlive the decoder's buffer.
    return np.array(image), 2 ** int(image.info.get("bit_depth", 8)) - 1


def heif_metadata(path: str | Path) -> tuple[bytes | None, bytes | None]:
    """Return the EXIF block and the ICC profile of a HEIC file, None for what it does not have."""
    info = _pillow_heif().open_heif(path).info
    return info.get("exif"), info.get("icc_profile")


def read_avif(path: str | Path) -> tuple[NDArray[Any], int]:
    """Decode an AVIF file; return ``(H, W)`` or ``(H, W, S)`` codes, not yet upright, and their white level."""
    import imagecodecs

    data = Path(path).read_bytes()
    codes = imagecodecs.avif_decode(data, index=0)
    if codes.dtype == np.uint8:
        return codes, 255
    flags = data[data.find(b"av1C") + 6] & 0x60
    return codes, 2 ** _AV1_DEPTHS.get(flags, 16) - 1


def _pillow_heif() -> ModuleType:
    try:
        import pillow_heif
    except ImportError as error:
        raise MissingDependencyError(
            "HEIC photos need pillow-heif; install stereohdr[heif], or convert the photos to JPEG or PNG"
        ) from error
    return pillow_heif
