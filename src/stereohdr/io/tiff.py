"""Floating-point TIFF, ``.tif`` and ``.tiff``: linear 32-bit floats, losslessly compressed.

References
----------
Adobe, "TIFF revision 6.0"; "Adobe Photoshop TIFF technical note 3" (floating-point predictor).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import FileFormatError, StereoHdrWarning
from stereohdr.io.images import check_size
from stereohdr.io.notes import attributes_from_json, attributes_to_json

if TYPE_CHECKING:
    from numpy.typing import NDArray


MARK = "stereohdr"
"""Key of the attributes in ImageDescription."""


def encode_tiff(radiance: NDArray[np.float32], attributes: Mapping[str, Any] | None = None) -> bytes:
    """Encode ``(H, W, C)`` float32 as a TIFF with Deflate compression and floating-point predictor.

    The attributes go into ImageDescription, as JSON: ``{"stereohdr": {...}}``.
    """
    import tifffile

    file = BytesIO()
    tifffile.imwrite(
        file,
        radiance if radiance.shape[2] == 3 else radiance[..., 0],
        photometric="rgb" if radiance.shape[2] == 3 else "minisblack",
        compression="zlib",
        predictor=True,
        rowsperstrip=64,
        description=f'{{"{MARK}": {attributes_to_json(attributes)}}}' if attributes else None,
        software=str((attributes or {}).get("software", "stereohdr")).encode("ascii", "replace").decode(),
        metadata=None,
    )
    return file.getvalue()


def read_tiff(path: str | Path) -> tuple[NDArray[np.float32], dict[str, Any]]:
    """Read the first page of a floating-point TIFF, grey or RGB; alpha and further pages are left, with a notice.

    Returns
    -------
    image
        ``(H, W, C)`` float32, C 1 or 3, the numbers as they are stored.
    attributes
        What `encode_tiff` was given; empty for files of other programs.

    Raises
    ------
    FileFormatError
        Not a TIFF, damaged, or it holds integers (see `read_photo`) or another kind of image.
    """
    import tifffile

    try:
        with tifffile.TiffFile(path) as file:
            page: Any = file.pages.first
            _check_page(page, path)
            image = page.asarray()
            attributes = attributes_from_json(page.description).get(MARK)
            axes, count = page.axes, len(file.pages)
    except FileFormatError:
        raise
    except Exception as error:  # tifffile and its decoders raise nearly anything on damaged files
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(f"{path}: damaged or unsupported TIFF file ({reason}); get it again") from error
    if count > 1:
        warnings.warn(f"{path}: only the first of its {count} pages was read", StereoHdrWarning, stacklevel=2)
    if axes == "SYX":
        image = np.moveaxis(image, 0, -1)
    image = image if image.ndim == 3 else image[..., None]
    colours = 1 if image.shape[2] < 3 else 3
    if image.shape[2] > colours:
        warnings.warn(f"{path}: its alpha channel was dropped", StereoHdrWarning, stacklevel=2)
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and `read_hdr` refuses it
        image = np.ascontiguousarray(image[..., :colours], np.float32)
    return image, attributes if isinstance(attributes, dict) else {}


def _check_page(page: Any, path: str | Path) -> None:
    """Refuse what is no floating-point image, or claims to be larger than the file can hold."""
    import tifffile

    samples = page.samplesperpixel
    grey = page.photometric == tifffile.PHOTOMETRIC.MINISBLACK and samples in (1, 2)
    rgb = page.photometric == tifffile.PHOTOMETRIC.RGB and samples in (3, 4)
    if page.dtype is not None and page.dtype.kind != "f":
        raise FileFormatError(
            f"{path}: holds {page.dtype} codes, not radiance in floating point; give a photo to fuse or merge, or "
            f"get the HDR image"
        )
    if page.axes not in ("YX", "YXS", "SYX") or not (grey or rgb) or page.dtype is None:
        raise FileFormatError(
            f"{path}: a TIFF of shape {page.shape} with {samples} channel(s) is no grey or RGB image; save it so"
        )
    length = Path(path).stat().st_size
    check_size(path, page.imagelength, page.imagewidth, samples * page.dtype.itemsize, length)
    if page.is_tiled:  # whole tiles are allocated, too
        check_size(path, page.tilelength, page.tilewidth, samples * page.dtype.itemsize, length)
    missing = math.prod(page.chunked) - sum(count > 0 for count in page.databytecounts)
    if missing > 0:  # tifffile would fill them with zeros
        raise FileFormatError(
            f"{path}: damaged TIFF file: {missing} of its strips or tiles are missing; get it again"
        )
