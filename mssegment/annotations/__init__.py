"""Labels of pixels in files: mask images, and the shapes of labelling tools (``registry.py``)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from mssegment.annotations.base import (
    TEXTS,
    Annotations,
    LabelledFrame,
    ShapeFormat,
    Tree,
    load_tree,
    numbered,
)
from mssegment.annotations.masks import read_masks
from mssegment.annotations.placing import frames_of, scaled
from mssegment.errors import DataError
from mssegment.imaging.pictures import PICTURE_SUFFIXES
from mssegment.imaging.sources import expand, natural_key
from mssegment.records import Frame
from mssegment.registry import ANNOTATIONS

__all__ = [
    "Annotations",
    "LabelledFrame",
    "frames_of",
    "holds_shapes",
    "read_annotations",
    "scaled",
]

_TREES = (".json", ".xml")
_NO_LABELS = ("classes.txt", "labels.txt", "notes.json")
"""Files beside labels that hold the names of classes."""


def read_annotations(paths: Sequence[str], frames: Sequence[Frame] = ()) -> Annotations:
    """Read mask images, or files of labelling tools.

    Parameters
    ----------
    paths : sequence of str
        Files, patterns, or folders of them, as in DAVIS.
    frames : sequence of Frame
        The frames that are labelled: some tools do not write the size of the pictures. Without
        frames these files are only checked.

    Returns
    -------
    Annotations

    Raises
    ------
    DataError
        If a file cannot be read, has no known format, or files of both kinds are mixed.
    """
    files: list[str] = []
    for path in paths:
        files += _files(path)
    trees = [path for path in files if Path(path).suffix.lower() in (*_TREES, *TEXTS)]
    if trees and len(trees) < len(files):
        other = next(path for path in files if path not in trees)
        raise DataError(f"{trees[0]} and {other}: expected mask images or shapes, not both")
    return _read_shapes(trees, frames) if trees else read_masks(files)


def holds_shapes(path: str) -> bool:
    """Whether a file of text has the shapes of a labelling tool, rather than a table of points."""
    try:
        tree = load_tree(path)
    except DataError:
        return False  # its reader says what is wrong
    return any(form.recognises(tree) for form in ANNOTATIONS.values())


def _files(given: str) -> list[str]:
    """The files that an argument names; of a folder its pictures, or else its JSON and XML."""
    if os.path.isdir(given):
        inside = sorted((str(path) for path in Path(given).iterdir()), key=natural_key)
        for suffixes in (PICTURE_SUFFIXES, _TREES, TEXTS):
            found = [path for path in inside if Path(path).suffix.lower() in suffixes]
            found = [path for path in found if Path(path).name not in _NO_LABELS]
            if found:
                return found
        folders = [Path(path).name for path in inside if Path(path).is_dir()]
        hint = f"; name one of its folders ({', '.join(folders[:4])})" if folders else ""
        raise DataError(f"{given}: no masks in this folder{hint}")
    return expand(given)[0]


def _read_shapes(paths: Sequence[str], frames: Sequence[Frame]) -> Annotations:
    shaped, notes = [], []
    for path in paths:
        tree = load_tree(path)
        if isinstance(tree, str) and not tree.strip():
            continue  # YOLO writes an empty file for a picture without objects
        found, own = _format_of(path, tree).read(tree, path)
        shaped += found
        notes += own
    sizes = {Path(f.path).stem: (f.width, f.height) for f in frames if f.index is None}
    first = (frames[0].width, frames[0].height) if frames else (1, 1)
    return numbered(shaped, notes, paths, lambda name: sizes.get(Path(name).stem, first))


def _format_of(path: str, tree: Tree) -> ShapeFormat:
    form: ShapeFormat
    for form in ANNOTATIONS.values():
        if form.recognises(tree):
            return form
    titles = ", ".join(form.title for form in ANNOTATIONS.values())
    raise DataError(f"{path}: no labels in this file; expected {titles}, or mask images")
