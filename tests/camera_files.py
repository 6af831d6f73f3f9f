"""Files as cameras write them, made small: DNG (sensor mosaics with the tags that LibRaw needs), Bayer TIFF."""

from pathlib import Path

import numpy as np
import tifffile

COLOURS = {"R": 0, "G": 1, "B": 2}

NEUTRAL = (0.5, 1.0, 0.625)
"""What a neutral grey gives on the sensor: white balance gains 2, 1, 1.6."""

MATRIX = (1.2, -0.3, -0.1, -0.4, 1.3, 0.1, 0.0, 0.1, 0.7)
"""From XYZ to camera RGB (DNG ColorMatrix1)."""


def bayer_mosaic(rgb: np.ndarray, pattern: str) -> np.ndarray:
    """Sample (H, W, 3) as a sensor with the given 2x2 cell does."""
    height, width, _ = rgb.shape
    cell = np.array([COLOURS[letter] for letter in pattern]).reshape(2, 2)
    channel = np.tile(cell, (height // 2 + 1, width // 2 + 1))[:height, :width]
    return np.take_along_axis(rgb, channel[..., None], axis=2)[..., 0]


def write_dng(
    path: Path,
    samples: np.ndarray,
    *,
    pattern: str = "RGGB",
    black: int | tuple[int, ...] = 0,
    white: int = 4095,
    camera: tuple[str, str] = ("Acme", "Acme One"),
    exposure: tuple[int, int] | None = (1, 60),
    f_number: tuple[int, int] = (28, 10),
    iso: int = 200,
    orientation: int = 1,
) -> Path:
    """Write a mosaic (H, W) or linear RGB (H, W, 3) as DNG; `pattern` lists a square cell, row by row."""
    side = round(len(pattern) ** 0.5)
    tags = [
        (271, 2, 0, camera[0], True),
        (272, 2, 0, camera[1], True),
        (274, 3, 1, orientation, True),
        (33437, 5, 1, f_number, True),
        (34855, 3, 1, iso, True),
        (50706, 1, 4, bytes((1, 4, 0, 0)), True),
        (50707, 1, 4, bytes((1, 1, 0, 0)), True),
        (50708, 2, 0, camera[1], True),
        (50717, 4, 1, white, True),
        (50721, 10, 9, _rationals(MATRIX), True),
        (50728, 5, 3, _rationals(NEUTRAL), True),
        (50778, 3, 1, 21, True),
    ]
    if exposure is not None:
        tags.append((33434, 5, 1, exposure, True))
    if samples.ndim == 2:
        tags.append((33421, 3, 2, (side, side), True))
        tags.append((33422, 1, len(pattern), bytes(COLOURS[letter] for letter in pattern), True))
    if isinstance(black, tuple):
        tags += [(50713, 3, 2, (2, 2), True), (50714, 4, 4, black, True)]
    else:
        tags.append((50714, 4, 1, black, True))
    kind = {"photometric": "cfa"} if samples.ndim == 2 else {"photometric": "linear_raw", "planarconfig": "contig"}
    tifffile.imwrite(path, samples, metadata=None, extratags=sorted(tags), subfiletype=0, **kind)
    return path


def write_bayer_tiff(path: Path, mosaic: np.ndarray, colours: bytes | None, *, repeat=(2, 2)) -> Path:
    """Write a mosaic as TIFF/EP does, not as DNG; `colours` are the codes of the CFAPattern tag."""
    tags = []
    if colours is not None:
        tags = [(33421, 3, 2, repeat, True), (33422, 1, len(colours), colours, True)]
    tifffile.imwrite(path, mosaic, photometric="cfa", metadata=None, extratags=tags)
    return path


def _rationals(values: tuple[float, ...]) -> tuple[int, ...]:
    return tuple(number for value in values for number in (round(value * 10000), 10000))
