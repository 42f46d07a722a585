"""Files of ``numpy.save`` and ``numpy.savez``."""

from __future__ import annotations

import io
import zipfile
from typing import Any

import numpy as np

from mssegment.datasets.containers import InputFile
from mssegment.errors import DataError
from mssegment.inputs.numpy_headers import DAMAGED, check_arrays


def load_numpy(file: InputFile) -> dict[str, Any]:
    """The arrays of a ``.npz`` by name, or of a ``.npy`` under the empty name.

    Raises DataError if the file is damaged, is another kind of archive, or holds pickled objects,
    which could run any code.
    """
    if file.content[:2] == b"PK":
        _check_archive(file)
    check_arrays(file.content, file.name, DataError)
    try:
        found = np.load(io.BytesIO(file.content), allow_pickle=False)
        if isinstance(found, np.ndarray):
            return {"": found}
        return {name: _array(found, name, file) for name in found.files}
    except DAMAGED as error:
        if "pickle" in str(error).lower():
            raise _pickled(file, "") from None
        reason = " ".join(str(error).split())
        raise DataError(f"{file.name}: a damaged numpy file ({reason}); save it again") from None


def _array(found: Any, name: str, file: InputFile) -> Any:
    try:
        return found[name]
    except ValueError as error:
        if "pickle" in str(error).lower():
            return _pickled(file, name)  # it only matters if this array is wanted
        raise


def _pickled(file: InputFile, name: str) -> DataError:
    what = f"array '{name}' is" if name else "the array is"
    return DataError(
        f"{file.name}: {what} of Python objects (pickled), which are not read; save a plain array "
        "of numbers [tracks, frames, 2]"
    )


def _check_archive(file: InputFile) -> None:
    """Raises DataError for an archive that numpy did not write."""
    try:
        names = zipfile.ZipFile(io.BytesIO(file.content)).namelist()
    except DAMAGED:
        raise DataError(f"{file.name}: a damaged archive; save it again") from None
    if not all(name.endswith(".npy") for name in names):
        kind = "an archive"
        if any(name.startswith("xl/") for name in names):
            kind = "an Excel workbook"
        elif any(name.endswith("data.pkl") for name in names):
            kind = "a PyTorch file"
        raise DataError(
            f"{file.name}: {kind}, which is not read; save the tracks as CSV, or an array "
            "[tracks, frames, 2] with numpy.save or numpy.savez"
        )
