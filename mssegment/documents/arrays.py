"""Arrays in JSON: nested lists, or ``{"dtype": "<f8", "shape": [...], "base64": "..."}``.

Readers accept both forms. Writers use base64 above ``LIST_LIMIT`` numbers, and for empty arrays
with several axes, whose shape nested lists cannot express. A missing number, such as a coordinate
of a point that is not visible in a frame, is null in a list and NaN in base64. Infinity is an
error.
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
DEEPEST = 8
"""Axes of an array; the documents have at most four."""
_DTYPES = {"<f8": np.dtype("<f8"), "<i8": np.dtype("<i8")}


class EncodedArray(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """An array as base64 of its little-endian bytes in C order."""

    dtype: str
    shape: list[int]
    base64: str


def encode_array(value: object) -> object:
    """The JSON form of a numpy array or number, as the ``enc_hook`` of msgspec.

    Raises TypeError for any other type.
    """
    if isinstance(value, np.ndarray):
        # nested lists cannot express the shape of an empty array
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
    """The array in ``value``, in either form, as the ``dec_hook`` of msgspec.

    Parameters
    ----------
    kind : type
        The annotated array type, ``Floats`` or ``Integers``.
    value : list or dict
        Nested lists, or the fields of an ``EncodedArray``.

    Returns
    -------
    ndarray
        float64 or int64.

    Raises
    ------
    ValueError
        If ``value`` is not such an array, with the position inside it.
    """
    try:
        return _decode(kind, value)
    except RecursionError:
        raise ValueError("Expected an array, got lists that are nested too deeply") from None
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
    depth = _depth(value)
    if depth > DEEPEST:
        raise ValueError(f"Expected an array, got lists nested {depth} deep")
    for _ in range(depth):
        kind = GenericAlias(list, (kind,))
    checked = msgspec.convert(value, kind)
    try:
        return np.array(checked, dtype=dtype)
    except OverflowError:
        raise ValueError("Expected a number of 64 bits, got a larger one") from None
    except ValueError as error:
        raise ValueError(_ragged(checked) or str(error)) from None


def _depth(value: object) -> int:
    """The nesting depth of a list, along the first element that is not empty at each level."""
    depth = 0
    while isinstance(value, list):
        depth += 1
        value = next((v for v in value if isinstance(v, list) and v), value[0] if value else None)
    return depth


def _ragged(value: list[Any], where: str = "$") -> str:
    """An error message for nested lists whose rows differ in length; empty if they do not."""
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
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"Expected base64, but {error}") from None
    if len(encoded.shape) > DEEPEST:
        raise ValueError(f"Expected an array, got one of {len(encoded.shape)} axes")
    if any(not 0 <= n < 2**62 for n in encoded.shape) or len(raw) != 8 * math.prod(encoded.shape):
        raise ValueError(f"Expected {encoded.shape} numbers of 8 bytes, got {len(raw)} bytes")
    return np.frombuffer(raw, dtype=_DTYPES[encoded.dtype]).reshape(encoded.shape).astype(dtype)


def readable(error: msgspec.ValidationError) -> str:
    """The message of a validation error with a single path to the value.

    "Expected `float`, got `str` - at `$[3][0]` - at `$.points`" becomes
    "expected float, got str at $.points[3][0]".
    """
    parts = re.split(r" - at `\$([^`]*)`", str(error))
    message, inner_to_outer = parts[0], parts[1::2]
    path = "$" + "".join(reversed(inner_to_outer))
    message = message.replace("`", "")
    message = message[:1].lower() + message[1:] if message.startswith("Expected") else message
    return message if path == "$" else f"{message} at {path}"
