"""Hot loops of `clean_shadows`; readable twin in tests/reference/shadows.py.

An image is read once, row by row, and what is made of a row waits in a few buffers until the rows below it, which
its windows reach, are there. All sums over windows are running sums in float64: along a row when it enters, down
the columns as the window moves on. Beyond the border, images go on with their border pixels.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from stereohdr.kernels import kernel

SMALLEST_SQUARE = 1e-30
"""Keeps divisions by a variance finite."""

LEAST_UNEXPLAINED = 0.1
"""Share of the noise variance that counts as unexplained at least: no relation is perfect."""

LEAST_SHARE = 1e-3
"""The auxiliary view is taken to be no darker than this share of the main view's value."""

TABLE_BITS = 6
"""Bits of a brightness, behind the leading one, that number the table of noise: 64 places per power of two."""

TABLE_SHIFT = 52 - TABLE_BITS
"""The bits of a float64 number behind them."""

LEAST_WEIGHT = 1e-6
"""Mean weight of the windows around a pixel below which none of them explains it."""


class Views(NamedTuple):
    """Radiance of both views, ``(H, W, C)``, and where the auxiliary view is usable; see `clean_shadows`."""

    main: NDArray[np.float32]
    auxiliary: NDArray[np.float32]
    usable: NDArray[np.bool_]


class Noise(NamedTuple):
    """Variance of the noise: a function of brightness, no less than that of rounding, plus the code's doubt."""

    brightness: NDArray[np.float64]
    """``(N,)``, neighbouring numbers of `TABLE_BITS` bits; beyond them the variance stays the same."""
    variance: NDArray[np.float64]
    """``(N,)``, linear in between."""
    slopes: NDArray[np.float64]
    """``(N,)``, from each point to the next, and 0 behind the last."""
    rounding: NDArray[np.float64]
    """``(codes,)`` variance of rounding to whole codes."""
    doubt: NDArray[np.float64]
    """``(codes,)`` squared error of the radiance that a code stands for."""


class Settings(NamedTuple):
    """Those of `ShadowsConfig`, in the same units."""

    radius: int
    noise_radius: int
    clean_noise: float
    level_error: float
    slope_pull: float
    fewest_share: float
    alone_share: float
    alone_noise: float
    lowest: float


# ---------------------------------------------------------------------------------------------------------------
# Sums over windows


class Windows(NamedTuple):
    """Sums of some quantities over windows that move down the image."""

    radius: int
    entering: NDArray[np.float64]
    """``(quantities, W + radius + 1)``, the row that enters, and room behind it."""
    rows: NDArray[np.float64]
    """``(2 radius + 2, quantities, W)``, the last rows, summed along each row; row y is at y % (2 radius + 2)."""
    total: NDArray[np.float64]
    """``(quantities, W)``, the sums."""


@kernel
def enter(windows, row):
    """Take in the row that stands in `entering` as row number `row`."""
    values, radius = windows.entering, windows.radius
    sums = windows.rows[row % windows.rows.shape[0]]
    quantities, width = sums.shape
    for q in range(0, quantities, 4):
        # Four running sums at a time, because each addition waits for the one before it.
        i, j, k = min(q + 1, quantities - 1), min(q + 2, quantities - 1), min(q + 3, quantities - 1)
        a, b, c, d = values[q], values[i], values[j], values[k]
        a[width:], b[width:], c[width:], d[width:] = a[width - 1], b[width - 1], c[width - 1], d[width - 1]
        sum_a, sum_b, sum_c, sum_d = radius * a[0], radius * b[0], radius * c[0], radius * d[0]
        for x in range(radius + 1):
            sum_a += a[x]
            sum_b += b[x]
            sum_c += c[x]
            sum_d += d[x]
        for x in range(width):
            sums[q, x], sums[i, x], sums[j, x], sums[k, x] = sum_a, sum_b, sum_c, sum_d
            ahead, behind = x + radius + 1, max(x - radius, 0)
            sum_a += a[ahead] - a[behind]
            sum_b += b[ahead] - b[behind]
            sum_c += c[ahead] - c[behind]
            sum_d += d[ahead] - d[behind]


@kernel
def move_to(windows, row, height, first):
    """Let `total` be the sums around the row below the one before, or around the `first` row of all.

    The rows up to ``row + radius`` have entered, and none below.
    """
    last, slots = height - 1, windows.rows.shape[0]
    total = windows.total.ravel()
    if not first:
        ahead = windows.rows[min(row + windows.radius, last) % slots].ravel()
        behind = windows.rows[max(row - windows.radius - 1, 0) % slots].ravel()
        for x in range(total.size):
            total[x] += ahead[x] - behind[x]
        return
    total[:] = 0
    for y in range(row - windows.radius, row + windows.radius + 1):
        ahead = windows.rows[min(max(y, 0), last) % slots].ravel()
        for x in range(total.size):
            total[x] += ahead[x]


# ---------------------------------------------------------------------------------------------------------------
# Noise


MAIN, AUXILIARY, USABLE = range(3)
"""A row of the images: the auxiliary view 0 where it is not usable, which is 1 or 0."""


@kernel
def read_row(views, channel, y, images):
    """Write a row of one channel of both views, ``(3, W)`` float32."""
    for x in range(images.shape[1]):
        usable = views.usable[y, x, channel]
        images[MAIN, x] = views.main[y, x, channel]
        images[AUXILIARY, x] = views.auxiliary[y, x, channel] if usable else np.float32(0)
        images[USABLE, x] = np.float32(1) if usable else np.float32(0)


COUNT, M, A, MM, AA, MA, NOISE, DOUBT, OWN, OWN_SQUARE, OWN_NOISE, BRIGHTNESS = range(12)
"""Quantities whose sums over windows are needed: those of usable pixels, and those of all from OWN on."""


@kernel
def fill_products(images, out):
    """Write of the usable pixels of a row: their number, m, a, m m, a a, m a."""
    for x in range(images.shape[1]):
        out[COUNT, x] = images[USABLE, x]
        out[M, x] = images[MAIN, x] * out[COUNT, x]
        out[A, x] = images[AUXILIARY, x]
    for x in range(images.shape[1]):
        m, a = out[M, x], out[A, x]
        out[MM, x] = m * m
        out[AA, x] = a * a
        out[MA, x] = m * a


@kernel
def measure_windows(views, channel, stride, images, windows, brightness, texture, noise):
    """Write what every `stride`-th window of every `stride`-th row shows.

    Parameters
    ----------
    images
        ``(3, W)`` float32, scratch memory.
    windows
        Of six quantities, scratch memory.
    brightness, texture, noise
        ``(rows, columns)``: mean of the auxiliary view, its variance over its squared mean, and what it leaves
        unexplained of the main view's variance. `brightness` is 0 where not all of a window is usable.
    """
    height, radius = views.main.shape[0], windows.radius
    size = (2 * radius + 1) ** 2
    y = np.int64(0)  # not 0: kernels are compiled anew for each constant that they are called with
    for row in range((brightness.shape[0] - 1) * stride + 1):
        while y <= min(row + radius, height - 1):
            read_row(views, channel, y, images)
            fill_products(images, windows.entering)
            enter(windows, y)
            y += 1
        move_to(windows, row, height, row == 0)
        if row % stride:
            continue
        total, i = windows.total, row // stride
        for j in range(brightness.shape[1]):
            x = j * stride
            m, a = total[M, x] / size, total[A, x] / size
            variance_m = max(total[MM, x] / size - m * m, 0.0)
            variance_a = max(total[AA, x] / size - a * a, 0.0)
            covariance = total[MA, x] / size - m * a
            slope = min(max(np.divide(covariance, variance_a + SMALLEST_SQUARE), 0.0), 2.0)
            unexplained = variance_m - 2 * slope * covariance + slope * slope * variance_a
            noise[i, j] = max(unexplained, 0.0) * size / (size - 2)
            whole = total[COUNT, x] > size - 0.5 and a > 0
            brightness[i, j] = a if whole else 0.0
            texture[i, j] = variance_a / (a * a) if whole else 0.0


# ---------------------------------------------------------------------------------------------------------------
# Cleaning


WEIGHT, SLOPE, OFFSET, UNEXPLAINED = range(4)
"""What a window says, the latter three times its weight."""

NEAR, NEAR_COUNT, NEAR_OWN = range(3)
"""Squared misses of the prediction, over the pixels that have one, and of the mean."""

KEPT_NOISE, KEPT_DOUBT, KEPT_MEAN, KEPT_STRUCTURE, KEPT_STRENGTH, KEPT_PREDICTION, KEPT_UNEXPLAINED = range(7)
"""What waits for the end. `KEPT_UNEXPLAINED` is -1 where no window explains a pixel."""


class Scratch(NamedTuple):
    """Memory for rows on their way through `clean_rows`; row y is at y modulo the length."""

    images: NDArray[np.float32]
    """``(2 radius + noise_radius + 2, 3, W)``, see `read_row`."""
    kept: NDArray[np.float64]
    """``(2 radius + 2, 7, W)``, see `KEPT_NOISE`."""
    lights: Windows
    """One quantity: the brightness that the noise depends on."""
    moments: Windows
    """Twelve, see `COUNT`."""
    fits: Windows
    """Four, see `WEIGHT`."""
    misses: Windows
    """Three, see `NEAR`."""


@kernel
def clean_rows(views, codes, channel, noise, settings, start, stop, scratch, cleaned, share):
    """Write rows start to stop of one channel of `clean_shadows`' answers, ``(H, W, C)``."""
    images, kept, lights, moments, fits, misses = scratch
    radius, height = settings.radius, views.main.shape[0]
    last = height - 1
    # The first row that each of them looks around, and the next row to read or make.
    of_misses = start
    of_fits = max(of_misses - 1, 0)
    of_moments = max(of_fits - radius, 0)
    of_lights = max(of_moments - radius, 0)
    missed, fitted, made, seen = of_fits, of_moments, of_lights, max(of_lights - lights.radius, 0)
    for y in range(start, stop):
        while missed <= min(y + 1, last):
            while fitted <= min(missed + radius, last):
                while made <= min(fitted + radius, last):
                    while seen <= min(made + lights.radius, last):
                        image = images[seen % images.shape[0]]
                        read_row(views, channel, seen, image)
                        fill_light(image, lights.entering)
                        enter(lights, seen)
                        seen += 1
                    move_to(lights, made, height, made == of_lights)
                    image, keep = images[made % images.shape[0]], kept[made % kept.shape[0]]
                    noise_row(lights, noise, codes[made], channel, keep)
                    fill_moments(image, keep, moments.entering)
                    enter(moments, made)
                    made += 1
                move_to(moments, fitted, height, fitted == of_moments)
                fit_windows(moments.total, settings, fits.entering)
                smooth(moments.total, settings, kept[fitted % kept.shape[0]])
                enter(fits, fitted)
                fitted += 1
            move_to(fits, missed, height, missed == of_fits)
            image, keep = images[missed % images.shape[0]], kept[missed % kept.shape[0]]
            predict(image, fits.total, settings, keep, misses.entering)
            enter(misses, missed)
            missed += 1
        move_to(misses, y, height, y == of_misses)
        image, keep = images[y % images.shape[0]], kept[y % kept.shape[0]]
        finish(image, misses.total, settings, keep, channel, cleaned[y], share[y])


@kernel
def fill_light(images, out):
    """Write the better known one of both views."""
    for x in range(images.shape[1]):
        out[0, x] = images[AUXILIARY, x] if images[USABLE, x] > 0 else images[MAIN, x]


@kernel
def noise_row(lights, noise, codes, channel, kept):
    """Write the variance of the noise of a row, and the part of it that is doubt about the code."""
    scale = 1 / (2 * lights.radius + 1) ** 2
    brightness, variance = lights.total[0], kept[KEPT_NOISE]
    darkest, brightest = noise.brightness[0], noise.brightness[-1]
    for x in range(variance.size):
        variance[x] = min(max(brightness[x] * scale, darkest), brightest)
    place = variance.view(np.int64)  # the leading bits of a number are its place among all numbers
    first = noise.brightness.view(np.int64)[0] >> TABLE_SHIFT
    for x in range(variance.size):
        k = (place[x] >> TABLE_SHIFT) - first
        measured = noise.variance[k] + noise.slopes[k] * (variance[x] - noise.brightness[k])
        code = codes[x, channel]
        kept[KEPT_DOUBT, x] = noise.doubt[code]
        variance[x] = max(measured, noise.rounding[code]) + noise.doubt[code]


@kernel
def fill_moments(images, kept, out):
    """Write all quantities of a row."""
    fill_products(images, out)
    for x in range(images.shape[1]):
        out[NOISE, x] = kept[KEPT_NOISE, x] * out[COUNT, x]
        out[DOUBT, x] = kept[KEPT_DOUBT, x] * out[COUNT, x]
        out[OWN_NOISE, x] = kept[KEPT_NOISE, x]
    for x in range(images.shape[1]):
        m = np.float64(images[MAIN, x])
        out[OWN, x] = m
        out[OWN_SQUARE, x] = m * m
        out[BRIGHTNESS, x] = out[A, x] + (m - out[M, x])


@kernel
def fit_windows(total, settings, out):
    """Write what each window says: M = slope A + offset, and the variance that this leaves unexplained."""
    fewest = settings.fewest_share * (2 * settings.radius + 1) ** 2
    for x in range(total.shape[1]):
        count = total[COUNT, x]
        scale = 1 / max(count, 1.0)
        m, a = total[M, x] * scale, total[A, x] * scale
        variance_m = max(total[MM, x] * scale - m * m, 0.0)
        variance_a = max(total[AA, x] * scale - a * a, 0.0)
        covariance = total[MA, x] * scale - m * a
        noise, doubt = max(total[NOISE, x] * scale, SMALLEST_SQUARE), max(total[DOUBT, x] * scale, 0.0)
        pull = settings.slope_pull * noise * scale + SMALLEST_SQUARE
        slope = min(max(np.divide(covariance + pull, variance_a + pull), 0.0), 2.0)
        unexplained = variance_m - 2 * slope * covariance + slope * slope * variance_a
        unexplained = max(unexplained - noise, 0.0) + LEAST_UNEXPLAINED * noise
        # Where the darkest codes hardly know their own level, the auxiliary view's level counts.
        level_error = settings.level_error * a
        known = level_error * level_error + noise * scale + SMALLEST_SQUARE
        level = m + np.divide(doubt, doubt + known) * (a - m)
        excess = 1 + np.divide(unexplained, noise)
        weight = np.divide(count, excess * excess) if count > fewest else 0.0
        out[WEIGHT, x] = weight
        out[SLOPE, x] = weight * slope
        out[OFFSET, x] = weight * (level - slope * a)
        out[UNEXPLAINED, x] = weight * unexplained


@kernel
def smooth(total, settings, kept):
    """Write mean and structure of each window of the main view, and how much cleaning its middle needs."""
    scale = 1 / (2 * settings.radius + 1) ** 2
    for x in range(kept.shape[1]):
        mean, noise = total[OWN, x] * scale, total[OWN_NOISE, x] * scale
        variance = max(total[OWN_SQUARE, x] * scale - mean * mean, 0.0)
        kept[KEPT_MEAN, x] = mean
        kept[KEPT_STRUCTURE, x] = max(variance - noise, 0.0) + LEAST_UNEXPLAINED * noise
    for x in range(kept.shape[1]):
        clean = max(total[BRIGHTNESS, x] * scale, SMALLEST_SQUARE) * settings.clean_noise
        kept[KEPT_STRENGTH, x] = max(np.divide(math.sqrt(kept[KEPT_NOISE, x]), clean) - 1, 0.0)


@kernel
def predict(images, total, settings, kept, out):
    """Join what the windows around each pixel say, and write how far this and the mean are from the main view."""
    least = LEAST_WEIGHT * (2 * settings.radius + 1) ** 2
    for x in range(kept.shape[1]):
        weight = total[WEIGHT, x]
        scale = np.divide(1.0, max(weight, least))
        kept[KEPT_PREDICTION, x] = (total[SLOPE, x] * images[AUXILIARY, x] + total[OFFSET, x]) * scale
        rest = max(total[UNEXPLAINED, x] * scale, 0.0)
        kept[KEPT_UNEXPLAINED, x] = rest if weight > least and images[USABLE, x] > 0 else -1.0
    for x in range(kept.shape[1]):
        miss = images[MAIN, x] - kept[KEPT_PREDICTION, x]
        own_miss = images[MAIN, x] - kept[KEPT_MEAN, x]
        explained = kept[KEPT_UNEXPLAINED, x] >= 0
        out[NEAR, x] = miss * miss if explained else 0.0
        out[NEAR_COUNT, x] = 1.0 if explained else 0.0
        out[NEAR_OWN, x] = own_miss * own_miss


@kernel
def finish(images, total, settings, kept, channel, cleaned, share):
    """Write one row of the answers."""
    clean = settings.clean_noise
    alone_rise = clean / max(settings.alone_noise - clean, clean)
    for x in range(kept.shape[1]):
        m, a, noise = np.float64(images[MAIN, x]), np.float64(images[AUXILIARY, x]), kept[KEPT_NOISE, x]
        prediction, mean = kept[KEPT_PREDICTION, x], kept[KEPT_MEAN, x]
        unexplained, structure = kept[KEPT_UNEXPLAINED, x], kept[KEPT_STRUCTURE, x]
        near, own_near = total[NEAR, x] / max(total[NEAR_COUNT, x], 1.0), total[NEAR_OWN, x] / 9
        explained = unexplained >= 0
        prediction = prediction if explained else mean
        # A pixel that the prediction misses by far more than the noise is something else: keep it.
        miss = m - prediction
        outlying = max((near if explained else own_near) - 2 * noise, miss * miss - 9 * noise)
        unexplained = max(unexplained if explained else structure, outlying)
        strength = min(kept[KEPT_STRENGTH, x] * (1.0 if explained else alone_rise), 1.0)
        part = np.divide(noise, noise + unexplained) * strength
        part *= 1.0 if explained else settings.alone_share
        darker = min(max(a, LEAST_SHARE * m), m) if explained else m
        drawn = max(m - part * miss, settings.lowest * darker)
        kept[KEPT_STRENGTH, x] = part
        kept[KEPT_PREDICTION, x] = drawn if part > 0 else m
    for x in range(kept.shape[1]):
        cleaned[x, channel] = kept[KEPT_PREDICTION, x]
        share[x, channel] = kept[KEPT_STRENGTH, x]
