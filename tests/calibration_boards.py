"""Photos of a calibration board by a known rig."""

from functools import cache

import numpy as np
from scipy import ndimage
from stereo_rigs import rig

from stereohdr import Photo
from stereohdr.rectification import Board, BoardView, CameraModel
from stereohdr.rectification.geometry import rotation_matrix

SIZE = (400, 300)
CHESSBOARD = Board(7, 5, 0.03)
CHARUCO = Board(7, 5, 0.03, "charuco", dictionary="4X4_50")
GRAIN = 3
"""Rays per pixel, along x and along y."""


def board_cameras(lens="plumb-bob"):
    distortion = {"plumb-bob": (-0.25, 0.08, 0.001, -0.001, 0.0), "fisheye": (0.03, -0.01, 0, 0)}[lens]
    focal = {"plumb-bob": 420.0, "fisheye": 300.0}[lens]
    return tuple(
        CameraModel(np.array([[f, 0, 201.0], [0, f, 148.0], [0, 0, 1]]), distortion, lens, SIZE)
        for f in (focal, focal + 12)
    )


def board_rig(lens="plumb-bob"):
    return rig((0.3, 1.0, -0.5), (-0.4, -1.5, 0.5), board_cameras(lens))


def poses(count=8, tilt=0.45, seed=0):
    """Rotations and places of the board's first corner, in the left camera's frame, in view of both cameras."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        rotation = rotation_matrix(np.append(rng.uniform(-tilt, tilt, 2), rng.uniform(-0.2, 0.2)))
        middle = np.array([rng.uniform(-0.05, 0.15), rng.uniform(-0.08, 0.08), rng.uniform(0.5, 0.7)])
        yield rotation, middle - rotation @ [0.09, 0.06, 0]


def corners_of(calibration, board, rotation, place, name, noise=0.0, seed=0):
    """What `find_board` would find, without a picture."""
    rng = np.random.default_rng(seed)
    points = board.points @ rotation.T + place
    moved = points @ calibration.rotation.T + calibration.translation
    views = []
    for side, camera, seen in (("left", calibration.left, points), ("right", calibration.right, moved)):
        pixels = camera.to_pixels(seen[:, :2] / seen[:, 2:])
        pixels = pixels + rng.normal(0, noise, pixels.shape)
        views.append(BoardView(f"{side}{name}.png", SIZE, np.arange(len(pixels)), pixels))
    return tuple(views)


def pictures(calibration, board, rotation, place, name=""):
    """Photos of both cameras."""
    views = []
    frames = ((np.eye(3), np.zeros(3)), (calibration.rotation, calibration.translation))
    for side, camera, (turn, shift) in zip(
        ("left", "right"), (calibration.left, calibration.right), frames, strict=True
    ):
        own, start = turn @ rotation, turn @ place + shift
        rays = _rays(camera)
        distance = (own[:, 2] @ start) / (rays @ own[:, 2])
        at = (rays * distance[..., None] - start) @ own
        share = _brightness(board, at[..., 0] / board.square, at[..., 1] / board.square)
        share = share.reshape(SIZE[1], GRAIN, SIZE[0], GRAIN).mean(axis=(1, 3))
        codes = np.rint(30 + 190 * ndimage.gaussian_filter(share, 0.5)).astype(np.uint8)
        views.append(Photo(codes, name=f"{side}{name}.png"))
    return tuple(views)


@cache
def _rays(camera):
    offset = (np.arange(GRAIN) - (GRAIN - 1) / 2) / GRAIN
    x = (np.arange(SIZE[0])[:, None] + offset).ravel()
    y = (np.arange(SIZE[1])[:, None] + offset).ravel()
    rays = camera.to_rays(np.stack(np.meshgrid(x, y), axis=-1))
    return np.concatenate([rays, np.ones((*rays.shape[:2], 1))], axis=-1)


def _brightness(board, u, v):
    """Brightness 0..1 of the board's plane, coordinates in squares from the first inner corner."""
    u, v = u + 1, v + 1  # from the outer corner
    columns, rows = board.columns + 1, board.rows + 1
    on_board = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
    plain = board.kind == "chessboard"
    white = (np.floor(u) + np.floor(v)) % 2 if plain else _charuco_texture(board, u, v)
    margin = (u >= -0.7) & (u < columns + 0.7) & (v >= -0.7) & (v < rows + 0.7)
    return np.where(on_board, white, np.where(margin, 1.0, 0.35))


def _charuco_texture(board, u, v):
    import cv2

    pixels = 40
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{board.dictionary}"))
    size = (board.columns + 1, board.rows + 1)
    drawn = cv2.aruco.CharucoBoard(size, 1.0, 0.75, dictionary).generateImage((size[0] * pixels, size[1] * pixels))
    row, column = (np.clip((c * pixels).astype(int), 0, n * pixels - 1) for c, n in ((v, size[1]), (u, size[0])))
    return drawn[row, column] / 255.0
