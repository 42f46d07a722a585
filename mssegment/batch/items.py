"""The items of a batch: what each one runs, and the name of its folder."""

from __future__ import annotations

import glob
import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from mssegment.batch.manifest import is_manifest, read_manifest
from mssegment.configuration import Configuration, Setting, resolve
from mssegment.configuration.files import read_settings
from mssegment.errors import ConfigurationError, DataError
from mssegment.imaging.frames import is_moving
from mssegment.imaging.pictures import MOTION_JPEG_SUFFIXES, PICTURE_SUFFIXES
from mssegment.imaging.sources import natural_key
from mssegment.records import Record
from mssegment.runs import are_tracks

VIDEOS = (
    *(".mp4", ".avi", ".mov", ".mkv", ".webm", ".m4v", ".mpg", ".mpeg", ".gif", ".wmv", ".mts"),
    *MOTION_JPEG_SUFFIXES,
)
TRACKS = (".csv", ".tsv", ".mat", ".npy", ".npz", ".h5", ".hdf5", ".db")
"""What counts as a clip or a file of tracks in a folder; files named one by one may be others."""
DEEPEST = 4
"""Names that are equal get those of at most three folders above their files, then numbers."""
LONGEST_NAME = 100
"""Characters of the name of an item, which is that of a folder."""


class Item(Record, frozen=True):
    """One run of a batch.

    Attributes
    ----------
    name : str
        Its name, and that of its folder.
    origin : str
        Where it comes from: a file, or a row of a manifest.
    configuration : Configuration
        All settings.
    """

    name: str
    origin: str
    configuration: Configuration


class Row(Record, frozen=True):
    """Settings of one item before they are combined with those of the batch."""

    name: str | None
    origin: str
    settings: list[Setting]


def items_of(
    inputs: Sequence[str], below: Sequence[Setting] = (), above: Sequence[Setting] = ()
) -> list[Item]:
    """The items that the inputs name.

    Parameters
    ----------
    inputs : sequence of str
        Manifests (CSV, TSV, YAML, JSON Lines), videos, files of tracks, folders of pictures or of
        clips, configuration files, and patterns of them.
    below : sequence of Setting
        Settings of all items, which those of a row override.
    above : sequence of Setting
        Settings of all items, which override those of a row.

    Returns
    -------
    list of Item
        In the order of the inputs; each name is unique.

    Raises
    ------
    ConfigurationError
        If a setting is unknown or invalid, or two rows have the same name.
    DataError
        If an input does not exist or is nothing that can be segmented alone.
    """
    rows = [row for given in inputs for row in _rows(given)]
    if not rows:
        raise DataError(f"{', '.join(inputs)}: no clip, no pair and no file of tracks in it")
    resolved = [resolve([*below, *row.settings, *above]) for row in rows]
    for row, configuration in zip(rows, resolved, strict=True):
        if not configuration.input.images and configuration.input.tracks is None:
            raise ConfigurationError(f"{row.origin}: names neither images nor tracks")
        if configuration.input.tracks == "-":
            raise ConfigurationError(f"{row.origin}: standard input cannot be an item of a batch")
    names = _names(rows, resolved)
    return [
        Item(name, row.origin, configuration)
        for name, row, configuration in zip(names, rows, resolved, strict=True)
    ]


def _rows(given: str) -> list[Row]:
    """The items that one input names."""
    if os.path.isdir(given):
        return _folder(given)
    if not os.path.exists(given.rpartition("#")[0] or given) and glob.has_magic(given):
        found = sorted(glob.glob(given, recursive=True), key=natural_key)
        if not found:
            raise DataError(f"{given}: nothing matches this pattern; check it")
        return [row for path in found for row in _rows(path)]
    if is_manifest(given):
        return [Row(*row) for row in read_manifest(given)]
    if given.lower().endswith((".yaml", ".yml")):
        return [Row(Path(given).stem, given, read_settings(given))]
    if given != "-" and not (os.path.exists(given) or os.path.exists(given.rpartition("#")[0])):
        raise DataError(f"{given}: no such file; check the name")
    if are_tracks(given):
        return [_row(given, "input.tracks", given)]
    if not is_moving(given):
        raise DataError(
            f"{given}: a single picture; name its folder to segment it as a sequence, or write a "
            "manifest with a row for each pair"
        )
    return [_row(given, "input.images", [given])]


def _row(origin: str, key: str, value: object) -> Row:
    return Row(None, origin, [Setting(key, value, origin)])


def _folder(given: str) -> list[Row]:
    """The clips, files of tracks and folders of pictures in a folder, or its own pictures."""
    rows = []
    names = sorted((n for n in os.listdir(given) if not n.startswith(".")), key=natural_key)
    for name in names:
        path = os.path.join(given, name)
        if os.path.isdir(path):
            if _has_pictures(path):
                rows.append(_row(path, "input.images", [path]))
        elif name.lower().endswith(VIDEOS):
            rows.append(_row(path, "input.images", [path]))
        elif name.lower().endswith(TRACKS):
            rows.append(_row(path, "input.tracks", path))
    if not rows and _has_pictures(given):
        return [_row(given, "input.images", [given])]
    if not rows:
        raise DataError(
            f"{given}: found no videos, files of tracks or folders of pictures in it; name them by "
            f"a pattern, such as '{given}/*/*.mat'"
        )
    return rows


def _has_pictures(folder: str) -> bool:
    return any(name.lower().endswith(tuple(PICTURE_SUFFIXES)) for name in os.listdir(folder))


def _names(rows: Sequence[Row], resolved: Sequence[Configuration]) -> list[str]:
    """The name of each item: as given, or from its files, with as many folders as it takes."""
    for row in rows:
        if row.name is not None and _safe(row.name) != row.name:
            raise ConfigurationError(
                f"{row.origin}: the name {row.name!r} cannot be that of a folder; expected at most "
                f"{LONGEST_NAME} letters, digits, -, _ and ."
            )
    given = Counter(row.name.casefold() for row in rows if row.name is not None)
    for row in rows:
        if row.name is not None and given[row.name.casefold()] > 1:
            raise ConfigurationError(f"{row.origin}: another item is named {row.name} too")
    names = [row.name or _from_files(c, 0) for row, c in zip(rows, resolved, strict=True)]
    for same in {name.casefold() for name in names}:
        group = [i for i, n in enumerate(names) if n.casefold() == same and rows[i].name is None]
        longer = [[_from_files(resolved[i], depth) for i in group] for depth in range(DEEPEST)]
        # the first of the most distinct ones
        best = max(longer, key=lambda found: len({name.casefold() for name in found}))
        for i, name in zip(group, best, strict=True):
            names[i] = name
    return _numbered(names, {row.name for row in rows if row.name is not None})


def _numbered(names: Sequence[str], given: set[str]) -> list[str]:
    """The names with a number where one is there already."""
    taken = {name.casefold() for name in given}
    unique = []
    for name in names:
        own, number = name, 1
        while name not in given and own.casefold() in taken:
            number += 1
            own = f"{name}-{number}"
        taken.add(own.casefold())
        unique.append(own)
    return unique


def _from_files(configuration: Configuration, depth: int) -> str:
    """A name from the files of an item and that many of the folders above them."""
    read = configuration.input
    paths = [read.tracks] if read.tracks is not None else [*read.images[:1], *read.images[1:][-1:]]
    parts = [_stem(paths[0], depth), *(_stem(path, 0) for path in paths[1:])]
    return _safe("-".join(dict.fromkeys(parts))) or "item"


def _stem(path: str, depth: int) -> str:
    name, _, part = (
        path.rpartition("#") if "#" in path and not Path(path).exists() else (path, "", "")
    )
    parts = [p for p in Path(os.path.normpath(name)).with_suffix("").parts if p not in ("/", "..")]
    return "-".join([*parts[-1 - depth :], *([part] if part else [])])


def _safe(name: str) -> str:
    """The name with letters, digits, ``-``, ``_`` and ``.`` only, and not hidden."""
    return re.sub(r"[^\w.-]+", "_", name).lstrip(".")[:LONGEST_NAME]
