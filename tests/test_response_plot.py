import numpy as np

from stereohdr import ResponseCurve
from stereohdr.response.rig import RigResponse
from stereohdr.response_plot import COLOURS, DOT, MARGIN, PANEL, response_picture


def result(channels, samples):
    return RigResponse(ResponseCurve.gamma(2.2, channels), samples, np.zeros((1, channels)), ("a, b",))


def where(picture, colour):
    return (picture == np.array(colour, np.uint8)).all(axis=-1)


def test_one_panel_per_channel_each_with_its_curve():
    picture = response_picture(result(3, (np.empty((0, 5)),) * 3), title="three")
    for channel, name in enumerate(("red", "green", "blue")):
        left = MARGIN + channel * (PANEL + MARGIN)
        columns = np.flatnonzero(where(picture, COLOURS[name]).any(axis=0))
        assert left - 1 <= columns.min()  # the line is two pixels wide
        assert columns.max() <= left + PANEL + 1
    assert picture.dtype == np.uint8


def test_a_sample_that_fits_lies_on_the_curve_and_one_that_does_not_beside_it():
    g = ResponseCurve.gamma(2.2, 1).log_exposure[0]
    fits = np.array([[200.0, 100.0, 9, g[200] - g[100], 0]])
    off = fits.copy()
    off[0, 3] -= 1.5
    without, with_fit, with_off = (
        where(response_picture(result(1, (rows,))), DOT)[MARGIN : MARGIN + PANEL]
        for rows in (np.empty((0, 5)), fits, off)
    )
    on_curve, beside = with_fit & ~without, with_off & ~without
    assert on_curve.sum() < beside.sum() == 9  # the curve is drawn over the dot that fits
    row, column = np.argwhere(beside).mean(axis=0)
    low, high = g.min(), g.max()
    assert column == round(MARGIN + PANEL * 200 / 255)
    assert abs(row - PANEL * (high - (g[200] - 1.5)) / (high - low)) < 1.5
