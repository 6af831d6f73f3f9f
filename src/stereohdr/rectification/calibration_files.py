"""Calibrations of stereo rigs in files: our own TOML, and those of OpenCV, ROS and Kalibr."""

from __future__ import annotations

import json
import math
import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from stereohdr.errors import FileFormatError, InputError, MissingDependencyError
from stereohdr.io.files import atomic_path
from stereohdr.io.metadata import first_bytes
from stereohdr.rectification.geometry import StereoCalibration
from stereohdr.rectification.lenses import CameraModel, LensModel

FORMAT = "stereohdr calibration"

LARGEST_FILE = 20_000_000
"""Bytes; nothing that is larger is a calibration."""

ROW_TOLERANCE = 0.01
"""Pixels by which the rows of two ROS projection matrices may differ in a rectified pair."""

Document = dict[str, Any]

_LENSES: dict[str, LensModel | None] = {
    "plumbbob": "plumb-bob",
    "radtan": "plumb-bob",
    "rational": "rational",
    "rationalpolynomial": "rational",
    "fisheye": "fisheye",
    "equidistant": "fisheye",
    "equi": "fisheye",
    "kannalabrandt": "fisheye",
    "none": None,
    "": None,
}
"""What files call the lens models, without punctuation; None: no distortion stated."""

_SIDES = {"left": ("1", "left", "l"), "right": ("2", "right", "r")}

_STEMS = {
    "matrix": ("m", "k", "cameramatrix", "camera", "intrinsic", "intrinsics", "intrinsicmatrix", "mtx"),
    "distortion": (
        "d",
        "distcoeffs",
        "distcoeff",
        "distortion",
        "distortioncoefficients",
        "distortioncoeffs",
        "dist",
    ),
}

_REQUIRED = object()

_KNOWN = (
    "known are the TOML of `stereohdr calibrate`, OpenCV files (M1, D1, M2, D2, R, T or cameraMatrix1, ...), ROS "
    "camera_info pairs and Kalibr camera chains"
)


def read_calibration(*paths: str | Path) -> StereoCalibration:
    """Read the calibration of a stereo rig.

    Parameters
    ----------
    paths
        One file: our TOML; OpenCV FileStorage in YAML, XML or JSON, with its matrices named as in OpenCV's samples
        or tutorials (``M1 D1 M2 D2 R T``, ``cameraMatrix1 distCoeffs1 ...``, ``left_camera_matrix ...``); a Kalibr
        camera chain of two cameras. Or two: OpenCV's ``intrinsics.yml`` and ``extrinsics.yml``; the ROS
        ``camera_info`` (or OpenCV's single-camera files) of the left and the right camera, in this order.

    Returns
    -------
    The calibration; without a pose when the files tell only the lenses.

    Raises
    ------
    FileFormatError
        A file cannot be read, is damaged, or holds no calibration of two cameras.
    MissingDependencyError
        A YAML file is given and PyYAML is not installed.
    """
    if not 1 <= len(paths) <= 2:
        raise InputError(f"a calibration is one file or two, got {len(paths)}")
    names = " and ".join(str(path) for path in paths)
    documents = [_document(path) for path in paths]
    try:
        return _calibration(documents)
    except (AttributeError, KeyError, TypeError, ValueError, IndexError, ArithmeticError) as error:
        reason = str(error) if isinstance(error, InputError) else f"not a calibration of two cameras; {_KNOWN}"
        raise FileFormatError(f"{names}: {reason}") from error


def write_calibration(path: str | Path, calibration: StereoCalibration) -> None:
    """Write a calibration as TOML, whole or not at all; `read_calibration` gives back the same numbers.

    Raises
    ------
    FileFormatError
        The name does not end in ``.toml``, or the file cannot be written.
    """
    if Path(path).suffix.lower() != ".toml":
        raise FileFormatError(f"{path}: a calibration is written as TOML; give a name that ends in .toml")
    lines = [f'format = "{FORMAT}"', "version = 1"]
    if calibration.rms is not None:
        lines.append(f"rms = {calibration.rms!r}  # reprojection error, pixels")
    for side, camera in (("left", calibration.left), ("right", calibration.right)):
        lines += ["", f"[{side}]"]
        if camera.size is not None:
            lines.append(f"size = [{camera.size[0]}, {camera.size[1]}]  # width, height")
        lines += [
            f'lens = "{camera.lens}"',
            f"matrix = {camera.matrix.tolist()}",
            f"distortion = {list(camera.distortion)}",
        ]
    if calibration.rotation is not None and calibration.translation is not None:
        lines += [
            "",
            "[pose]  # X_right = rotation X_left + translation, metres",
            f"rotation = {calibration.rotation.tolist()}",
            f"translation = {calibration.translation.tolist()}",
        ]
    with atomic_path(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def _document(path: str | Path) -> Document:
    """Return what a file holds; matrices as arrays."""
    content = first_bytes(path, LARGEST_FILE + 1)
    try:
        text = content.decode("utf-8-sig").strip()
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: is not a text file; {_KNOWN}") from error
    if len(content) > LARGEST_FILE:
        raise FileFormatError(f"{path}: is too large for a calibration; {_KNOWN}")
    try:
        if Path(path).suffix.lower() == ".toml":
            document = tomllib.loads(text)
        elif text.startswith("<"):
            document = {element.tag: _xml_value(element) for element in ElementTree.fromstring(text)}
        elif text.startswith("{"):
            document = json.loads(text)
        else:
            document = _yaml(text)
        if isinstance(document, dict) and document:
            return {str(key): _value(value) for key, value in document.items()}
    except MissingDependencyError:
        raise
    except Exception as error:  # four parsers, each with its own kinds of errors
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise FileFormatError(f"{path}: damaged calibration ({reason}); {_KNOWN}") from error
    raise FileFormatError(f"{path}: not a calibration; {_KNOWN}")


def _yaml(text: str) -> Any:
    try:
        import yaml
    except ImportError as error:
        raise MissingDependencyError(
            "reading a YAML calibration needs PyYAML; install stereohdr[calib]"
        ) from error

    class Loader(yaml.SafeLoader):
        """Takes OpenCV's tagged matrices for mappings."""

    def mapping(loader: Any, suffix: str, node: Any) -> Any:
        return loader.construct_mapping(node, deep=True)

    Loader.add_multi_constructor("tag:yaml.org,2002:opencv-", mapping)
    # OpenCV begins with "%YAML:1.0", which is no YAML.
    return yaml.load("\n".join(line for line in text.splitlines() if not line.startswith("%")), Loader)


def _xml_value(element: ElementTree.Element) -> Any:
    if element.find("data") is not None and element.find("rows") is not None:
        return {
            "rows": int(element.findtext("rows", "")),
            "cols": int(element.findtext("cols", "")),
            "data": element.findtext("data", "").split(),
        }
    if len(element):
        return {child.tag: _xml_value(child) for child in element}
    words = (element.text or "").split()
    return words[0] if len(words) == 1 else words


def _value(value: Any) -> Any:
    """Turn matrices, written as rows, cols and data, into arrays."""
    if isinstance(value, dict):
        if {"rows", "cols", "data"} <= value.keys():
            return np.array(value["data"], dtype=np.float64).reshape(int(value["rows"]), int(value["cols"]))
        return {str(key): _value(entry) for key, entry in value.items()}
    return value


def _calibration(documents: list[Document]) -> StereoCalibration:
    if len(documents) == 1 and documents[0].get("format") == FORMAT:
        return _own(documents[0])
    if len(documents) == 1 and {"cam0", "cam1"} <= documents[0].keys():
        return _kalibr(documents[0])
    if len(documents) == 2 and all(_is_single_camera(document) for document in documents):
        return _ros_pair(*documents)
    if any(_is_single_camera(document) for document in documents):
        raise InputError(
            "holds one camera only; give the files of both, left then right (command line: --calib twice)"
        )
    return _opencv({_plain(key): value for document in documents for key, value in document.items()})


def _own(document: Document) -> StereoCalibration:
    cameras = []
    for side in ("left", "right"):
        table = document[side]
        cameras.append(
            CameraModel(
                np.array(table["matrix"], dtype=np.float64),
                tuple(table.get("distortion", ())),
                table["lens"],
                _size(table),
            )
        )
    pose = document.get("pose")
    rotation, translation = (None, None) if pose is None else (pose["rotation"], pose["translation"])
    return StereoCalibration(cameras[0], cameras[1], rotation, translation, document.get("rms"))


def _kalibr(document: Document) -> StereoCalibration:
    """Return the calibration of a Kalibr chain; the camera that stands to the left is the left one."""
    cameras = []
    for name in ("cam0", "cam1"):
        camera = document[name]
        if camera.get("camera_model", "pinhole") != "pinhole":
            raise InputError(
                f"Kalibr's camera model {camera['camera_model']!r} is not known; calibrate with pinhole-radtan or "
                f"pinhole-equi"
            )
        fx, fy, cx, cy = (float(value) for value in camera["intrinsics"])
        cameras.append(
            _camera(
                [[fx, 0, cx], [0, fy, cy], [0, 0, 1]],
                camera.get("distortion_coeffs", ()),
                camera.get("distortion_model"),
                _size(camera),
            )
        )
    transform = np.array(document["cam1"]["T_cn_cnm1"], dtype=np.float64).reshape(4, 4)
    calibration = StereoCalibration(cameras[0], cameras[1], transform[:3, :3], transform[:3, 3])
    baseline = calibration.baseline
    assert baseline is not None
    return calibration if baseline[0] > 0 else calibration.exchanged()


def _is_single_camera(document: Document) -> bool:
    keys = {_plain(key) for key in document}
    return bool(keys & {"cameramatrix", "k"}) and "t" not in keys


def _ros_pair(left: Document, right: Document) -> StereoCalibration:
    """Return the calibration of two ROS ``camera_info``; ``P`` and ``R`` tell the pose if they are of a pair."""
    plain = [{_plain(key): value for key, value in document.items()} for document in (left, right)]
    names = [str(document.get("cameraname", "")).lower() for document in plain]
    if "right" in names[0] and "left" in names[1]:
        raise InputError("the right camera comes first; give the files in the order left, right")
    cameras = []
    for document in plain:
        matrix = _first(document, "cameramatrix", "k")
        coefficients = _first(document, "distortioncoefficients", "distcoeffs", "d", otherwise=())
        cameras.append(_camera(_square(matrix), coefficients, document.get("distortionmodel"), _size(document)))
    turns = [_first(document, "rectificationmatrix", "r", otherwise=None) for document in plain]
    projections = [_first(document, "projectionmatrix", "p", otherwise=None) for document in plain]
    if any(value is None for value in (*turns, *projections)):
        return StereoCalibration(cameras[0], cameras[1])
    from_left, from_right = (_square(turn) for turn in turns)
    p_left, p_right = (np.array(p, dtype=np.float64).reshape(3, 4) for p in projections)
    same_rows = np.abs(p_left[1, :3] - p_right[1, :3]).max() <= ROW_TOLERANCE
    shift = p_right[0, 3] / p_right[0, 0] if p_right[0, 0] else 0.0
    if not same_rows or shift == 0:  # each camera was calibrated by itself
        return StereoCalibration(cameras[0], cameras[1])
    return StereoCalibration(cameras[0], cameras[1], from_right.T @ from_left, from_right.T @ [shift, 0.0, 0.0])


def _opencv(document: Mapping[str, Any]) -> StereoCalibration:
    """Return the calibration of an OpenCV file; its keys are in lower case, without punctuation."""
    size, model = _size(document), document.get("distortionmodel", document.get("cameramodel"))
    cameras = []
    for side in ("left", "right"):
        matrix = _of_side(document, "matrix", side)
        if matrix is None:
            raise InputError(f"no camera matrix of the {side} camera is there; {_KNOWN}")
        coefficients = _of_side(document, "distortion", side)
        cameras.append(_camera(_square(matrix), () if coefficients is None else coefficients, model, size))
    rotation = _first(document, "r", "rotation", "rotationmatrix", otherwise=None)
    translation = _first(document, "t", "translation", "translationvector", otherwise=None)
    if rotation is None or translation is None:
        return StereoCalibration(cameras[0], cameras[1])
    return StereoCalibration(
        cameras[0], cameras[1], _square(rotation), np.array(translation, dtype=np.float64).ravel()
    )


def _camera(matrix: Any, coefficients: Any, model: str | None, size: tuple[int, int] | None) -> CameraModel:
    values = tuple(np.trim_zeros(np.ravel(np.array(coefficients, dtype=np.float64)), "b").tolist())
    name = _plain(model or "")
    if name not in _LENSES:
        raise InputError(
            f"the lens model {model!r} is not known; calibrate with plumb-bob, rational or fisheye (equidistant)"
        )
    lens = _LENSES[name]
    if lens is None:
        lens = "plumb-bob" if len(values) <= 5 else "rational"
    elif lens == "plumb-bob" and any(values[5:]):
        lens = "rational"
    return CameraModel(np.array(matrix, dtype=np.float64), values, lens, size)


def _of_side(document: Mapping[str, Any], what: str, side: str) -> Any:
    """Return a matrix or coefficients by the names that are in use: M1, cameraMatrix1, left_camera_matrix, ..."""
    marks = _SIDES[side]
    for stem in _STEMS[what]:
        for name in (*(stem + mark for mark in marks), side + stem):
            value = document.get(name)
            if value is not None and np.size(value) > 1:
                return value
    return None


def _size(document: Mapping[str, Any]) -> tuple[int, int] | None:
    width = _first(document, "imagewidth", "width", otherwise=None)
    height = _first(document, "imageheight", "height", otherwise=None)
    if width is None or height is None:
        both = _first(document, "imagesize", "size", "resolution", otherwise=None)
        if both is None:
            return None
        if np.size(both) != 2:
            raise InputError("the image size must be two numbers, width and height")
        width, height = np.ravel(both)
    sides = float(width), float(height)
    if not all(math.isfinite(side) and side >= 1 for side in sides):
        raise InputError(f"the image size {width}x{height} makes no sense")
    return round(sides[0]), round(sides[1])


def _first(document: Mapping[str, Any], *names: str, otherwise: Any = _REQUIRED) -> Any:
    """Return the first of the named values that is there."""
    for name in names:
        if document.get(name) is not None:
            return document[name]
    if otherwise is _REQUIRED:
        raise KeyError(names[0])
    return otherwise


def _square(matrix: Any) -> NDArray[np.float64]:
    return np.array(matrix, dtype=np.float64).reshape(3, 3)


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", str(name).lower())
