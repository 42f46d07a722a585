"""Tables in random dialects: separators, decimals, encodings, names, orders, gaps; all are read."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mssegment import datasets
from mssegment.records import Floats

TRACK = (
    "track|Track ID|TRACK_ID|TrackID|id|particle|object_id|obj|trajectory|tid|feature_id|Track #"
)
FRAME = "frame|frame_id|Frame|frame number|frameNumber|frame_no|t|Time (s)|timestamp|image|slice"
PLACE = (
    "x,y|X,Y|x_px,y_px|x (px),y (px)|X [pixel],Y [pixel]|pos_x,pos_y|POSITION_X,POSITION_Y|u,v"
    "|cx,cy|center_x,center_y|x_center,y_center|Centroid X,Centroid Y|xPos,yPos"
    "|coord_x,coord_y|col,row"
)
VIEWS = (
    "x1,y1,x2,y2|u1,v1,u2,v2|x0,y0,x1,y1|x_1,y_1,x_2,y_2|src_x,src_y,dst_x,dst_y|xa,ya,xb,yb"
    "|left_x,left_y,right_x,right_y|kp1_x,kp1_y,kp2_x,kp2_y|x,y,x_new,y_new|x,y,x',y'"
    "|prev_x,prev_y,curr_x,curr_y|x_t0,y_t0,x_t1,y_t1|queryX,queryY,trainX,trainY"
)
FRAMES = [str, lambda f: f"{f}.0", lambda f: f"img_{f:04d}.png", lambda f: f"{0.04 * f:.2f}"]
IDS = [str, lambda p: f"T{p:02d}", lambda p: str(9007199254740993000 + p)]


class Dialect:
    """A way to write a table, drawn at random."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng = rng
        self.separator = self.one(",", ";", "\t", " ", "|", "; ")
        self.comma = self.separator not in (",", " ") and rng.random() < 0.4
        self.missing = (
            self.one("nan", "NA") if self.separator == " " else self.one("", "nan", "null")
        )
        self.quoted = self.separator != " " and rng.random() < 0.15

    def one(self, *ways: str) -> str:
        """One of some ways."""
        return ways[self.rng.integers(len(ways))]

    def number(self, value: float) -> str:
        """A number, or what stands for none."""
        text = f"{value:.3f}" if np.isfinite(value) else self.missing
        return text.replace(".", ",") if self.comma else text

    def write(self, path: Path, rows: list[list[str]]) -> None:
        """Write rows, the first of which are the names."""
        if self.separator == " ":
            rows = [[cell.replace(" ", "_") for cell in row] for row in rows]
        quote = '"' if self.quoted else ""
        lines = [self.separator.join(f"{quote}{cell}{quote}" for cell in row) for row in rows]
        text = self.one("\n", "\r\n").join(lines) + self.one("", "\n")
        path.write_bytes(
            text.encode(self.one("utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-16-le"))
        )


def tracks(rng: np.random.Generator, frames: int) -> Floats:
    """Tracks [P, F, 2] of which some positions are not seen, but each track somewhere."""
    found = (
        rng.uniform(20, 600, (14, 1, 2))
        + rng.uniform(-6, 6, (14, 1, 2)) * np.arange(frames)[None, :, None]
    )
    found[rng.random(found.shape[:2]) < 0.1] = np.nan
    found[:, 0] = np.nan_to_num(found[:, 0], nan=50.0)
    return np.round(found, 3)


@pytest.mark.parametrize("seed", range(120))
def test_positions_one_per_line(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(seed)
    dialect, points = Dialect(rng), tracks(rng, 5)
    x, y = dialect.one(*PLACE.split("|")).split(",")
    names = [dialect.one(*TRACK.split("|")), dialect.one(*FRAME.split("|")), x, y]
    frame, identifier = FRAMES[rng.integers(len(FRAMES))], IDS[rng.integers(len(IDS))]
    cells = [
        [identifier(p), frame(f), *map(dialect.number, points[p, f])]
        for p in range(len(points))
        for f in range(points.shape[1])
    ]
    extra = rng.integers(3)
    order = rng.permutation(4 + extra)
    names += ["quality", "note"][:extra]
    cells = [[*row, *["7", "ok"][:extra]] for row in cells]
    table = [[row[i] for i in order] for row in [names, *cells]]
    dialect.write(tmp_path / "t.csv", table)
    np.testing.assert_allclose(datasets.read(tmp_path / "t.csv").tracks.points, points, atol=1e-9)


@pytest.mark.parametrize("seed", range(120))
def test_tracks_one_per_line(seed: int, tmp_path: Path) -> None:
    rng = np.random.default_rng([1, seed])
    dialect = Dialect(rng)
    if rng.random() < 0.7:
        points, names = tracks(rng, 2), dialect.one(*VIEWS.split("|")).split(",")
    else:
        points = tracks(rng, 6)
        names = [f"{axis}{view}" for view in range(1, 7) for axis in "xy"]
    cells = [list(map(dialect.number, row)) for row in points.reshape(len(points), -1)]
    if rng.random() < 0.3:
        names, cells = ["id", *names], [[str(p), *row] for p, row in enumerate(cells)]
    if rng.random() < 0.3:
        names, cells = [*names, "score"], [[*row, dialect.number(0.9)] for row in cells]
    has_names = "id" in names or "score" in names or rng.random() < 0.8
    dialect.write(tmp_path / "t.txt", [names, *cells] if has_names else cells)
    np.testing.assert_allclose(datasets.read(tmp_path / "t.txt").tracks.points, points, atol=1e-9)
