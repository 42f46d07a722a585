"""One of several pairs of images in a file, as ``FILE#FIRST,SECOND`` names it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import TypeVar

from mssegment.datasets.containers import InputFile
from mssegment.errors import DataError

Pair = tuple[str, str]
_Value = TypeVar("_Value")
_BETWEEN = (",", "-", " ", ", ")
"""What may stand between the names; ``-`` is also hloc's ``/``."""


def chosen_pair(
    pairs: Mapping[Pair, _Value], file: InputFile, other_names: Mapping[str, Sequence[str]] = {}
) -> tuple[Pair, _Value, bool]:
    """The pair that ``FILE#PART`` names, or the only one.

    Parameters
    ----------
    pairs : mapping of (str, str)
        The pairs of images, the best first.
    file : InputFile
        The file; its member is two names with a comma, a slash or a blank between them, in any
        order, with or without suffixes.
    other_names : mapping of str to sequence of str
        Further names of an image, such as its number.

    Returns
    -------
    pair : (str, str)
    value
        What ``pairs`` holds for it.
    is_reversed : bool
        Whether the images were named in the other order.

    Raises
    ------
    DataError
        If the pair must be chosen, or there is no such pair.
    """
    if not file.member and len(pairs) == 1:
        pair = next(iter(pairs))
        return pair, pairs[pair], False
    wanted = _plain(file.member)
    found = [
        (pair, is_reversed)
        for pair in pairs
        for is_reversed in (False, True)
        if file.member and wanted in _ways(pair[::-1] if is_reversed else pair, other_names)
    ]
    if not found:
        names = [",".join(pair) for pair in pairs]
        shown = "; ".join(names[:3]) + ("; ..." if len(names) > 3 else "")
        said = f"no matches of '{file.member}', but of" if file.member else "matches of"
        raise DataError(
            f"{file.name}: {said} {len(names)} pair{'s' * (len(names) > 1)} of images ({shown}); "
            f"choose one: '{file.name}#{names[0]}'"
        )
    pair, is_reversed = found[0]
    return pair, pairs[pair], is_reversed


def _ways(pair: Pair, other_names: Mapping[str, Sequence[str]]) -> set[str]:
    first, second = (_names(name, other_names) for name in pair)
    return {f"{a}{between}{b}" for a in first for b in second for between in _BETWEEN}


def _names(image: str, other_names: Mapping[str, Sequence[str]]) -> set[str]:
    path = PurePath(image)
    stem = str(path.with_suffix("")) if path.suffix else image
    return {
        _plain(name) for name in (image, stem, path.name, path.stem, *other_names.get(image, ()))
    }


def _plain(name: str) -> str:
    return name.strip().replace("/", "-")
