"""Dense optical flow of two images, as RAFT and its like save it: read as matches on a grid.

References
----------
S. Baker et al., "A database and evaluation methodology for optical flow", IJCV 92, 2011: the files
``.flo``.
"""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import numpy.typing as npt

from mssegment.datasets.base import DataSet, ImportedTracks, check_points, frames_inside
from mssegment.datasets.containers import InputFile, Variables
from mssegment.errors import DataError
from mssegment.inputs import limits
from mssegment.records import Floats, Tracks

MAGIC = b"PIEH"
"""The first bytes of a ``.flo`` file: the number 202021.25."""
MOST_MATCHES = 4000
"""Pixels further apart than those of so many matches tell the motions just as well."""
_NAMES = re.compile(
    r"(pred_|optical_|est_|gt_)?flows?(_(up|fw|fwd|forward|pred|est|low|12|01|gt))?"
)
_UNKNOWN = 1e9
"""Middlebury's value where the flow is not known is larger."""
_SMALLEST_SIDE = 64
"""Fields without a name are of pictures of at least this size, in pixels."""
_FARTHEST = 0.25
"""Displacements are nearly all shorter than this share of the picture; positions, read as a field
of as many pixels as there are tracks and frames, are not."""


def load_flo(file: InputFile) -> Variables:
    """The field of a ``.flo`` file as ``flow``; raises DataError if it is damaged."""
    header = np.frombuffer(file.content[4:12].ljust(8, b"\0"), dtype="<i4")
    width, height = int(header[0]), int(header[1])
    size = 12 + 8 * width * height
    if width < 1 or height < 1 or len(file.content) != size:
        raise DataError(
            f"{file.name}: a damaged .flo file ({len(file.content)} bytes for {width}x{height} "
            f"pixels; expected {size}); write it again"
        )
    values = np.frombuffer(file.content, dtype="<f4", offset=12)
    return {"flow": values.reshape(height, width, 2)}


def recognises(content: Variables) -> bool:
    """Whether an array is a field of displacements, by its name or by its values."""
    return _chosen(content) is not None


def read(file: InputFile) -> ImportedTracks:
    """Read the flow at the pixels of a grid, each a match of two views.

    Pixels without a flow (NaN, or Middlebury's large values) are left out. Raises DataError if
    there are none left.
    """
    name = _chosen(file.variables)
    assert name is not None
    field = _field(file.variables[name])
    assert field is not None
    height, width = field.shape[:2]
    limits.check("picture_pixels", width * height, f"{file.name}: a flow of {width}x{height}")
    step = max(math.ceil(math.sqrt(width * height / MOST_MATCHES)), 1)
    y, x = np.mgrid[step // 2 : height : step, step // 2 : width : step]
    first = np.stack([x.ravel(), y.ravel()], axis=1).astype(np.float64)
    moved = field[y.ravel(), x.ravel()].astype(np.float64)
    known = np.isfinite(moved).all(axis=1) & (np.abs(moved) < _UNKNOWN).all(axis=1)
    points = np.stack([first[known], first[known] + moved[known]], axis=1)
    check_points(points, f"{file.name}: flow of {width}x{height} pixels")
    lost = f", {int((~known).sum())} without a flow left out" if not known.all() else ""
    rest = [other for other in file.variables if other != name]
    notes = [f"optical flow of {width}x{height} pixels: read at every {step}th pixel{lost}"]
    notes += [f"ignored: {', '.join(rest[:8])}"] if rest else []
    frames = frames_inside(file.name, file.content, range(2), width, height)
    return ImportedTracks(file.path.stem, Tracks(points), frames, notes=tuple(notes))


def _chosen(content: Variables) -> str | None:
    """The name of the field; fields without a telling one must be alone."""
    for name, value in content.items():
        if _NAMES.fullmatch(name.lower()) and _field(value) is not None:
            return name
    return "" if set(content) == {""} and _is_of_displacements(content[""]) else None


def _field(value: Any) -> npt.NDArray[Any] | None:
    """An array as [h, w, 2], from [h, w, 2] or [2, h, w], perhaps of a batch of one; or None."""
    if not isinstance(value, np.ndarray) or value.dtype.kind != "f":
        return None
    field: npt.NDArray[Any] = value
    while field.ndim > 3 and field.shape[0] == 1:
        field = field[0]
    if field.ndim != 3 or 0 in field.shape:
        return None
    if field.shape[2] == 2:
        return field
    return np.moveaxis(field, 0, 2) if field.shape[0] == 2 else None


def _is_of_displacements(value: Any) -> bool:
    """Whether the values of an array without a name are displacements and not positions."""
    field = _field(value)
    if field is None or min(field.shape[:2]) < _SMALLEST_SIDE:
        return False
    known: Floats = np.abs(np.asarray(field[np.isfinite(field)], dtype=np.float64))
    known = known[known < _UNKNOWN]
    far = _FARTHEST * min(field.shape[:2])
    return known.size > 0 and float(np.quantile(known, 0.99)) < far


FLOWS = DataSet(
    "flows",
    "optical flow of two images, on a grid (.flo, .npy, .npz)",
    ("flow", "numpy", "hdf5", "matlab"),
    recognises,
    read,
)
