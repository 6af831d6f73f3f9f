"""OpenCV, loaded when it is needed and not before."""

from __future__ import annotations

from typing import TYPE_CHECKING

from stereohdr.errors import MissingDependencyError

if TYPE_CHECKING:
    from types import ModuleType


def load_opencv(purpose: str) -> ModuleType:
    """Return the module ``cv2``.

    Parameters
    ----------
    purpose
        What needs it, the beginning of the message.

    Raises
    ------
    MissingDependencyError
        OpenCV is not installed.
    """
    try:
        import cv2  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingDependencyError(f"{purpose} needs OpenCV; install stereohdr[calib]") from error
    return cv2
