"""Sample scenes: the generator makes the very files, and they are what they say."""

from __future__ import annotations

import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from mssegment.imaging.corners import detect_all
from mssegment.imaging.frames import open_frames
from mssegment.imaging.matching import match

generate = pytest.importorskip("sample_data.generate")
png = pytest.importorskip("sample_data.png")
FOLDER = Path(generate.__file__).parent
SCENES = {scene.name: scene for scene in generate.SCENES}
EXACT = "ng" not in zlib.ZLIB_RUNTIME_VERSION
"""zlib-ng compresses to other bytes that unpack to the same picture."""


def mask(name: str, frame: int) -> np.ndarray:
    return cv2.imread(str(FOLDER / name / f"mask-{frame}.png"), cv2.IMREAD_UNCHANGED)


@pytest.mark.parametrize("name", SCENES)
def test_the_generator_reproduces_the_files(name: str) -> None:
    last = SCENES[name].frames - 1
    picture, labels = generate.render(SCENES[name], last)
    for kind, content in (
        ("frame", png.encode(picture, generate.palette())),
        ("mask", png.encode(labels)),
    ):
        stored = (FOLDER / name / f"{kind}-{last + 1}.png").read_bytes()
        one, two = (
            cv2.imdecode(np.frombuffer(c, np.uint8), cv2.IMREAD_UNCHANGED)
            for c in (stored, content)
        )
        np.testing.assert_array_equal(one, two)
        assert stored == content or not EXACT


def test_our_png_is_read_back_as_written() -> None:
    rng = np.random.default_rng(0)
    grey = rng.integers(0, 256, (31, 17), dtype=np.uint8)
    read = cv2.imdecode(np.frombuffer(png.encode(grey), np.uint8), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(read, grey)
    palette = rng.integers(0, 256, (256, 3), dtype=np.uint8)
    read = cv2.imdecode(np.frombuffer(png.encode(grey, palette), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(read[..., ::-1], palette[grey])


@pytest.mark.parametrize("name", SCENES)
def test_masks_show_three_bodies_and_their_rims(name: str) -> None:
    for frame in range(1, SCENES[name].frames + 1):
        labels = mask(name, frame)
        assert labels.shape == (480, 640)
        assert set(np.unique(labels)) == {0, 1, 2, 3, 255}
        assert min((labels == n).sum() for n in (1, 2, 3)) > 8000


def test_small_enough_to_live_in_the_repository() -> None:
    assert sum(f.stat().st_size for f in FOLDER.rglob("*.png")) < 2_000_000


def test_the_camera_is_the_one_that_rendered() -> None:
    camera = yaml.safe_load((FOLDER / "translation" / "camera.yaml").read_text())
    assert camera == {"fx": 800.0, "fy": 800.0, "cx": 319.5, "cy": 239.5}


@pytest.mark.parametrize("name", SCENES)
def test_bodies_move_and_the_wall_stands(name: str) -> None:
    source = open_frames([str(FOLDER / name / "frame-*.png")])
    assert len(source) == SCENES[name].frames
    pictures = source.greys()
    points = match(pictures, detect_all(pictures)).points
    labels = np.stack(
        [
            mask(name, f + 1)[tuple(np.rint(points[:, f, ::-1]).astype(int).T)]
            for f in range(len(source))
        ],
        axis=1,
    )
    same = (labels == labels[:, :1]).all(axis=1)
    moved = np.linalg.norm(points[:, -1] - points[:, 0], axis=1)
    for body in (1, 2, 3):
        mine = same & (labels[:, 0] == body)
        assert mine.sum() >= 50
        assert np.median(moved[mine]) > 8
    assert np.mean(moved[same & (labels[:, 0] == 0)] < 1) > 0.97


def test_boxes_translate_as_the_camera_says() -> None:
    """Matches on a box satisfy t . (x1 x x2) = 0, equation (25), with the box's own t."""
    scene = SCENES["translation"]
    pictures = open_frames([str(FOLDER / "translation" / "frame-*.png")]).greys()
    points = match(pictures, detect_all(pictures)).points
    rays = np.concatenate(
        [(points - (319.5, 239.5)) / 800.0, np.ones((*points.shape[:2], 1))], axis=2
    )
    normals = np.cross(rays[:, 0], rays[:, 1])
    where = np.rint(points[:, 0, ::-1]).astype(int)
    labels = mask("translation", 1)[tuple(where.T)]
    for number, box in enumerate(scene.bodies, start=1):
        t = np.subtract(box.centres[1], box.centres[0])
        mine = normals[labels == number]
        # n . t is |t| times the distance to the epipolar line, in the picture at distance 1
        pixels = 800 * np.abs(mine @ t) / np.linalg.norm(t) / np.linalg.norm(mine, axis=1)
        slope = np.linalg.norm(points[labels == number, 1] - points[labels == number, 0], axis=1)
        assert np.median(pixels * slope / 800) < 0.5
