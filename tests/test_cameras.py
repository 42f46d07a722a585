"""Camera files of calibration programs: all give the camera that they were written from."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import scipy.io

from mssegment.cameras import fitted, notes_on_tracks, read_camera
from mssegment.errors import ConfigurationError
from mssegment.imaging.camera import undistort_points
from mssegment.records import Camera

FX, FY, CX, CY = 800.5, 790.25, 319.5, 241.0
K = np.array([[FX, 0, CX], [0, FY, CY], [0, 0, 1]])
BROWN = (-0.2, 0.05, 0.001, -0.002, 0.01)
KB = (0.1, 0.02, -0.01, 0.003)
Write = Callable[[Path], None]


def text(content: str) -> Write:
    return lambda path: path.write_text(content) and None


def file_storage(suffix: str) -> Write:
    """Written by OpenCV itself."""

    def write(path: Path) -> None:
        own = path.with_suffix(suffix)
        storage = cv2.FileStorage(str(own), cv2.FILE_STORAGE_WRITE)
        storage.write("calibration_time", "today, at noon")
        storage.write("image_width", 640)
        storage.write("image_height", 480)
        storage.write("camera_matrix", K)
        storage.write("distortion_coefficients", np.array(BROWN)[:, None])
        storage.write("grid_points", np.zeros((3, 2)))
        storage.release()
        own.rename(path)

    return write


ROS = f"""image_width: 640
image_height: 480
camera_name: narrow_stereo
camera_matrix:
  rows: 3
  cols: 3
  data: {K.ravel().tolist()}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: {list(BROWN)}}}
rectification_matrix: {{rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}}
projection_matrix: {{rows: 3, cols: 4, data: [9, 0, 9, 0, 0, 9, 9, 0, 0, 0, 1, 0]}}
"""
KALIBR = f"""cam0:
  camera_model: pinhole
  intrinsics: [{FX}, {FY}, {CX}, {CY}]
  distortion_model: radtan
  distortion_coeffs: {list(BROWN[:4])}
  resolution: [640, 480]
  rostopic: /cam0/image_raw
"""
EUROC = f"""%YAML:1.0
sensor_type: camera
T_BS:
  cols: 4
  rows: 4
  data: {np.eye(4).ravel().tolist()}
rate_hz: 20
resolution: [640, 480]
camera_model: pinhole
intrinsics: [{FX}, {FY}, {CX}, {CY}] #fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: {list(BROWN[:4])}
"""
ORB_SLAM = f"""%YAML:1.0

Camera.type: "PinHole"
Camera.fx: {FX}
Camera.fy: {FY}
Camera.cx: {CX}
Camera.cy: {CY}
Camera.k1: {BROWN[0]}
Camera.k2: {BROWN[1]}
Camera.p1: {BROWN[2]}
Camera.p2: {BROWN[3]}
Camera.k3: {BROWN[4]}
Camera.width: 640
Camera.height: 480
ORBextractor.nFeatures: 1000
"""
COLMAP = f"""# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
1 OPENCV 640 480 {FX} {FY} {CX + 0.5} {CY + 0.5} {" ".join(map(str, BROWN[:4]))}
"""
SIZED = {"width": 640, "height": 480}
PLAIN = {"fx": FX, "fy": FY, "cx": CX, "cy": CY}
OPEN3D = SIZED | {"intrinsic_matrix": K.T.ravel().tolist()}
REALSENSE = SIZED | {"fx": FX, "fy": FY, "ppx": CX, "ppy": CY, "model": "Brown Conrady"}
KITTI = "".join(
    f"P{i}: {' '.join(f'{v:.12e}' for v in np.hstack([K + i, [[i], [0], [0]]]).ravel())}\n"
    if i == 0
    else f"P{i}: {' '.join(f'{v:.12e}' for v in np.hstack([K, [[-i], [0], [0]]]).ravel())}\n"
    for i in range(4)
)

VINS = (
    "%YAML:1.0\n---\nmodel_type: PINHOLE\ncamera_name: c\nimage_width: 640\nimage_height: 480\n"
    "distortion_parameters:\n"
    + "".join(f"   {n}: {v}\n" for n, v in zip(("k1", "k2", "p1", "p2"), BROWN, strict=False))
    + f"projection_parameters:\n   fx: {FX}\n   fy: {FY}\n   cx: {CX}\n   cy: {CY}\n"
)
HLOC = "".join(
    f"{name} OPENCV 640 480 {FX} {FY} {CX + 0.5} {CY + 0.5} {' '.join(map(str, BROWN[:4]))}\n"
    for name in ("a.jpg", "b.jpg")
)
FILES: dict[str, tuple[str, Write, tuple[float, ...], bool]] = {
    "own": ("c.yaml", text(f"fx: {FX}\nfy: {FY}\ncx: {CX}\ncy: {CY}\n"), (), False),
    "own, tabs": ("c.yaml", text(f"fx:\t{FX}\nfy:\t{FY}\ncx:\t{CX}\ncy:\t{CY}\n"), (), False),
    "own, capitals": ("c.yml", text(f"FX: {FX}\nFY: {FY}\nCX: {CX}\nCY: {CY}\n"), (), False),
    "own, size": ("c.json", text(json.dumps(PLAIN | SIZED)), (), True),
    "opencv yaml": ("c.yml", file_storage(".yml"), BROWN, True),
    "opencv xml": ("c.xml", file_storage(".xml"), BROWN, True),
    "opencv json": ("c.json", file_storage(".json"), BROWN, True),
    "opencv, no suffix": ("calibration", file_storage(".yml"), BROWN, True),
    "ros": ("ost.yaml", text(ROS), BROWN, True),
    "ros topic": (
        "info.txt",
        text(
            f"header:\n  seq: 1\nheight: 480\nwidth: 640\ndistortion_model: plumb_bob\n"
            f"d: {list(BROWN)}\nk: {K.ravel().tolist()}\nbinning_x: 0\n---\nheader:\n  seq: 2\n"
        ),
        BROWN,
        True,
    ),
    "kalibr": ("camchain.yaml", text(KALIBR), BROWN[:4], True),
    "euroc": ("sensor.yaml", text(EUROC), BROWN[:4], True),
    "orb-slam": ("o.yaml", text(ORB_SLAM), BROWN, True),
    "colmap": ("cameras.txt", text(COLMAP), BROWN[:4], True),
    "kitti": ("calib.txt#P1", text(KITTI), (), False),
    "open3d": ("c.json", text(json.dumps(OPEN3D)), (), True),
    "open3d, nested": ("c.json", text(json.dumps({"intrinsic": OPEN3D})), (), True),
    "realsense": ("c.json", text(json.dumps(REALSENSE | {"coeffs": BROWN})), BROWN, True),
    "nerfstudio": (
        "transforms.json",
        text(json.dumps({"fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY, "w": 640, "h": 480})),
        (),
        True,
    ),
    "savetxt": ("K.txt", lambda path: np.savetxt(path, K), (), False),
    "commas": ("K.csv", lambda path: np.savetxt(path, K, delimiter=","), (), False),
    "printed": ("K.txt", text(str(K)), (), False),
    "strecha": (
        "0000.png.camera",
        text(f"{FX} 0 {CX} \n0 {FY} {CY} \n0 0 1 \n0 0 0\n1 0 0\n0 1 0\n0 0 1\n5 6 7\n640 480\n"),
        (),
        False,
    ),
    "four numbers": ("k.txt", text(f"{FX} {FY} {CX} {CY}\n"), (), False),
    "npy": ("K.npy", lambda path: np.save(path, K), (), False),
    "npz": ("calib.npz", lambda path: np.savez(path, mtx=K, dist=[BROWN]), BROWN, False),
    "vins": ("v.yaml", text(VINS), BROWN[:4], True),
    "ini": (
        "c.ini",
        text(f"; a camera\n[left]\nfx = {FX}\nfy = {FY}\ncx = {CX}\ncy = {CY}\nk1 = {BROWN[0]}\n"),
        BROWN[:1],
        False,
    ),
    "assignments": ("c.txt", text(f"fx={FX}\nfy={FY}\ncx={CX}\ncy={CY}  # px\n"), (), False),
    "matlab": (
        "Calib_Results.mat",
        lambda path: scipy.io.savemat(
            path, {"KK": K, "kc": np.array(BROWN)[:, None], "nx": 640, "ny": 480, "active": [1, 2]}
        ),
        BROWN,
        True,
    ),
    "hloc": ("list.txt#b.jpg", text(HLOC), BROWN[:4], True),
    "colmap, one line": (
        "c.txt",
        text(f"PINHOLE 640 480 {FX} {FY} {CX + 0.5} {CY + 0.5}\n"),
        (),
        True,
    ),
    "pycolmap": (
        "c.json",
        text(
            json.dumps(
                SIZED
                | {
                    "model": "OPENCV",
                    "params": [FX, FY, CX + 0.5, CY + 0.5, *BROWN[:4]],
                    "camera_id": 1,
                }
            )
        ),
        BROWN[:4],
        True,
    ),
    "K and D": ("k.json", text(json.dumps({"K": K.tolist(), "D": BROWN})), BROWN, False),
}


@pytest.mark.parametrize("kind", FILES)
def test_every_format_gives_the_camera(tmp_path: Path, kind: str) -> None:
    name, write, distortion, has_size = FILES[kind]
    write(tmp_path / name.split("#")[0])
    found = read_camera(str(tmp_path / name))
    np.testing.assert_allclose([found.fx, found.fy, found.cx, found.cy], [FX, FY, CX, CY])
    np.testing.assert_allclose(found.distortion, distortion)
    assert found.distortion_model == "brown"
    assert (found.width, found.height) == ((640, 480) if has_size else (None, None))


FISHEYE = {
    "kalibr": KALIBR.replace("radtan", "equidistant").replace(str(list(BROWN[:4])), str(list(KB))),
    "ros": ROS.replace("plumb_bob", "equidistant").replace(str(list(BROWN)), str(list(KB))),
    "colmap": COLMAP.replace("OPENCV", "OPENCV_FISHEYE").replace(
        " ".join(map(str, BROWN[:4])), " ".join(map(str, KB))
    ),
    "orb-slam": f'Camera1.type: "KannalaBrandt8"\nCamera1.fx: {FX}\nCamera1.fy: {FY}\n'
    f"Camera1.cx: {CX}\nCamera1.cy: {CY}\n"
    + "".join(f"Camera1.k{i}: {k}\n" for i, k in enumerate(KB, 1)),
    "vins": "%YAML:1.0\n---\nmodel_type: KANNALA_BRANDT\nprojection_parameters:\n"
    + "".join(f"   k{i}: {k}\n" for i, k in enumerate(KB, 2))
    + f"   mu: {FX}\n   mv: {FY}\n   u0: {CX}\n   v0: {CY}\n",
    "own": "\n".join(f"{name}: {value}" for name, value in PLAIN.items())
    + f"\ndistortion: {list(KB)}\ndistortion_model: fisheye\n",
}


@pytest.mark.parametrize("kind", FISHEYE)
def test_fisheye_lenses(tmp_path: Path, kind: str) -> None:
    (tmp_path / "c.txt").write_text(FISHEYE[kind])
    found = read_camera(str(tmp_path / "c.txt"))
    assert found.distortion_model == "fisheye"
    np.testing.assert_allclose(found.distortion, KB)
    np.testing.assert_allclose([found.fx, found.fy, found.cx, found.cy], [FX, FY, CX, CY])


def test_fisheye_points_become_those_of_a_pinhole(rng: np.random.Generator) -> None:
    camera = Camera(300.0, 310.0, 320.0, 240.0, KB, "fisheye")
    angle, turn = rng.uniform(0, 1.2, 200), rng.uniform(-np.pi, np.pi, 200)
    ray = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    bent = angle * (1 + KB[0] * angle**2 + KB[1] * angle**4 + KB[2] * angle**6 + KB[3] * angle**8)
    scale, centre = np.array([camera.fx, camera.fy]), np.array([camera.cx, camera.cy])
    seen = ray * bent[:, None] * scale + centre
    straight = ray * np.tan(angle)[:, None] * scale + centre
    found = undistort_points(seen, camera)
    np.testing.assert_allclose(found, straight, atol=1e-3)
    behind = centre[None] + np.array([[scale[0] * 10.0, 0.0]])
    assert np.isnan(undistort_points(behind, camera)).all(), "no pinhole camera sees this ray"


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (KITTI, r"holds 4 cameras \(P0, P1, P2, P3\); choose one: '.*#P0'"),
        (KALIBR + KALIBR.replace("cam0", "cam1"), r"holds 2 cameras \(cam0, cam1\)"),
        (KALIBR.replace("pinhole", "omni"), "cam0: camera model omni"),
        (KALIBR.replace("radtan", "fov"), "distortion model fov; expected Brown's"),
        (COLMAP.replace("OPENCV", "THIN_PRISM_FISHEYE"), "camera model THIN_PRISM_FISHEYE"),
        ("800 0 320\n0 800 240\n0 1 1\n", "not a calibration matrix"),
        ("800 40 320\n0 800 240\n0 0 1\n", "skew 40"),
        ("hello\n", "no camera in this file"),
        (VINS.replace("PINHOLE", "MEI"), "model_type MEI; expected one of PINHOLE"),
        (VINS.replace(f"fx: {FX}", "fx: wide"), "fx is 'wide'; expected a number"),
        ("fx = 1\nfx = 2\nfy = 1\n", "line 2: fx stands twice"),
        ('{"camera_angle_x": 0.7, "frames": []}', "camera_angle_x without w and h"),
        ('{"camera_angle_x": 7, "w": 4, "h": 4}', "camera_angle_x is 7; expected radians"),
        ("<calibration><projection>frame</projection><f>800</f></calibration>", "width is missing"),
        ("<opencv_storage><broken>", "not XML"),
        ('<!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "DOCTYPE"),
        ("fx: 800\nfy: 0\ncx: 1\ncy: 1\n", "fy is 0; expected more than 0"),
    ],
)
def test_what_is_no_camera_is_said(tmp_path: Path, content: str, words: str) -> None:
    (tmp_path / "c.txt").write_text(content)
    with pytest.raises(ConfigurationError, match=words) as caught:
        read_camera(str(tmp_path / "c.txt"))
    assert "\n" not in str(caught.value)


def test_one_focal_length_serves_both_axes(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(f"f: {FX}\ncx: {CX}\ncy: {CY}\n")
    assert read_camera(str(tmp_path / "c.yaml")) == Camera(FX, FX, CX, CY)


def test_one_of_several_cameras(tmp_path: Path) -> None:
    stereo = {"M1": K.tolist(), "D1": BROWN, "M2": (2 * K).tolist(), "D2": [0] * 5}
    stereo["M2"][2][2] = 1
    (tmp_path / "c.json").write_text(json.dumps(stereo))
    assert read_camera(f"{tmp_path / 'c.json'}#2").fx == 2 * FX
    with pytest.raises(ConfigurationError, match="no camera '3'; found 1, 2"):
        read_camera(f"{tmp_path / 'c.json'}#3")


def test_a_camera_must_be_that_of_the_pictures() -> None:
    camera = Camera(800.0, 800.0, 319.5, 239.5, (), "brown", 640, 480)
    assert fitted(camera, 640, 480) == (camera, ())
    half, notes = fitted(camera, 320, 240)
    assert (half.fx, half.cx, half.cy) == (400.0, 159.5, 119.5)
    assert "scaled to 320x240" in notes[0]
    with pytest.raises(ConfigurationError, match="another shape"):
        fitted(camera, 480, 480)
    with pytest.raises(ConfigurationError, match=r"fx is 4.15, which cannot be pixels"):
        fitted(Camera(4.15, 4.15, 2.88, 2.16), 640, 480)
    _, notes = fitted(Camera(800.0, 800.0, 900.0, 239.5), 640, 480)
    assert "principal point (900, 239.5) lies outside" in notes[0]


def test_a_field_of_view_is_a_focal_length(tmp_path: Path) -> None:
    """As in the transforms.json of NeRF's synthetic scenes."""
    (tmp_path / "c.json").write_text(json.dumps({"camera_angle_x": np.pi / 2, "w": 640, "h": 480}))
    found = read_camera(str(tmp_path / "c.json"))
    np.testing.assert_allclose([found.fx, found.fy, found.cx, found.cy], [320, 320, 319.5, 239.5])


@pytest.mark.parametrize(
    "key",
    [
        "dist_coeff",
        "distCoeffs",
        "distortion_coefficients",
        "dist",
        "D",
        "distortionParams",
        "distortion_coef",
        "coeffs",
    ],
)
@pytest.mark.parametrize("as_matrix", [False, True])
def test_distortion_is_never_lost_by_the_name_of_its_key(
    tmp_path: Path, key: str, as_matrix: bool
) -> None:
    known = {"camera_matrix": K.tolist()} if as_matrix else PLAIN
    (tmp_path / "c.json").write_text(json.dumps({**known, key: [BROWN]}))
    np.testing.assert_allclose(read_camera(str(tmp_path / "c.json")).distortion, BROWN)


# --- rigs, reconstructions, text ------------------------------------------------------------------

RADIAL = (BROWN[0], BROWN[1], 0.0, 0.0, BROWN[4])
KB_NAMES = dict(zip(("k1", "k2", "k3", "k4"), KB, strict=True))
BROWN_NAMES = dict(zip(("k1", "k2", "p1", "p2", "k3"), BROWN, strict=True))


def basalt(kind: str, values: dict[str, float], count: int = 1) -> str:
    own = {"camera_type": kind, "intrinsics": PLAIN | values}
    other = {"camera_type": kind, "intrinsics": PLAIN | values | {"fx": 1.0}}
    cameras = [other] * (count - 1) + [own]
    inner = {"T_imu_cam": [{"px": 1}], "intrinsics": cameras, "resolution": [[640, 480]] * count}
    return json.dumps({"value0": inner})


def openmvg(name: str, values: dict[str, object], nested: bool = False) -> str:
    data: dict[str, object] = {**SIZED, "focal_length": FX, "principal_point": [CX, CY]}
    data = {"value0": data, **values} if nested else {**data, **values}
    value = {
        "polymorphic_id": 2147483649,
        "polymorphic_name": name,
        "ptr_wrapper": {"id": 2147483660, "data": data},
    }
    return json.dumps({"sfm_data_version": "0.3", "intrinsics": [{"key": 0, "value": value}]})


def meshroom(version: str, **values: object) -> str:
    """All numbers are text in Meshroom's files."""
    entry = {"intrinsicId": "7", "width": "640", "height": "480", "type": "radial3"}
    bent = [str(BROWN[0]), str(BROWN[1]), str(BROWN[4])]
    intrinsics = [{**entry, "distortionParams": bent, **values}]
    return json.dumps({"version": version.split("."), "intrinsics": intrinsics})


OFFSET = [str(CX - 320), str(CY - 240)]
METASHAPE = (
    f"<f>{FY}</f><cx>{CX + 0.5 - 320}</cx><cy>{CY + 0.5 - 240}</cy><b1>{FX - FY}</b1>"
    f"<k1>{BROWN[0]}</k1><k2>{BROWN[1]}</k2><k3>{BROWN[4]}</k3>"
    f"<p1>{BROWN[3]}</p1><p2>{BROWN[2]}</p2>"
)
MATRIX_ROWS = "\n".join(" ".join(map(str, row)) for row in K.tolist())
RIGS: dict[str, tuple[str, str | bytes, tuple[float, ...]]] = {
    "basalt": ("c.json", basalt("pinhole", {}), ()),
    "basalt, kb4": ("c.json", basalt("kb4", KB_NAMES), KB),
    "basalt, radtan8": (
        "c.json",
        basalt("pinhole-radtan8", {**BROWN_NAMES, "k4": 0, "k5": 0, "k6": 0, "rpmax": 2.7}),
        BROWN,
    ),
    "basalt, a sphere that is none": ("c.json", basalt("ds", {"xi": 0, "alpha": 0}), ()),
    "basalt, one of two": ("c.json#cam1", basalt("pinhole", {}, 2), ()),
    "openmvg": ("sfm_data.json", openmvg("pinhole", {}), ()),
    "openmvg, radial": (
        "sfm_data.json",
        openmvg("pinhole_radial_k3", {"disto_k3": [BROWN[0], BROWN[1], BROWN[4]]}, nested=True),
        RADIAL,
    ),
    "openmvg, brown": (
        "sfm_data.json",
        openmvg("pinhole_brown_t2", {"disto_t2": [BROWN[i] for i in (0, 1, 4, 2, 3)]}),
        BROWN,
    ),
    "openmvg, fisheye": ("sfm_data.json", openmvg("fisheye", {"fisheye": KB}), KB),
    "meshroom 2019": (
        "cameras.sfm",
        meshroom("1.0.0", pxFocalLength=str(FX), principalPoint=[str(CX), str(CY)]),
        RADIAL,
    ),
    "meshroom 2021": (
        "cameras.sfm",
        meshroom("1.2.1", pxFocalLength=[str(FX), str(FY)], principalPoint=OFFSET),
        RADIAL,
    ),
    "meshroom 2023": (
        "cameras.sfm",
        meshroom(
            "1.2.6",
            sensorWidth="36",
            focalLength=str(FX * 36 / 640),
            pixelRatio=str(FY / FX),
            principalPoint=OFFSET,
        ),
        RADIAL,
    ),
    "metashape": (
        "cameras.xml",
        '<?xml version="1.0" encoding="UTF-8"?>\n<document><chunk><sensors><sensor id="0">'
        '<calibration type="frame"><resolution width="640" height="480"/>'
        f"{METASHAPE}</calibration></sensor></sensors></chunk></document>",
        BROWN,
    ),
    "metashape, a calibration": (
        "c.xml",
        "<calibration><projection>frame</projection><width>640</width><height>480</height>"
        f"{METASHAPE}<date>2024</date></calibration>",
        BROWN,
    ),
    "opensfm": (
        "camera_models.json",
        json.dumps(
            {
                "v2 maker 640 480": SIZED
                | {"projection_type": "brown", "focal_x": FX / 640, "focal_y": FY / 640}
                | {"c_x": (CX - 319.5) / 640, "c_y": (CY - 239.5) / 640, **BROWN_NAMES}
            }
        ),
        BROWN,
    ),
    "colmap, binary": (
        "cameras.bin",
        struct.pack("<QiiQQ8d", 1, 3, 4, 640, 480, FX, FY, CX + 0.5, CY + 0.5, *BROWN[:4]),
        BROWN[:4],
    ),
    "orb-slam 3, fisheye": (
        "o.yaml",
        '%YAML:1.0\nCamera.type: "KannalaBrandt8"\nCamera.width: 640\nCamera.height: 480\n'
        f"Camera1.fx: {FX}\nCamera1.fy: {FY}\nCamera1.cx: {CX}\nCamera1.cy: {CY}\n"
        + "".join(f"Camera1.{name}: {value}\n" for name, value in KB_NAMES.items()),
        KB,
    ),
    "okvis": (
        "config.yaml",
        "%YAML:1.0\ncameras:\n     - {T_SC:\n        [1, 0, 0, 0,\n          0, 1, 0, 0],\n"
        f"        image_dimension: [640, 480],\n"
        f"        distortion_coefficients: {list(BROWN[:4])},\n"
        "        distortion_type: radialtangential,\n"
        f"        focal_length: [{FX}, {FY}],\n        principal_point: [{CX}, {CY}]}}\n",
        BROWN[:4],
    ),
    "svo": (
        "svo.yaml",
        "label: rig\ncameras:\n- camera:\n    label: left\n    image_height: 480\n"
        "    image_width: 640\n    type: pinhole\n    intrinsics:\n      cols: 1\n      rows: 4\n"
        f"      data: [{FX}, {FY}, {CX}, {CY}]\n    distortion:\n      type: radial-tangential\n"
        f"      parameters: {{cols: 1, rows: 4, data: {list(BROWN[:4])}}}\n",
        BROWN[:4],
    ),
    "mrcal": (
        "left.cameramodel",
        f"# made\n{{\n    'lensmodel': 'LENSMODEL_OPENCV5',\n    # fx,fy,cx,cy\n    'intrinsics': "
        f"[ {FX}, {FY}, {CX}, {CY}, {', '.join(map(str, BROWN))},],\n"
        "    'imagersize': [ 640, 480,]\n}",
        BROWN,
    ),
    "nerfstudio, frames": (
        "transforms.json",
        json.dumps(
            {
                "camera_model": "OPENCV",
                "frames": [
                    {"file_path": f"{i}.png", "fl_x": FX, "fl_y": FY, "cx": CX, "cy": CY}
                    | {"w": 640, "h": 480}
                    for i in range(3)
                ],
            }
        ),
        (),
    ),
    "nested": (
        "c.yaml",
        f"camera:\n  resolution: {{width: 640, height: 480}}\n  width: 640\n  height: 480\n"
        f"  intrinsics: {{fx: {FX}, fy: {FY}, cx: {CX}, cy: {CY}}}\n",
        (),
    ),
    "vectors": (
        "c.json",
        json.dumps(
            {"focal_length": [FX, FY], "principal_point": [CX, CY], "image_size": [640, 480]}
        ),
        (),
    ),
    "toolbox, text": (
        "Calib_Results.m",
        f"% made\nfc = [ {FX} ; {FY} ];\ncc = [ {CX} ; {CY} ];\nalpha_c = 0.0;\n"
        f"kc = [ {' ; '.join(map(str, BROWN))} ];\nnx = 640;\nny = 480;\n",
        BROWN,
    ),
    "ost": (
        "ost.txt",
        f"# oST version 5.0 parameters\n\n[image]\n\nwidth\n640\n\nheight\n480\n\n[left]\n\n"
        f"camera matrix\n{MATRIX_ROWS}\n\ndistortion\n{' '.join(map(str, BROWN))}\n\n"
        "rectification\n1 0 0\n0 1 0\n0 0 1\n",
        BROWN,
    ),
    "opencv before 2.0": (
        "c.yml",
        f"%YAML:1.0\nimage_width:640\nimage_height:480\ncamera_matrix:!!opencv-matrix\n   rows:3\n"
        f"   cols:3\n   dt:d\n   data:[ {FX}, 0., {CX}, 0., {FY},\n       {CY}, 0., 0., 1. ]\n",
        (),
    ),
}
UNSIZED: dict[str, tuple[str, str, tuple[float, ...]]] = {
    "matlab": ("k.m", f"K = [{FX} 0 {CX}; 0 {FY} {CY}; 0 0 1];\n", ()),
    "python": ("k.txt", f"mtx = np.array([[{FX}, 0, {CX}], [0, {FY}, {CY}], [0, 0, 1]])\n", ()),
    "4x4": ("intrinsic.txt", f"{FX} 0 {CX} 0\n0 {FY} {CY} 0\n0 0 1 0\n0 0 0 1\n", ()),
    "tum": ("tum.txt", f"# fx fy\n{FX} {FY} {CX} {CY} {' '.join(map(str, BROWN))}\n", BROWN),
    "pairs": ("k.csv", f"fx,{FX}\nfy,{FY}\ncx,{CX}\ncy,{CY}\n", ()),
    "one line": ("k.txt", f"fx: {FX} fy: {FY} cx: {CX} cy: {CY}\n", ()),
    "a row": ("k.csv", f"fx,fy,cx,cy\n{FX},{FY},{CX},{CY}\n", ()),
}


@pytest.mark.parametrize("kind", [*RIGS, *UNSIZED])
def test_rigs_reconstructions_and_text(tmp_path: Path, kind: str) -> None:
    name, content, distortion = (RIGS | UNSIZED)[kind]
    path = tmp_path / name.split("#")[0]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    found = read_camera(str(tmp_path / name))
    fy = FX if kind.startswith("openmvg") or kind == "meshroom 2019" else FY
    np.testing.assert_allclose([found.fx, found.fy, found.cx, found.cy], [FX, fy, CX, CY])
    bent = np.trim_zeros(np.array(found.distortion), "b")
    np.testing.assert_allclose(bent, distortion)
    assert found.distortion_model == ("fisheye" if distortion == KB else "brown")
    assert (found.width, found.height) == ((640, 480) if kind in RIGS else (None, None))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("c.json", basalt("ds", {"xi": -0.2, "alpha": 0.6}), "camera_type ds; expected pinhole"),
        ("c.json", basalt("pinhole", {}, 2), r"holds 2 cameras .cam0, cam1.; choose one"),
        ("c.json", json.dumps(PLAIN | {"xi": -0.2, "alpha": 0.6}), "a double sphere"),
        ("s.json", openmvg("spherical", {}), "model spherical; expected one of pinhole"),
        ("s.json", '{"sfm_data_version": "0.3", "intrinsics": []}', "no intrinsics"),
        ("s.json", openmvg("pinhole", {}).replace("focal_length", "x"), "no focal_length in it"),
        ("m.sfm", meshroom("1.2.6", type="3deanamorphic4"), "type 3deanamorphic4; expected one"),
        ("m.sfm", meshroom("1.2.6"), "no focalLength in it"),
        ("m.xml", "<calibration><f>1</f></calibration>", "width is missing; expected a number"),
        ("cameras.bin", bytes(7), "a damaged file, or none of COLMAP's cameras"),
        ("cameras.bin", struct.pack("<QiiQQ", 1, 1, 99, 640, 480), "a damaged file, or none"),
        ("c.ini", "[left]\nfx = 1\nfx = 2\n", r"c.ini: line 3: .left.: fx stands twice"),
        ("c.cameramodel", "{'lensmodel': 'LENSMODEL_SPLINED', 'intrinsics': [1,2,3,4]}", "SPLINED"),
    ],
)
def test_cameras_that_are_not_read(tmp_path: Path, name: str, content: str, words: str) -> None:
    path = tmp_path / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(ConfigurationError, match=words) as caught:
        read_camera(str(path))
    assert "\n" not in str(caught.value)


def test_lines_of_yaml_are_counted_with_its_directive(tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text("%YAML:1.0\n---\nfx: 800\nfy: [1, 2\ncx: 3\n")
    with pytest.raises(ConfigurationError, match=r"c.yaml:5:3: not YAML"):
        read_camera(str(tmp_path / "c.yaml"))


def test_text_of_any_length_is_looked_at_quickly(tmp_path: Path) -> None:
    start = time.process_time()
    for content in ("a" * 30_000, '{"a": ["' + "a" * 30_000 + '"]}', "a 1 " * 9_000, "a=" * 9_000):
        (tmp_path / "c.txt").write_text(content)
        with pytest.raises(ConfigurationError):
            read_camera(str(tmp_path / "c.txt"))
    assert time.process_time() - start < 2


def test_a_camera_for_tracks_is_checked_by_what_they_cover() -> None:
    own = Camera(800.0, 800.0, 320.0, 240.0, width=640, height=480)
    assert not notes_on_tracks(own, 650, 300)
    assert "reach over 1900x1000 pixels, but the camera" in notes_on_tracks(own, 1900, 1000)[0]
    with pytest.raises(ConfigurationError, match="fx is 4, which cannot be pixels"):
        notes_on_tracks(Camera(4.0, 4.0, 2.0, 2.0), 640, 480)


@pytest.mark.parametrize(("fx", "fy", "name"), [(4.0, 800.0, "fx"), (800.0, 3e-307, "fy")])
def test_both_focal_lengths_are_checked(fx: float, fy: float, name: str) -> None:
    with pytest.raises(ConfigurationError, match=f"camera: {name} is .*cannot be pixels"):
        fitted(Camera(fx, fy, 320.0, 240.0), 640, 480)
