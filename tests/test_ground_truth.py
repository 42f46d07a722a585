"""Manual labels: points and masks become one true label per track."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from mssegment.errors import DataError
from mssegment.ground_truth import true_labels
from mssegment.records import IGNORED, Frame, Tracks

FRAMES = [Frame(f"frame-{i}.png", 40, 30) for i in (1, 2, 3)]
TRACKS = Tracks(
    np.array(
        [
            [[5, 5], [6, 5], [7, 5]],  # on object 1 throughout
            [[30, 20], [29, 20], [28, 20]],  # on object 2 throughout
            [[5, 8], [30, 20], [5, 8]],  # changes its object
            [[20, 28], [20, 28], [20, 28]],  # on none
            [[39, 29], [39, 29], [39, 29]],  # where the masks say ignore
        ],
        dtype=float,
    )
)


def mask() -> np.ndarray:
    picture = np.zeros((30, 40), np.uint8)
    picture[:15, :15] = 1
    picture[15:25, 25:] = 2
    picture[29:, 35:] = 255
    return picture


def save(folder: Path, name: str, picture: np.ndarray) -> str:
    assert cv2.imwrite(str(folder / name), picture)
    return str(folder / name)


def test_masks_of_all_frames_of_one_and_of_the_numbered_one(tmp_path: Path) -> None:
    everywhere = [save(tmp_path, f"m{i}.png", mask()) for i in (1, 2, 3)]
    assert true_labels(everywhere, TRACKS, FRAMES, 1.0).tolist() == [1, 2, 0, 0, IGNORED]
    first = [save(tmp_path, "mask.png", mask())]
    assert true_labels(first, TRACKS, FRAMES, 1.0).tolist() == [1, 2, 1, 0, IGNORED]
    second = [save(tmp_path, "mask-2.png", mask())]
    assert true_labels(second, TRACKS, FRAMES, 1.0).tolist() == [1, 2, 2, 0, IGNORED]


def test_a_grey_mask_may_be_stored_in_colour(tmp_path: Path) -> None:
    stored = save(tmp_path, "mask.png", np.dstack([mask()] * 3))
    assert true_labels([stored], TRACKS, FRAMES, 1.0).tolist() == [1, 2, 1, 0, IGNORED]


def test_points_label_the_tracks_near_them(tmp_path: Path) -> None:
    (tmp_path / "l.csv").write_text("x,y,label\n5.5,5,1\n30,20,2\n20,28,0\n")
    found = true_labels([str(tmp_path / "l.csv")], TRACKS, FRAMES, 1.0)
    assert found.tolist() == [1, 2, IGNORED, 0, IGNORED]


def test_labels_that_cannot_be_right(tmp_path: Path) -> None:
    small = save(tmp_path, "small.png", mask()[:10])
    edges = np.tile(np.repeat([0, 60, 120, 180, 240, 255], [12, 1, 1, 1, 1, 24]), (30, 1))
    soft = save(tmp_path, "soft.png", edges.astype(np.uint8))
    jpeg = save(tmp_path, "mask.jpg", mask())
    other = [save(tmp_path, f"mask-{i}.png", mask()) for i in (1, 9)]
    blind = save(tmp_path, "blind.png", np.full((30, 40), 255, np.uint8))
    (tmp_path / "far.csv").write_text("x,y,label\n500,500,1\n")
    far = str(tmp_path / "far.csv")
    for paths, said in (
        ([small], "the mask is 40x10; expected 40x30"),
        ([soft], "6 values, most of them only along edges"),
        ([jpeg], "a JPEG, which blurs"),
        (other, r"mask-9\.png: no frame has this number"),
        ([blind], "match no track"),
        ([far], "none lies within 1 px"),
        ([far, blind], "expected either one table of labels or mask images"),
        (["none.png"], "none.png"),
    ):
        with pytest.raises(DataError, match=said) as caught:
            true_labels(paths, TRACKS, FRAMES, 1.0)
        assert "\n" not in str(caught.value)


def test_a_table_of_labels_may_have_any_separator(tmp_path: Path) -> None:
    (tmp_path / "l.txt").write_text("x y label\n5.5 5 1\n30 20 2\n")
    found = true_labels([str(tmp_path / "l.txt")], TRACKS, FRAMES, 1.0)
    assert found.tolist() == [1, 2, IGNORED, IGNORED, IGNORED]
