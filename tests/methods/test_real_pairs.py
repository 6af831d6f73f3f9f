"""Method `paper` on real pairs of two exposures; skipped where the data are not beside the checkout."""

import numpy as np
import pytest

from stereohdr import PaperConfig, Photo, ResponseCurve, StereoPair, fuse, read_photo
from stereohdr.metrics import aligning_scale, log2_error, log2_rmse
from stereohdr.response import solve_response


def half(photo, time):
    """Return a photo of half the size, area-averaged."""
    h, w = (n // 2 * 2 for n in photo.codes.shape[:2])
    codes = photo.codes[:h, :w].reshape(h // 2, 2, w // 2, 2, 3).mean(axis=(1, 3))
    return Photo(np.rint(codes).astype(np.uint8), time, name=photo.name)


def median_pairs(first, second):
    """Return for each code of either photo the median code of the other, where it is not clipped."""
    pairs = []
    for a, b, swap in ((first, second, False), (second, first, True)):
        for code in range(2, 251):
            others = b[a == code]
            if others.size >= 20 and 2 <= (median := round(float(np.median(others)))) <= 250:
                pairs.append((median, code) if swap else (code, median))
    return np.array(pairs)


def bracket_reference(short, long):
    """Merge two exposures of one view (hat weights), with the response that their common pixels show."""
    times = (short.exposure_time, long.exposure_time)
    curves = [solve_response(median_pairs(short.codes[..., c], long.codes[..., c]), times) for c in range(3)]
    response = ResponseCurve(np.stack(curves))
    views = [response.apply(p.codes, 255) / t for p, t in zip((short, long), times, strict=True)]
    weights = [np.minimum(p.codes, 255 - p.codes).astype(float) for p in (short, long)]
    # Black in both: the bound of the long exposure; white in both: that of the short one.
    weights[0] += 1e-6 * (short.codes > 128)
    weights[1] += 1e-6 * (long.codes <= 128)
    total = weights[0] + weights[1]
    return (views[0] * weights[0] + views[1] * weights[1]) / np.where(total > 0, total, np.nan)


def errors_in_s(result, pair, reference):
    s = result.stages["exposure_map"]
    scores = []
    for image in (result.stages["main_radiance"], result.radiance):
        error = log2_error(image, reference, scale=aligning_scale(image, reference, pair.main_photo))
        scores.append(log2_rmse(error, s))
    return scores


@pytest.fixture(scope="module")
def art(shared_data):
    folder = shared_data / "middlebury2005_full" / "Art"

    def view(name, time):
        return half(read_photo(folder / f"{name}_{round(1000 * time)}ms.png"), time)

    return {
        "view1 short": view("view1_Illum1_Exp0", 0.25),
        "view1 long": view("view1_Illum1_Exp1", 1.0),
        "view2 long": view("view2_Illum1_Exp1", 1.0),
        "view2 longest": view("view2_Illum1_Exp2", 4.0),
        "view5 long": view("view5_Illum1_Exp1", 1.0),
    }


@pytest.mark.parametrize(
    ("auxiliary", "reach", "gain"),
    [("view5 long", 120, 0.97), ("view2 longest", 60, 0.75)],
)
def test_art_short_main_view(art, auxiliary, reach, gain):
    pair = StereoPair(art["view1 short"], art[auxiliary])
    result = fuse(pair, "paper", PaperConfig(max_disparity=reach), keep_stages=True)
    assert result.response.is_monotone
    reference = bracket_reference(art["view1 short"], art["view1 long"])
    main_only, fused = errors_in_s(result, pair, reference)
    assert fused < gain * main_only


def test_art_over_exposed_right_main_view(art):
    pair = StereoPair(art["view1 short"], art["view2 longest"], main="right")
    result = fuse(pair, "paper", PaperConfig(max_disparity=60), keep_stages=True)
    reference = bracket_reference(art["view2 long"], art["view2 longest"])
    main_only, fused = errors_in_s(result, pair, reference)
    assert fused < 0.6 * main_only


def test_books_is_finite_and_positive(shared_data):
    folder = shared_data / "middlebury2005_half" / "Books"
    pair = StereoPair(
        read_photo(folder / "view1_Illum1_Exp0.png", exposure_time=0.25),
        read_photo(folder / "view5_Illum1_Exp1.png", exposure_time=1.0),
    )
    result = fuse(pair, "paper", PaperConfig(max_disparity=120))
    assert np.isfinite(result.radiance).all()
    assert (result.radiance > 0).all()
    assert 0 < (result.weight > 0).mean() < 0.5
