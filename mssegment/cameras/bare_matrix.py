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
from mssegment.records import Camera

_BETWEEN = r"[\s,;\[\]()]+"
_ALLOWED = re.compile(r"[-+.,;\deE\s\[\]()]+")


def read(file: CameraFile) -> dict[str, Camera]:
    """The camera of a 3x3 or 3x4 matrix, of four numbers fx fy cx cy, or of the first three lines.

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
    if len(numbers) == 4:
        return {"": camera(file.name, *numbers)}
    matrix = matrix_of(numbers)
    return {} if matrix is None else {"": camera_of_matrix(matrix, file.name)}


BARE_MATRIX = CameraFormat("bare_matrix", "a 3x3 matrix, or fx fy cx cy, as text or .npy", read)
