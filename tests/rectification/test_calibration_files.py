import json
import sys

import numpy as np
import pytest
from stereo_rigs import camera, rig

from stereohdr.errors import FileFormatError, InputError, MissingDependencyError
from stereohdr.rectification import StereoCalibration, read_calibration, write_calibration

pytest.importorskip("yaml")

K1 = [[500.5, 0, 320.25], [0, 501.5, 240.5], [0, 0, 1]]
K2 = [[498.0, 0, 322.0], [0, 499.0, 238.0], [0, 0, 1]]
D1, D2 = [-0.3, 0.1, 0.001, -0.002, 0.05], [-0.28, 0.09, 0.0005, 0.0003, 0.0]
R = [[0.9998, 0.0, 0.0199986], [0.0, 1.0, 0.0], [-0.0199986, 0.0, 0.9998]]
T = [-0.12, 0.001, 0.002]


def flat(matrix):
    return np.ravel(matrix).tolist()


def assert_read(found, size=(640, 480), pose=True, lens="plumb-bob"):
    np.testing.assert_allclose(found.left.matrix, K1)
    np.testing.assert_allclose(found.right.matrix, K2)
    assert found.left.distortion == pytest.approx(D1)
    assert found.right.distortion == pytest.approx(D2)
    assert (found.left.lens, found.right.lens) == (lens, lens)
    assert (found.left.size, found.right.size) == (size, size)
    assert found.has_pose == pose
    if pose:
        np.testing.assert_allclose(found.rotation, R, atol=1e-6)
        np.testing.assert_allclose(found.translation, T)


@pytest.mark.parametrize(
    "calibration",
    [
        rig((0.1, 0.2, 0.3), (-0.3, 0.1, 0.0), (camera(350, (-0.1, 1 / 3)), camera(280, (0.01,), "fisheye"))),
        StereoCalibration(camera(300, (-6.5, 19.2, 0, 0, -6.4, -6.3, 17.6, -2.1), "rational"), camera(300)),
        StereoCalibration(camera(300), camera(300), np.eye(3), np.array([-1 / 3, 0, 0]), 0.123456789),
    ],
)
def test_our_toml_gives_back_the_same_numbers(tmp_path, calibration):
    path = tmp_path / "rig.toml"
    write_calibration(path, calibration)
    found = read_calibration(path)
    for one, other in ((found.left, calibration.left), (found.right, calibration.right)):
        np.testing.assert_array_equal(one.matrix, other.matrix)
        assert (one.distortion, one.lens, one.size) == (other.distortion, other.lens, other.size)
    assert found.rms == calibration.rms
    assert found.has_pose == calibration.has_pose
    if calibration.has_pose:
        np.testing.assert_allclose(found.rotation, calibration.rotation, rtol=0, atol=1e-15)
        np.testing.assert_array_equal(found.translation, calibration.translation)


@pytest.mark.parametrize("suffix", ["yml", "yaml", "xml", "json"])
def test_what_opencv_writes(tmp_path, suffix):
    cv2 = pytest.importorskip("cv2")
    path = tmp_path / f"rig.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in (("M1", K1), ("D1", [D1]), ("M2", K2), ("D2", [D2]), ("R", R), ("T", np.transpose([T]))):
        storage.write(name, np.array(value, dtype=np.float64))
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.release()
    assert_read(read_calibration(path))


@pytest.mark.parametrize(
    "names",
    [
        ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2"),
        ("K1", "D1", "K2", "D2"),
        (
            "left_camera_matrix",
            "left_distortion_coefficients",
            "right_camera_matrix",
            "right_distortion_coefficients",
        ),
        ("cameraMatrixL", "distL", "cameraMatrixR", "distR"),
        ("mtx_left", "dist_left", "mtx_right", "dist_right"),
    ],
)
def test_other_names_for_the_same(tmp_path, names):
    path = tmp_path / "rig.json"
    content = dict(zip(names, (K1, D1, K2, D2), strict=True))
    path.write_text(json.dumps({**content, "R": R, "T": T, "image_size": [640, 480]}))
    assert_read(read_calibration(path))


def test_opencvs_two_files(tmp_path):
    (tmp_path / "intrinsics.yml").write_text(
        "%YAML:1.0\n---\n"
        + "".join(
            f"{name}: !!opencv-matrix\n   rows: {len(rows)}\n   cols: {len(rows[0])}\n   dt: d\n"
            f"   data: {flat(rows)}\n"
            for name, rows in (("M1", K1), ("D1", [D1]), ("M2", K2), ("D2", [D2 + [0.0] * 9]))
        )
    )
    (tmp_path / "extrinsics.yml").write_text(
        f"%YAML:1.0\nR: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: {flat(R)}\n"
        f"T: !!opencv-matrix\n   rows: 3\n   cols: 1\n   dt: d\n   data: {T}\n"
    )
    assert_read(read_calibration(tmp_path / "intrinsics.yml", tmp_path / "extrinsics.yml"), size=None)
    assert_read(read_calibration(tmp_path / "intrinsics.yml"), size=None, pose=False)


CAMERA_INFO = """image_width: 640
image_height: 480
camera_name: {name}
camera_matrix:
  rows: 3
  cols: 3
  data: {k}
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: {d}
rectification_matrix:
  rows: 3
  cols: 3
  data: {r}
projection_matrix:
  rows: 3
  cols: 4
  data: {p}
"""


def write_ros(tmp_path, turns, shift, row=240.0, names=("stereo/left", "stereo/right")):
    paths = []
    for name, k, d, turn, x, cy in zip(names, (K1, K2), (D1, D2), turns, (0.0, shift), (240.0, row), strict=True):
        path = tmp_path / f"{name.replace('/', '_')}.yaml"
        projection = [450.0, 0, 320, 450.0 * x, 0, 450.0, cy, 0, 0, 0, 1, 0]
        path.write_text(CAMERA_INFO.format(name=name, k=flat(k), d=d, r=np.ravel(turn).tolist(), p=projection))
        paths.append(path)
    return paths


def test_a_ros_pair_tells_the_pose_by_its_rectification(tmp_path):
    from stereo_rigs import degrees

    from_left, from_right = degrees(0.5, 1, -1), degrees(-0.5, 0, 1)
    found = read_calibration(*write_ros(tmp_path, (from_left, from_right), -0.12))
    np.testing.assert_allclose(found.rotation, from_right.T @ from_left, atol=1e-9)
    np.testing.assert_allclose(found.translation, from_right.T @ [-0.12, 0, 0], atol=1e-9)
    assert found.left.size == (640, 480)


def test_ros_cameras_that_were_calibrated_by_themselves(tmp_path):
    found = read_calibration(*write_ros(tmp_path, (np.eye(3), np.eye(3)), -0.12, row=231.0))
    assert_read(found, pose=False)
    assert_read(read_calibration(*write_ros(tmp_path, (np.eye(3), np.eye(3)), 0.0)), pose=False)


def test_ros_files_in_the_wrong_order(tmp_path):
    left, right = write_ros(tmp_path, (np.eye(3), np.eye(3)), -0.12)
    with pytest.raises(FileFormatError, match="right camera comes first"):
        read_calibration(right, left)
    with pytest.raises(FileFormatError, match="one camera only"):
        read_calibration(left)


def test_messages_of_ros_topics(tmp_path):
    for side, k, d in (("left", K1, D1), ("right", K2, D2)):
        (tmp_path / f"{side}.yaml").write_text(
            f"header: {{seq: 1}}\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\nD: {d}\nK: {flat(k)}\n"
            f"R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\nP: [450, 0, 320, {-54.0 if side == 'right' else 0}, 0, 450, 240, 0, "
            f"0, 0, 1, 0]\n"
        )
    found = read_calibration(tmp_path / "left.yaml", tmp_path / "right.yaml")
    assert found.left.distortion == pytest.approx(D1)
    np.testing.assert_allclose(found.translation, [-0.12, 0, 0])


KALIBR = """cam0:
  camera_model: pinhole
  intrinsics: [500.5, 501.5, 320.25, 240.5]
  distortion_model: {model}
  distortion_coeffs: [-0.3, 0.1, 0.001, -0.002]
  resolution: [640, 480]
  rostopic: /cam0
cam1:
  camera_model: pinhole
  intrinsics: [498.0, 499.0, 322.0, 238.0]
  distortion_model: {model}
  distortion_coeffs: [-0.28, 0.09, 0.0005, 0.0003]
  resolution: [640, 480]
  T_cn_cnm1:
  - [0.9998, 0.0, 0.0199986, {x}]
  - [0.0, 1.0, 0.0, 0.001]
  - [-0.0199986, 0.0, 0.9998, 0.002]
  - [0.0, 0.0, 0.0, 1.0]
"""


@pytest.mark.parametrize(("model", "lens"), [("radtan", "plumb-bob"), ("equidistant", "fisheye")])
def test_kalibr_chains(tmp_path, model, lens):
    (tmp_path / "camchain.yaml").write_text(KALIBR.format(model=model, x=-0.12))
    found = read_calibration(tmp_path / "camchain.yaml")
    np.testing.assert_allclose(found.left.matrix, K1)
    assert found.left.lens == lens
    assert found.left.distortion[:4] == (-0.3, 0.1, 0.001, -0.002)
    np.testing.assert_allclose(found.rotation, R, atol=1e-6)
    np.testing.assert_allclose(found.translation, T)


def test_the_left_camera_of_a_chain_may_come_second(tmp_path):
    (tmp_path / "camchain.yaml").write_text(KALIBR.format(model="radtan", x=0.12))
    found = read_calibration(tmp_path / "camchain.yaml")
    np.testing.assert_allclose(found.left.matrix, K2)
    assert found.baseline is not None
    assert found.baseline[0] > 0


def test_a_chain_of_another_model(tmp_path):
    (tmp_path / "a.yaml").write_text(KALIBR.format(model="radtan", x=-0.1).replace("pinhole", "omni"))
    with pytest.raises(FileFormatError, match="camera model 'omni' is not known"):
        read_calibration(tmp_path / "a.yaml")
    (tmp_path / "b.yaml").write_text(KALIBR.format(model="fov", x=-0.1))
    with pytest.raises(FileFormatError, match="lens model 'fov' is not known"):
        read_calibration(tmp_path / "b.yaml")


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.toml", b""),
        ("a.toml", b"format = 3"),
        ("a.toml", b'format = "stereohdr calibration"\n[left]\nlens = "plumb-bob"\n'),
        ("a.toml", b"not toml ["),
        ("a.json", b"{"),
        ("a.json", b"[1, 2]"),
        ("a.json", b'{"M1": 3, "R": "x"}'),
        ("a.xml", b"<opencv_storage><M1>"),
        ("a.xml", b"<svg></svg>"),
        ("a.yml", b"M1: [1, 2"),
        ("a.yml", b"M1: !!opencv-matrix\n  rows: 3\n  cols: 3\n  data: [1, 2]"),
        ("a.yml", b"M1: !!opencv-matrix\n  rows: 3\n  cols: 3\n  data: [a, b, c, d, e, f, g, h, i]"),
        ("a.yml", b"!!python/object/apply:os.system ['echo']"),
        ("a.yml", b"just a sentence"),
        ("a.yml", b"cam0: 1\ncam1: 2"),
        ("a.yml", b"\xff\xd8\xff\xe0\x00\x10JFIF"),
        ("a.yml", b"- " * 3000),
    ],
)
def test_damaged_files(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(FileFormatError, match=name):
        read_calibration(tmp_path / name)


def test_sizes_that_make_no_sense(tmp_path):
    path = tmp_path / "a.toml"
    write_calibration(path, rig())
    path.write_text(path.read_text().replace("[360, 270]", "[360, inf]", 1))
    with pytest.raises(FileFormatError, match=r"a\.toml: the image size 360.0xinf makes no sense"):
        read_calibration(path)
    path.write_text(path.read_text().replace("[360.0, inf]", "[360]", 1).replace("[360, inf]", "[360]", 1))
    with pytest.raises(FileFormatError, match=r"a\.toml: the image size must be two numbers"):
        read_calibration(path)
    path = tmp_path / "a.yaml"
    path.write_text(KALIBR.format(model="radtan", x=-0.1).replace("resolution: [640", "resolution: [.inf", 1))
    with pytest.raises(FileFormatError, match=r"a\.yaml: the image size infx480.0 makes no sense"):
        read_calibration(path)


def test_an_opencv_file_may_name_its_lens_model(tmp_path):
    content = {"K1": K1, "D1": D1[:4], "K2": K2, "D2": D2[:4], "R": R, "T": T}
    for more, lens in (({}, "plumb-bob"), ({"distortion_model": "fisheye"}, "fisheye")):
        (tmp_path / "rig.json").write_text(json.dumps(content | more))
        assert read_calibration(tmp_path / "rig.json").left.lens == lens


def test_values_that_make_no_sense_name_the_file(tmp_path):
    content = {"M1": K1, "D1": D1, "M2": K2, "D2": D2, "R": (2 * np.array(R)).tolist(), "T": T}
    (tmp_path / "rig.json").write_text(json.dumps(content))
    with pytest.raises(FileFormatError, match=r"rig.json: the matrix R of the calibration is not a rotation"):
        read_calibration(tmp_path / "rig.json")
    content |= {"R": R, "image_size": [0, 480]}
    (tmp_path / "rig.json").write_text(json.dumps(content))
    with pytest.raises(FileFormatError, match=r"rig.json: the image size"):
        read_calibration(tmp_path / "rig.json")


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(FileFormatError, match=r"none.toml: no such file; check the name"):
        read_calibration(tmp_path / "none.toml")
    with pytest.raises(FileFormatError, match="is a folder"):
        read_calibration(tmp_path)
    with pytest.raises(InputError, match="one file or two, got 3"):
        read_calibration("a", "b", "c")
    (tmp_path / "big.yml").write_bytes(b"#" * 21_000_000)
    with pytest.raises(FileFormatError, match="too large"):
        read_calibration(tmp_path / "big.yml")


def test_a_calibration_is_written_as_toml_only(tmp_path):
    with pytest.raises(FileFormatError, match="written as TOML"):
        write_calibration(tmp_path / "rig.yml", rig())


def test_a_missing_pyyaml_is_said(tmp_path, monkeypatch):
    (tmp_path / "a.yml").write_text("M1: 3")
    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(MissingDependencyError, match=r"PyYAML; install stereohdr\[calib\]"):
        read_calibration(tmp_path / "a.yml")
