"""What arrays of numpy state about their size, before they are allocated."""

from __future__ import annotations

import io
import math
import tokenize
import zipfile
import zlib
from typing import IO, Any

import numpy as np

from mssegment.errors import MssegmentError
from mssegment.inputs import limits

DAMAGED = (
    *(OSError, ValueError, EOFError, KeyError, TypeError, AttributeError, SyntaxError),
    *(NotImplementedError, RuntimeError, OverflowError, MemoryError, RecursionError),
    *(zipfile.BadZipFile, zlib.error, tokenize.TokenError),
)
"""What numpy and zipfile raise on damaged files: the header of an array is a Python literal."""


def check_arrays(content: bytes, where: str, error: type[MssegmentError]) -> None:
    """Check the size of a ``.npy`` file, or of all arrays in a ``.npz``.

    Parameters
    ----------
    content : bytes
        The file.
    where : str
        Its name, which opens the message.
    error : type
        The error to raise.

    Raises
    ------
    MssegmentError
        ``error``, if the arrays are larger than ``limits.unpacked_bytes``. A damaged file is left
        to numpy, which names what is wrong.
    """
    total = 0
    try:
        if not content.startswith(b"PK"):
            total = _stated(io.BytesIO(content))
        else:
            with zipfile.ZipFile(io.BytesIO(content)) as archive:
                for member in archive.infolist():
                    with archive.open(member) as file:
                        total += _stated(file)
    except Exception:  # the header is a Python literal: numpy's parser raises many types of error
        return
    limits.check("unpacked_bytes", total, where, error)


def _stated(file: IO[bytes]) -> int:
    """The bytes that the header of an array states."""
    version = np.lib.format.read_magic(file)
    read: Any = np.lib.format.read_array_header_1_0
    if version != (1, 0):
        read = np.lib.format.read_array_header_2_0
    shape, _, dtype = read(file)
    return int(math.prod(shape)) * int(dtype.itemsize)
