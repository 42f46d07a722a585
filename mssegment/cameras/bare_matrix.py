"""A calibration matrix as plain numbers, as ``numpy.savetxt`` writes it."""

from __future__ import annotations

import re

import numpy as np

from mssegment.cameras.base import CameraFile, CameraFormat, camera_of_matrix, matrix_of
from mssegment.records import Camera

_ALLOWED = re.compile(r"[-+.,;\deE\s\[\]()]+")


def read(file: CameraFile) -> dict[str, Camera]:
    """The camera of a 3x3 or 3x4 matrix, or of the three rows of one.

    Raises ConfigurationError for a matrix that is none of a camera.
    """
    lines = [line for line in file.text.splitlines() if not line.lstrip().startswith(("#", "%"))]
    text = "\n".join(lines).strip()
    if not text or not _ALLOWED.fullmatch(text):
        return {}
    words = [word for word in re.split(r"[\s,;\[\]()]+", text) if word]
    try:
        matrix = matrix_of(np.array(words, dtype=np.float64))
    except ValueError:
        return {}
    return {} if matrix is None else {"": camera_of_matrix(matrix, file.name)}


BARE_MATRIX = CameraFormat("bare_matrix", "a 3x3 matrix as text or .npy", read)
