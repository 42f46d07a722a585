"""HDF5 files, also those of Matlab 7.3, by h5py (the extra ``mssegment[hdf5]``)."""

from __future__ import annotations

from typing import Any

import numpy as np

from mssegment.datasets.foreign import read_variables
from mssegment.errors import DataError


def load_hdf5(content: bytes, name: str, transposed: bool = False) -> dict[str, Any]:
    """Read every array of an HDF5 file.

    Parameters
    ----------
    content : bytes
        The file.
    name : str
        Its name, for errors.
    transposed : bool
        Whether axes are in the order of Matlab, which is the reverse.

    Returns
    -------
    dict
        Arrays by the name of the dataset; groups are dictionaries of the same kind.

    Raises
    ------
    DataError
        If h5py is not installed, or the file is damaged.
    """
    import importlib.util

    if importlib.util.find_spec("h5py") is None:
        raise DataError(
            f"{name}: an HDF5 file{' of Matlab 7.3' if transposed else ''}; it is read where h5py "
            f"is installed: pip install 'mssegment[hdf5]'"
            + ("; or save it with -v7" if transposed else "")
        )
    found = read_variables(content, name, "hdf5")
    return _transposed(found) if transposed else found


def _transposed(variables: dict[str, Any]) -> dict[str, Any]:
    """The variables with the axes of each array reversed."""
    return {
        key: _transposed(value)
        if isinstance(value, dict)
        else value.T
        if isinstance(value, np.ndarray)
        else value
        for key, value in variables.items()
    }
