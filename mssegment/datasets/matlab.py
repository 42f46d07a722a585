"""Matlab files as a mapping of variables, with errors that say what is wrong with the file."""

from __future__ import annotations

import io
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from mssegment.datasets.base import Variables
from mssegment.errors import DataError
from mssegment.records import Floats


def load_matlab(path: Path) -> Variables:
    """The variables of a Matlab file (version 4 to 7.2)."""
    import scipy.io  # slow to load, and most commands read no Matlab file

    try:
        raw = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        _check_checksums(raw)
        content: dict[str, Any] = scipy.io.loadmat(io.BytesIO(raw))
    except NotImplementedError as error:
        raise DataError(
            f"{path}: a Matlab 7.3 file (HDF5); save it with -v7 and try again"
        ) from error
    except Exception as error:  # scipy raises whatever its parser stumbles on
        raise DataError(
            f"{path}: not a readable Matlab file ({type(error).__name__}: {error}); "
            "expected the .mat file as published"
        ) from error
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _check_checksums(raw: bytes) -> None:
    """Unpack every compressed element once: scipy's parser crashes the process on damaged ones."""
    if raw[126:128] not in (b"IM", b"MI"):
        return
    order = "<" if raw[126:128] == b"IM" else ">"
    start, compressed = 128, 15
    while start + 8 <= len(raw):
        kind, size = struct.unpack_from(order + "II", raw, start)
        if kind == compressed:
            zlib.decompress(raw[start + 8 : start + 8 + size])
        start += 8 + size


def numbers(variables: Variables, name: str, path: Path, shape: tuple[int | None, ...]) -> Floats:
    """Variable ``name`` as float64; DataError unless it has ``shape`` (None: any length)."""
    if name not in variables:
        known = ", ".join(sorted(variables)) or "nothing"
        raise DataError(f"{path}: no variable '{name}' (the file holds {known})")
    try:
        values = np.asarray(variables[name], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{path}: variable '{name}' does not hold numbers") from error
    right = values.ndim == len(shape) and all(
        wanted is None or wanted == got for wanted, got in zip(shape, values.shape, strict=True)
    )
    if not right:
        expected = " x ".join("any" if length is None else str(length) for length in shape)
        found = " x ".join(str(length) for length in values.shape)
        raise DataError(f"{path}: variable '{name}' is {found}; expected {expected}")
    return values


def scalar(variables: Variables, name: str, path: Path) -> int:
    """A positive whole number that Matlab keeps as a 1x1 matrix."""
    value = float(numbers(variables, name, path, (1, 1))[0, 0])
    if not np.isfinite(value) or value < 1 or value != round(value):
        raise DataError(f"{path}: variable '{name}' is {value:g}; expected a whole number above 0")
    return int(value)
