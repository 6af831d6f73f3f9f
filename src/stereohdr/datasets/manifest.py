"""Any folder of photos as a scene: a small TOML file ``scene.toml`` says what is what.

For instance, the Jumble set that the paper borrows (views 12 and 13 of 15, 61 and 5 ms, halved, cropped)::

    name = "Jumble-short-long"
    left = "view12_61ms.png"
    right = "view13_5ms.png"
    exposures = ["61ms", "5ms"]
    max_disparity = 100
    reduce = 2
    crop = [0, 0, 800, 600]
    bracket = ["view12_5ms.png", "view12_17ms.png", "view12_61ms.png"]
    bracket_exposures = ["5ms", "17ms", "61ms"]

Keys
----
left, right
    The photos of the two cameras: PNG, JPEG or TIFF, rectified. Required.
exposures
    Exposure times, left then right: seconds, or text such as ``"1/60"`` and ``"250ms"``. From EXIF when missing.
main
    ``"left"`` (default) or ``"right"``: the view in which the result is compared.
max_disparity
    Largest disparity to search, in pixels of the reduced image. Required.
reference
    HDR image of the main view (.exr, .hdr, .pfm, .npy), of the size of the photos. Either this or:
bracket, bracket_exposures
    Photos of the main view that are merged into the reference, and their times as in `exposures`.
disparity_left, disparity_right, disparity_scale
    Ground truth in each view's pixels: PNG (0 is unknown) or .pfm (infinity is); stored value of one pixel of
    disparity (default 1). Of the size of the photos.
response
    Known response of the camera: a file that ``ResponseCurve.save`` wrote.
white_level
    Code at which the sensor clips, for instance 4095 for 12 bits in 16.
reduce
    Blocks of so many pixels are averaged (default 1).
crop
    ``[left, top, width, height]`` in pixels of the reduced image.
name, description
    For tables; the name of the folder by default.

Names of files are relative to the manifest. All that has the size of the photos is reduced and cropped alike.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from stereohdr.datasets.brackets import bracket_reference
from stereohdr.datasets.ground_truth import Values, known_disparities, read_disparity, reduced_disparity
from stereohdr.datasets.resizing import Box, cropped, cropped_photo, reduced_image, reduced_photo
from stereohdr.datasets.scene import EvaluationScene
from stereohdr.errors import FileFormatError, InputError
from stereohdr.io import read_hdr, read_photo
from stereohdr.io.metadata import parse_exposure_time
from stereohdr.model import Photo, ResponseCurve, StereoPair

MANIFEST_NAME = "scene.toml"
"""The file that makes a folder a scene."""

_TEXT, _NUMBER, _WHOLE, _LIST = "text in quotes", "a number", "a whole number", "a list"
_KEYS: Mapping[str, str] = {
    "name": _TEXT,
    "description": _TEXT,
    "left": _TEXT,
    "right": _TEXT,
    "main": _TEXT,
    "exposures": _LIST,
    "max_disparity": _WHOLE,
    "reference": _TEXT,
    "bracket": _LIST,
    "bracket_exposures": _LIST,
    "disparity_left": _TEXT,
    "disparity_right": _TEXT,
    "disparity_scale": _NUMBER,
    "response": _TEXT,
    "white_level": _WHOLE,
    "reduce": _WHOLE,
    "crop": _LIST,
}
_TYPES: Mapping[str, tuple[type, ...]] = {_TEXT: (str,), _NUMBER: (int, float), _WHOLE: (int,), _LIST: (list,)}
_REQUIRED = ("left", "right", "max_disparity")


def read_manifest(path: str | Path) -> dict[str, Any]:
    """Read and check the keys of a manifest; see the module for their meaning.

    Raises
    ------
    FileFormatError
        The file cannot be read, is not TOML, or a key is unknown, missing, or of the wrong kind.
    """
    try:
        with open(path, "rb") as file:
            content = tomllib.load(file)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot read the manifest ({error.strerror})") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise FileFormatError(f"{path}: not valid TOML ({error}); correct the manifest") from error
    for key, value in content.items():
        if key not in _KEYS:
            raise FileFormatError(f"{path}: unknown key {key!r}; known are {', '.join(sorted(_KEYS))}")
        if type(value) not in _TYPES[_KEYS[key]]:
            raise FileFormatError(f"{path}: {key} must be {_KEYS[key]}, got {value!r}")
    missing = [key for key in _REQUIRED if key not in content]
    if missing:
        raise FileFormatError(f"{path}: the manifest does not say {', '.join(missing)}; add it")
    if ("reference" in content) == ("bracket" in content):
        raise FileFormatError(
            f"{path}: the main view needs something to compare with; give either reference (an HDR image) or "
            f"bracket (its photos at several exposures)"
        )
    crop = content.get("crop")
    if crop is not None and not (len(crop) == 4 and all(type(value) is int for value in crop)):
        raise FileFormatError(f"{path}: crop must be [left, top, width, height] in whole pixels, got {crop!r}")
    if content.get("reduce", 1) < 1:
        raise FileFormatError(f"{path}: reduce must be 1 or more, got {content['reduce']}")
    return content


def manifest_scene(path: str | Path) -> EvaluationScene:
    """Read the scene that a manifest describes.

    Parameters
    ----------
    path
        The manifest, or the folder that holds it.

    Raises
    ------
    FileFormatError
        The manifest or a file that it names is missing or wrong.
    InputError
        The photos do not fit together.
    """
    path = Path(path)
    path = path / MANIFEST_NAME if path.is_dir() else path
    content = read_manifest(path)
    try:
        return _scene(path, content)
    except FileFormatError:
        raise
    except InputError as error:
        raise type(error)(f"{path}: {error}") from error


def _scene(path: Path, content: Mapping[str, Any]) -> EvaluationScene:
    folder = path.parent
    white, factor = content.get("white_level"), content.get("reduce", 1)
    box = cast(Box, tuple(content["crop"])) if "crop" in content else None

    def photos(names: list[Any], times: list[float] | list[None]) -> list[Photo]:
        found = []
        for name, time in zip(names, times, strict=True):
            photo = reduced_photo(read_photo(folder / name, exposure_time=time, white_level=white), factor)
            found.append(photo if box is None else cropped_photo(photo, box))
        return found

    left, right = photos([content["left"], content["right"]], _times(path, content, "exposures", 2))
    pair = StereoPair(left, right, content.get("main", "left"))

    known_response = ResponseCurve.load(folder / content["response"]) if "response" in content else None
    estimated = None
    if "bracket" in content:
        names = content["bracket"]
        if not all(isinstance(name, str) for name in names):
            raise FileFormatError(f"{path}: bracket must be a list of file names, got {names!r}")
        bracket = photos(names, _times(path, content, "bracket_exposures", len(names)))
        reference, clipped, curve = bracket_reference(bracket, known_response)
        estimated = None if known_response else curve
    else:
        reference = _reference(folder / content["reference"], folder / content[pair.main], factor, box)
        clipped = np.zeros(reference.shape[:2], bool)

    def disparity(key: str) -> Values | None:
        if key not in content:
            return None
        values = read_disparity(folder / content[key], scale=content.get("disparity_scale", 1.0))
        values = reduced_disparity(values, factor)
        return values if box is None else cropped(values, box, str(folder / content[key]))

    truth = known_disparities(disparity("disparity_left"), disparity("disparity_right"))
    name = content.get("name", folder.resolve().name)
    return EvaluationScene(
        name=name,
        pair=pair,
        reference=reference,
        reference_clipped=clipped,
        max_disparity=content["max_disparity"],
        disparity_main=truth[0] if pair.main == "left" else truth[1],
        disparity_auxiliary=truth[1] if pair.main == "left" else truth[0],
        response=known_response,
        reference_response=estimated,
        description=content.get("description", f"{name}, described by {path.name}"),
    )


def _reference(path: Path, photo: Path, factor: int, box: Box | None) -> NDArray[np.float32]:
    radiance = read_hdr(path)
    expected = read_photo(photo).codes.shape
    if radiance.shape != expected:
        raise FileFormatError(
            f"{path}: the reference has shape {radiance.shape}, the photo {photo.name} has {expected}; "
            f"give a reference of the size of the photos (it is reduced and cropped like them)"
        )
    positive = radiance > 0
    if not positive.any():
        raise FileFormatError(f"{path}: the reference is black everywhere; give another image")
    radiance = np.maximum(radiance, radiance[positive].min())  # pictures of this kind hold zeros; stops need none
    if factor > 1:
        radiance = reduced_image(radiance, factor, str(path)).astype(np.float32)
    return radiance if box is None else cropped(radiance, box, str(path))


def _times(path: Path, content: Mapping[str, Any], key: str, count: int) -> list[float] | list[None]:
    """Return `count` exposure times in seconds, None each when the manifest leaves them to EXIF."""
    if key not in content:
        return [None] * count
    given = content[key]
    if len(given) != count:
        raise FileFormatError(f"{path}: {key} gives {len(given)} times for {count} photos; give one for each")
    times = []
    for value in given:
        if type(value) not in (int, float, str):
            raise FileFormatError(
                f"{path}: {key} holds {value!r}; give seconds, or text such as '1/60' or '250ms'"
            )
        try:
            times.append(parse_exposure_time(str(value)))
        except InputError as error:
            raise FileFormatError(f"{path}: {key}: {error}") from error
    return times
