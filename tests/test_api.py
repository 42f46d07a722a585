"""The Python interface: images, arrays and tracks agree; wrong input is named in one line."""

from __future__ import annotations

import os
import pydoc
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import mssegment
from mssegment.errors import ConfigurationError, DataError, UsageError

SAMPLE = Path(__file__).parents[1] / "sample_data"
PAIR = [SAMPLE / "affine" / f"frame-{i}.png" for i in (1, 2)]
AFFINE = {"hypothesize.model": "affine"}


@pytest.fixture(scope="module")
def from_files() -> Any:
    return mssegment.segment_pictures(PAIR, AFFINE)


def test_pictures_from_files(from_files: Any) -> None:
    assert len(from_files.motions) == 3
    assert from_files.points.shape == (len(from_files.labels), 2, 2)
    for motion in from_files.motions:
        assert (from_files.labels[motion.inliers] == motion.label).all()


def test_arrays_give_what_their_files_give(from_files: Any) -> None:
    arrays = [cv2.imread(str(path))[..., ::-1] for path in PAIR]
    found = mssegment.segment_pictures(arrays, AFFINE)
    np.testing.assert_array_equal(found.labels, from_files.labels)
    np.testing.assert_array_equal(found.points, from_files.points)


def test_tracks_give_what_the_pictures_gave(from_files: Any) -> None:
    found = mssegment.segment_tracks(from_files.points, AFFINE, frame_size=(640, 480))
    np.testing.assert_array_equal(found.labels, from_files.labels)


def test_a_camera_is_what_translation_needs() -> None:
    import yaml

    known = yaml.safe_load((SAMPLE / "translation" / "camera.yaml").read_text())
    camera = mssegment.Camera(**known)
    pictures = [SAMPLE / "translation" / f"frame-{i}.png" for i in (1, 2)]
    found = mssegment.segment_pictures(
        pictures, {"hypothesize.model": "translation"}, camera=camera
    )
    assert len(found.motions) == 3


@pytest.mark.parametrize(
    ("points", "error", "said"),
    [
        (np.zeros((5, 2)), UsageError, r"shape is \(5, 2\); expected \[tracks, frames, 2\]"),
        (np.zeros((0, 3, 2)), DataError, "0 tracks"),
        (np.full((5, 2, 2), np.inf), DataError, "track 0 is at"),
    ],
)
def test_tracks_that_are_none(points: Any, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        mssegment.segment_tracks(points)


@pytest.mark.parametrize(
    ("pictures", "error", "said"),
    [
        ([np.zeros((4, 4))] * 2, UsageError, r"pictures\[0\]: float64"),
        ([np.zeros((4, 4, 4), np.uint8)] * 2, UsageError, r"pictures\[0\]: uint8 of shape"),
        ([np.zeros((4, 4), np.uint8)], UsageError, "found 1 image"),
        ([np.zeros((4, 4), np.uint8), "frame.png"], UsageError, "files and arrays"),
        ([np.zeros((4, n), np.uint8) for n in (4, 5, 5)], DataError, "frames differ in size"),
        ("nowhere.png", DataError, "nowhere.png"),
        ([], UsageError, "no pictures"),
    ],
)
def test_pictures_that_are_none(pictures: Any, error: type[Exception], said: str) -> None:
    with pytest.raises(error, match=said):
        mssegment.segment_pictures(pictures)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"hypothesize.modell": "affine"}, "did you mean hypothesize.model"),
        ({"hypothesize.model": "afine"}, "'afine'"),
    ],
)
def test_settings_that_are_none(settings: Any, said: str) -> None:
    with pytest.raises(ConfigurationError, match=f"settings: .*{said}"):
        mssegment.segment_tracks(np.zeros((5, 2, 2)), settings)


def test_nothing_else_is_in_the_package() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'segment'"):
        mssegment.segment  # type: ignore[attr-defined]  # noqa: B018


def test_the_public_api_is_listed_and_documented() -> None:
    assert set(mssegment.__all__) <= set(dir(mssegment))
    for name in mssegment.__all__:
        assert getattr(mssegment, name) is not None
        if name != "__version__":
            assert getattr(mssegment, name).__doc__
    text = pydoc.plain(pydoc.render_doc(mssegment))
    assert all(name in text for name in mssegment.__all__)
    with pytest.raises(AttributeError, match="segment_picture"):
        _ = mssegment.segment_picture


def test_importing_the_package_loads_nothing_and_changes_nothing() -> None:
    code = "import sys, mssegment; print(*(m for m in sys.modules if m.startswith('mssegment')))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert set(found.stdout.split()) == {"mssegment", "mssegment.version"}


def test_a_checker_of_types_knows_the_api(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    script = tmp_path / "stranger.py"
    script.write_text(
        "import numpy as np\n"
        "import mssegment\n"
        "found: mssegment.Segmentation = mssegment.segment_tracks(np.zeros((3, 2, 2)))\n"
        "first: mssegment.Motion = found.motions[0]\n"
        "camera = mssegment.Camera(1.0, 1.0, 0.0, 0.0)\n"
        "shift = mssegment.MeanShift('euclidean(2)', 1.0)\n"
        "reveal_type(found.labels)\n"
    )
    command = [sys.executable, "-m", "mypy", "--strict", str(script), "--cache-dir"]
    environment = {**os.environ, "MYPYPATH": str(Path(mssegment.__file__).parents[1])}
    found = subprocess.run(
        [*command, str(tmp_path / "cache")], capture_output=True, text=True, env=environment
    )
    assert found.returncode == 0, found.stdout
    assert "numpy.ndarray" in found.stdout
