import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereohdr.errors import InputError
from stereohdr.rectification import CameraModel

MATRIX = np.array([[610.0, 0, 318.0], [0, 595.0, 246.0], [0, 0, 1]])

LENSES = [
    ("plumb-bob", ()),
    ("plumb-bob", (-0.29, 0.11, 0.001, -0.002, -0.02)),
    ("plumb-bob", (0.2,)),
    ("rational", (-6.56, 19.2, 0.0011, -0.0002, -6.4, -6.29, 17.6, -2.1)),
    ("fisheye", (0.05, -0.02, 0.01, -0.003)),
]


def grid(slope):
    side = np.linspace(-slope, slope, 21)
    return np.stack(np.meshgrid(side, 0.8 * side), axis=-1)


@pytest.mark.parametrize(("lens", "coefficients"), LENSES)
def test_pixels_are_those_of_opencv(lens, coefficients):
    cv2 = pytest.importorskip("cv2")
    rays = grid(0.5).reshape(-1, 2)
    points = np.concatenate([rays, np.ones((len(rays), 1))], axis=1)
    padded = np.zeros({"plumb-bob": 5, "rational": 8, "fisheye": 4}[lens])
    padded[: len(coefficients)] = coefficients
    still = np.zeros(3)
    if lens == "fisheye":
        expected, _ = cv2.fisheye.projectPoints(points[None], still, still, MATRIX, padded)
    else:
        expected, _ = cv2.projectPoints(points, still, still, MATRIX, padded)
    found = CameraModel(MATRIX, coefficients, lens).to_pixels(rays)
    np.testing.assert_allclose(found, expected.reshape(-1, 2), atol=1e-9)


@pytest.mark.parametrize(("lens", "coefficients"), LENSES)
def test_pixels_lead_back_to_their_rays(lens, coefficients):
    camera = CameraModel(MATRIX, coefficients, lens)
    rays = grid(0.5)
    np.testing.assert_allclose(camera.to_rays(camera.to_pixels(rays)), rays, atol=1e-8)


@given(st.floats(-0.3, 0.3), st.floats(-0.05, 0.05), st.floats(-0.005, 0.005), st.floats(-0.005, 0.005))
def test_mild_lenses_can_be_inverted(k1, k2, p1, p2):
    camera = CameraModel(MATRIX, (k1, k2, p1, p2))
    rays = grid(0.4)
    np.testing.assert_allclose(camera.to_rays(camera.to_pixels(rays)), rays, atol=1e-8)


def test_a_lens_is_not_followed_beyond_where_it_folds_back():
    camera = CameraModel(MATRIX, (-0.3,))  # 1 - 0.9 r^2 = 0 at r = 1.054: further out, pixels come back inwards
    rays = np.array([[1.0, 0.0], [1.1, 0.0], [3.0, 0.0]])
    inside = np.isfinite(camera.to_pixels(rays)).all(axis=-1)
    assert inside.tolist() == [True, False, False]
    furthest = camera.to_pixels(np.array([1.05, 0.0]))[0]
    assert np.isnan(camera.to_rays(np.array([furthest + 20, 246.0]))).all()


def test_focal_is_the_mean():
    assert CameraModel(MATRIX).focal == 602.5


def test_zeros_of_longer_models_are_dropped():
    assert CameraModel(MATRIX, (-0.1, 0.2, 0, 0, 0.1, 0, 0, 0, 0, 0, 0, 0, 0, 0)).distortion[:2] == (-0.1, 0.2)
    with pytest.raises(InputError, match="5 coefficients, got 8"):
        CameraModel(MATRIX, (-0.1, 0.2, 0, 0, 0.1, 0.3, 0, 0))


@pytest.mark.parametrize(
    "matrix",
    [
        np.eye(2),
        np.zeros((3, 3)),
        np.diag([-500.0, 500, 1]),
        [[500, 2, 320], [0, 500, 240], [0, 0, 1]],
        [[500, 0, 320], [0, 500, 240], [0, 0, 2]],
        [[500, 0, np.nan], [0, 500, 240], [0, 0, 1]],
    ],
)
def test_matrices_that_no_camera_has(matrix):
    with pytest.raises(InputError, match="a camera matrix is"):
        CameraModel(np.array(matrix, dtype=float))


def test_other_bad_values():
    with pytest.raises(InputError, match="lens model must be"):
        CameraModel(MATRIX, lens="magic")  # pyright: ignore[reportArgumentType]
    with pytest.raises(InputError, match="must be finite"):
        CameraModel(MATRIX, (np.inf,))
    with pytest.raises(InputError, match="image size"):
        CameraModel(MATRIX, size=(0, 480))
