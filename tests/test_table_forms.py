"""Forms of tables and JSON in which scripts write tracks."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest

from mssegment import datasets
from mssegment.errors import DataError
from mssegment.records import Floats

TRACKS, FRAMES = 30, 6


@pytest.fixture
def points() -> Floats:
    """Tracks [P, F, 2] that move by a few pixels from frame to frame."""
    rng = np.random.default_rng(5)
    first = rng.uniform(0.0, 500.0, (TRACKS, 1, 2))
    steps = rng.uniform(-4.0, 4.0, (TRACKS, 1, 2)) * np.arange(FRAMES)[None, :, None]
    return np.asarray((first + steps).round(2))


def written(path: Path, head: str, rows: Iterable[Iterable[object]], separator: str = ",") -> Path:
    lines = [separator.join(map(str, row)) for row in rows]
    path.write_text("\n".join(([head] if head else []) + lines) + "\n")
    return path


@pytest.mark.parametrize("head", ["x,y,dx,dy", "X [px],Y [px],U [px],V [px]", "u,v,flow_x,flow_y"])
def test_displacements(head: str, points: Floats, tmp_path: Path) -> None:
    moves = points[:, 1] - points[:, 0]
    path = written(tmp_path / "a.csv", head, np.hstack([points[:, 0], moves]))
    if head.startswith("u"):
        path.write_text(path.read_text().replace("u,v", "px,py", 1))
    found = datasets.read(path)
    np.testing.assert_allclose(found.tracks.points, points[:, :2], atol=1e-9)
    assert "displacements" in found.notes[0]


def test_u_and_v_are_positions_where_the_places_cancel(points: Floats, tmp_path: Path) -> None:
    path = written(tmp_path / "a.csv", "x,y,u,v", np.hstack([points[:, 0], points[:, 1]]))
    found = datasets.read(path)
    np.testing.assert_array_equal(found.tracks.points, points[:, :2])
    assert "positions in the second view" in found.notes[0]


def test_displacements_in_several_frames_are_no_pair(points: Floats, tmp_path: Path) -> None:
    rows = [[i % 3, *points[i, 0], 1.0, 2.0] for i in range(TRACKS)]
    with pytest.raises(DataError, match="columns frame, x, y, dx, dy"):
        datasets.read(written(tmp_path / "a.csv", "frame,x,y,dx,dy", rows))


@pytest.mark.parametrize("separator", [" ", ",", "\t"])
def test_names_of_rows_as_r_writes_them(separator: str, points: Floats, tmp_path: Path) -> None:
    head = separator.join(f'"{name}"' for name in ("x1", "y1", "x2", "y2"))
    rows = [[f'"{i + 1}"', *points[i, :2].ravel()] for i in range(TRACKS)]
    found = datasets.read(written(tmp_path / "a.txt", head, rows, separator))
    np.testing.assert_array_equal(found.tracks.points, points[:, :2])
    assert found.notes == ("column ignored: row name",)


@pytest.mark.parametrize("form", ["({}, {})", "[{} {}]", "[{};{}]"])
def test_positions_in_one_cell(form: str, points: Floats, tmp_path: Path) -> None:
    def cell(point: Floats) -> str:
        return '"' + form.format(*point) + '"'

    rows = [[i, f, cell(points[i, f])] for i in range(TRACKS) for f in range(FRAMES)]
    found = datasets.read(written(tmp_path / "a.csv", "track,frame,position", rows))
    np.testing.assert_array_equal(found.tracks.points, points)
    pairs = [[cell(own[0]), cell(own[1])] for own in points]
    found = datasets.read(written(tmp_path / "b.csv", "from,to", pairs))
    np.testing.assert_array_equal(found.tracks.points, points[:, :2])


@pytest.mark.parametrize("with_index", [True, False])
def test_columns_with_levels(with_index: bool, points: Floats, tmp_path: Path) -> None:
    names = [f"bead {i}" for i in range(TRACKS)]
    lines = [["track", *np.repeat(names, 2)], ["coordinate", *["x", "y"] * TRACKS]]
    if with_index:
        lines.append(["frame", *[""] * (2 * TRACKS)])
    lines += [[f, *points[:, f].ravel()] for f in range(FRAMES)]
    found = datasets.read(written(tmp_path / "a.csv", "", lines))
    np.testing.assert_array_equal(found.tracks.points, points)
    assert found.ids == tuple(names)


@pytest.mark.parametrize("by", ["frame", "track"])
def test_positions_by_frame_and_track(by: str, points: Floats, tmp_path: Path) -> None:
    outer, inner = (FRAMES, TRACKS) if by == "frame" else (TRACKS, FRAMES)
    nested = {
        str(a): {
            str(b): (points[b, a] if by == "frame" else points[a, b]).tolist() for b in range(inner)
        }
        for a in range(outer)
    }
    path = tmp_path / "a.json"
    path.write_text(json.dumps(nested))
    np.testing.assert_array_equal(datasets.read(path).tracks.points, points)


def test_boxes_of_supervision(points: Floats, tmp_path: Path) -> None:
    rows = [
        {"x_min": x - 5, "y_min": y - 4, "x_max": x + 5, "y_max": y + 4, "tracker_id": i}
        | {"frame_number": f, "class_id": 2, "confidence": 0.9}
        for i, own in enumerate(points.tolist())
        for f, (x, y) in enumerate(own)
    ]
    path = tmp_path / "a.json"
    path.write_text(json.dumps(rows))
    np.testing.assert_allclose(datasets.read(path).tracks.points, points, atol=1e-9)


@pytest.mark.parametrize("halves", [True, False])
def test_a_measurement_matrix_as_text(halves: bool, points: Floats, tmp_path: Path) -> None:
    axes = np.moveaxis(points, 0, -1)
    matrix = np.moveaxis(axes, 1, 0).reshape(-1, TRACKS) if halves else axes.reshape(-1, TRACKS)
    np.savetxt(tmp_path / "W.txt", matrix)
    found = datasets.read(tmp_path / "W.txt")
    np.testing.assert_allclose(found.tracks.points, points, atol=1e-9)
    assert found.notes[0].startswith(f"matrix [{2 * FRAMES}, {TRACKS}]: read as ")
    np.savetxt(tmp_path / "rows.txt", points.reshape(TRACKS, -1))
    np.testing.assert_allclose(datasets.read(tmp_path / "rows.txt").tracks.points, points)
