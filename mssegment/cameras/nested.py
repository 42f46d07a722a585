"""Mappings inside a camera file, with the names by which a user may choose them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from mssegment.cameras.base import Tree, plain

_DEEPEST = 6
_MOST = 5000
"""Entries of a list that are looked at: a file of poses may hold one for every picture."""
_NAMES = ("name", "label", "file_path", "filename", "camera_name", "serial", "id", "key")
"""Keys that name an entry of a list."""
_INHERITED = frozenset(
    (
        *("width", "height", "w", "h", "imagewidth", "imageheight", "resolution", "imagesize"),
        *("cameramodel", "distortionmodel", "camerawidth", "cameraheight", "imagedimension"),
        *("type", "fisheye", "isfisheye"),
    )
)
"""Plain keys of sizes and models, which count for what is nested below them, too."""
_LEFT_OUT = frozenset(("calibration", "camera", "cameras", "intrinsics", "value0", "value", "data"))
"""Plain keys that say nothing in a name, where there is something else to say."""


def mappings_of(tree: Tree) -> Iterator[tuple[str, Tree]]:
    """Every mapping in a tree with its name, from the top down; the top has no name.

    The name consists of the keys on the way, and of the names or numbers in lists; keys that every
    file has are left out. Sizes and models are passed on to what is nested.
    """
    yield from _walk(tree, (), 0)


def _walk(tree: Tree, way: tuple[str, ...], level: int) -> Iterator[tuple[str, Tree]]:
    yield ".".join(_telling(way)), tree
    if level == _DEEPEST:
        return
    passed = {key: value for key, value in tree.items() if plain(str(key)) in _INHERITED}
    for key, value in tree.items():
        if isinstance(value, Mapping):
            yield from _walk({**passed, **value}, (*way, str(key)), level + 1)
        elif isinstance(value, list):
            for i, entry in enumerate(value[:_MOST]):
                if isinstance(entry, Mapping):
                    name = _name_of(entry, i)
                    yield from _walk({**passed, **entry}, (*way, str(key), name), level + 1)


def _telling(way: tuple[str, ...]) -> tuple[str, ...]:
    found = tuple(part for part in way if plain(part) not in _LEFT_OUT)
    return found or way[-1:]


def _name_of(entry: Mapping[Any, Any], index: int) -> str:
    for key in _NAMES:
        value = entry.get(key)
        if isinstance(value, str | int) and not isinstance(value, bool) and str(value).strip():
            return str(value)
    return str(index)
