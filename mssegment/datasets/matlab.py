"""Reading Matlab files, with errors that name the file and the variable."""

from __future__ import annotations

import io
import struct
import zlib
from typing import Any

import numpy as np

from mssegment.datasets.containers import InputFile, Variables
from mssegment.errors import DataError
from mssegment.records import Floats


def load_matlab(file: InputFile) -> Variables:
    """Read the variables of a Matlab file, and the fields of its structs as variables too.

    Raises DataError if the file is damaged, or has version 7.3 and h5py is not installed.
    """
    if file.content[:10] == b"MATLAB 7.3":
        from mssegment.datasets.hdf5 import load_hdf5

        return _with_fields(load_hdf5(file.content, file.name, transposed=True))
    import scipy.io  # slow to import, and most commands read no Matlab file

    try:
        _check_checksums(file.content)
        content: dict[str, Any] = scipy.io.loadmat(io.BytesIO(file.content))
    except Exception as error:  # scipy's parser raises many types of error
        raise DataError(
            f"{file.name}: not a readable Matlab file ({type(error).__name__}: {error}); "
            "expected the .mat file as published"
        ) from error
    return _with_fields({k: v for k, v in content.items() if not k.startswith("__")})


def _with_fields(variables: dict[str, Any]) -> dict[str, Any]:
    """The variables and, where no variable has the same name, the fields of single structs."""
    fields: dict[str, Any] = {}
    for value in variables.values():
        fields |= fields_of(value)
    return fields | variables


def fields_of(value: Any) -> dict[str, Any]:
    """The fields of a struct of one element; empty for anything else."""
    if isinstance(value, dict):
        return value
    if not isinstance(value, np.ndarray) or value.dtype.names is None or value.size != 1:
        return {}
    record = value.ravel()[0]
    return {name: record[name] for name in value.dtype.names}


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


def numbers(variables: Variables, name: str, path: str, shape: tuple[int | None, ...]) -> Floats:
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


def scalar(variables: Variables, name: str, path: str) -> int:
    """Variable ``name``, a 1x1 matrix that holds a positive whole number.

    Raises DataError if it is missing or anything else.
    """
    value = float(numbers(variables, name, path, (1, 1))[0, 0])
    if not np.isfinite(value) or value < 1 or value != round(value):
        raise DataError(f"{path}: variable '{name}' is {value:g}; expected a whole number above 0")
    return int(value)
