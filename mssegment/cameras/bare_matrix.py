"""A calibration matrix as plain numbers, as ``numpy.savetxt`` writes it."""

from __future__ import annotations

import re

import numpy as np

from mssegment.cameras.base import (
    CameraFile,
    CameraFormat,
    camera,
    camera_of_matrix,
    matrix_of,
)
from mssegment.records import Camera, Floats

_BETWEEN = r"[\s,;\[\]()]+"
_ALLOWED = re.compile(r"[-+.,;\deE\s\[\]()]+")


def read(file: CameraFile) -> dict[str, Camera]:
    """The camera of a 3x3, 3x4 or 4x4 matrix, or of fx fy cx cy, perhaps with coefficients.

    A matrix on the first three lines may be followed by a pose (Strecha's ``.camera``
    files). Raises ConfigurationError for a matrix that is none of a camera.
    """
    lines = [line for line in file.text.splitlines() if not line.lstrip().startswith(("#", "%"))]
    text = "\n".join(lines).strip()
    if not text or not _ALLOWED.fullmatch(text):
        return {}
    try:
        rows = [[float(word) for word in re.split(_BETWEEN, row) if word] for row in lines if row]
    except ValueError:
        return {}
    if [len(row) for row in rows[:3]] == [3, 3, 3] and rows[2] == [0, 0, 1]:
        rows = rows[:3]
    numbers = np.array([value for row in rows for value in row])
    is_flat = len(rows) == 1 and len(numbers) in (8, 9, 12) and not _is_matrix(numbers)
    if len(numbers) == 4 or is_flat:
        fx, fy, cx, cy, *bent = numbers.tolist()
        return {"": camera(file.name, fx, fy, cx, cy, bent)}
    matrix = matrix_of(numbers)
    return {} if matrix is None else {"": camera_of_matrix(matrix, file.name)}


def _is_matrix(numbers: Floats) -> bool:
    """Whether 9 or 12 numbers are a matrix: below its diagonal are zeros, or right of it."""
    if len(numbers) not in (9, 12) or not np.isfinite(numbers).all():
        return False
    matrix = numbers.reshape(3, -1)
    return not (matrix[1, 0] or matrix[2, 0] or matrix[2, 1]) or not (matrix[0, 1] or matrix[0, 2])


BARE_MATRIX = CameraFormat("bare_matrix", "a 3x3 matrix, or fx fy cx cy, as text or .npy", read)
