"""Variables of Matlab and HDF5 files, read by a process of its own (``foreign_reader``)."""

from __future__ import annotations

import subprocess
import sys
from typing import Any, Literal

import msgspec
import numpy as np

from mssegment.datasets import foreign_reader
from mssegment.errors import DataError
from mssegment.inputs import limits

_SECONDS = 60
"""Seconds of CPU that a file may take; the largest of the public data sets takes less than one."""


def read_variables(content: bytes, name: str, kind: Literal["mat", "hdf5"]) -> dict[str, Any]:
    """Read the variables of a file.

    Parameters
    ----------
    content : bytes
        The file.
    name : str
        Its name, for errors.
    kind : {"mat", "hdf5"}
        ``mat`` up to version 7, by SciPy; ``hdf5`` by h5py.

    Returns
    -------
    dict
        Arrays by name. Structs and groups are dictionaries of the same kind, cells arrays of
        objects; of any other variable only the type is kept, as text.

    Raises
    ------
    DataError
        If the file is damaged, holds more than ``limits.unpacked_bytes``, or kills its parser.
    """
    title = "Matlab" if kind == "mat" else "HDF5"
    largest = limits.limit("unpacked_bytes")
    command = [sys.executable, foreign_reader.__file__, kind, str(_SECONDS), str(largest)]
    child = subprocess.run(command, input=content, capture_output=True, check=False)
    if child.returncode:
        raise DataError(
            f"{name}: a damaged {title} file (its parser died: {_cause(child.returncode)}); copy "
            "it again, or save the tracks as CSV"
        )
    found: dict[str, Any] = msgspec.msgpack.decode(child.stdout)
    if found.get("error") == "memory":
        raise DataError(limits.exceeded("unpacked_bytes", None, name))
    if "error" in found:
        raise DataError(
            f"{name}: not a readable {title} file ({found['error']}); expected the file as "
            "published, or save the tracks as CSV"
        )
    variables: dict[str, Any] = _value(found["variables"])
    return variables


def _cause(status: int) -> str:
    if status >= 0:
        return f"exit status {status}"
    import signal

    return signal.Signals(-status).name


def _value(node: dict[str, Any]) -> Any:
    if "fields" in node:
        return {name: _value(own) for name, own in node["fields"].items()}
    if "array" in node:
        stored = np.frombuffer(node["array"], dtype=np.dtype(node["dtype"]))
        return stored.reshape(node["shape"]).astype(stored.dtype.newbyteorder("="))
    if "cells" in node:
        cells = np.empty(len(node["cells"]), dtype=object)
        for i, own in enumerate(node["cells"]):
            cells[i] = _value(own)
        return cells.reshape(node["shape"])
    return str(node["other"])
