"""Documents of earlier versions, brought to the present form.

Version 1 of the hypotheses and segmentation documents had other names for some fields, and no
strategy: ``cluster`` guessed it from the sets. Only that of two views needs no guess.
"""

from __future__ import annotations

from typing import Any

import msgspec

_KINDS = {f"mssegment/{kind}/1": kind for kind in ("hypotheses", "segmentation")}
_NAMES = {"coordinates": "normalization", "set": "set_index"}
"""Fields by their earlier name."""


def upgraded(content: bytes, schema: str) -> bytes | None:
    """A document of an earlier version in the present form.

    Parameters
    ----------
    content : bytes
        The JSON text.
    schema : str
        Its schema.

    Returns
    -------
    bytes or None
        None if that version is not known, or the document cannot be brought to the present form.
    """
    kind = _KINDS.get(schema)
    if kind is None:
        return None
    tree: dict[str, Any] = msgspec.json.decode(content)
    frames = tree.get("frames")
    if kind == "hypotheses" and not (isinstance(frames, list) and len(frames) == 2):
        return None
    tree["schema"] = f"mssegment/{kind}/2"
    tree.setdefault("strategy", "modes")
    for name in ("sets", "motions", "modes"):
        if isinstance(tree.get(name), list):
            tree[name] = [_renamed(entry) for entry in tree[name]]
    return msgspec.json.encode(tree)


def _renamed(entry: Any) -> Any:
    if not isinstance(entry, dict):
        return entry
    return {_NAMES.get(name, name): value for name, value in entry.items()}
