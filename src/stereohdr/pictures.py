"""Pictures for people: stage images, maps in colour, and the contact sheet of the demo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stereohdr.io.files import atomic_path, make_folder
from stereohdr.io.images import write_png
from stereohdr.model import HdrResult, Photo, SourceFlag
from stereohdr.tone_mapping import tonemap

Picture = NDArray[np.uint8]

HEAT = np.array(
    [[8, 5, 30], [66, 14, 92], [135, 34, 106], [196, 60, 78], [239, 112, 46], [252, 181, 56], [252, 250, 190]]
)
"""Colours of `heat` from 0 to 1."""

RAINBOW = np.array([[30, 60, 200], [40, 170, 220], [80, 200, 90], [240, 220, 60], [220, 30, 30]])
"""Colours of probabilities from 0 to 1, as HDR-VDP maps are usually drawn."""

DIVERGING = np.array([[24, 60, 150], [110, 160, 215], [238, 238, 238], [225, 140, 110], [150, 22, 36]])
"""Colours of `diverging` from -1 (too dark) over 0 to 1 (too bright)."""

SOURCE_COLOURS = {
    SourceFlag.MEASURED: (70, 70, 70),
    SourceFlag.AUXILIARY: (60, 190, 90),
    SourceFlag.FILLED_OCCLUDED: (60, 110, 235),
    SourceFlag.FILLED_REJECTED: (245, 165, 35),
    SourceFlag.NO_INFORMATION: (220, 40, 40),
    SourceFlag.WEIGHT_CUT: (180, 60, 190),
}
"""Colour of each flag in pictures of `HdrResult.source`."""


def _gradient(values: NDArray[Any], colours: NDArray[Any]) -> Picture:
    position = np.clip(np.nan_to_num(values), 0.0, 1.0) * (len(colours) - 1)
    knots = np.arange(len(colours))
    channels = [np.interp(position, knots, colours[:, c]) for c in range(3)]
    return np.rint(np.stack(channels, axis=-1)).astype(np.uint8)


def heat(values: NDArray[Any], *, low: float = 0.0, high: float = 1.0) -> Picture:
    """Colour ``(H, W)`` numbers from dark (`low`) to bright (`high`); returns ``(H, W, 3)`` uint8."""
    return _gradient((np.asarray(values, float) - low) / ((high - low) or 1.0), HEAT)


def diverging(values: NDArray[Any], *, limit: float) -> Picture:
    """Colour ``(H, W)`` signed numbers, blue at -`limit`, grey at 0, red at `limit`; ``(H, W, 3)`` uint8."""
    return _gradient(0.5 + 0.5 * np.asarray(values, float) / limit, DIVERGING)


def segment_colours(labels: NDArray[np.integer[Any]]) -> Picture:
    """Give each ``(H, W)`` label a colour of its own; returns ``(H, W, 3)`` uint8."""
    palette = np.random.default_rng(20).integers(40, 256, (int(labels.max()) + 1, 3)).astype(np.uint8)
    return palette[labels]


def source_colours(source: NDArray[np.uint8]) -> Picture:
    """Colour ``(H, W)`` source flags by `SOURCE_COLOURS`; returns ``(H, W, 3)`` uint8."""
    palette = np.zeros((max(SOURCE_COLOURS) + 1, 3), np.uint8)
    for flag, colour in SOURCE_COLOURS.items():
        palette[flag] = colour
    return palette[source]


def tonemap_together(images: Sequence[NDArray[np.float32]]) -> list[Picture]:
    """Tone map ``(H, W, C)`` radiance images of equal width with one common curve, to compare them."""
    heights = np.cumsum([image.shape[0] for image in images])[:-1]
    # An unconstrained Poisson solution may dip below zero.
    stacked = np.maximum(np.concatenate(list(images)), 0)
    return np.split(tonemap(stacked), heights)


def codes_picture(photo: Photo) -> Picture:
    """Return a photo's codes in 8 bits, whatever its bit depth; ``(H, W, C)``."""
    return np.rint(photo.codes * (255.0 / photo.white)).astype(np.uint8)


def stage_pictures(stages: Mapping[str, NDArray[Any]]) -> dict[str, Picture]:
    """Draw every intermediate array in the way that suits it.

    Parameters
    ----------
    stages
        `HdrResult.stages`: bool maps, integer labels, ``(H, W)`` float maps, ``(H, W, C)`` float radiance.

    Returns
    -------
    Name to ``(H, W)`` or ``(H, W, C)`` uint8. All radiance images share one tone curve.
    """
    radiance = {name: array for name, array in stages.items() if array.ndim == 3}
    toned = dict(zip(radiance, tonemap_together(list(radiance.values())), strict=True)) if radiance else {}
    pictures = {}
    for name, array in stages.items():
        if name in toned:
            pictures[name] = toned[name]
        elif array.dtype == bool:
            pictures[name] = array.astype(np.uint8) * np.uint8(255)
        elif np.issubdtype(array.dtype, np.integer):
            pictures[name] = segment_colours(array)
        else:
            pictures[name] = heat(array, high=max(1.0, float(array.max())))
    return pictures


def save_stages(result: HdrResult, folder: str | Path) -> list[Path]:
    """Write every intermediate of a result as picture and array, numbered in the order of the stages.

    Parameters
    ----------
    result
        Made with ``keep_stages=True``.
    folder
        Created if it does not exist.

    Returns
    -------
    The files written: ``01_main_radiance.png``, ``01_main_radiance.npy``, ...; then the result itself, its
    source flags, and ``response.json``.
    """
    folder = make_folder(folder)
    arrays = {**result.stages, "result": result.radiance}
    pictures = stage_pictures(arrays)
    arrays["source"], pictures["source"] = result.source, source_colours(result.source)
    written = []
    for number, (name, array) in enumerate(arrays.items(), start=1):
        base = folder / f"{number:02d}_{name}"
        write_png(base.with_suffix(".png"), pictures[name])
        with atomic_path(base.with_suffix(".npy")) as temporary:
            np.save(temporary, array, allow_pickle=False)
        written += [base.with_suffix(".png"), base.with_suffix(".npy")]
    result.response.save(folder / "response.json")
    return [*written, folder / "response.json"]


def visibility_picture(probability: NDArray[np.float64], reference: NDArray[np.floating[Any]]) -> Picture:
    """Draw where a difference is seen, in colour over the grey picture, with a colour bar.

    Parameters
    ----------
    probability
        ``(H, W)``, 0..1, `HdrVdp2Result.p_map`.
    reference
        ``(H, W, C)`` radiance >= 0 of the picture behind.

    Returns
    -------
    ``(H + 40, W, 3)`` uint8: blue is not seen, red is seen by everyone.
    """
    from PIL import Image, ImageDraw, ImageFont

    grey = tonemap(reference, saturation=0.0).mean(axis=2, keepdims=True) / 255.0
    colour = _gradient(probability, RAINBOW) / 255.0
    # The colour carries the probability, the brightness the picture.
    over = np.rint(255 * colour * (0.25 + 0.75 * grey)).astype(np.uint8)
    height, width = probability.shape
    picture = Image.new("RGB", (width, height + 40), (24, 24, 26))
    picture.paste(Image.fromarray(over), (0, 0))
    bar = np.repeat(_gradient(np.linspace(0, 1, width)[None], RAINBOW), 14, axis=0)
    picture.paste(Image.fromarray(bar), (0, height + 4))
    draw, font = ImageDraw.Draw(picture), ImageFont.load_default(14)
    for share, anchor in ((0.0, "lt"), (0.5, "mt"), (1.0, "rt")):
        draw.text((share * (width - 1), height + 22), f"{share:g}", font=font, fill=(230, 230, 230), anchor=anchor)
    return np.asarray(picture)


def contact_sheet(
    tiles: Sequence[tuple[str, Picture]], *, columns: int = 4, tile_width: int = 480, title: str = ""
) -> Picture:
    """Arrange captioned pictures on one sheet.

    Parameters
    ----------
    tiles
        Captions and pictures, ``(H, W)``, ``(H, W, 1)`` or ``(H, W, 3)`` uint8; scaled to `tile_width`.
    columns
        Tiles per row.
    tile_width
        Pixels.
    title
        Line above the tiles.

    Returns
    -------
    ``(H, W, 3)`` uint8.
    """
    from PIL import Image, ImageDraw, ImageFont

    gap, caption = 10, 26
    font, title_font = ImageFont.load_default(16), ImageFont.load_default(22)
    scaled = []
    for _, picture in tiles:
        flat = picture[..., 0] if picture.ndim == 3 and picture.shape[2] == 1 else picture
        image = Image.fromarray(flat).convert("RGB")
        height = max(1, round(image.height * tile_width / image.width))
        filter_ = Image.Resampling.LANCZOS if image.width > tile_width else Image.Resampling.NEAREST
        scaled.append(image.resize((tile_width, height), filter_))
    tile_height = max(image.height for image in scaled) + caption
    rows = -(-len(tiles) // columns)
    top = gap + (34 if title else 0)
    size = (gap + columns * (tile_width + gap), top + rows * (tile_height + gap))
    sheet = Image.new("RGB", size, (24, 24, 26))
    draw = ImageDraw.Draw(sheet)
    draw.text((gap, gap), title, font=title_font, fill=(255, 255, 255))
    for n, ((text, _), image) in enumerate(zip(tiles, scaled, strict=True)):
        x = gap + n % columns * (tile_width + gap)
        y = top + n // columns * (tile_height + gap)
        draw.text((x, y + 3), text, font=font, fill=(225, 225, 225))
        sheet.paste(image, (x, y + caption))
    return np.asarray(sheet)
