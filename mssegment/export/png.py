"""Indexed and grey PNG files. OpenCV writes no palettes, and other tools read the indices."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]


def voc_palette() -> Bytes:
    """The colours [256, 3] (red first) of masks in PASCAL VOC and DAVIS.

    Each bit of an index is a bit of one channel, so that neighbouring indices differ clearly.

    Examples
    --------
    >>> voc_palette()[:4].tolist()
    [[0, 0, 0], [128, 0, 0], [0, 128, 0], [128, 128, 0]]
    """
    index = np.arange(256)
    colours = np.zeros((256, 3), dtype=np.int64)
    for level in range(8):
        for channel in range(3):
            colours[:, channel] |= ((index >> (3 * level + channel)) & 1) << (7 - level)
    return colours.astype(np.uint8)


def encode_png(picture: Bytes, palette: Bytes | None = None) -> bytes:
    """The content of a PNG of 8 bits per pixel.

    Parameters
    ----------
    picture : ndarray [h, w] of uint8
        Grey values, or indices into the palette.
    palette : ndarray [n, 3] of uint8, optional
        Colours, red first.
    """
    height, width = picture.shape
    colour_type = 0 if palette is None else 3
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, colour_type, 0, 0, 0))]
    if palette is not None:
        chunks.append((b"PLTE", palette.tobytes()))
    # filter 2, the difference from the row above, leaves little of a mask
    rows = np.full((height, width + 1), 2, dtype=np.uint8)
    rows[:, 1:] = np.diff(picture, axis=0, prepend=np.zeros((1, width), dtype=np.uint8))
    chunks += [(b"IDAT", zlib.compress(rows.tobytes())), (b"IEND", b"")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, content) for kind, content in chunks)


def _chunk(kind: bytes, content: bytes) -> bytes:
    check = struct.pack(">I", zlib.crc32(kind + content))
    return struct.pack(">I", len(content)) + kind + content + check
