"""The scenes of the benchmark by name, as far as their images are there.

Real pairs ``R1`` to ``R9`` (``-half``: halved), then ``<Scene>-<setting>`` made by the simulated camera,
procedural scenes, the paper's own inputs from full Middlebury sets, and folders with a manifest. Each row of the
tables below is a scene or a family of scenes; the readers are in the modules beside this one.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from stereohdr.config import DEFAULT_DISPARITY_SHARE
from stereohdr.datasets.boreal import read_boreal
from stereohdr.datasets.brackets import bracket_scene, rectified_bracket
from stereohdr.datasets.manifest import MANIFEST_NAME, manifest_scene, read_manifest
from stereohdr.datasets.middlebury import (
    ExposurePair,
    MiddleburyFolder,
    common_exposure,
    exposure_scene,
    same_exposure_pair,
    two_view_pair,
)
from stereohdr.datasets.polar import read_polar
from stereohdr.datasets.scene import EvaluationScene
from stereohdr.datasets.simulated import PROCEDURAL, SETTINGS, SameExposurePair, procedural_scene, reexposed_scene
from stereohdr.errors import InputError
from stereohdr.rectification._opencv import load_opencv

Loader = Callable[[], EvaluationScene]

_ART, _BOOKS = "middlebury2005_full/Art", "middlebury2005_half/Books"
_R1 = ExposurePair(main=(1, 0), auxiliary=(5, 1), bracket=(0, 1), max_disparity=240)
# View 2 lies a quarter of the way from view 1 to view 5.
_R2 = ExposurePair(main=(1, 0), auxiliary=(2, 2), bracket=(0, 1), max_disparity=60)
_R3 = ExposurePair(main=(2, 2), auxiliary=(1, 0), bracket=(1, 2), max_disparity=60)
_R4 = ExposurePair(main=(1, 0), auxiliary=(5, 1), bracket=(0, 1), max_disparity=120)
_R5 = ExposurePair(main=(5, 1), auxiliary=(1, 0), bracket=(1,), auxiliary_bracket=(0, 1), max_disparity=120)

REAL_PAIRS: tuple[tuple[str, str, ExposurePair], ...] = (
    ("R1", _ART, _R1),
    ("R1-half", _ART, replace(_R1, reduce=2, max_disparity=120)),
    ("R2", _ART, _R2),
    ("R2-half", _ART, replace(_R2, reduce=2, max_disparity=30)),
    ("R3", _ART, _R3),
    ("R3-half", _ART, replace(_R3, reduce=2, max_disparity=30)),
    ("R4", _BOOKS, _R4),
    ("R5", _BOOKS, _R5),
)
"""Name, folder below the data, and recipe of the pairs that were really taken at two exposures."""

STAND_IN_TIMES = (0.25, 1.0, 4.0)
"""Seconds of exposures 0, 1, 2 where the data state none (Books): only their ratio, 4, is known and matters."""

UNRECTIFIED: Mapping[str, tuple[str, float, float]] = {
    "R6": ("POLAR", 0.064, 1.024),
    "R7": ("POLAR", 1.024, 0.064),
    "R8": ("Boreal", 0.001, 0.032),
    "R9": ("Boreal", 0.032, 0.001),
}
"""Real pairs that are rectified from their own features, which needs OpenCV: data set, exposure times of the left
(main) and the right view in seconds. The reference is the bracket of the left view, rectified the same way."""


@dataclass(frozen=True)
class _SameExposureFamily:
    """Same-exposure pairs in subfolders of a folder below the data, each in all settings of the camera."""

    folder: str
    suffix: str
    """What distinguishes their names from those of other sizes."""
    is_pair: Callable[[Path], bool]
    read: Callable[..., SameExposurePair]


SAME_EXPOSURE: tuple[_SameExposureFamily, ...] = (
    _SameExposureFamily(
        "middlebury_third", "", lambda path: common_exposure(path) is not None, same_exposure_pair
    ),
    _SameExposureFamily(
        "middlebury2005_half", "-half", lambda path: common_exposure(path) is not None, same_exposure_pair
    ),
    _SameExposureFamily(
        "middlebury2006_half", "-half", lambda path: common_exposure(path) is not None, same_exposure_pair
    ),
    _SameExposureFamily("middeval3_Q", "", lambda path: path.name == "Motorcycle", two_view_pair),
)
"""Where same-exposure pairs are. (MotorcycleE is not one: its exposures differ by an unknown ratio.)"""

FIRST_SCENES = ("Art", "Aloe", "Moebius")
"""The paper's scenes come first, the others by name."""


@dataclass(frozen=True)
class _PaperSet:
    """A scene of the paper's tables: illumination, times of exposures 0 to 2 in seconds, d_max at half size."""

    illumination: int
    exposure_times: tuple[float, ...]
    max_disparity: int


PAPER_SETS = {
    "Art": _PaperSet(2, (0.25, 1.0, 4.0), 120),
    "Aloe": _PaperSet(3, (0.125, 0.5, 2.0), 100),
    "Moebius": _PaperSet(1, (0.25, 1.0, 4.0), 120),
}
"""The paper's inputs, from full Middlebury sets in the official layout."""

PAPER_EXPOSURES = {"normal-long": (1, 2), "short-long": (0, 2)}
"""Exposures of view 1 (MV) and view 5 (AV) in the paper's tables."""


def benchmark_scenes(data: str | Path | None = None) -> dict[str, Loader]:
    """Return the scenes whose images are there, in a fixed order.

    Parameters
    ----------
    data
        Folder of image data; None offers the procedural scenes only.

    Returns
    -------
    Names to functions that read or make the scene. Nothing but names of files (and manifests) is read before.

    Raises
    ------
    InputError
        `data` is not a folder, or two scenes in it have the same name.
    """
    scenes: dict[str, Loader] = {}
    if data is not None:
        data = Path(data)
        if not data.is_dir():
            raise InputError(f"{data}: is not a folder; give the folder that holds the image data")
    families = [] if data is None else [_real_pairs(data), _unrectified_pairs(data), _reexposed(data)]
    families.append((name, partial(procedural_scene, name)) for name in PROCEDURAL)
    families += [] if data is None else [_paper_sets(data), _manifests(data)]
    for family in families:
        for name, loader in family:
            if name in scenes:
                raise InputError(f"{data}: two scenes are called {name!r}; give one of them another name")
            scenes[name] = loader
    return scenes


def load_scene(name: str, data: str | Path | None = None) -> EvaluationScene:
    """Read one scene of the benchmark.

    Parameters
    ----------
    name
        As `benchmark_scenes` lists it.
    data
        Folder of image data.

    Raises
    ------
    InputError
        There is no such scene, or its images are absent.
    MissingDependencyError
        It must be rectified first, and OpenCV is not installed.
    """
    scenes = benchmark_scenes(data)
    if name in scenes:
        return scenes[name]()
    if name in UNRECTIFIED and data is not None and _bracket_folder(Path(data), name).is_dir():
        load_opencv(f"rectifying scene {name}")
    where = "no data folder was given" if data is None else f"its images are not in {data}"
    near = get_close_matches(name, scenes, n=4, cutoff=0.0)
    raise InputError(
        f"scene {name!r} is not there ({where}); {len(scenes)} scenes are, the nearest names are {', '.join(near)}"
    )


def _real_pairs(data: Path) -> Iterator[tuple[str, Loader]]:
    for name, folder, recipe in REAL_PAIRS:
        source = MiddleburyFolder(data / folder, STAND_IN_TIMES)
        if _is_complete(source, recipe):
            yield name, partial(exposure_scene, name, source, recipe)


def _unrectified_pairs(data: Path) -> Iterator[tuple[str, Loader]]:
    if find_spec("cv2") is None:
        return
    for name in UNRECTIFIED:
        if _bracket_folder(data, name).is_dir():
            yield name, partial(_unrectified_pair, data, name)


def _bracket_folder(data: Path, name: str) -> Path:
    return data / ("polar" if UNRECTIFIED[name][0] == "POLAR" else "boreal/cycle00")


def _unrectified_pair(data: Path, name: str) -> EvaluationScene:
    kind, t_main, t_auxiliary = UNRECTIFIED[name]
    folder = _bracket_folder(data, name)
    if kind == "POLAR":
        brackets = read_polar(folder)
    else:
        brackets = read_boreal(folder, data / "boreal/calibration/pcalib_inside1.txt")
    exposures = (t_main, t_auxiliary)
    brackets, pair = rectified_bracket(brackets, main="left", exposures=exposures)
    reach = pair.largest_disparity or round(DEFAULT_DISPARITY_SHARE * pair.left.width)
    return bracket_scene(brackets, main="left", exposures=exposures, max_disparity=reach, name=name)


def _is_complete(source: MiddleburyFolder, recipe: ExposurePair) -> bool:
    """Return whether all files of a scene are there."""
    photos = [recipe.main, recipe.auxiliary]
    photos += [(recipe.main[0], exposure) for exposure in recipe.bracket]
    photos += [(recipe.auxiliary[0], exposure) for exposure in recipe.auxiliary_bracket]
    return all(path.is_file() for path in source.truth_paths()) and all(
        source.photo_path(view, recipe.illumination, exposure) is not None for view, exposure in photos
    )


def _reexposed(data: Path) -> Iterator[tuple[str, Loader]]:
    for family in SAME_EXPOSURE:
        parent = data / family.folder
        folders = [path for path in (parent.iterdir() if parent.is_dir() else ()) if path.is_dir()]
        for folder in sorted(folders, key=_paper_scenes_first):
            if family.is_pair(folder):
                for setting in SETTINGS:
                    name = f"{folder.name}{family.suffix}-{setting}"
                    yield name, partial(_reexposed_scene, family.read, folder, setting, name)


def _paper_scenes_first(folder: Path) -> tuple[int, str]:
    return (FIRST_SCENES.index(folder.name) if folder.name in FIRST_SCENES else len(FIRST_SCENES), folder.name)


def _reexposed_scene(
    read: Callable[..., SameExposurePair], folder: Path, setting: str, name: str
) -> EvaluationScene:
    return reexposed_scene(read(folder), setting, name=name)


def _paper_sets(data: Path) -> Iterator[tuple[str, Loader]]:
    for scene, paper in PAPER_SETS.items():
        for setting, (main, auxiliary) in PAPER_EXPOSURES.items():
            recipe = ExposurePair(
                main=(1, main),
                auxiliary=(5, auxiliary),
                bracket=(0, 1, 2),
                max_disparity=paper.max_disparity,
                illumination=paper.illumination,
            )
            sources = (MiddleburyFolder(path, paper.exposure_times) for path in _official_folders(data, scene))
            source = next((source for source in sources if _is_complete(source, recipe)), None)
            if source is not None:
                name = f"{scene}-paper-{setting}"
                yield name, partial(_paper_scene, name, source, recipe)


def _official_folders(data: Path, scene: str) -> list[Path]:
    """Return folders of the scene in the official layout, those that say "half" first (the paper's size)."""
    candidates = [data / scene, *data.glob(f"*/{scene}")]
    found = [path for path in candidates if next(path.glob("Illum*/Exp*"), None) is not None]
    return sorted(found, key=lambda path: ("half" not in str(path.relative_to(data)).lower(), str(path)))


def _paper_scene(name: str, source: MiddleburyFolder, recipe: ExposurePair) -> EvaluationScene:
    """Read a scene at the paper's half size; from a third-size set, at that size."""
    factor = source.size_factor()
    if factor == 1:
        recipe = replace(recipe, reduce=2)
    else:
        recipe = replace(recipe, max_disparity=round(recipe.max_disparity * 2 / factor))
    return exposure_scene(name, source, recipe)


def _manifests(data: Path) -> Iterator[tuple[str, Loader]]:
    for pattern in (MANIFEST_NAME, f"*/{MANIFEST_NAME}", f"*/*/{MANIFEST_NAME}"):
        for path in sorted(data.glob(pattern)):
            try:
                name = read_manifest(path).get("name", path.resolve().parent.name)
            except InputError:  # listed all the same: whoever asks for it is told what is wrong
                name = path.resolve().parent.name
            yield name, partial(manifest_scene, path)
