"""The methods by name. Each is one short file that composes stages.

Another package adds a method through the entry point group ``stereohdr.methods``: the entry point names a
`Method`.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Protocol

from stereohdr.config import (
    Baetz2014Config,
    FuseConfig,
    Lin2009Config,
    OpencvConfig,
    OracleConfig,
    PaperConfig,
    RobustConfig,
    Sun2010Config,
)
from stereohdr.errors import ConfigError
from stereohdr.model import Disparity, HdrResult, ResponseCurve, StereoPair
from stereohdr.stage_log import StageLog

ENTRY_POINT_GROUP = "stereohdr.methods"


class MethodFunction(Protocol):
    """Fuse a checked pair whose main view is the left one."""

    def __call__(
        self,
        pair: StereoPair,
        config: FuseConfig,
        /,
        *,
        response: ResponseCurve | None,
        disparity: Disparity | None,
        log: StageLog,
        threads: int | None,
    ) -> HdrResult:
        """Return the result without versions, timings and warnings, which `stereohdr.fuse` adds."""
        ...


@dataclass(frozen=True)
class Method:
    """A way to fuse a pair."""

    name: str
    """What ``--method`` and ``fuse(method=...)`` call it."""
    summary: str
    """One line for help texts."""
    config_type: type[FuseConfig]
    """Its configuration dataclass."""
    function: str
    """Where the code is, ``"module:function"``; loaded when the method is used."""
    takes_memory: bool = False
    """Whether the function takes ``memory``, a `stereohdr.memory.Budget`, and keeps to it or refuses."""
    pixel_bytes: int = 0
    """Of other methods: memory per pixel at most, beside the photos; 0 if unknown, and nothing is refused."""
    cell_bytes: int = 0
    """The same per pixel and disparity; the larger of the two counts."""

    def load(self) -> MethodFunction:
        """Import and return the function."""
        module, _, name = self.function.partition(":")
        return getattr(importlib.import_module(module), name)


BUILT_IN = {
    method.name: method
    for method in (
        Method(
            "robust",
            "our own, the default: the paper's stages, each in a form that holds where one view sees little",
            RobustConfig,
            "stereohdr.methods.robust:fuse_robust",
            takes_memory=True,
        ),
        Method(
            "paper",
            "Park et al., Sensors 2017, to the letter",
            PaperConfig,
            "stereohdr.methods.paper:fuse_paper",
            pixel_bytes=320,
        ),
        Method(
            "mv-only",
            "the main view alone, for comparison",
            FuseConfig,
            "stereohdr.methods.mv_only:fuse_mv_only",
            pixel_bytes=80,
        ),
        Method(
            "opencv",
            "what one would script with OpenCV: SGBM, warp, Debevec merge (needs the extra opencv)",
            OpencvConfig,
            "stereohdr.methods.opencv:fuse_opencv",
            pixel_bytes=140,
        ),
        Method(
            "lin2009",
            "Lin and Chang 2009, a stand-in: the original's inner details are not public",
            Lin2009Config,
            "stereohdr.methods.lin2009:fuse_lin2009",
            pixel_bytes=200,
            cell_bytes=6,
        ),
        Method(
            "sun2010",
            "Sun, Mansour and Ward 2010, a stand-in: the original's inner details are not public",
            Sun2010Config,
            "stereohdr.methods.sun2010:fuse_sun2010",
            pixel_bytes=180,
        ),
        Method(
            "baetz2014",
            "Baetz et al. 2014, a stand-in: the original's inner details are not public",
            Baetz2014Config,
            "stereohdr.methods.baetz2014:fuse_baetz2014",
            pixel_bytes=210,
        ),
        Method(
            "oracle",
            "the paper's fusion of a known disparity, for comparison",
            OracleConfig,
            "stereohdr.methods.oracle:fuse_oracle",
            pixel_bytes=320,
        ),
    )
}


def available_methods() -> tuple[str, ...]:
    """Return the names of all methods, built in first."""
    added = sorted(entry.name for entry in entry_points(group=ENTRY_POINT_GROUP))
    return (*BUILT_IN, *(name for name in added if name not in BUILT_IN))


def get_method(name: str) -> Method:
    """Return the method of this name.

    Raises
    ------
    ConfigError
        There is none; the message lists what there is.
    """
    if not isinstance(name, str):
        raise ConfigError(f"a method is given by its name, got a {type(name).__name__}")
    if name in BUILT_IN:
        return BUILT_IN[name]
    for entry in entry_points(group=ENTRY_POINT_GROUP):
        if entry.name == name:
            return entry.load()
    raise ConfigError(f"unknown method {name!r}; known are {', '.join(available_methods())}")
