"""HDF5 files, also those of Matlab 7.3, by h5py (the extra ``mssegment[hdf5]``)."""

from __future__ import annotations

import io
from typing import Any

import numpy as np

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
    try:
        import h5py
    except ImportError:
        raise DataError(
            f"{name}: an HDF5 file{' of Matlab 7.3' if transposed else ''}; it is read where h5py "
            f"is installed: pip install 'mssegment[hdf5]'"
            + ("; or save it with -v7" if transposed else "")
        ) from None

    def value(node: Any) -> Any:
        if isinstance(node, h5py.Group):
            return {key: value(child) for key, child in node.items() if not key.startswith("#")}
        array = np.asarray(node[()])
        return array.T if transposed else array

    try:
        with h5py.File(io.BytesIO(content), "r") as file:
            return dict(value(file))
    except (OSError, RuntimeError, ValueError, KeyError) as error:
        reason = " ".join(str(error).split())
        raise DataError(f"{name}: a damaged HDF5 file ({reason}); copy it again") from None
