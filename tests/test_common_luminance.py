import numpy as np
import pytest

from stereohdr import ResponseCurve
from stereohdr.radiance import clip_to_common_interval, common_luminance, initial_radiance, luminance

from conftest import make_pair


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize(("dtype", "white"), [(np.uint8, None), (np.uint16, 4095)])
def test_equals_the_luminance_of_clipped_radiance(channels, dtype, white):
    pair = make_pair(channels=channels, dtype=dtype, white=white)
    response = ResponseCurve.gamma(2.2, channels)
    views = [
        initial_radiance(photo, response, exposure=time)
        for photo, time in zip((pair.main_photo, pair.auxiliary_photo), pair.exposures, strict=True)
    ]
    expected = [luminance(view) for view in clip_to_common_interval(*views, response, exposures=pair.exposures)]
    got = common_luminance(pair, response)
    for view, wanted in zip(got, expected, strict=True):
        assert view.dtype == np.float32
        np.testing.assert_array_equal(view, wanted)
        assert np.ptp(view) > 0
