"""Data that is no picture on the command line: readers, stages, results, messages."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from mssegment.cli import invoke
from mssegment.datasets.containers import InputFile
from mssegment.datasets.points import read_points
from mssegment.errors import DataError, ExitStatus
from tests.structures import bodies, hyperplanes


@pytest.fixture(scope="module")
def lines(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A table of two lines in the plane and outliers, with labels."""
    points, labels = hyperplanes(np.random.default_rng(12), count=2, per=40, outliers=30)
    path = tmp_path_factory.mktemp("points") / "lines.csv"
    rows = "\n".join(
        f"{x:.6g},{y:.6g},{label}" for (x, y), label in zip(points, labels, strict=True)
    )
    path.write_text(f"x,y,label\n{rows}\n")
    return str(path)


def of(content: str | bytes, name: str = "points.csv") -> np.ndarray:
    data = content if isinstance(content, bytes) else content.encode()
    return read_points(InputFile(name, data)).tracks.points


def test_tables() -> None:
    assert of("x,y,z\n1,2,3\n4,5,6\n").shape == (2, 1, 3)
    assert of("1 2 3\n4 5 6\n").shape == (2, 1, 3)
    assert of("age;income;height;label\n1;2;3;0\n4;5;6;1\n").shape == (2, 1, 3)
    assert of("x,y,z,red,green\n1,2,3,9,9\n4,5,6,9,9\n").shape == (2, 1, 3)
    assert of("1 2 3 255 255 255\n4 5 6 0 0 0\n", "cloud.xyz").shape == (2, 1, 3)
    pairs = of("x1,y1,z1,x2,y2,z2\n1,2,3,4,5,6\n1,2,3,4,5,7\n")
    assert pairs[0].tolist() == [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]


def test_labels_and_names() -> None:
    found = read_points(InputFile("a.csv", b"id,x,y,label\na,1,2,0\nb,3,4,2\n"))
    assert found.ids == ("a", "b")
    assert found.tracks.labels.tolist() == [0, 2]
    assert [(frame.width, frame.height) for frame in found.frames] == [(0, 0)]


def test_a_missing_coordinate_is_said() -> None:
    found = read_points(InputFile("a.csv", b"x,y\n1,2\n,4\n5,6\n"))
    assert np.isnan(found.tracks.points[1]).all()
    assert found.notes == ("1 points lack a coordinate and belong to no structure",)


def test_arrays(tmp_path: Path) -> None:
    points = np.arange(12.0).reshape(2, 6)
    np.save(tmp_path / "a.npy", points)
    assert of((tmp_path / "a.npy").read_bytes(), "a.npy").shape == (2, 1, 6)
    np.save(tmp_path / "b.npy", points.reshape(2, 2, 3))
    assert of((tmp_path / "b.npy").read_bytes(), "b.npy").shape == (2, 2, 3)
    np.savez(tmp_path / "c.npz", cloud=points, labels=[0, 1])
    found = read_points(InputFile("c.npz", (tmp_path / "c.npz").read_bytes()))
    assert found.tracks.labels.tolist() == [0, 1]


def test_point_clouds() -> None:
    pytest.importorskip("plyfile", reason="needs mssegment[points]")
    header = "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
    ply = header + "property float z\nproperty uchar label\nend_header\n1 2 3 0\n4 5 6 1\n"
    found = read_points(InputFile("a.ply", ply.encode()))
    assert found.tracks.points[1, 0].tolist() == [4.0, 5.0, 6.0]
    assert found.tracks.labels.tolist() == [0, 1]
    pytest.importorskip("pypcd4", reason="needs mssegment[points]")
    pcd = (
        "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\n"
        "HEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA ascii\n1 2 3\n4 5 6\n"
    )
    assert of(pcd, "a.pcd")[1, 0].tolist() == [4.0, 5.0, 6.0]


@pytest.mark.parametrize(
    ("content", "name", "message"),
    [
        (b"", "a.csv", "a.csv: empty"),
        (b"x,y\n1,2\n3,hello\n", "a.csv", "line 3: 'hello' in column 'y'"),
        (b"label\n1\n2\n", "a.csv", "no column of coordinates"),
        (b"x,y,label\n1,2,0\n1,2,-4\n", "a.csv", "found -4"),
        (b"ply\nformat ascii 1.0\nelement face 0\nend_header\n", "a.ply", "damaged PLY"),
        (b"{}", "a.json", "arrays of points"),
        (b"<a/>", "a.xml", "not a file of points"),
    ],
)
def test_damaged_files(content: bytes, name: str, message: str) -> None:
    if name.endswith("ply"):
        pytest.importorskip("plyfile", reason="needs mssegment[points]")
    with pytest.raises(DataError, match=message):
        read_points(InputFile(name, content))


def test_run_writes_everything(lines: str, tmp_path: Path, capfd) -> None:
    out = tmp_path / "out"
    options = ["--model", "line", "--out", str(out), "--export", "points", "--json", "-q"]
    assert invoke(["run", lines, *options]) == 0
    report = json.loads(capfd.readouterr().out)
    assert report["motions"] == 2
    assert report["misclassification"] < 0.08
    assert {path.name for path in out.iterdir()} >= {
        "frame-1.png",
        "points.png",
        "points.csv",
        "report.html",
        "segmentation.json",
    }
    rows = list(csv.DictReader((out / "points.csv").open()))
    assert [int(row["structure"]) for row in rows] == report["labels"]
    for row in rows[:20]:
        if int(row["structure"]):
            a, b, c = report["motion_list"][int(row["structure"]) - 1]["coefficients"]
            miss = abs(a * float(row["x"]) + b * float(row["y"]) + c)
            assert miss == pytest.approx(float(row["residual"]), abs=1e-9)
    page = (out / "report.html").read_text()
    assert "2 structures in 110 points" in page


def test_a_pipe_gives_the_same(lines: str, tmp_path: Path, capfd) -> None:
    names = [str(tmp_path / name) for name in ("points.json", "hypotheses.json", "found.json")]
    assert invoke(["import", "--points", lines, "-o", names[0], "-q"]) == 0
    assert invoke(["hypothesize", names[0], "--model", "line", "-o", names[1], "-q"]) == 0
    assert invoke(["cluster", names[1], "-o", names[2], "-q"]) == 0
    assert invoke(["report", names[2], "--format", "text", "-q"]) == 0
    said = capfd.readouterr().out
    assert "2 structures in 110 points" in said
    assert "px" not in said
    out = str(tmp_path / "out")
    assert invoke(["run", lines, "--model", "line", "--out", out, "--json", "-q"]) == 0
    capfd.readouterr()
    piped, whole = (
        json.loads(Path(path).read_text()) for path in (names[2], f"{out}/segmentation.json")
    )
    assert piped["labels"] == whole["labels"]


def test_nothing_to_find_is_a_result(tmp_path: Path, capfd) -> None:
    path = tmp_path / "noise.csv"
    np.savetxt(path, np.random.default_rng(0).uniform(size=(80, 2)), delimiter=",")
    assert invoke(["run", str(path), "--model", "line", "--out", str(tmp_path / "o"), "-q"]) == 0
    report = json.loads(capfd.readouterr().out)
    assert report["motions"] == 0
    assert any(note.startswith("no structure") for note in report["notes"])


def test_matched_points_have_two_pictures(tmp_path: Path, capfd) -> None:
    points, labels = bodies(np.random.default_rng(3), count=2, per=30, outliers=20)
    path = tmp_path / "pairs.csv"
    rows = np.column_stack([points.reshape(len(points), 6), labels])
    np.savetxt(path, rows, delimiter=",", header="x1,y1,z1,x2,y2,z2,label", comments="", fmt="%.6g")
    out = tmp_path / "out"
    options = ["--model", "rigid3d", "--out", str(out), "-q"]
    assert invoke(["run", str(path), *options, "--set", "report.picture_format=svg"]) == 0
    report = json.loads(capfd.readouterr().out)
    assert report["motions"] == 2
    assert np.shape(report["motion_list"][0]["matrix"]) == (4, 4)
    assert (out / "frame-2.svg").read_text().startswith("<svg")


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["--model", "plane"], ExitStatus.DATA, "plane is for points with 3 coordinates; found 2"),
        (["--model", "rigid3d"], ExitStatus.DATA, "needs two matched sets of points; found 1"),
        (["--model", "subspace"], ExitStatus.CONFIGURATION, "hypothesize.rank is auto"),
        (["--model", "line", "--masks"], ExitStatus.USAGE, "--masks: this data is no picture"),
        (["--model", "line", "--export", "mot"], ExitStatus.USAGE, "choose points"),
        (
            ["--model", "line", "--set", "segment.selection=dominance"],
            ExitStatus.CONFIGURATION,
            "use mdl for data",
        ),
    ],
)
def test_wrong_options(arguments, status, message, lines: str, tmp_path: Path, capfd) -> None:
    assert invoke(["run", lines, *arguments, "--out", str(tmp_path / "o")]) == status
    assert message in capfd.readouterr().err


def test_models_of_the_other_kind_are_refused(lines: str, tmp_path: Path, capfd) -> None:
    name = str(tmp_path / "points.json")
    assert invoke(["import", "--points", lines, "-o", name, "-q"]) == 0
    assert invoke(["hypothesize", name]) == ExitStatus.CONFIGURATION
    assert "choose hyperplane" in capfd.readouterr().err
    table = tmp_path / "matches.csv"
    table.write_text("x1,y1,x2,y2\n" + "10,20,30,40\n50,60,70,80\n" * 5)
    assert invoke(["import", str(table), "-o", name, "-q"]) == 0
    assert invoke(["hypothesize", name, "--model", "plane"]) == ExitStatus.CONFIGURATION
    assert "these are tracks in pictures" in capfd.readouterr().err
