"""Reading and writing HDR images; the suffix of the name says the format."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stereohdr.errors import FileFormatError, InputError
from stereohdr.io.exr import read_exr, write_exr
from stereohdr.io.files import atomic_path, check_output
from stereohdr.io.metadata import first_bytes
from stereohdr.io.pfm import decode_pfm, encode_pfm
from stereohdr.io.radiance_hdr import decode_radiance_hdr, encode_radiance_hdr

if TYPE_CHECKING:
    from numpy.typing import NDArray

HDR_SUFFIXES = (".exr", ".hdr", ".pfm", ".npy")
"""Formats that can be read and written: OpenEXR, Radiance, portable float map, NumPy."""


def read_hdr(path: str | Path) -> NDArray[np.float32]:
    """Read an HDR image from an OpenEXR, Radiance, PFM or NumPy file.

    Parameters
    ----------
    path
        Ends in one of `HDR_SUFFIXES`.

    Returns
    -------
    ``(H, W, C)`` float32, C 1 or 3. Radiance pictures always have three channels.

    Raises
    ------
    FileFormatError
        Unknown suffix; the file cannot be read, is damaged, has another shape, or holds NaN or infinity.
    """
    suffix = _suffix(path)
    first_bytes(path, 1)  # a missing file or a folder gets its own sentence
    if suffix == ".exr":
        image = read_exr(path)[0]
    elif suffix == ".npy":
        image = _read_npy(path)
    else:
        data = Path(path).read_bytes()
        image = decode_pfm(data, str(path)) if suffix == ".pfm" else decode_radiance_hdr(data, str(path))
    wrong = _first_and_count(~np.isfinite(image))
    if wrong:
        raise FileFormatError(f"{path}: holds {wrong} that are NaN or infinite; repair the file first")
    return image


def write_hdr(path: str | Path, radiance: NDArray[Any], *, attributes: Mapping[str, Any] | None = None) -> None:
    """Write an HDR image as OpenEXR, Radiance, PFM or NumPy file, whole or not at all.

    OpenEXR, PFM and NumPy keep every bit; Radiance keeps 8 bits per channel and stores grey as RGB. The same
    input gives the same bytes.

    Parameters
    ----------
    path
        Ends in one of `HDR_SUFFIXES`.
    radiance
        ``(H, W)``, ``(H, W, 1)`` or ``(H, W, 3)``, finite, >= 0; stored as float32.
    attributes
        Names to strings, numbers or sequences of numbers. OpenEXR keeps them (see `write_exr`), Radiance
        gets comment lines, the others ignore them.

    Raises
    ------
    InputError
        Wrong shape or type, a value that is negative or not finite in float32, or an attribute that OpenEXR
        cannot hold; nothing was written.
    FileFormatError
        Unknown suffix, or the file cannot be written.
    """
    suffix = check_hdr_path(path)
    image = _checked(path, radiance)
    if suffix == ".exr":
        write_exr(path, image, attributes)
        return
    with atomic_path(path) as temporary:
        if suffix == ".npy":
            with open(temporary, "wb") as file:  # given a name, np.save adds another suffix to .NPY
                np.save(file, image, allow_pickle=False)
        else:
            temporary.write_bytes(
                encode_pfm(image) if suffix == ".pfm" else encode_radiance_hdr(image, attributes)
            )


def check_hdr_path(path: str | Path) -> str:
    """Return the suffix, in lower case, of a name that `write_hdr` can write to.

    Called before anything is computed, so that a typing error does not cost a result.

    Raises
    ------
    FileFormatError
        The suffix is unknown, or the file cannot be written, see `check_output`.
    """
    suffix = _suffix(path)
    check_output(path)
    return suffix


def _suffix(path: str | Path) -> str:
    suffix = Path(path).suffix.lower()
    if suffix not in HDR_SUFFIXES:
        raise FileFormatError(
            f"{path}: {suffix or 'no suffix'} is not an HDR format; use {', '.join(HDR_SUFFIXES)}"
        )
    return suffix


def _checked(path: str | Path, radiance: NDArray[Any]) -> NDArray[np.float32]:
    given = np.asarray(radiance)
    if given.dtype.kind not in "fiu" or not _is_image_shape(given.shape):
        raise InputError(
            f"{path}: radiance must be real numbers of shape (H, W), (H, W, 1) or (H, W, 3), got {given.dtype} "
            f"{given.shape}"
        )
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite and is reported as such
        image = given.astype(np.float32, copy=False)
    image = image if image.ndim == 3 else image[..., None]
    wrong = _first_and_count(~(np.isfinite(image) & (image >= 0)))
    if wrong:
        raise InputError(f"{path}: not written: {wrong} that are NaN, infinite in float32, or negative")
    return image


def _read_npy(path: str | Path) -> NDArray[np.float32]:
    try:
        # Mapped, because np.load would otherwise allocate whatever the header promises.
        mapped = np.load(path, mmap_mode="r", allow_pickle=False)
    except Exception as error:  # a damaged header raises nearly anything, even SyntaxError
        reason = " ".join(str(error).split()) or type(error).__name__
        raise FileFormatError(f"{path}: not a readable NumPy file ({reason}); get it again") from error
    if not isinstance(mapped, np.ndarray) or mapped.dtype.kind not in "fiu" or not _is_image_shape(mapped.shape):
        found = f"{mapped.dtype} {mapped.shape}" if isinstance(mapped, np.ndarray) else "an archive"
        raise FileFormatError(
            f"{path}: expected numbers of shape (H, W), (H, W, 1) or (H, W, 3), found {found}; save it so"
        )
    with np.errstate(over="ignore"):  # what float32 cannot hold becomes infinite, and `read_hdr` refuses it
        image = np.array(mapped, dtype=np.float32, order="C")
    return image if image.ndim == 3 else image[..., None]


def _is_image_shape(shape: tuple[int, ...]) -> bool:
    return 0 not in shape and (len(shape) == 2 or (len(shape) == 3 and shape[2] in (1, 3)))


def _first_and_count(wrong: NDArray[np.bool_]) -> str:
    """Return ``"n of m values (first at row y, column x, channel c)"``, empty when nothing is wrong."""
    count = int(np.count_nonzero(wrong))
    if count == 0:
        return ""
    y, x, channel = np.unravel_index(int(np.argmax(wrong)), wrong.shape)
    return f"{count} of {wrong.size} values (first at row {y}, column {x}, channel {channel})"
