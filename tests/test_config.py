import dataclasses
import math

import pytest

from stereohdr import PaperConfig
from stereohdr.config import (
    AggregationConfig,
    AgreementConfig,
    BilateralWindowConfig,
    HighlightsConfig,
    OpencvStereoConfig,
    ParametricResponseConfig,
    PolynomialResponseConfig,
    ResponseConfig,
    RobustConfig,
    ShadowsConfig,
    SurveyConfig,
    TwoWayConfig,
    WindowMatchingConfig,
    config_from_mapping,
    load_config,
)
from stereohdr.errors import ConfigError


def test_defaults_are_section_3_1_of_the_paper():
    c = PaperConfig()
    assert (c.exposure_map.under_threshold, c.exposure_map.over_threshold) == (5, 250)
    assert (c.lattice.pitch, c.lattice.tolerance) == (6, 4)
    assert c.merging.scale == 150
    assert c.merging.minimum_size == 1
    assert (c.census.window, c.census.threshold) == (7, 0.08)
    assert c.candidates.share == 0.1
    assert (c.aggregation.sigma, c.aggregation.radius) == (17, 17)
    assert (c.edge_filter.spatial_sigma, c.edge_filter.range_sigma, c.edge_filter.iterations) == (20, 0.0005, 2)
    assert c.search_range(695) == 120


def test_every_field_has_a_docstring():
    import ast
    import inspect

    import stereohdr.config as module

    for node in ast.parse(inspect.getsource(module)).body:
        if isinstance(node, ast.ClassDef):
            for field, following in zip(node.body, [*node.body[1:], None], strict=True):
                if isinstance(field, ast.AnnAssign):
                    assert isinstance(following, ast.Expr), f"{node.name}.{field.target.id}"


def test_toml_sets_nested_fields_and_keeps_the_rest(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text(
        "max_disparity = 64\n[exposure_map]\nover_threshold = 245\n[aggregation]\nsquared_sigma = true\n"
    )
    config = load_config(PaperConfig, path)
    assert config.max_disparity == 64
    assert config.exposure_map.over_threshold == 245.0
    assert config.exposure_map.under_threshold == 5
    assert config.aggregation == AggregationConfig(squared_sigma=True)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("max_disparty = 3", "unknown setting 'max_disparty'; known are aggregation"),
        ("[census]\nwindows = 3", r"census: unknown setting 'windows'"),
        ("max_disparity = 2.5", "max_disparity must be int"),
        ("max_disparity = true", "max_disparity must be int"),
        ("max_disparity = -1", "max_disparity must be a whole number from 0 to 32766"),
        ("census = 7", "census is a table"),
        ("[census]\nwindow = 4", "3, 5 or 7, got 4"),
        ("[exposure_map]\nunder_threshold = 251", "under < over"),
        ("[aggregation]\nsigma = nan", "sigma must be from 0.001"),
        ("[edge_filter]\nrange_sigma = 'x'", "range_sigma must be float"),
        ("[lattice]\ntolerance = 6", "below the pitch"),
        ("[response]\nsamples = 'surf'", r"response: samples must be 'cdf' or 'sift', got 'surf'"),
        ("[response]\nsamples = ['cdf']", r"samples must be 'cdf' or 'sift', got \['cdf'\]"),
        ("[response]\nsmoothness = inf", "smoothness must be from"),
        ("[edge_filter]\niterations = 600", "iterations must be a whole number from 1 to 16"),
        ("[candidates]\nbox = 37", "box must be a whole number from 1 to 35"),
        ("max_disparity = 40000", "from 0 to 32766"),
        ("max_disparity = ", "not valid TOML"),
    ],
)
def test_wrong_settings_are_refused_with_their_place(tmp_path, text, message):
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=message) as caught:
        load_config(PaperConfig, path)
    assert "c.toml" in str(caught.value)


def test_a_choice_is_taken_by_name_from_toml_and_from_python(tmp_path):
    path = tmp_path / "c.toml"
    path.write_text("[response]\nsamples = 'sift'\n")
    assert load_config(PaperConfig, path).response == ResponseConfig(samples="sift")
    with pytest.raises(ConfigError, match=r"response\.samples must be 'cdf' or 'sift', got 'surf'"):
        ResponseConfig(samples="surf")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("stage", "setting", "message"),
    [
        (WindowMatchingConfig, {"window": 8}, "odd, got 8"),
        (WindowMatchingConfig, {"window": 1}, "from 3 to 31"),
        (WindowMatchingConfig, {"tolerance": -1.0}, "tolerance"),
        (BilateralWindowConfig, {"range_sigma": 0.0}, "range_sigma"),
        (PolynomialResponseConfig, {"degree": 7}, "degree"),
        (OpencvStereoConfig, {"block_size": 4}, "odd"),
        (OpencvStereoConfig, {"large_penalty": 8}, "above P1"),
    ],
)
def test_the_stages_of_the_comparison_methods_check_their_settings(stage, setting, message):
    with pytest.raises(ConfigError, match=message):
        stage(**setting)


@pytest.mark.parametrize(
    ("stage", "setting", "message"),
    [
        (ParametricResponseConfig, {"degree": 9}, "degree must be a whole number from 0 to 8"),
        (ParametricResponseConfig, {"ridge": 0.0}, "ridge"),
        (ParametricResponseConfig, {"tie": -1.0}, "tie"),
        (ParametricResponseConfig, {"outlier_scale": math.nan}, "outlier_scale"),
        (ParametricResponseConfig, {"lowest_code": -1}, "lowest_code"),
        (ParametricResponseConfig, {"lowest_code": 100, "highest_code": 100}, "highest_code must be .* 101 to"),
        (ParametricResponseConfig, {"fewest_pixels": 0}, "fewest_pixels"),
        (ParametricResponseConfig, {"most_outside": 1.5}, "most_outside"),
        (TwoWayConfig, {"runs": 3}, "runs must be 1 or 2"),
        (TwoWayConfig, {"tolerance": -0.5}, "tolerance"),
        (TwoWayConfig, {"one_run": 2.0}, "one_run"),
        (TwoWayConfig, {"usual_margin": 0.0}, "usual_margin"),
        (SurveyConfig, {"width": 16}, "width must be a whole number from 32"),
        (SurveyConfig, {"search_share": 1.5}, "search_share"),
        (SurveyConfig, {"negative_share": -0.1}, "negative_share"),
        (SurveyConfig, {"sure": 2.0}, "sure"),
        (SurveyConfig, {"outlier_share": 0.6}, "outlier_share"),
        (SurveyConfig, {"negative_evidence": -1.0}, "negative_evidence"),
        (SurveyConfig, {"smallest_offset": 0.0}, "smallest_offset"),
        (AgreementConfig, {"codes": -1.0}, "codes"),
        (AgreementConfig, {"auxiliary_codes": 256.0}, "auxiliary_codes"),
        (AgreementConfig, {"slack": 11.0}, "slack"),
        (AgreementConfig, {"borrowed_slack": -1.0}, "borrowed_slack"),
        (AgreementConfig, {"white_code": 9.0}, "white_code must be from 10"),
        (AgreementConfig, {"black_code": -1.0}, "black_code"),
        (AgreementConfig, {"support": 21}, "support"),
        *((HighlightsConfig, {f.name: 0.0}, f"highlights.{f.name}") for f in dataclasses.fields(HighlightsConfig)),
        *((ShadowsConfig, {f.name: -1}, f"shadows.{f.name}") for f in dataclasses.fields(ShadowsConfig)),
        (RobustConfig, {"response_rounds": 3}, "response_rounds must be 1 or 2"),
        (RobustConfig, {"max_disparity": -1}, "max_disparity"),
    ],
    ids=str,
)
def test_the_stages_of_the_default_method_check_their_settings(stage, setting, message):
    stage()
    with pytest.raises(ConfigError, match=message):
        stage(**setting)


def test_a_missing_file_is_said(tmp_path):
    with pytest.raises(ConfigError, match="cannot read"):
        load_config(PaperConfig, tmp_path / "none.toml")


@pytest.mark.parametrize("width", [1, 2, 5, 695, 4000])
def test_the_default_range_is_below_the_width(width):
    assert 0 <= PaperConfig().search_range(width) < width


def test_a_range_as_wide_as_the_image_is_refused():
    assert PaperConfig(max_disparity=63).search_range(64) == 63
    with pytest.raises(ConfigError, match="below the image width 64, got 64"):
        PaperConfig(max_disparity=64).search_range(64)


@pytest.mark.parametrize("config_type", [PaperConfig, RobustConfig])
def test_a_config_survives_its_own_dictionary(config_type):
    config = dataclasses.replace(config_type(), max_disparity=9)
    values = dataclasses.asdict(config)
    assert config_from_mapping(config_type, values) == config


def test_whole_numbers_stay_whole_from_python():
    with pytest.raises(ConfigError, match="whole number"):
        PaperConfig(max_disparity=12.0)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="whole number"):
        AggregationConfig(radius=True)
