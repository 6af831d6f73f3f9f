import numpy as np

from stereohdr.disparity.consistency import consistent_share


def test_a_shifted_view_confirms_every_match_and_noise_few():
    rng = np.random.default_rng(0)
    scene = rng.uniform(1, 2, (40, 90)).astype(np.float32)
    usable = np.ones((40, 80), dtype=bool)
    main, auxiliary = np.ascontiguousarray(scene[:, :80]), np.ascontiguousarray(scene[:, 7:87])
    assert consistent_share(main, auxiliary, usable, usable, max_disparity=14) > 0.98
    other = rng.uniform(1, 2, (40, 80)).astype(np.float32)
    assert consistent_share(main, other, usable, usable, max_disparity=14) < 0.75


def test_only_usable_pixels_with_a_whole_search_range_count():
    image = np.random.default_rng(1).uniform(1, 2, (20, 30)).astype(np.float32)
    everywhere = np.ones((20, 30), dtype=bool)
    right = np.zeros((20, 30), dtype=bool)
    right[:, 25:] = True  # their search would leave the main view
    assert np.isnan(consistent_share(image, image, everywhere, right, max_disparity=9))
    assert np.isnan(consistent_share(image, image, right, everywhere, max_disparity=9))
    right[:, 4:8] = True
    assert consistent_share(image, image, everywhere, right, max_disparity=9) == 1.0
