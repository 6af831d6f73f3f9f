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
class ParametricResponseConfig:
    """Response as a mixture of a gamma and the sRGB curve, bent by a polynomial (`fit_parametric_response`)."""

    degree: int = 4
    """Degree of the polynomial, 0 to 8."""
    ridge: float = 1e-4
    """Weight of the polynomial's squared coefficients against a fit of total weight 1, > 0."""
    tie: float = 0.1
    """Weight of the squared differences between the channels' coefficients, >= 0."""
    outlier_scale: float = 0.05
    """Residual (ln X) from which on a pair counts less than half, > 0."""
    lowest_code: int = 4
    """Codes (of 255) below it do not take part: clipping bends the relation."""
    highest_code: int = 247
    """Codes (of 255) above it do not take part."""
    fewest_pixels: int = 40
    """Pixels that a pair of codes needs behind it, at least 1."""
    most_outside: float = 0.2
    """Largest share (0..1) of a code's partners that may lie beyond these codes."""

    def __post_init__(self) -> None:
        _require_whole("response.degree", self.degree, 0, 8)
        _require_number("response.ridge", self.ridge, 1e-12, 1e6)
        _require_number("response.tie", self.tie, 0, 1e6)
        _require_number("response.outlier_scale", self.outlier_scale, 1e-6, 10)
        _require_whole("response.lowest_code", self.lowest_code, 0, 255)
        _require_whole("response.highest_code", self.highest_code, self.lowest_code + 1, 255)
        _require_whole("response.fewest_pixels", self.fewest_pixels, 1, 1_000_000)
        _require_number("response.most_outside", self.most_outside, 0, 1)


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
class SemiGlobalConfig:
    """Semi-global matching (Hirschmueller 2008): how much a change of disparity costs along the paths.

    Costs count unequal census codes, 0 to 48 per pixel.
    """

    paths: Literal[4, 8] = 8
    """Directions that are followed: 8, or 4 (horizontal and vertical only), which is faster and less smooth."""
    small_penalty: int = 19
    """P1, for a disparity that changes by 1 from pixel to pixel; 0 to 100. Our choice, 0.4 of the largest cost."""
    large_penalty: int = 95
    """P2, for a larger change between pixels of the same brightness; above P1, up to 200. Our choice, 5 P1."""
    edge_factor: float = 30.0
    """P2 is divided by 1 + this times the difference of the log luminance (but stays above P1): depth changes
    where the brightness does; 0 to 1e6. Our choice."""
    outside_cost: int = 20
    """Cost of a disparity that leads out of the other view, 0 to 48: close to that of a fair match, so that
    neighbours decide. Our choice."""

    def __post_init__(self) -> None:
        _require(self.paths in (4, 8), "semiglobal.paths", self.paths, "4 or 8")
        _require_whole("semiglobal.small_penalty", self.small_penalty, 0, 100)
        _require_whole("semiglobal.large_penalty", self.large_penalty, 1, 200)
        _require(
            self.large_penalty > self.small_penalty, "semiglobal.large_penalty", self.large_penalty, "above P1"
        )
        _require_number("semiglobal.edge_factor", self.edge_factor, 0, 1e6)
        _require_whole("semiglobal.outside_cost", self.outside_cost, 0, 48)


@dataclass(frozen=True)
class TwoWayConfig:
    """What counts as confirmed, and how confident a match is (`match_two_ways`)."""

    runs: Literal[1, 2] = 2
    """2 matches along the edges of each view; 1 along those of the main view only, which is faster."""
    tolerance: float = 1.5
    """Disparities of both views, or of both runs, this close are the same; pixels, >= 0."""
    one_run: float = 0.6
    """Confidence of a match that one of the two runs confirms, against 1 for both; 0 to 1."""
    usual_margin: float = 40.0
    """Margin (`SemiGlobalMatch.margin`) that halves the confidence, > 0."""

    def __post_init__(self) -> None:
        _require(self.runs in (1, 2), "two_way.runs", self.runs, "1 or 2")
        _require_number("two_way.tolerance", self.tolerance, 0, 100)
        _require_number("two_way.one_run", self.one_run, 0, 1)
        _require_number("two_way.usual_margin", self.usual_margin, 1e-3, 1e6)


@dataclass(frozen=True)
class SurveyConfig:
    """The first look at a pair, at reduced size (`stereohdr.survey`)."""

    width: int = 360
    """Columns to which the pair is reduced at most, 32 to 4096."""
    search_share: float = 0.45
    """Largest disparity that is tried when none is given, as a share of the width, 0 to 1."""
    negative_share: float = 0.06
    """Negative disparities that are tried when none is given (rectification may leave them), as a share of the
    width, 0 to 1."""
    sure: float = 0.6
    """Confidence from which on a match tells about the range of disparities, 0 to 1."""
    outlier_share: float = 0.001
    """Share (0 to 0.5) of these matches at either end that may be wrong."""
    negative_evidence: float = 0.01
    """Share (0 to 1) of these matches that must be negative before negative disparities are searched."""
    smallest_offset: float = 0.3
    """Vertical offset between the views from which on the auxiliary view is shifted, rows, > 0. (Shifting by a
    part of a row costs sharpness.)"""

    def __post_init__(self) -> None:
        _require_whole("survey.width", self.width, 32, 4096)
        _require_number("survey.search_share", self.search_share, 0, 1)
        _require_number("survey.negative_share", self.negative_share, 0, 1)
        _require_number("survey.sure", self.sure, 0, 1)
        _require_number("survey.outlier_share", self.outlier_share, 0, 0.5)
        _require_number("survey.smallest_offset", self.smallest_offset, 1e-6, 1e6)
        _require_number("survey.negative_evidence", self.negative_evidence, 0, 1)


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
class AgreementConfig:
    """Which warped radiance can be what the main view saw (`agrees_with_main`)."""

    codes: float = 10.0
    """Half width c of the interval E(z - c) to E(z + c), codes of 255, >= 0."""
    auxiliary_codes: float = 4.0
    """The same for the auxiliary view's codes, c', where they are the coarser ones; codes of 255, >= 0."""
    slack: float = 0.1
    """Relative widening of the interval, for errors of the response; 0 to 10."""
    borrowed_slack: float = 0.3
    """The same where the disparity is borrowed from the background."""
    white_code: float = 245.0
    """From this code (of 255) on there is no upper limit: sensors bend before they clip. Also what counts as
    clipped in both views."""
    black_code: float = 10.0
    """Up to this code (of 255) there is no lower limit."""
    support: int = 1
    """Radius of the window in which more than half of the pixels must agree, pixels, 0 to 20."""

    def __post_init__(self) -> None:
        _require_number("agreement.codes", self.codes, 0, 255)
        _require_number("agreement.auxiliary_codes", self.auxiliary_codes, 0, 255)
        _require_number("agreement.slack", self.slack, 0, 10)
        _require_number("agreement.borrowed_slack", self.borrowed_slack, 0, 10)
        _require_number("agreement.black_code", self.black_code, 0, 255)
        _require_number("agreement.white_code", self.white_code, self.black_code, 255)
        _require_whole("agreement.support", self.support, 0, 20)


@dataclass(frozen=True)
class HighlightsConfig:
    """Errors (standard deviations, ln units, 0.001 to 100) of what is known of clipped pixels."""

    level_error: float = 0.03
    """Matched auxiliary radiance."""
    gradient_error: float = 0.03
    """Differences of matched neighbours."""
    borrowed_level_error: float = 0.25
    """Auxiliary radiance at a disparity borrowed from the background."""
    borrowed_gradient_error: float = 0.1
    """Differences of neighbours of which one is borrowed."""
    colour_error: float = 0.2
    """Differences of neighbours, taken from the channels that are not clipped."""
    smoothness_error: float = 0.1
    """Differences of neighbours of which nothing is known, against 0."""
    prior_correlation: float = 4.0
    """Pixels that count as one where only the mean of their class is known: they are not independent."""

    def __post_init__(self) -> None:
        for field_ in fields(self):
            _require_number(f"highlights.{field_.name}", getattr(self, field_.name), 1e-3, 100)


@dataclass(frozen=True)
class ShadowsConfig:
    """How noisy pixels are cleaned (`clean_shadows`)."""

    radius: int = 3
    """Radius of the windows in which the views are compared, pixels, 1 to 50."""
    noise_radius: int = 2
    """Radius of the windows in which the noise is measured, pixels, 1 to 50."""
    clean_noise: float = 0.02
    """Relative noise below which a pixel stays as it is; from twice this on it is cleaned fully. 1e-6 to 10."""
    level_error: float = 0.05
    """Relative error of the auxiliary view's level (vignetting, gloss, response), 0 to 10."""
    slope_pull: float = 4.0
    """How strongly noise draws the slope of the relation to 1, 0 to 1e6."""
    fewest_share: float = 0.4
    """Share of a window that must be usable, 0 to 1."""
    alone_share: float = 0.7
    """How far a noisy pixel without a usable match is drawn to its neighbours, 0 to 1: among them noise and fine
    structure look alike."""
    alone_noise: float = 0.12
    """Relative noise from which such a pixel is drawn fully, 0 to 10: weaker noise shows less than what smoothing
    takes with it."""
    lowest: float = 0.3
    """The result stays above this share of the darker one of both views, 0 to 1."""

    def __post_init__(self) -> None:
        _require_whole("shadows.radius", self.radius, 1, 50)
        _require_whole("shadows.noise_radius", self.noise_radius, 1, 50)
        _require_number("shadows.clean_noise", self.clean_noise, 1e-6, 10)
        _require_number("shadows.level_error", self.level_error, 0, 10)
        _require_number("shadows.slope_pull", self.slope_pull, 0, 1e6)
        _require_number("shadows.fewest_share", self.fewest_share, 0, 1)
        _require_number("shadows.alone_share", self.alone_share, 0, 1)
        _require_number("shadows.alone_noise", self.alone_noise, 0, 10)
        _require_number("shadows.lowest", self.lowest, 0, 1)


@dataclass(frozen=True)
class RobustConfig(FuseConfig):
    """Method ``robust``; our own choices throughout, measured on the benchmark."""

    max_disparity: int | None = None
    """Largest disparity that is searched, pixels, below the image width; the search then begins at 0. None finds
    the range, also a negative one, from the pair."""
    survey: SurveyConfig = field(default_factory=SurveyConfig)
    """First look at reduced size."""
    response: ParametricResponseConfig = field(default_factory=ParametricResponseConfig)
    """Response from few parameters; skipped when a response is given."""
    response_rounds: Literal[1, 2] = 2
    """1 keeps the response of the survey, 2 fits it again to the matches at full size."""
    toe: bool = True
    """Whether the lowest codes are set to what the longer exposure measures there."""
    census: CensusConfig = field(default_factory=CensusConfig)
    """Pixel codes that are matched."""
    semiglobal: SemiGlobalConfig = field(default_factory=SemiGlobalConfig)
    """Matching."""
    two_way: TwoWayConfig = field(default_factory=TwoWayConfig)
    """Left-right check and confidence."""
    agreement: AgreementConfig = field(default_factory=AgreementConfig)
    """Which matches can be true."""
    highlights: HighlightsConfig = field(default_factory=HighlightsConfig)
    """Restoring clipped channels, when the auxiliary exposure is the shorter one."""
    shadows: ShadowsConfig = field(default_factory=ShadowsConfig)
    """Cleaning noisy pixels, when the auxiliary exposure is the longer one."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _require(self.response_rounds in (1, 2), "response_rounds", self.response_rounds, "1 or 2")


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
        raise ConfigError(f"{path}: cannot read the configuration ({error.strerror}); check the name") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{path}: not valid TOML ({error})") from error
    return config_from_mapping(config_type, values, str(path))
