"""Labels of pixels in files: mask images, and the shapes of labelling tools (``registry.py``)."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from mssegment.annotations.base import (
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
from mssegment.registry import ANNOTATIONS

__all__ = ["Annotations", "LabelledFrame", "frames_of", "read_annotations", "scaled"]

_TREES = (".json", ".xml")


def read_annotations(paths: Sequence[str]) -> Annotations:
    """Read mask images, or files of labelme, COCO or CVAT.

    Parameters
    ----------
    paths : sequence of str
        Files, patterns, or folders of them, as in DAVIS.

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
    trees = [path for path in files if Path(path).suffix.lower() in _TREES]
    if trees and len(trees) < len(files):
        other = next(path for path in files if path not in trees)
        raise DataError(f"{trees[0]} and {other}: expected mask images or shapes, not both")
    return _read_shapes(trees) if trees else read_masks(files)


def _files(given: str) -> list[str]:
    """The files that an argument names; of a folder its pictures, or else its JSON and XML."""
    if os.path.isdir(given):
        inside = sorted((str(path) for path in Path(given).iterdir()), key=natural_key)
        for suffixes in (PICTURE_SUFFIXES, _TREES):
            found = [path for path in inside if Path(path).suffix.lower() in suffixes]
            if found:
                return found
        folders = [Path(path).name for path in inside if Path(path).is_dir()]
        hint = f"; name one of its folders ({', '.join(folders[:4])})" if folders else ""
        raise DataError(f"{given}: no masks in this folder{hint}")
    return expand(given)[0]


def _read_shapes(paths: Sequence[str]) -> Annotations:
    frames, notes = [], []
    for path in paths:
        found, own = _format_of(path, tree := load_tree(path)).read(tree, path)
        frames += found
        notes += own
    return numbered(frames, notes, paths)


def _format_of(path: str, tree: Tree) -> ShapeFormat:
    form: ShapeFormat
    for form in ANNOTATIONS.values():
        if form.recognises(tree):
            return form
    titles = ", ".join(form.title for form in ANNOTATIONS.values())
    raise DataError(f"{path}: no labels in this file; expected {titles}, or mask images")
