"""Twin of stereohdr.restoration.shadows: whole images in float64, every window summed afresh."""

from itertools import pairwise

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

LEVELS = 24
FEWEST_WINDOWS = 50
SMALLEST_SQUARE = 1e-30
LEAST_UNEXPLAINED = 0.1
LEAST_SHARE = 1e-3
LEAST_WEIGHT = 1e-6


def clean_shadows(main, radiance, auxiliary, usable, response, *, exposure, config):
    result, shares = radiance.copy(), np.zeros_like(radiance)
    for c in range(radiance.shape[2]):
        if usable[..., c].any():
            table = np.exp(response.log_exposure[c]) / exposure
            result[..., c], shares[..., c] = clean_channel(
                main.codes[..., c], main.white, radiance[..., c], auxiliary[..., c], usable[..., c], table, config
            )
    return result, shares


def clean_channel(codes, white, radiance, auxiliary, usable, table, config):
    main, warped = radiance.astype(np.float64), np.where(usable, auxiliary, 0).astype(np.float64)
    step, doubt = code_errors(codes, white, table)
    levels, log_variance = noise_curve(main, warped, usable, config.noise_radius)
    noise = np.zeros(main.shape)
    if levels.size:
        brightness = mean(np.where(usable, warped, main), config.noise_radius)
        places = table_places(np.exp(levels[0]), np.exp(levels[-1]))
        noise = np.interp(brightness, places, np.exp(np.interp(np.log(places), levels, log_variance)))
    noise = np.maximum(noise, np.maximum(step**2 / 12, SMALLEST_SQUARE)) + doubt**2

    prediction, unexplained, explained = predict(main, warped, usable, noise, doubt, config)
    miss = (main - prediction) ** 2
    near = mean(np.where(explained, miss, 0), 1) / np.maximum(mean(explained.astype(np.float64), 1), 1 / 9)
    unexplained = np.maximum(unexplained, outlying(miss, near, noise))
    own_mean, own_share = smooth(main, noise, config.radius)
    prediction = np.where(explained, prediction, own_mean)
    share = np.where(explained, noise / (noise + unexplained), config.alone_share * own_share)
    brightness = np.maximum(mean(np.where(usable, warped, main), config.radius), SMALLEST_SQUARE)
    full = np.where(explained, 2 * config.clean_noise, max(config.alone_noise, 2 * config.clean_noise))
    share *= np.clip((np.sqrt(noise) / brightness - config.clean_noise) / (full - config.clean_noise), 0, 1)
    cleaned = main + share * (prediction - main)
    darker = np.where(explained, np.clip(warped, LEAST_SHARE * main, main), main)
    return np.where(share > 0, np.maximum(cleaned, config.lowest * darker), main), share


def table_places(low, high):
    """64 places in each power of two, the last one at or below `low` to the first one above `high`."""
    places = np.ldexp(1 + np.arange(64) / 64, np.arange(-100, 100)[:, None]).ravel()
    return places[np.searchsorted(places, low, "right") - 1 : np.searchsorted(places, high, "right") + 1]


def noise_curve(main, auxiliary, usable, radius):
    count, (_, mean_a, variance_m, variance_a, covariance) = moments(main, auxiliary, usable, radius)
    slope = np.clip(covariance / (variance_a + SMALLEST_SQUARE), 0, 2)
    pixels = (2 * radius + 1) ** 2
    noise = np.maximum(variance_m - 2 * slope * covariance + slope**2 * variance_a, 0) * pixels / (pixels - 2)
    full = (count > pixels - 0.5) & (mean_a > 0)
    if full.sum() < FEWEST_WINDOWS:
        return np.empty(0), np.empty(0)
    level, noise = np.log(mean_a[full]), noise[full]
    texture = variance_a[full] / mean_a[full] ** 2
    edges = np.quantile(level, np.linspace(0, 1, min(LEVELS, level.size // FEWEST_WINDOWS) + 1))
    levels, variances = [], []
    for low, high in pairwise(edges):
        inside = (level >= low) & (level <= high)
        if inside.sum() >= FEWEST_WINDOWS:
            flat = texture[inside] <= np.median(texture[inside])
            levels.append(np.median(level[inside]))
            variances.append(np.median(noise[inside][flat]))
    return np.array(levels), np.log(np.maximum(variances, SMALLEST_SQUARE))


def smooth(main, noise, radius):
    """The mean of each window, and how much of a pixel's deviation from it is noise (Lee 1980)."""
    own_mean = mean(main, radius)
    variance = np.maximum(mean(main * main, radius) - own_mean**2, 0)
    mean_noise = mean(noise, radius)
    structure = np.maximum(variance - mean_noise, 0) + LEAST_UNEXPLAINED * mean_noise
    miss = (main - own_mean) ** 2
    structure = np.maximum(structure, outlying(miss, mean(miss, 1), noise))
    return own_mean, noise / (noise + structure)


def outlying(miss, near, noise):
    """How much the squared miss of a pixel, or of those around it, exceeds what noise can do."""
    return np.maximum(near - 2 * noise, miss - 9 * noise)


def predict(main, warped, usable, noise, doubt, config):
    """The prediction, the variance that it leaves unexplained beyond noise, and where there is one."""
    radius = config.radius
    pixels = (2 * radius + 1) ** 2
    found, (mean_m, mean_a, variance_m, variance_a, covariance) = moments(main, warped, usable, radius)
    count = np.maximum(found, 1)
    mean_noise = np.maximum(mean(usable * noise, radius) * pixels / count, SMALLEST_SQUARE)
    mean_doubt = mean(usable * doubt**2, radius) * pixels / count
    pull = config.slope_pull * mean_noise / count + SMALLEST_SQUARE
    slope = np.clip((covariance + pull) / (variance_a + pull), 0, 2)
    unexplained = variance_m - 2 * slope * covariance + slope**2 * variance_a
    unexplained = np.maximum(unexplained - mean_noise, 0) + LEAST_UNEXPLAINED * mean_noise
    # Where the darkest codes hardly know their own level, the auxiliary view's level counts.
    level_error = (config.level_error * mean_a) ** 2 + mean_noise / count + SMALLEST_SQUARE
    level = mean_m + mean_doubt / (mean_doubt + level_error) * (mean_a - mean_m)
    offset = level - slope * mean_a
    weight = np.where(found > config.fewest_share * pixels, count / (1 + unexplained / mean_noise) ** 2, 0)
    total = mean(weight, radius)
    explained = usable & (total > LEAST_WEIGHT)
    scale = explained / np.maximum(total, LEAST_WEIGHT)
    slope, offset, unexplained = (mean(weight * value, radius) * scale for value in (slope, offset, unexplained))
    return slope * warped + offset, unexplained, explained


def code_errors(codes, white, table):
    """The radiance step of one code at each pixel, and how wrong the radiance of the code itself may be."""
    position = np.linspace(0, len(table) - 1, white + 1)
    step = np.gradient(np.interp(position, np.arange(len(table)), table))
    doubt = step / (1 + np.arange(white + 1)) ** 2
    return step[codes], doubt[codes]


def moments(main, auxiliary, usable, radius):
    """The number of usable pixels in each window, and means, variances and covariance over them."""
    pixels = (2 * radius + 1) ** 2
    count = np.rint(mean(usable.astype(np.float64), radius) * pixels)
    scale = pixels / np.maximum(count, 1)
    m, a = usable * main, usable * auxiliary
    mean_m, mean_a = mean(m, radius) * scale, mean(a, radius) * scale
    variance_m = np.maximum(mean(m * main, radius) * scale - mean_m**2, 0)
    variance_a = np.maximum(mean(a * auxiliary, radius) * scale - mean_a**2, 0)
    covariance = mean(m * auxiliary, radius) * scale - mean_m * mean_a
    return count, (mean_m, mean_a, variance_m, variance_a, covariance)


def mean(image, radius):
    """Mean over windows; the image goes on with its border pixels."""
    padded = np.pad(image, radius, mode="edge")
    return sliding_window_view(padded, (2 * radius + 1, 2 * radius + 1)).mean(axis=(2, 3))
