"""High dynamic range images from a stereo pair whose two cameras were set to different exposures.

The public names below are loaded on first use, so that ``import stereohdr`` stays light.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from stereohdr.config import FuseConfig, PaperConfig, RobustConfig
    from stereohdr.errors import InputError, StereoHdrError, StereoHdrWarning
    from stereohdr.io import read_hdr, read_photo, write_hdr
    from stereohdr.model import (
        Disparity,
        DisparityFlag,
        HdrResult,
        Photo,
        ResponseCurve,
        SourceFlag,
        StereoPair,
    )
    from stereohdr.pipeline import fuse, fuse_other_view
    from stereohdr.tone_mapping import tonemap

_HOME = {
    "Disparity": "model",
    "DisparityFlag": "model",
    "FuseConfig": "config",
    "HdrResult": "model",
    "InputError": "errors",
    "PaperConfig": "config",
    "Photo": "model",
    "ResponseCurve": "model",
    "RobustConfig": "config",
    "SourceFlag": "model",
    "StereoHdrError": "errors",
    "StereoHdrWarning": "errors",
    "StereoPair": "model",
    "fuse": "pipeline",
    "fuse_other_view": "pipeline",
    "read_hdr": "io",
    "read_photo": "io",
    "tonemap": "tone_mapping",
    "write_hdr": "io",
}

__all__ = [
    "Disparity",
    "DisparityFlag",
    "FuseConfig",
    "HdrResult",
    "InputError",
    "PaperConfig",
    "Photo",
    "ResponseCurve",
    "RobustConfig",
    "SourceFlag",
    "StereoHdrError",
    "StereoHdrWarning",
    "StereoPair",
    "__version__",
    "fuse",
    "fuse_other_view",
    "read_hdr",
    "read_photo",
    "tonemap",
    "write_hdr",
]


def __getattr__(name: str) -> Any:
    if name not in _HOME:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOME[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
