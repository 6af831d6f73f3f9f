import json

import numpy as np
import pytest

from stereohdr import PaperConfig, SourceFlag, fuse
from stereohdr.pictures import (
    SOURCE_COLOURS,
    contact_sheet,
    diverging,
    heat,
    save_stages,
    segment_colours,
    source_colours,
    stage_pictures,
    tonemap_together,
)
from stereohdr.report import document, exposure_text, source_shares, summary

from conftest import make_pair


@pytest.fixture(scope="module")
def pair():
    return make_pair(60, 90, times=(0.64, 0.04))


@pytest.fixture(scope="module")
def result(pair):
    return fuse(pair, "paper", PaperConfig(max_disparity=12), keep_stages=True)


def test_heat_runs_from_dark_to_bright():
    colours = heat(np.linspace(-1, 2, 31)[None])[0].astype(int).sum(axis=1)
    assert (np.diff(colours) >= 0).all()
    np.testing.assert_array_equal(heat(np.array([[5.0]]), low=5, high=5), heat(np.array([[0.0]])))


def test_diverging_is_blue_below_grey_at_and_red_above_zero():
    low, middle, high = diverging(np.array([[-1.0, 0.0, 1.0]]), limit=1.0)[0].astype(int)
    assert low[2] > low[0] + 50
    assert middle.std() < 5
    assert high[0] > high[2] + 50


def test_every_flag_and_every_segment_has_its_own_colour():
    assert len(set(SOURCE_COLOURS.values())) == len(SourceFlag)
    flags = np.array([list(SourceFlag)], dtype=np.uint8)
    np.testing.assert_array_equal(source_colours(flags)[0], [SOURCE_COLOURS[f] for f in SourceFlag])
    assert len(np.unique(segment_colours(np.arange(50)[None])[0], axis=0)) == 50


def test_images_mapped_together_share_one_curve_even_below_zero():
    one = np.linspace(-0.1, 1, 30, dtype=np.float32).reshape(2, 5, 3)
    first, second = tonemap_together([one, one])
    np.testing.assert_array_equal(first, second)
    assert first[0, 0, 0] == 0


def test_every_stage_gets_a_picture(result):
    pictures = stage_pictures(result.stages)
    assert list(pictures) == list(result.stages)
    for name, picture in pictures.items():
        assert picture.dtype == np.uint8, name
        assert picture.shape[:2] == (60, 90), name
    np.testing.assert_array_equal(pictures["exposure_map"] == 255, result.stages["exposure_map"])


def test_saved_stages_are_listed(result, tmp_path):
    written = save_stages(result, tmp_path / "new" / "folder")
    assert sorted(written) == sorted((tmp_path / "new" / "folder").iterdir())
    np.testing.assert_array_equal(
        np.load(tmp_path / "new" / "folder" / "01_main_radiance.npy"), result.stages["main_radiance"]
    )


def test_a_contact_sheet_holds_its_tiles():
    red = np.zeros((30, 40, 3), np.uint8)
    red[..., 0] = 255
    grey = np.full((60, 40, 1), 128, np.uint8)
    sheet = contact_sheet([("red", red), ("grey", grey), ("red again", red)], columns=2, tile_width=40, title="t")
    assert (sheet == [255, 0, 0]).all(axis=2).sum() == 2 * 30 * 40
    assert (sheet == [128, 128, 128]).all(axis=2).sum() >= 60 * 40


@pytest.mark.parametrize(
    ("seconds", "text"), [(1 / 60, "1/60 s"), (0.25, "1/4 s"), (4.0, "4 s"), (0.5, "0.5 s"), (0.0301, "0.0301 s")]
)
def test_exposure_times_as_photographers_write_them(seconds, text):
    assert exposure_text(seconds) == text


def test_shares_and_document_add_up(result, pair):
    shares = source_shares(result)
    assert sum(shares.values()) == pytest.approx(1)
    assert shares["measured"] == pytest.approx((result.source == 0).mean())
    content = json.loads(json.dumps(document(result, pair), allow_nan=False))
    assert content["size"] == [90, 60]
    assert content["exposure_ratio"] == 16
    assert content["statistics"]["clipped_share"] == pytest.approx(result.stages["exposure_map"].mean())
    s = content["statistics"]
    interest, arrived = result.stages["main_interest"], result.stages["arrived"]
    assert s["interest_share"] == pytest.approx(interest.mean())
    assert s["occluded_share"] == pytest.approx((interest & ~arrived).mean())
    assert s["rejected_share"] == pytest.approx((interest & result.stages["rejected"]).mean())


def test_the_summary_names_what_counts(result, pair):
    text = "\n".join(summary(result, pair))
    for word in ("left at 0.64 s", "right at 1/25 s", "ratio 16", "90x60 RGB", "searched 0 to 12", "seconds"):
        assert word in text
