"""The library as a stranger uses it: in a notebook, in a script that is type checked."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import mssegment
from mssegment.errors import DataError, UsageError

ROOT = Path(__file__).parents[1]
PAIR = [ROOT / "sample_data" / "affine" / f"frame-{i}.png" for i in (1, 2)]


@pytest.fixture(scope="module")
def found() -> mssegment.Segmentation:
    return mssegment.segment_pictures(PAIR)


def two_groups(seed: int = 0) -> np.ndarray[Any, Any]:
    rng = np.random.default_rng(seed)
    first = rng.uniform(0, 480, (80, 2))
    second = np.where(
        np.arange(80)[:, None] < 40, first + np.array([12, 3]), 1.1 * first - [20, 40]
    )
    return np.stack([first, second], axis=1) + rng.normal(0, 0.2, (80, 2, 2))


def test_repr_is_short_and_says_what_was_found(found: mssegment.Segmentation) -> None:
    sizes = ", ".join(f"{n}: {len(found.motion(n).inliers)}" for n in (1, 2, 3))
    head = f"<Segmentation of {len(found.labels)} tracks over 2 frames: {sizes}; "
    assert repr(found).startswith(head)
    assert re.fullmatch(r"(outliers: \d; )?background: \d+>", repr(found).removeprefix(head))
    assert repr(found.motion(1)) == f"Motion 1: affine, {len(found.motion(1).inliers)} inliers"


def test_html_has_the_picture_and_the_table(found: mssegment.Segmentation) -> None:
    text = found._repr_html_()
    assert text.startswith('<img src="data:image/jpeg;base64,')
    assert text.count("<tr>") == 6
    without = mssegment.segment_tracks(two_groups())
    assert "data:image/jpeg" in without._repr_html_()


def test_motions_know_the_points_of_their_tracks(found: mssegment.Segmentation) -> None:
    motion = found.motion(2)
    np.testing.assert_array_equal(motion.inlier_points, found.points[found.labels == 2])
    assert found.motions[1].label == motion.label == 2
    assert found.camera_motion is None
    with pytest.raises(UsageError, match="there is no motion 4; the labels are 1 to 3"):
        found.motion(4)


def test_dataframe_has_numbers_by_column(found: mssegment.Segmentation) -> None:
    pytest.importorskip("pandas")
    table = found.to_dataframe()
    assert len(table) == np.isfinite(found.points).all(axis=2).sum()
    assert table.dtypes[["x", "y", "residual_px"]].eq("float64").all()
    assert (table.groupby("motion").id.nunique()[[1, 2, 3]] == [509, 235, 171]).all()


def test_plot_draws_every_label(found: mssegment.Segmentation) -> None:
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    axes = found.plot(frame=1)
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert names == ["background", "motion 1", "motion 2", "motion 3"]
    with pytest.raises(UsageError, match="there is no frame 2; expected 0 to 1"):
        found.plot(frame=2)


@pytest.mark.parametrize(("module", "call"), [("pandas", "to_dataframe"), ("matplotlib", "plot")])
def test_a_missing_extra_is_named(
    found: mssegment.Segmentation, monkeypatch: pytest.MonkeyPatch, module: str, call: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    monkeypatch.setitem(sys.modules, f"{module}.pyplot", None)
    extra = {"pandas": "pandas", "matplotlib": "plot"}[module]
    with pytest.raises(UsageError, match=rf"{module} is not installed; .*mssegment\[{extra}\]"):
        getattr(found, call)()


def test_save_writes_what_run_writes(found: mssegment.Segmentation, tmp_path: Path) -> None:
    out = tmp_path / "out"
    files = found.save(out)
    assert all(file.is_file() for file in files)
    assert {"segmentation.json", "report.html", "overlay.png"} <= {file.name for file in files}
    with pytest.raises(UsageError, match=r"folder: .* is not empty; pass overwrite=True"):
        found.save(out)
    found.save(out, overwrite=True)
    with pytest.raises(UsageError, match=r"folder: .* is a file"):
        found.save(out / "report.html")


def test_tracks_on_pictures_of_their_own_have_masks(found: mssegment.Segmentation) -> None:
    again = mssegment.segment_tracks(found.points, pictures=PAIR)
    masks = again.masks()
    assert masks.shape == (2, 480, 640)
    assert set(np.unique(masks)) == {0, 1, 2, 3}
    with pytest.raises(UsageError, match="found 3 for 2 frames"):
        mssegment.segment_tracks(found.points, pictures=[*PAIR, PAIR[0]])
    with pytest.raises(DataError, match="masks need the picture"):
        mssegment.segment_tracks(found.points).masks()


def test_bgr_arrays_are_what_their_files_are(found: mssegment.Segmentation) -> None:
    arrays = [cv2.imread(str(path)) for path in PAIR]
    again = mssegment.segment_pictures(arrays, channels="bgr")
    np.testing.assert_array_equal(again.points, found.points)
    np.testing.assert_array_equal(again.report().pictures(0), arrays[0])
    with pytest.raises(UsageError, match="channels: found 'gbr'; expected 'rgb' or 'bgr'"):
        mssegment.segment_pictures(arrays, channels="gbr")  # type: ignore[arg-type]


def test_numbers_of_numpy_are_numbers() -> None:
    points = two_groups()
    plain = mssegment.segment_tracks(points, {"seed": 3, "segment.motions": 2})
    of_numpy = {"seed": np.int64(3), "segment.motions": np.int8(2)}
    again = mssegment.segment_tracks(points, of_numpy, frame_size=tuple(np.array([500, 500])))
    np.testing.assert_array_equal(again.labels, plain.labels)
    with pytest.raises(mssegment.ConfigurationError, match=r"seed is 1\.5"):
        mssegment.segment_tracks(points, {"seed": np.float64(1.5)})
    camera = mssegment.Camera(*np.array([800.0, 800.0, 250.0, 250.0]), tuple(np.zeros(4)))
    mssegment.segment_tracks(points, {"hypothesize.model": "translation"}, camera=camera)


def test_masked_positions_are_not_seen() -> None:
    points = np.repeat(two_groups(), 2, axis=1)[:, [0, 2, 1, 3]]
    masked = np.ma.masked_array(points, mask=np.zeros(points.shape, bool))
    masked[::3, 1, 0] = np.ma.masked  # one coordinate is enough
    holes = points.copy()
    holes[::3, 1] = np.nan
    found, expected = mssegment.segment_tracks(masked), mssegment.segment_tracks(holes)
    np.testing.assert_array_equal(found.points, expected.points)
    np.testing.assert_array_equal(found.labels, expected.labels)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda p: np.swapaxes(p, 0, 1), r"pass numpy\.swapaxes\(points, 0, 1\)"),
        (lambda p: (p[:, 0], p[:, 1]), r"pass numpy\.swapaxes\(points, 0, 1\)"),
        (lambda p: np.moveaxis(np.repeat(p, 2, 1), 2, 0), r"pass numpy\.moveaxis\(points, 0, 2\)"),
        (lambda p: p.reshape(-1, 4), r"points\.reshape\(-1, 2, 2\)"),
        (lambda p: p[:, 0], r"shape is \(80, 2\); expected \[tracks, frames, 2\]"),
        (lambda p: [["a", "b"]], "points: not an array of numbers"),
    ],
)
def test_axes_in_another_order_are_recognised(change: Any, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        mssegment.segment_tracks(change(two_groups()))


def test_few_tracks_over_many_frames_are_tracks() -> None:
    rng = np.random.default_rng(0)
    steps = rng.normal(0, 1, (40, 2)).cumsum(axis=0)
    points = rng.uniform(0, 400, (12, 1, 2)) + steps
    assert len(mssegment.segment_tracks(points).labels) == 12


def test_ids_are_kept_and_counted() -> None:
    points = two_groups()
    names = [f"t{i}" for i in range(80)]
    assert mssegment.segment_tracks(points, ids=names).tracks.tracks.ids == tuple(names)
    with pytest.raises(UsageError, match="ids: found 1 for 80 tracks"):
        mssegment.segment_tracks(points, ids=["a"])


def test_errors_name_arguments_and_not_options() -> None:
    with pytest.raises(mssegment.MssegmentError) as caught:
        mssegment.segment_tracks(two_groups(), {"hypothesize.model": "translation"})
    assert "camera=Camera(fx, fy, cx, cy)" in str(caught.value)
    tracks = np.repeat(two_groups(), 3, axis=1)
    with pytest.raises(UsageError, match=r"^threads is 2"):
        mssegment.segment_tracks(tracks, threads=2)


def test_the_notebook_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("pandas")
    pytest.importorskip("matplotlib").use("Agg")
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    monkeypatch.chdir(tmp_path)
    notebook = json.loads((ROOT / "docs" / "guide" / "notebook.ipynb").read_text())
    names: dict[str, Any] = {}
    for cell in notebook["cells"]:
        if cell["cell_type"] == "code":
            assert not cell["outputs"]
            exec("".join(cell["source"]), names)
    assert len(names["again"].motions) == 3
    assert names["masks"].shape == (2, 480, 640)


STRANGER = """\
import numpy as np
import numpy.typing as npt

import mssegment

names = ["sample_data/affine/frame-1.png", "sample_data/affine/frame-2.png"]
found = mssegment.segment_pictures(names, {"seed": 1})
print(found)
for motion in found.motions:
    points: npt.NDArray[np.float64] = motion.inlier_points
    matrix = motion.matrix
    if matrix is not None:
        moved = np.c_[points[:, 0], np.ones(len(points))] @ matrix.T
        print(motion.label, np.abs(moved[:, :2] / moved[:, 2:] - points[:, 1]).max() < 5)
camera = found.camera_motion
print("static camera" if camera is None else camera.label)
first = found.motion(1)
masks: npt.NDArray[np.uint8] = found.masks()
print(first.is_camera, masks.shape, [str(path.name) for path in found.save("saved")][-1])
"""


def test_a_script_of_a_stranger_is_type_checked_and_runs(tmp_path: Path) -> None:
    pytest.importorskip("mypy")
    script = tmp_path / "stranger.py"
    script.write_text(STRANGER)
    (tmp_path / "sample_data").symlink_to(ROOT / "sample_data")
    environment = os.environ | {"MYPYPATH": str(ROOT), "PYTHONPATH": str(ROOT)}
    for command in (["-m", "mypy", "--strict", "--cache-dir", str(tmp_path / "c")], []):
        ran = subprocess.run(
            [sys.executable, *command, str(script)],
            capture_output=True,
            text=True,
            env=environment,
            cwd=tmp_path,
        )
        assert ran.returncode == 0, ran.stdout + ran.stderr
    lines = ran.stdout.splitlines()
    assert re.match(r"<Segmentation of 15\d\d tracks", lines[0])
    assert lines[1:4] == ["1 True", "2 True", "3 True"]
    assert lines[-1] == "False (2, 480, 640) report.html"
