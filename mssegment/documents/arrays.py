"""Arrays in JSON: nested lists, or ``{"dtype": "<f8", "shape": [...], "base64": "..."}``.

Every reader takes both; writers switch to base64 above ``LIST_LIMIT`` numbers, and for empty
arrays with several axes. A position that is not seen is null in a list and NaN in base64; infinity
is refused.
"""

from __future__ import annotations

import base64
import binascii
import math
import re
from types import GenericAlias
from typing import Any, get_args

import msgspec
import numpy as np
import numpy.typing as npt

LIST_LIMIT = 100_000
_DTYPES = {"<f8": np.dtype("<f8"), "<i8": np.dtype("<i8")}


class EncodedArray(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An array as base64 of its little-endian bytes in C order."""

    dtype: str
    shape: list[int]
    base64: str


def encode_array(value: object) -> object:
    """``enc_hook`` of msgspec: what JSON can hold of a numpy array or number.

    Raises TypeError for anything else.
    """
    if isinstance(value, np.ndarray):
        # an empty list could not say its inner lengths
        if value.size <= LIST_LIMIT and (value.size or value.ndim == 1):
            return value.tolist()
        little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
        return EncodedArray(
            dtype=little.dtype.str,
            shape=list(value.shape),
            base64=base64.b64encode(little.tobytes()).decode("ascii"),
        )
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"no JSON for {type(value).__name__}")


def decode_array(kind: Any, value: object) -> npt.NDArray[Any]:
    """``dec_hook`` of msgspec: the array of the annotated type ``kind`` from either form.

    Raises ValueError, saying where inside the array, for anything that is not such an array.
    """
    try:
        return _decode(kind, value)
    except msgspec.ValidationError as error:
        # as a plain ValueError, msgspec adds the path to this array
        raise ValueError(str(error)) from None


def _decode(kind: Any, value: object) -> npt.NDArray[Any]:
    arguments = get_args(kind)
    if len(arguments) != 2 or not get_args(arguments[1]):
        raise NotImplementedError(f"no array type: {kind}")
    dtype = np.dtype(get_args(arguments[1])[0])
    if isinstance(value, dict):
        array = _from_base64(msgspec.convert(value, EncodedArray), dtype)
    elif isinstance(value, list):
        array = _from_list(value, dtype)
    else:
        raise ValueError(f"Expected an array, got `{type(value).__name__}`")
    if dtype.kind == "f" and np.isinf(array).any():
        where = "".join(f"[{i}]" for i in np.argwhere(np.isinf(array))[0])
        raise ValueError(f"Expected a finite number or null, got infinity - at `${where}`")
    return array


def _from_list(value: list[Any], dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    number: Any = (float | None) if dtype.kind == "f" else int
    kind = number
    for _ in range(_depth(value)):
        kind = GenericAlias(list, (kind,))
    checked = msgspec.convert(value, kind)
    try:
        return np.array(checked, dtype=dtype)
    except ValueError as error:
        raise ValueError(_ragged(checked) or str(error)) from None


def _depth(value: object) -> int:
    """How deep lists are nested along the first elements that say it."""
    depth = 0
    while isinstance(value, list):
        depth += 1
        value = next((v for v in value if isinstance(v, list) and v), value[0] if value else None)
    return depth


def _ragged(value: list[Any], where: str = "$") -> str:
    """What is wrong with a nested list whose rows differ in length; empty when nothing is."""
    if not value or not isinstance(value[0], list):
        return ""
    for i, row in enumerate(value):
        if len(row) != len(value[0]):
            return f"Expected {len(value[0])} numbers, got {len(row)} - at `{where}[{i}]`"
        if problem := _ragged(row, f"{where}[{i}]"):
            return problem
    return ""


def _from_base64(encoded: EncodedArray, dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    if encoded.dtype not in _DTYPES or _DTYPES[encoded.dtype].kind != dtype.kind:
        wanted = "<f8" if dtype.kind == "f" else "<i8"
        raise ValueError(f"Expected dtype {wanted}, got {encoded.dtype!r}")
    try:
        raw = base64.b64decode(encoded.base64, validate=True)
    except binascii.Error as error:
        raise ValueError(f"Expected base64, but {error}") from None
    if any(n < 0 for n in encoded.shape) or len(raw) != 8 * math.prod(encoded.shape):
        raise ValueError(f"Expected {encoded.shape} numbers of 8 bytes, got {len(raw)} bytes")
    return np.frombuffer(raw, dtype=_DTYPES[encoded.dtype]).reshape(encoded.shape).astype(dtype)


def readable(error: msgspec.ValidationError) -> str:
    """The message of msgspec in the words of our documents, with one path to the place.

    "Expected `float`, got `str` - at `$[3][0]` - at `$.points`" becomes
    "expected float, got str at $.points[3][0]".
    """
    parts = re.split(r" - at `\$([^`]*)`", str(error))
    message, inner_to_outer = parts[0], parts[1::2]
    path = "$" + "".join(reversed(inner_to_outer))
    message = message.replace("`", "")
    message = message[:1].lower() + message[1:] if message.startswith("Expected") else message
    return message if path == "$" else f"{message} at {path}"
