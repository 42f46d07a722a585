"""Reading Matlab files, with errors that name the file and the variable."""

from __future__ import annotations

import struct
import zlib
from typing import Any

import numpy as np

from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.foreign import read_variables
from mssegment.errors import DataError
from mssegment.inputs import limits
from mssegment.records import Floats

_PIECE = 1 << 20


def load_matlab(file: InputFile) -> Variables:
    """Read the variables of a Matlab file, and the fields of its structs as variables too.

    Raises DataError if the file is damaged, or has version 7.3 and h5py is not installed.
    """
    if file.content[:10] == b"MATLAB 7.3":
        from mssegment.datasets.hdf5 import load_hdf5

        return _with_fields(load_hdf5(file.content, file.name, transposed=True))
    _check_unpacked(file.content, file.name)
    return _with_fields(read_variables(file.content, file.name, "mat"))


def _with_fields(variables: dict[str, Any]) -> dict[str, Any]:
    """The variables and, where no variable has the same name, the fields of single structs."""
    fields: dict[str, Any] = {}
    for value in variables.values():
        fields |= fields_of(value)
    return fields | variables


def fields_of(value: Any) -> dict[str, Any]:
    """The fields of a struct of one element; empty for anything else."""
    return value if isinstance(value, dict) else {}


def _check_unpacked(raw: bytes, name: str) -> None:
    """Raises DataError if the compressed elements hold more than ``limits.unpacked_bytes``."""
    if raw[126:128] not in (b"IM", b"MI"):
        return
    order = "<" if raw[126:128] == b"IM" else ">"
    start, compressed, left = 128, 15, limits.limit("unpacked_bytes")
    while start + 8 <= len(raw):
        kind, size = struct.unpack_from(order + "II", raw, start)
        if kind == compressed:
            left -= _unpacked_size(raw[start + 8 : start + 8 + size], left, name)
        start += 8 + size


def _unpacked_size(packed: bytes, most: int, name: str) -> int:
    """The size of a compressed element; raises DataError above ``most``, or if it is damaged."""
    unpacker = zlib.decompressobj()
    size = 0
    try:
        while packed:
            size += len(unpacker.decompress(packed, _PIECE))
            if size > most:
                raise DataError(limits.exceeded("unpacked_bytes", None, name))
            packed = unpacker.unconsumed_tail
    except zlib.error as error:
        raise DataError(f"{name}: a damaged Matlab file ({error}); copy it again") from None
    return size


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
    except (TypeError, ValueError, OverflowError) as error:
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
