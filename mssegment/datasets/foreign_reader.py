"""Read a Matlab or HDF5 file in a process of its own, and write its variables to standard output.

The parsers of SciPy and of the HDF5 library kill their process on some damaged files, and allocate
what a file states. Here they kill this process, which has limits, and the parent says so in one
line. The file is run by its path and imports nothing of the package, so it starts fast.

It takes the kind of the file (``mat`` or ``hdf5``), the number of seconds and the number of bytes
that it may use, and writes one MessagePack object: ``{"error": text}``, or ``{"variables": node}``,
where a node is one of

    {"array": bytes, "dtype": text, "shape": [...]}    numbers, truth values or text, in C order
    {"cells": [node, ...], "shape": [...]}             an array of nodes
    {"fields": {name: node}}                           a struct or a group
    {"other": text}                                    anything else: its type

A table that pandas keeps in HDF5 is the struct of its columns, and beside each block of columns
stand their names.
"""

from __future__ import annotations

import io
import pickle
import sys
from typing import Any

import msgspec
import numpy as np

_DEEPEST = 20
"""Levels of structs in structs that are read."""


def main(kind: str, seconds: int, largest: int) -> int:
    """Read the file on standard input as ``kind`` and write its variables."""
    _limit_process(seconds, largest)
    content = sys.stdin.buffer.read()
    try:
        found = {"variables": _matlab(content) if kind == "mat" else _hdf5(content, largest)}
    except MemoryError:
        found = {"error": "memory"}
    except Exception as error:  # the parsers raise many types of error on damaged files
        found = {"error": f"{type(error).__name__}: {' '.join(str(error).split())}"}
    sys.stdout.buffer.write(msgspec.msgpack.encode(found))
    return 0


def _limit_process(seconds: int, largest: int) -> None:
    """Bound time and memory, where the system can; a crash leaves no core file."""
    try:
        import resource
    except ImportError:  # Windows
        return
    # the parser holds the content, the arrays and their encoding; the libraries take the rest
    for kind, wanted in (
        (resource.RLIMIT_AS, 4 * largest + 2**30),
        (resource.RLIMIT_CPU, seconds),
        (resource.RLIMIT_CORE, 0),
    ):
        soft, hard = resource.getrlimit(kind)
        given = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
        resource.setrlimit(kind, (min([wanted, *given]), hard))


def _matlab(content: bytes) -> Any:
    import scipy.io

    found = scipy.io.loadmat(io.BytesIO(content))
    return {"fields": {k: _node(v) for k, v in found.items() if not k.startswith("__")}}


def _hdf5(content: bytes, largest: int) -> Any:
    import h5py

    left = largest

    def value(node: Any, level: int) -> Any:
        nonlocal left
        if isinstance(node, h5py.Group):
            if level > _DEEPEST:
                return {"other": "a group, nested too deeply"}
            # links into other files are not followed
            keys = [k for k in node if isinstance(node.get(k, getlink=True), h5py.HardLink)]
            own = [key for key in keys if not key.startswith("#")]
            return {"fields": {key: value(node[key], level + 1) for key in own}}
        if not isinstance(node, h5py.Dataset) or node.external:
            return {"other": type(node).__name__}
        left -= node.size * node.dtype.itemsize if node.size else 0
        if left < 0:
            raise MemoryError
        array = np.asarray(node[()])
        if node.dtype.names and node.parent.attrs.get("pandas_type") == b"frame_table":
            return _pandas_table(array, node.attrs)
        return _node(array)

    with h5py.File(io.BytesIO(content), "r") as file:
        return value(file, 0)


def _pandas_table(rows: Any, attributes: Any) -> Any:
    fields = {name: _node(rows[name]) for name in rows.dtype.names}
    for name in rows.dtype.names:
        names = _column_names(attributes.get(f"{name}_kind"))
        if names is not None:
            fields[f"{name}_items"] = _node(np.array(names))
    return {"fields": fields}


def _column_names(stored: Any) -> list[str] | None:
    """The names of the columns of a block, which PyTables pickles; several levels by tabs."""
    if not isinstance(stored, bytes) or not stored.startswith(b"(l"):
        return None  # the type of the index
    names = _PlainUnpickler(io.BytesIO(stored)).load()
    return ["\t".join(map(str, name)) if isinstance(name, tuple) else str(name) for name in names]


class _PlainUnpickler(pickle.Unpickler):
    """Lists, tuples, texts and numbers only: other pickles may run any code."""

    def find_class(self, module: str, name: str) -> Any:
        raise pickle.UnpicklingError(f"a name of a column is a {module}.{name}, and no text")


def _node(value: Any, level: int = 0) -> Any:
    if not isinstance(value, np.ndarray) or level > _DEEPEST:
        return {"other": type(value).__name__}
    if value.dtype.names is not None:
        structs = [
            {"fields": {name: _node(record[name], level + 1) for name in value.dtype.names}}
            for record in value.ravel()
        ]
        return structs[0] if value.size == 1 else {"cells": structs, "shape": list(value.shape)}
    if value.dtype.kind == "O":
        cells = [_node(part, level + 1) for part in value.ravel()]
        return {"cells": cells, "shape": list(value.shape)}
    if value.dtype.kind not in "biufcUS":
        return {"other": str(value.dtype)}
    little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
    return {"array": little.tobytes(), "dtype": little.dtype.str, "shape": list(value.shape)}


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], *map(int, sys.argv[2:4])))
