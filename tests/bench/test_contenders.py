from dataclasses import replace

import numpy as np
import pytest

from stereohdr import PaperConfig
from stereohdr.bench.contenders import (
    VARIANTS,
    ceiling_radiance,
    contender_config,
    run_contender,
)
from stereohdr.bench.published import TABLE2, published_score
from stereohdr.bench.tables import table_scenes
from stereohdr.datasets.scene import channel_mask, visible_in_auxiliary
from stereohdr.errors import ConfigError


def test_the_eight_variants_are_those_of_table_2():
    assert list(VARIANTS) == list(TABLE2)
    assert VARIANTS["paper"].config() == PaperConfig()
    config = VARIANTS["paper-sift-no-rejection-no-poisson"].config()
    assert config.response.samples == "sift"
    assert not config.rejection.enabled
    assert not config.poisson.enabled


def test_unknown_contenders_are_refused():
    with pytest.raises(ConfigError, match=r"unknown method 'magic'.*C3"):
        contender_config("magic")


def test_ceilings_are_the_reference_where_it_counts(small_scene):
    main_only = run_contender(small_scene, "mv-only").radiance
    out_of_range, visible = channel_mask(small_scene), visible_in_auxiliary(small_scene)
    assert (out_of_range & ~visible).any()
    for label, replaced in (("C3", out_of_range & visible), ("C2", out_of_range)):
        ceiling = run_contender(small_scene, label).radiance
        np.testing.assert_array_equal(ceiling, ceiling_radiance(small_scene, main_only, label))
        np.testing.assert_array_equal(ceiling[~replaced], main_only[~replaced])
        ratio = ceiling[replaced] / small_scene.reference[replaced]
        np.testing.assert_allclose(ratio, ratio.flat[0], rtol=1e-5)


def test_what_needs_the_truth_says_so(small_scene):
    blind = replace(small_scene, disparity_main=None, disparity_auxiliary=None)
    for label in ("C3", "oracle"):
        with pytest.raises(ConfigError, match=f"{label} needs the true disparity"):
            run_contender(blind, label)


def test_the_papers_numbers_stand_beside_the_same_scene_and_setting():
    assert published_score("Art-normal-long", "paper") == 94.87
    assert published_score("Aloe-paper-short-long", "lin2009") == 78.89
    assert published_score("Moebius-short-long", "paper-no-poisson") == 87.78
    assert published_score("Art-long-short", "paper") is None
    assert published_score("Dolls-short-long", "paper") is None
    assert published_score("Art-short-long", "mv-only") is None


def test_tables_take_the_paper_s_own_inputs_when_they_are_there():
    available = ["R1", "Art-normal-long", "Art-short-long", "Dolls-short-long", "room"]
    assert table_scenes(available, "table1") == ["Art-normal-long", "Art-short-long"]
    assert table_scenes(available, "table2") == ["Art-short-long"]
    assert table_scenes(available, "quality") == available
    available += ["Art-paper-normal-long", "Art-paper-short-long"]
    assert table_scenes(available, "table1") == ["Art-paper-normal-long", "Art-paper-short-long"]
