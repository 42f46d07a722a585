"""Matches of two images from a COLMAP database."""

from __future__ import annotations

import os
import sqlite3
import tempfile
from typing import Any

import numpy as np

from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.image_pairs import chosen_pair
from mssegment.datasets.keypoints import matched, pairs_of
from mssegment.errors import DataError
from mssegment.records import Floats

_LARGEST_ID = 2147483647
"""COLMAP's pair_id is image_id1 * 2147483647 + image_id2."""
_CENTRE = 0.5
"""COLMAP's centre of the first pixel."""


def load_database(file: InputFile) -> Variables:
    """The names of images by their identifier, and the rows of keypoints and matches.

    Raises DataError if the database is damaged or is none of COLMAP.
    """
    connection = sqlite3.connect(":memory:")
    try:
        with tempfile.TemporaryDirectory(prefix="mssegment-") as folder:
            # a copy: SQLite writes beside the file that it reads
            copy = os.path.join(folder, "database.db")
            with open(copy, "wb") as out:
                out.write(file.content)
            source = sqlite3.connect(copy)
            source.execute("pragma trusted_schema = off")
            try:
                source.backup(connection)
            finally:
                source.close()
        connection.execute("pragma trusted_schema = off")
        # no views: a query on one may run for ever
        named = connection.execute("select name from sqlite_master where type = 'table'")
        tables = {str(row[0]) for row in named}
        if not {"images", "keypoints", "matches"} <= tables:
            raise DataError(
                f"{file.name}: a database with {', '.join(sorted(tables)) or 'no tables'}; "
                "expected one of COLMAP (images, keypoints, matches)"
            )
        return {
            "images": dict(connection.execute("select image_id, name from images")),
            "pairs": _pairs(connection, tables),
            "connection": connection,
        }
    except (sqlite3.Error, ValueError, TypeError, OverflowError, MemoryError) as error:
        raise DataError(f"{file.name}: a damaged database ({error}); copy it again") from None


def _pairs(connection: sqlite3.Connection, tables: set[str]) -> dict[int, tuple[str, int]]:
    """The table and the number of matches of each pair; raw matches where there are some."""
    found: dict[int, tuple[str, int]] = {}
    for table in ("two_view_geometries", "matches"):
        if table in tables:
            rows = connection.execute(f"select pair_id, rows from {table} where rows > 0")
            found |= {pair: (table, rows) for pair, rows in rows}
    return found


def recognises(content: Variables) -> bool:
    """Whether the content is that of a COLMAP database."""
    return {"images", "pairs", "connection"} <= set(content)


def read(file: InputFile) -> ImportedTracks:
    """Read the matches of one pair of images, ``FILE#FIRST,SECOND`` where there are several.

    Raw matches are preferred: verified ones (two_view_geometries) have lost what moves by itself.
    Pixel centres, which COLMAP counts from 0.5, are moved to whole numbers.

    Raises DataError if the pair must be chosen, or the rows are damaged.
    """
    names, pairs = file.variables["images"], file.variables["pairs"]
    numbers = {str(name): [str(number)] for number, name in names.items()}
    by_name = {
        (str(names.get(_images(pair)[0], "?")), str(names.get(_images(pair)[1], "?"))): pair
        for pair in sorted(pairs, key=lambda pair: -pairs[pair][1])
    }
    if not by_name:
        raise DataError(f"{file.name}: the database has no matches; run COLMAP's matcher first")
    chosen, pair, is_reversed = chosen_pair(by_name, file, numbers)
    connection: sqlite3.Connection = file.variables["connection"]
    places = [_keypoints(connection, image, file) for image in _images(pair)]
    table = pairs[pair][0]
    query = f"select data, rows, cols from {table} where pair_id = ?"
    matches = _matrix(connection.execute(query, (pair,)).fetchone(), np.uint32, file)
    found = pairs_of(matches, len(places[0]), len(places[1]), f"{file.name}: {table}")
    points = np.stack([places[0][found[:, 0]], places[1][found[:, 1]]], axis=1)
    if is_reversed:
        points, found, chosen = points[:, ::-1], found[:, ::-1], chosen[::-1]
    return matched(points, found, file, f"COLMAP: {','.join(chosen)}, table {table}")


def _images(pair: int) -> tuple[int, int]:
    return pair // _LARGEST_ID, pair % _LARGEST_ID


def _keypoints(connection: sqlite3.Connection, image: int, file: InputFile) -> Floats:
    query = "select data, rows, cols from keypoints where image_id = ?"
    row = connection.execute(query, (image,)).fetchone()
    if row is None:
        raise DataError(f"{file.name}: image {image} has matches but no keypoints")
    return np.asarray(_matrix(row, np.float32, file)[:, :2], dtype=np.float64) - _CENTRE


def _matrix(row: Any, kind: type[np.generic], file: InputFile) -> Any:
    data, rows, columns = row
    item = np.dtype(kind).newbyteorder("<")
    length = len(data) if isinstance(data, bytes) else 0
    are_whole = isinstance(rows, int) and isinstance(columns, int)
    if not are_whole or columns < 2 or length != rows * columns * item.itemsize:
        raise DataError(f"{file.name}: a damaged row ({length} bytes for {rows}x{columns} numbers)")
    return np.frombuffer(data or b"", dtype=item).reshape(rows, columns)


COLMAP = DataSet(
    "colmap", "matches of two images in a COLMAP database", ("database",), recognises, read
)
