"""Manifests: CSV, TSV, YAML or JSON Lines with a row for each item.

A row has keys of the configuration, such as ``input.images`` or ``segment.motions``, and ``name``,
the name of the item. ``images``, ``tracks``, ``labels`` and ``camera`` are short for the keys of
that meaning, and ``image1``, ``image2``, ... for the images one by one. In a CSV file, several
images in one cell are separated by ``;``, and an empty cell sets nothing. Relative paths are
relative to the folder of the manifest.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import msgspec

from mssegment.configuration import KEYS, Setting
from mssegment.configuration.files import relative_to, value_of
from mssegment.configuration.settings import check_key
from mssegment.documents import read_bytes
from mssegment.errors import ConfigurationError, DataError

SHORT = {
    "images": "input.images",
    "tracks": "input.tracks",
    "labels": "report.labels",
    "camera": "camera.file",
}
NAME = "name"
_IMAGE = re.compile(r"image_?(\d+)")
_SEVERAL = ("input.images", "report.labels", "report.export")
_TABLES = {".csv": ",", ".tsv": "\t"}
_LINES = (".jsonl", ".ndjson")

ManifestRow = tuple[str | None, str, list[Setting]]
"""Name, origin and settings."""


def is_manifest(path: str) -> bool:
    """Whether a file is a manifest: by its suffix, and a table by the names of its columns."""
    suffix = Path(path).suffix.lower()
    if suffix in _LINES:
        return True
    if not Path(path).is_file():
        return False
    if suffix in (".yaml", ".yml"):
        return _text(path).lstrip().startswith(("-", "[")) or _starts_with_list(path)
    if suffix in _TABLES:
        with Path(path).open("rb") as file:
            head = file.readline(100_000).decode("utf-8-sig", "replace")
        try:
            cells = next(csv.reader([head], delimiter=_TABLES[suffix]))
        except csv.Error:
            return False
        return any(_is_column(cell) for cell in cells)
    return False


def read_manifest(path: str) -> list[ManifestRow]:
    """The name, the origin and the settings of each row.

    Raises
    ------
    DataError
        If the file cannot be read.
    ConfigurationError
        If it is no manifest, or a row has an unknown key.
    """
    suffix = Path(path).suffix.lower()
    if suffix in _TABLES:
        rows = _table(path, _TABLES[suffix])
    elif suffix in _LINES:
        rows = _json_lines(path)
    else:
        rows = _yaml(path)
    found = [_read_row(row, origin, Path(path).parent) for origin, row in rows]
    if not found:
        raise ConfigurationError(f"{path}: no rows; expected one for each item")
    return found


def _is_column(cell: str) -> bool:
    cell = cell.strip()
    return (
        cell == NAME or cell in SHORT or ("." in cell and cell in KEYS) or cell.startswith("image")
    )


def _text(path: str) -> str:
    try:
        return read_bytes(path).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise DataError(f"{path}: not UTF-8; save it in this encoding") from None


def _starts_with_list(path: str) -> bool:
    """Whether the first line that is not a comment begins a list."""
    lines = (line.strip() for line in _text(path).splitlines())
    first = next((line for line in lines if line and not line.startswith(("#", "%", "---"))), "")
    return first.startswith(("-", "["))


def _table(path: str, delimiter: str) -> Iterator[tuple[str, dict[str, Any]]]:
    try:
        lines = list(csv.reader(io.StringIO(_text(path), newline=""), delimiter=delimiter))
    except csv.Error as error:
        raise DataError(f"{path}: not a table ({error})") from None
    header = [cell.strip() for cell in lines[0]]
    double = next((cell for cell in header if header.count(cell) > 1), None)
    if double is not None:
        raise ConfigurationError(f"{path}:1: two columns are named {double!r}")
    for number, cells in enumerate(lines[1:], 2):
        if not any(cell.strip() for cell in cells):
            continue
        origin = f"{path}:{number}"
        if len(cells) > len(header):
            raise ConfigurationError(
                f"{origin}: {len(cells)} cells, expected {len(header)} as in the first line"
            )
        row = {key: cell.strip() for key, cell in zip(header, cells, strict=False) if cell.strip()}
        yield origin, {key: _cell(key, cell, origin) for key, cell in row.items()}


def _cell(key: str, text: str, origin: str) -> Any:
    full = SHORT.get(key, key)
    if full in _SEVERAL:
        return [part.strip() for part in text.split(";") if part.strip()]
    if key == NAME or _IMAGE.fullmatch(key) or full in ("input.tracks", "camera.file"):
        return text
    return value_of(text, f"{origin}: {key}")


def _json_lines(path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for number, line in enumerate(_text(path).splitlines(), 1):
        if line.strip():
            try:
                yield f"{path}:{number}", msgspec.json.decode(line, type=dict[str, Any])
            except msgspec.DecodeError as error:
                raise ConfigurationError(
                    f"{path}:{number}: {error}; expected a JSON object"
                ) from None


def _yaml(path: str) -> Iterator[tuple[str, dict[str, Any]]]:
    rows = value_of(_text(path), path)
    for number, row in enumerate(rows, 1):
        origin = f"{path}: item {number}"
        if not isinstance(row, dict):
            raise ConfigurationError(f"{origin}: expected keys, such as `images: [a.png, b.png]`")
        yield origin, row


def _read_row(row: Mapping[Any, Any], origin: str, folder: Path) -> ManifestRow:
    """The name and the settings of a row, with paths that are relative to the folder."""
    values: dict[str, Any] = {}
    images: dict[int, Any] = {}
    for key, value in _flat(row):
        image = _IMAGE.fullmatch(key)
        if image:
            images[int(image[1])] = value
            continue
        full = SHORT.get(key, key)
        if full in values:
            raise ConfigurationError(f"{origin}: {full} is set twice; remove one of them")
        values[full] = value
    if images and "input.images" in values:
        raise ConfigurationError(f"{origin}: has images and image{min(images)}; keep one of them")
    if images:
        values["input.images"] = [images[number] for number in sorted(images)]
    name = values.pop(NAME, None)
    settings = []
    for key, value in values.items():
        check_key(key, origin)
        settings.append(relative_to(folder, Setting(key, value, origin)))
    return None if name is None else str(name), origin, settings


def _flat(row: Mapping[Any, Any], section: str = "") -> Iterator[tuple[str, Any]]:
    """The values by dotted key; sections may be nested, as in a configuration file."""
    for key, value in row.items():
        name = f"{section}{key}"
        if isinstance(value, dict) and any(known.startswith(f"{name}.") for known in KEYS):
            yield from _flat(value, f"{name}.")
        else:
            yield name, value
