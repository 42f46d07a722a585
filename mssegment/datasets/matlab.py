"""Reading Matlab files, with errors that name the file and the variable."""

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
    """Read the variables of a Matlab file, versions 4 to 7.2.

    Raises DataError if the file cannot be read, is damaged, or has version 7.3.
    """
    import scipy.io  # slow to import, and most commands read no Matlab file

    try:
        raw = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        _check_checksums(raw)
        content: dict[str, Any] = scipy.io.loadmat(io.BytesIO(raw))
    except NotImplementedError as error:
        raise DataError(
            f"{path}: Matlab version 7.3 (HDF5) is not supported; save the file with -v7"
        ) from error
    except Exception as error:  # scipy's parser raises many types of error
        raise DataError(
            f"{path}: not a readable Matlab file ({type(error).__name__}: {error}); "
            "expected the .mat file as published"
        ) from error
    return {name: value for name, value in content.items() if not name.startswith("__")}


def _check_checksums(raw: bytes) -> None:
    """Decompress every compressed element: scipy's parser crashes the process on damaged ones."""
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
    """Variable ``name`` as float64.

    Raises DataError if it is missing, is not numeric, or does not have ``shape``, where None
    matches any length.
    """
    if name not in variables:
        known = ", ".join(sorted(variables)) or "none"
        raise DataError(f"{path}: no variable '{name}'; the variables in the file are: {known}")
    try:
        values = np.asarray(variables[name], dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise DataError(f"{path}: variable '{name}' is not numeric; expected numbers") from error
    right = values.ndim == len(shape) and all(
        wanted is None or wanted == got for wanted, got in zip(shape, values.shape, strict=True)
    )
    if not right:
        expected = " x ".join("any" if length is None else str(length) for length in shape)
        found = " x ".join(str(length) for length in values.shape)
        raise DataError(f"{path}: variable '{name}' has shape {found}; expected {expected}")
    return values


def scalar(variables: Variables, name: str, path: Path) -> int:
    """Variable ``name``, a 1x1 matrix that holds a positive whole number.

    Raises DataError if it is missing or anything else.
    """
    value = float(numbers(variables, name, path, (1, 1))[0, 0])
    if not np.isfinite(value) or value < 1 or value != round(value):
        raise DataError(f"{path}: variable '{name}' is {value:g}; expected a whole number above 0")
    return int(value)
