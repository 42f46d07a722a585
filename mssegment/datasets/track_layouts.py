"""Texts with the positions in blocks, track by track or frame by frame, and COLMAP's models.

References
----------
T. Brox and J. Malik, "Object segmentation by long term analysis of point trajectories", ECCV 2010:
the tracks of the data sets BMS-26 and FBMS-59.
"""

from __future__ import annotations

import re
from collections.abc import Callable

from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.colmap_model import read_binary_images, read_images
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.layouts import HEAD, layout_of
from mssegment.datasets.sightings import read_sightings
from mssegment.datasets.tables import Table
from mssegment.errors import DataError
from mssegment.inputs import limits
from mssegment.inputs.encodings import text_of
from mssegment.records import replace

_CELL = re.compile(r"\( *([^,() ]{1,40}) *, *([^,() ]{1,40}) *\) *= *(-?\d{1,12})")
"""A position in KLT's table, and its value."""


def recognises(content: Variables) -> bool:
    """Whether a file has one of the layouts, which its container has found out already."""
    return not content


def read(file: InputFile) -> ImportedTracks:
    """Read the positions; raises DataError, with the line, for a damaged file."""
    if b"\0" in file.content[:64]:
        return read_binary_images(file)
    text = text_of(file.content, file.name)
    limits.check("text_bytes", len(text), file.name)
    layout = layout_of(text[:HEAD])
    if layout == "colmap_images":
        return read_images(text, file)
    if layout in _REFUSED:
        raise DataError(f"{file.name}: {_REFUSED[layout]}")
    rows, note = _READERS[layout](text.lstrip("\ufeff").splitlines(), file.name)
    if not rows.lines:
        raise DataError(f"{file.name}: no positions in this file; expected one track or more")
    found = read_sightings(Table(file.name, rows.columns, rows.lines), file)
    return replace(found, notes=(note, *found.notes), is_upwards=layout == "equalizer")


class _Rows:
    """Columns of a table with one position of a track per row, and the line of each."""

    def __init__(self, *more: str) -> None:
        self.columns: dict[str, list[str]] = {n: [] for n in ("track", "frame", "x", "y", *more)}
        self.lines: list[int] = []

    def add(self, line: int, *values: object) -> None:
        """Add a row."""
        self.lines.append(line)
        for cells, value in zip(self.columns.values(), values, strict=True):
            cells.append(str(value))


class _Words:
    """The words of a text one after the other, with their lines for errors."""

    def __init__(self, lines: list[str], name: str) -> None:
        self.name = name
        self._words = ((i, word) for i, line in enumerate(lines, 1) for word in line.split())
        self.line = 0

    def next(self, expected: str) -> str:
        """The next word; raises DataError at the end of the text."""
        found = next(self._words, None)
        if found is None:
            raise DataError(f"{self.name}: ends where {expected} should stand; copy it again")
        self.line, word = found
        return word

    def count(self, expected: str) -> int:
        """The next word as a whole number from 0; raises DataError if it is none."""
        word = self.next(expected)
        if not re.fullmatch(r"\d{1,9}", word):
            raise DataError(f"{self.name}: line {self.line}: '{word}'; expected {expected}")
        return int(word)


def _brox(lines: list[str], name: str) -> tuple[_Rows, str]:
    """Numbers of frames and tracks, then for each track a label, a length, and lines x y frame."""
    words, rows = _Words(lines, name), _Rows("label")
    frames = words.count("the number of frames")
    tracks = words.count("the number of tracks")
    for track in range(tracks):
        label = words.next(f"the label of track {track + 1} of {tracks}")
        for _ in range(words.count("the length of a track")):
            x, y, frame = (
                words.next(f"{axis} of track {track + 1}") for axis in ("x", "y", "frame")
            )
            rows.add(words.line, track, frame, x, y, label)
    if len(set(rows.columns["label"])) == 1:
        del rows.columns["label"]  # written by a tracker, which knows no labels
    return rows, f"dense point trajectories (Brox): {tracks} tracks in {frames} frames"


def _equalizer(lines: list[str], name: str) -> tuple[_Rows, str]:
    """A number of points, and for each a name, a colour, a length, and lines frame x y."""
    rows = _Rows()
    left = iter([(i, line.strip()) for i, line in enumerate(lines, 1) if line.strip()])

    def line(expected: str) -> tuple[int, str]:
        found = next(left, None)
        if found is None:
            raise DataError(f"{name}: ends where {expected} should stand; export it again")
        return found

    def count(expected: str) -> int:
        number, text = line(expected)
        if not re.fullmatch(r"\d{1,9}", text):
            raise DataError(f"{name}: line {number}: '{text}'; expected {expected}")
        return int(text)

    for place in range(count("the number of points")):
        _, point = line(f"the name of point {place + 1}")
        count("a colour")
        for _ in range(count("a number of frames")):
            number, text = line("frame x y")
            words = text.split()
            if len(words) != 3:
                raise DataError(f"{name}: line {number}: '{text}'; expected frame x y")
            rows.add(number, f"{place + 1} {point}", *words)
    return rows, "2-D tracks of 3DEqualizer"


def _mtrackj(lines: list[str], name: str) -> tuple[_Rows, str]:
    """Lines ``Track number``, and below each ``Point number x y z t channel``."""
    rows, track = _Rows(), 0
    for number, line in enumerate(lines, 1):
        words = line.split()
        if words[:1] == ["Track"]:
            track += 1
        elif words[:1] == ["Point"]:
            if len(words) < 6:
                raise DataError(f"{name}: line {number}: expected Point number x y z t")
            rows.add(number, track, words[5], words[2], words[3])
    return rows, "tracks of MTrackJ"


def _after_effects(lines: list[str], name: str) -> tuple[_Rows, str]:
    """Blocks of a name, a line ``Frame X pixels Y pixels``, and lines frame x y."""
    rows, point, is_position = _Rows(), "", False
    for number, line in enumerate(lines, 1):
        words = [word.strip() for word in line.split("\t") if word.strip()]
        if line.strip() and not line.startswith("\t"):
            point, is_position = " ".join(words), False
        elif words[:1] == ["Frame"]:
            is_position = words[1:3] in (["X pixels", "Y pixels"], ["X", "Y"])
        elif is_position and words:
            if len(words) < 3:
                raise DataError(f"{name}: line {number}: expected frame, x, y")
            rows.add(number, point, *words[:3])
    return rows, "keyframe data of After Effects: each animated position is a track"


def _klt(lines: list[str], name: str) -> tuple[_Rows, str]:
    """Lines ``feature | (x, y)=value (x, y)=value ...``; a value below 0 is a lost feature."""
    rows = _Rows()
    for number, line in enumerate(lines, 1):
        row = re.match(r"\s*(\d+)\s*\|(.*)", line)
        if row is None:
            continue
        for frame, (x, y, value) in enumerate(_CELL.findall(row[2])):
            if int(value) >= 0:
                rows.add(number, row[1], frame, x, y)
    return rows, "feature table of KLT"


_READERS: dict[str, Callable[[list[str], str], tuple[_Rows, str]]] = {
    "brox": _brox,
    "equalizer": _equalizer,
    "mtrackj": _mtrackj,
    "after_effects": _after_effects,
    "klt": _klt,
}
_REFUSED = {
    "colmap_points": "3-D points of COLMAP, without their pictures; give images.txt, or "
    "database.db for the matches of a pair",
    "colmap_matches": "indices of matches for COLMAP, without their keypoints; give the database",
    "nuke": "a script of Nuke, which is not read; export the tracker as text, or its tracks as CSV",
    "mots": "masks of KITTI MOTS, which are no tracks of points; give the boxes, or the masks as "
    "--labels",
}
"""Layouts that are known and not read."""


TRACK_LAYOUTS = DataSet(
    "track_layouts",
    "tracks in blocks: Brox's trajectories (BMS-26, FBMS-59), KLT's feature table, MTrackJ, "
    "3DEqualizer, After Effects, COLMAP's images.txt and images.bin",
    ("layout",),
    recognises,
    read,
)
