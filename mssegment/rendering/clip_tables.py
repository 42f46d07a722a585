"""The tables of a long clip: its objects, and from which frame to which each is seen."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

from mssegment.documents.clips import ClipDocument, ClipObject, encode_json
from mssegment.rendering.style import label_style
from mssegment.rendering.tables import Table, format_table


def format_clip(document: ClipDocument, form: str) -> str:
    """The table of a clip in a format of ``tables.FORMATS``; JSON is the whole document."""
    if form == "json":
        return encode_json(document).decode() + "\n"
    table = format_table(objects_table(document, plain=form in ("csv", "latex")), form)
    if form != "text":
        return table
    return f"{table}{clip_summary(document)}\n"


def objects_table(document: ClipDocument, *, plain: bool = False) -> Table:
    """One row per object: when it moves and stands still, its tracks, where it comes from."""
    rows = []
    for one in document.whole_objects:
        name = "camera" if one.identity == 0 else str(one.identity)
        if not plain and one.identity:
            name += f" {label_style(one.identity).glyph}"
        rows.append(
            (name, periods(one.moving), periods(one.resting), str(one.tracks), remarks(one))
        )
    return Table("Objects", ("object", "moves", "rests", "tracks", "remarks"), tuple(rows))


def periods(frames: Sequence[tuple[int, int]]) -> str:
    """Periods of frames, as ``0-41, 60-99``; ``-`` without one."""
    return ", ".join(f"{first}-{last}" for first, last in frames) or "-"


def remarks(one: ClipObject) -> str:
    """Where an object comes from and where it goes, in words."""
    said = []
    if one.origin is not None:
        said.append(f"split from {one.origin}")
    if one.merged_into is not None:
        said.append(f"merged into {one.merged_into or 'the static world'}")
    return ", ".join(said) or "-"


def clip_summary(document: ClipDocument) -> str:
    """What was found, in a sentence."""
    moving = sum(one.identity > 0 for one in document.whole_objects)
    windows = len(document.windows)
    return (
        f"{moving} object{'s' * (moving != 1)} in {document.frames} frames, {windows} "
        f"window{'s' * (windows != 1)}; {camera_sentence(document)}"
    )


def camera_sentence(document: ClipDocument) -> str:
    """Whether the camera moves, and when."""
    runs = [(camera, list(own)) for camera, own in groupby(enumerate(document.cameras), _camera)]
    if len(runs) == 1:
        return "the camera is static" if runs[0][0] == "static" else "the camera moves"
    spans = [
        f"{document.windows[own[0][0]][0]}-{document.windows[own[-1][0]][1] - 1}"
        for camera, own in runs
        if camera == "moving"
    ]
    return f"the camera moves in frames {', '.join(spans)}, otherwise it is static"


def _camera(item: tuple[int, str]) -> str:
    return item[1]
