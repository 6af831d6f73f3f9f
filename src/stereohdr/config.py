"""Configuration: frozen dataclasses, one per stage, and one per method built from them.

Every field has a docstring with its meaning, unit, range and source. A TOML file sets the fields by name::

    max_disparity = 120

    [exposure_map]
    over_threshold = 245
"""

from __future__ import annotations

import tomllib
import typing
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar

from stereohdr.errors import ConfigError

ConfigT = TypeVar("ConfigT")


def _require(condition: bool, name: str, value: object, accepted: str) -> None:
    if not condition:
        raise ConfigError(f"{name} must be {accepted}, got {value!r}")


def _either(choices: tuple[str, ...]) -> str:
    """Return the choices as a message lists them."""
    return " or ".join(repr(choice) for choice in choices)


def _require_number(name: str, value: float, low: float, high: float) -> None:
    _require(low <= value <= high, name, value, f"from {low:g} to {high:g}")  # False for NaN, too


def _require_whole(name: str, value: int, low: int, high: int) -> None:
    whole = isinstance(value, int) and not isinstance(value, bool)
    _require(whole and low <= value <= high, name, value, f"a whole number from {low} to {high}")


ResponseSamples = Literal["cdf", "sift"]
"""How codes of equal radiance are found in the two views."""


@dataclass(frozen=True)
class ResponseConfig:
    """Response from sample pairs of the two views (paper section 2.1), solved after Debevec and Malik 1997."""

    samples: ResponseSamples = "cdf"
    """``cdf``: codes of equal cumulative frequency, the paper's choice. ``sift``: codes at matched SIFT features,
    the "conventional ICRF" of its Table 2; needs scikit-image."""
    smoothness: float = 20.0
    """Weight lambda of the second-difference rows, 0.001 to 1e6. Not given in the paper; our choice."""

    def __post_init__(self) -> None:
        choices = typing.get_args(ResponseSamples)
        _require(self.samples in choices, "response.samples", self.samples, _either(choices))
        _require_number("response.smoothness", self.smoothness, 1e-3, 1e6)


@dataclass(frozen=True)
class PolynomialResponseConfig:
    """Response as a gamma curve times the exponential of a polynomial, fitted to matched pixels."""

    degree: int = 3
    """Degree of the polynomial, 0 to 6; 0 is a gamma curve. Our choice."""
    initial_gamma: float = 2.2
    """Exponent of the gamma curve that the first matching assumes, 0.1 to 10."""

    def __post_init__(self) -> None:
        _require_whole("response.degree", self.degree, 0, 6)
        _require_number("response.initial_gamma", self.initial_gamma, 0.1, 10)


@dataclass(frozen=True)
class ExposureMapConfig:
    """Under- and over-exposed map S (equation 1)."""

    under_threshold: float = 5.0
    """tau_u: luminance codes below it are under-exposed; 8-bit codes, 0..255."""
    over_threshold: float = 250.0
    """tau_o: luminance codes above it are over-exposed; 8-bit codes, 0..255."""

    def __post_init__(self) -> None:
        _require(
            0 <= self.under_threshold < self.over_threshold <= 255,
            "exposure_map.under_threshold, over_threshold",
            (self.under_threshold, self.over_threshold),
            "0 <= under < over <= 255",
        )


@dataclass(frozen=True)
class LatticeConfig:
    """Super-pixel lattice (Moore et al. 2008, reference 20 of the paper)."""

    pitch: int = 6
    """Distance of the nominal lattice lines in pixels ("strip size"), 2 to 1000."""
    tolerance: int = 4
    """How far a path may leave its nominal line, in pixels ("energy tolerance"), 0 to 127, below the pitch."""
    smoothing_sigma: float = 1.0
    """Sigma of the Gaussian before the Sobel filter, pixels, 0 to 100."""

    def __post_init__(self) -> None:
        _require_whole("lattice.pitch", self.pitch, 2, 1000)
        _require_whole("lattice.tolerance", self.tolerance, 0, 127)
        _require(
            0 <= self.tolerance < self.pitch,
            "lattice.tolerance",
            self.tolerance,
            "at least 0, below the pitch",
        )
        _require_number("lattice.smoothing_sigma", self.smoothing_sigma, 0, 100)


@dataclass(frozen=True)
class MergingConfig:
    """Graph-based region merging (Felzenszwalb and Huttenlocher 2004, reference 21 of the paper)."""

    scale: float = 150.0
    """k: larger values make larger segments; colour distance on the 0..255 scale, 0 to 1e9 ("control
    value")."""
    minimum_size: int = 1
    """Segments of fewer super-pixels are merged with their closest neighbour, >= 1."""

    def __post_init__(self) -> None:
        _require_number("merging.scale", self.scale, 0, 1e9)
        _require_whole("merging.minimum_size", self.minimum_size, 1, 10**9)


@dataclass(frozen=True)
class CensusConfig:
    """Four-valued census transform (equations 2 to 4)."""

    window: int = 7
    """Side of the square window in pixels: 3, 5 or 7."""
    threshold: float = 0.08
    """Just noticeable difference as a share of the centre's radiance (equation 4), 0 to 1."""

    def __post_init__(self) -> None:
        _require_whole("census.window", self.window, 3, 7)
        _require(self.window % 2 == 1, "census.window", self.window, "3, 5 or 7")
        _require_number("census.threshold", self.threshold, 0, 1)


@dataclass(frozen=True)
class CandidateConfig:
    """Disparity candidates (Min et al. 2011, reference 27 of the paper)."""

    share: float = 0.1
    """Candidates kept per pixel as a share of the largest disparity, 0 < share <= 1."""
    box: int = 5
    """Side of the box filter on the similarity before the selection, odd, 1 to 35 pixels."""

    def __post_init__(self) -> None:
        _require(0 < self.share <= 1, "candidates.share", self.share, "above 0, at most 1")
        _require_whole("candidates.box", self.box, 1, 35)  # sums of 37x37 similarities would not fit uint16
        _require(self.box % 2 == 1, "candidates.box", self.box, "odd")

    def count(self, max_disparity: int) -> int:
        """Return the number of candidates per pixel, at least 1."""
        return max(1, round(self.share * max_disparity))


@dataclass(frozen=True)
class AggregationConfig:
    """Aggregation inside segments (equations 6 to 8)."""

    radius: int = 17
    """Half side of the square window in pixels, 0 to 255; 17 gives 35x35."""
    sigma: float = 17.0
    """Decay length of the weight exp(-distance / sigma) in pixels, 0.001 to 1e6."""
    squared_sigma: bool = False
    """Use exp(-distance / sigma^2), equation 6 to the letter: nearly flat, and measurably worse."""

    def __post_init__(self) -> None:
        _require_whole("aggregation.radius", self.radius, 0, 255)
        _require_number("aggregation.sigma", self.sigma, 1e-3, 1e6)


@dataclass(frozen=True)
class RejectionConfig:
    """Rejection of uncertain warped pixels by their 3x3 bit pattern (reference 28 of the paper)."""

    enabled: bool = True
    """False keeps every warped pixel (an ablation of the paper's Table 2)."""
    tolerance: float = 1e-4
    """A value this far below the patch mean, relative to the mean, still counts as at the mean, so that
    rounding in a flat patch does not flip bits; 0 <= tolerance < 1."""

    def __post_init__(self) -> None:
        _require(0 <= self.tolerance < 1, "rejection.tolerance", self.tolerance, "at least 0, below 1")


@dataclass(frozen=True)
class DomainTransformConfig:
    """Recursive edge-preserving filter (Gastal and Oliveira 2011, reference 29 of the paper)."""

    spatial_sigma: float = 20.0
    """sigma_s in pixels, 0.001 to 1e6."""
    range_sigma: float = 0.0005
    """sigma_r in radiance units: exposure X (1 at the mid code) per millisecond, 1e-12 to 1e12."""
    iterations: int = 2
    """N, 1 to 16."""

    def __post_init__(self) -> None:
        _require_number("edge_filter.spatial_sigma", self.spatial_sigma, 1e-3, 1e6)
        _require_number("edge_filter.range_sigma", self.range_sigma, 1e-12, 1e12)
        _require_whole("edge_filter.iterations", self.iterations, 1, 16)


@dataclass(frozen=True)
class PoissonConfig:
    """Poisson image editing of the holes (equation 11, Perez et al. 2003)."""

    enabled: bool = True
    """False leaves the filled and filtered holes as they are (an ablation of the paper's Table 2)."""


@dataclass(frozen=True)
class WindowMatchingConfig:
    """Window matching by zero-mean normalised cross-correlation, with a left-right check."""

    window: int = 9
    """Side of the square window in pixels, odd, 3 to 31."""
    tolerance: float = 1.0
    """Largest difference in pixels between the disparities of both views that confirm each other, 0 to 1000."""

    def __post_init__(self) -> None:
        _require_whole("matching.window", self.window, 3, 31)
        _require(self.window % 2 == 1, "matching.window", self.window, "odd")
        _require_number("matching.tolerance", self.tolerance, 0, 1000)


@dataclass(frozen=True)
class BilateralWindowConfig:
    """Weights inside a matching window: what is near the centre, and like it, counts most."""

    spatial_sigma: float = 4.0
    """Standard deviation over the distance in pixels, 0.001 to 1e6. Our choice."""
    range_sigma: float = 0.5
    """Standard deviation over the difference in ln radiance, 0.001 to 1e6. Our choice."""

    def __post_init__(self) -> None:
        _require_number("bilateral.spatial_sigma", self.spatial_sigma, 1e-3, 1e6)
        _require_number("bilateral.range_sigma", self.range_sigma, 1e-3, 1e6)


@dataclass(frozen=True)
class OpencvStereoConfig:
    """OpenCV's semi-global block matching, with the values of its documentation and samples."""

    block_size: int = 5
    """Side of the matched block in pixels, odd, 1 to 11."""
    small_penalty: int = 8
    """P1 per pixel of the block, for a disparity that changes by 1; 0 to 1000."""
    large_penalty: int = 32
    """P2 per pixel of the block, for a larger change; above P1, up to 1000."""
    uniqueness: int = 10
    """Margin in per cent by which the best cost must win, 0 to 100."""
    tolerance: int = 1
    """Largest difference of the left-right check in pixels, 0 to 1000."""
    speckle_size: int = 100
    """Smaller regions of their own disparity are dropped, pixels, 0 to 10000; 0 keeps all."""
    speckle_range: int = 2
    """Largest disparity difference inside a region, pixels, 0 to 100."""

    def __post_init__(self) -> None:
        _require_whole("stereo.block_size", self.block_size, 1, 11)
        _require(self.block_size % 2 == 1, "stereo.block_size", self.block_size, "odd")
        _require_whole("stereo.small_penalty", self.small_penalty, 0, 1000)
        _require_whole("stereo.large_penalty", self.large_penalty, 1, 1000)
        _require(self.large_penalty > self.small_penalty, "stereo.large_penalty", self.large_penalty, "above P1")
        _require_whole("stereo.uniqueness", self.uniqueness, 0, 100)
        _require_whole("stereo.tolerance", self.tolerance, 0, 1000)
        _require_whole("stereo.speckle_size", self.speckle_size, 0, 10_000)
        _require_whole("stereo.speckle_range", self.speckle_range, 0, 100)


@dataclass(frozen=True)
class FuseConfig:
    """What every method understands."""

    max_disparity: int | None = None
    """d_max, the largest disparity that is searched, pixels, below the image width. None takes
    `DEFAULT_DISPARITY_SHARE` of the width."""
    exposure_map: ExposureMapConfig = field(default_factory=ExposureMapConfig)
    """Under- and over-exposed map S."""

    def __post_init__(self) -> None:
        if self.max_disparity is not None:
            _require_whole("max_disparity", self.max_disparity, 0, LARGEST_DISPARITY)

    def search_range(self, width: int) -> int:
        """Return d_max for images of `width` columns.

        Raises
        ------
        ConfigError
            `max_disparity` is not below the width.
        """
        if self.max_disparity is None:
            return min(width - 1, round(DEFAULT_DISPARITY_SHARE * width), LARGEST_DISPARITY)
        if self.max_disparity >= width:
            raise ConfigError(
                f"the largest disparity must be below the image width {width}, got {self.max_disparity}"
            )
        return self.max_disparity


LARGEST_DISPARITY = 32766
"""Disparities are held in 16 bits while they are compared."""

DEFAULT_DISPARITY_SHARE = 120 / 695
"""Search range as a share of the width when none is given: the paper's 120 px on 695 px wide images."""


@dataclass(frozen=True)
class PaperConfig(FuseConfig):
    """Method ``paper``; the defaults are section 3.1 of the paper, or our decision where it is silent."""

    response: ResponseConfig = field(default_factory=ResponseConfig)
    """Inverse response from histograms, or from SIFT matches; skipped when a response is given."""
    lattice: LatticeConfig = field(default_factory=LatticeConfig)
    """Super-pixels."""
    merging: MergingConfig = field(default_factory=MergingConfig)
    """Segments."""
    census: CensusConfig = field(default_factory=CensusConfig)
    """Matching cost."""
    candidates: CandidateConfig = field(default_factory=CandidateConfig)
    """Which disparities are aggregated."""
    aggregation: AggregationConfig = field(default_factory=AggregationConfig)
    """Aggregation inside segments."""
    rejection: RejectionConfig = field(default_factory=RejectionConfig)
    """Rejection of uncertain warped pixels."""
    edge_filter: DomainTransformConfig = field(default_factory=DomainTransformConfig)
    """Edge-preserving filter of the filled holes and of the weight map."""
    poisson: PoissonConfig = field(default_factory=PoissonConfig)
    """Poisson image editing."""


@dataclass(frozen=True)
class OracleConfig(PaperConfig):
    """Method ``oracle``: that of ``paper``, without the rejection of warped pixels."""

    rejection: RejectionConfig = field(default_factory=lambda: RejectionConfig(enabled=False))
    """Off: the disparity is known to be right."""


@dataclass(frozen=True)
class Lin2009Config(FuseConfig):
    """Method ``lin2009``."""

    response: ResponseConfig = field(default_factory=lambda: ResponseConfig(samples="sift"))
    """Inverse response from SIFT matches; skipped when a response is given."""
    matching: WindowMatchingConfig = field(default_factory=WindowMatchingConfig)
    """Window matching."""


@dataclass(frozen=True)
class Baetz2014Config(FuseConfig):
    """Method ``baetz2014``."""

    response: ResponseConfig = field(default_factory=ResponseConfig)
    """Inverse response from histograms, only where no calibrated one is given."""
    matching: WindowMatchingConfig = field(default_factory=WindowMatchingConfig)
    """Window matching."""


@dataclass(frozen=True)
class Sun2010Config(FuseConfig):
    """Method ``sun2010``."""

    response: PolynomialResponseConfig = field(default_factory=PolynomialResponseConfig)
    """Inverse response from the pixels of the first matching; skipped when a response is given."""
    matching: WindowMatchingConfig = field(default_factory=WindowMatchingConfig)
    """Window matching."""
    bilateral: BilateralWindowConfig = field(default_factory=BilateralWindowConfig)
    """Weights inside the window."""


@dataclass(frozen=True)
class OpencvConfig(FuseConfig):
    """Method ``opencv``."""

    response: ResponseConfig = field(default_factory=ResponseConfig)
    """Inverse response from histograms; skipped when a response is given."""
    stereo: OpencvStereoConfig = field(default_factory=OpencvStereoConfig)
    """Semi-global block matching."""


def config_from_mapping(config_type: type[ConfigT], values: Mapping[str, Any], where: str = "config") -> ConfigT:
    """Build a configuration from nested mappings, as TOML gives them; missing fields keep their defaults.

    Parameters
    ----------
    config_type
        One of the dataclasses of this module, or of another method.
    values
        Field names to values; a stage is a nested mapping.
    where
        Named in messages.

    Raises
    ------
    ConfigError
        Unknown field, wrong type, or value out of range.
    """
    known = {f.name: f for f in fields(typing.cast(Any, config_type))}
    types = typing.get_type_hints(config_type)
    arguments: dict[str, Any] = {}
    for name, value in values.items():
        if name not in known:
            raise ConfigError(f"{where}: unknown setting {name!r}; known are {', '.join(sorted(known))}")
        arguments[name] = _checked(types[name], value, f"{where}: {name}")
    try:
        return config_type(**arguments)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from None


def _checked(expected: Any, value: Any, where: str) -> Any:
    if is_dataclass(expected):
        if not isinstance(value, Mapping):
            raise ConfigError(f"{where} is a table of settings, got {value!r}")
        return config_from_mapping(typing.cast(type, expected), value, where)
    accepted = typing.get_args(expected) or (expected,)
    if typing.get_origin(expected) is Literal:
        if value not in accepted:
            raise ConfigError(f"{where} must be {_either(accepted)}, got {value!r}")
        return value
    if float in accepted and type(value) is int:
        return float(value)
    if type(value) not in accepted:
        names = " or ".join(t.__name__ for t in accepted if t is not type(None))
        raise ConfigError(f"{where} must be {names}, got {value!r}")
    return value


def load_config(config_type: type[ConfigT], path: str | Path) -> ConfigT:
    """Read a configuration from a TOML file.

    Raises
    ------
    ConfigError
        The file cannot be read, is not TOML, or holds a wrong setting.
    """
    try:
        with open(path, "rb") as file:
            values = tomllib.load(file)
    except OSError as error:
        raise ConfigError(f"{path}: cannot read the configuration ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML ({error})") from error
    return config_from_mapping(config_type, values, str(path))
