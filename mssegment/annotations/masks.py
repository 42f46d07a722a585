"""Mask images: indices, grey values, colours, black and white; and masks as arrays of numpy."""

from __future__ import annotations

import io
import struct
import zlib
from collections.abc import Sequence

import cv2
import numpy as np

from mssegment.annotations.base import IGNORE, Annotations, LabelledFrame
from mssegment.errors import DataError
from mssegment.imaging.pictures import decode, looks_like_picture, read_bytes
from mssegment.inputs import limits
from mssegment.inputs.numpy_headers import DAMAGED, check_arrays
from mssegment.records import Integers
from mssegment.special import distinct

MOST_COLOURS = 254
VOID = (192, 224, 224)
"""Blue, green, red of PASCAL VOC's void, which is ignored."""
_IN_ARCHIVE = ("masks", "mask", "labels", "label", "segmentation")
"""Names of the array of masks among others, the most telling first."""
LARGEST_VALUE = 65535
"""Largest label of an array: that of a picture of 16 bits."""
_FEWEST_SOFT = 4
"""A mask with fewer values than this is not called soft."""


def read_masks(paths: Sequence[str]) -> Annotations:
    """Read mask images.

    Parameters
    ----------
    paths : sequence of str
        One file per labelled frame. A palette gives indices. Grey values are labels, 255 ignore;
        where all masks together have only 0 and one other value, such as 255, that one is object 1.
        Colours are numbered in order of appearance, black is 0.

    Returns
    -------
    Annotations

    Raises
    ------
    DataError
        If a file cannot be read, or its values are no labels: a JPEG, or a mask with soft edges.
    """
    opened = [(path, number, own) for path in paths for number, own in _opened(path)]
    paths, stored = [path for path, _, _ in opened], [own for _, _, own in opened]
    notes: list[str] = []
    if any(mask.ndim == 3 for mask in stored):
        colours: dict[int, int] = {}
        masks = [_by_colour(mask, colours, path) for mask, path in zip(stored, paths, strict=True)]
        shown = list(map(_colour_name, colours))
        notes.append(
            f"coloured masks: {len(shown)} colours are the objects 1 to {len(shown)} "
            f"({', '.join(shown[:4])}{', ...' if len(shown) > 4 else ''})"
        )
    else:
        masks = stored
        for mask, path in zip(masks, paths, strict=True):
            _check_hard(mask, path)
        masks = _black_and_white(masks, notes)
    found = [
        LabelledFrame(path, number, mask)
        for (path, number, _), mask in zip(opened, masks, strict=True)
    ]
    return Annotations(tuple(found), tuple(notes))


def _opened(path: str) -> list[tuple[int | None, Integers]]:
    """The masks in a file, with the numbers of their frames where it has several."""
    content = read_bytes(path)
    if content.startswith((b"\x93NUMPY", b"PK")):
        return _of_array(content, path)
    return [(None, _stored(path, content))]


def _stored(path: str, content: bytes) -> Integers:
    """The labels [h, w], or the colours [h, w, 3] where the channels differ."""
    if content.startswith(b"\xff\xd8"):
        raise DataError(f"{path}: a JPEG, which blurs the values of labels; save the mask as PNG")
    if not looks_like_picture(path, content[:16]):
        raise DataError(
            f"{path}: not a mask image; expected PNG, TIFF, .npy, ... masks, a table of labelled "
            "points, or files of labelme, COCO, CVAT, VIA, VOC, YOLO or MOTS"
        )
    mask = np.asarray(decode(path, as_indices(content)))
    if mask.dtype.kind not in "ui":
        raise DataError(f"{path}: {mask.dtype} values; expected whole numbers")
    depth = palette_depth(content)
    if mask.ndim == 3:
        colours = mask[..., :3]
        if (colours != colours[..., :1]).any():
            return np.asarray(colours, dtype=np.int64)
        mask = colours[..., 0]
    labels = np.asarray(mask, dtype=np.int64)
    # an index of 1, 2 or 4 bits was decoded as a grey value that fills 8 bits
    return labels // (255 // (2**depth - 1)) if depth in (1, 2, 4) else labels


def _of_array(content: bytes, path: str) -> list[tuple[int | None, Integers]]:
    """The labels of an array of whole numbers: of one picture [h, w], or of frames [f, h, w].

    Truth values are those of objects [n, h, w] in one picture; of objects that overlap, the last
    one counts. A ``.npz`` must hold one array, or one that is called ``masks`` or ``labels``.
    """
    check_arrays(content, path, DataError)
    try:
        array = np.load(io.BytesIO(content), allow_pickle=False)
        if not isinstance(array, np.ndarray):
            array = array[_chosen(array.files, path)]
    except DAMAGED as error:
        reason = " ".join(str(error).split())
        raise DataError(f"{path}: not a readable numpy file ({reason})") from None
    limits.check("stack_pixels", array.size, path)
    if array.dtype.kind == "b" and array.ndim in (2, 3) and 0 not in array.shape:
        mask = np.zeros(array.shape[-2:], dtype=np.int64)
        for number, region in enumerate(array.reshape(-1, *mask.shape), start=1):
            mask[region] = number
        return [(None, mask)]
    if array.ndim == 4 and 1 in (array.shape[1], array.shape[-1]):
        array = np.squeeze(array, axis=1 if array.shape[1] == 1 else 3)
    is_shape = array.ndim == 2 or (array.ndim == 3 and array.shape[2] > 4)  # no colours
    if array.dtype.kind not in "ui" or not is_shape or not array.size or array.min() < 0:
        shape = "x".join(map(str, array.shape))
        raise DataError(
            f"{path}: an array {shape} of {array.dtype}; expected labels [height, width] or "
            "[frames, height, width], whole numbers from 0, or truth values [objects, height, "
            "width]"
        )
    if array.max() > LARGEST_VALUE:
        raise DataError(f"{path}: found {array.max()}; expected labels up to {LARGEST_VALUE}")
    if array.ndim == 2:
        return [(None, np.asarray(array, dtype=np.int64))]
    return [(i, np.asarray(own, dtype=np.int64)) for i, own in enumerate(array)]


def _chosen(names: Sequence[str], path: str) -> str:
    """The array of masks in an archive."""
    known = [name for name in _IN_ARCHIVE if name in names]
    if known or len(names) == 1:
        return (known or list(names))[0]
    raise DataError(
        f"{path}: several arrays ({', '.join(names[:6])}); expected one, or one called masks or "
        "labels"
    )


def palette_depth(content: bytes) -> int:
    """Bits per index of a PNG with a palette; 0 for any other file."""
    if content[:8] != b"\x89PNG\r\n\x1a\n" or content[12:16] != b"IHDR" or len(content) < 33:
        return 0
    return content[24] if content[25] == 3 else 0


def as_indices(content: bytes) -> bytes:
    """A PNG with a palette as one of grey values, which are the indices; others unchanged."""
    if not palette_depth(content):
        return content
    header = content[16:25] + b"\0" + content[26:29]
    parts = [content[:16], header, struct.pack(">I", zlib.crc32(b"IHDR" + header))]
    place = 33
    while place + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, place)
        if content[place + 4 : place + 8] not in (b"PLTE", b"tRNS", b"hIST", b"bKGD", b"sBIT"):
            parts.append(content[place : place + 12 + length])
        place += 12 + length
    return b"".join(parts)


def _by_colour(mask: Integers, colours: dict[int, int], path: str) -> Integers:
    """Labels of a coloured mask; ``colours`` is extended by those that are new."""
    if mask.ndim == 2:
        mask = np.repeat(mask[..., None], 3, axis=2)
    codes = (mask * [1, 1 << 16, 1 << 32]).sum(axis=-1)
    _check_hard(codes, path)
    values, first, inverse = np.unique(codes, return_index=True, return_inverse=True)
    void = int(np.dot(VOID, [1, 1 << 16, 1 << 32]))
    for place in np.argsort(first):
        code = int(values[place])
        if code not in (0, void):
            colours.setdefault(code, len(colours) + 1)
    if len(colours) > MOST_COLOURS:
        raise DataError(
            f"{path}: more than {MOST_COLOURS} colours; expected a mask, one colour per object"
        )
    named = {0: 0, void: IGNORE} | colours
    labels = np.array([named[int(code)] for code in values], dtype=np.int64)
    return labels[inverse].reshape(codes.shape)


def _colour_name(code: int) -> str:
    blue, green, red = code & 0xFFFF, code >> 16 & 0xFFFF, code >> 32
    return f"#{red:02x}{green:02x}{blue:02x}"


def _check_hard(mask: Integers, path: str) -> None:
    """Raises DataError for a mask with soft edges: most of its values fill no place anywhere."""
    values = distinct(mask)
    if len(values) < _FEWEST_SOFT:
        return
    place = np.searchsorted(values, mask).astype(np.float32)
    block = np.ones((3, 3), np.uint8)
    solid = cv2.erode(place, block) == cv2.dilate(place, block)
    filling = len(distinct(place[solid].astype(np.int64)))
    if (len(values) - filling) * 2 > len(values):
        raise DataError(
            f"{path}: {len(values)} values, most of them only along edges: a picture, or a mask "
            "with soft edges; expected labels, saved without smoothing"
        )


def _black_and_white(masks: list[Integers], notes: list[str]) -> list[Integers]:
    """Masks of 0 and one value that marks the object everywhere, as 0 and 1."""
    values = distinct(np.concatenate([distinct(mask) for mask in masks]))
    if len(values) != 2 or values[0] != 0 or values[1] not in (255, 65535):
        return masks
    notes.append(f"the masks have only the values 0 and {values[1]}: {values[1]} is object 1")
    return [np.asarray(mask > 0, dtype=np.int64) for mask in masks]
