import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from stereohdr import Photo, ResponseCurve
from stereohdr.config import AgreementConfig
from stereohdr.restoration.agreement import agrees_with_main


def at(curve, position):
    return np.interp(position, np.arange(256), curve)


@given(seed=st.integers(0, 999), ratio=st.sampled_from([2.0, 16.0]), channels=st.sampled_from([1, 3]))
def test_two_intervals_agree_where_they_meet(seed, ratio, channels):
    rng = np.random.default_rng(seed)
    config = AgreementConfig()
    response = ResponseCurve.gamma(2.2, channels)
    shape = (6, 7, channels)
    main = Photo(rng.integers(0, 256, shape, dtype=np.uint8), 1.0)
    exposure = np.exp(response.log_exposure[0])
    warped = rng.choice(np.append(exposure * ratio, [0.0]), shape) * rng.uniform(0.9, 1.1, shape)
    found = agrees_with_main(
        main, warped.astype(np.float32), np.ones(shape, bool), response, exposures=(1.0, 1 / ratio), config=config
    )

    z, own = main.codes.astype(float), exposure * ratio
    position = np.interp(warped, own, np.arange(256))
    most = at(own, np.minimum(position + config.auxiliary_codes, 255))
    least = np.where(position < config.auxiliary_codes, 0, at(own, position - config.auxiliary_codes))
    highest = np.where(z >= config.white_code, np.inf, at(exposure, np.minimum(z + config.codes, 255)))
    lowest = np.where(z <= config.black_code, 0, at(exposure, np.maximum(z - config.codes, 0)))
    highest, lowest = highest * (1 + config.slack), lowest * (1 - config.slack)
    near = np.isclose(least, highest, rtol=1e-5, atol=1e-9) | np.isclose(most, lowest, rtol=1e-5, atol=1e-9)
    clear = ~near.any(axis=2)
    expected = ((least <= highest) & (most >= lowest)).all(axis=2)
    np.testing.assert_array_equal(found[clear], expected[clear])
    assert clear.any()
