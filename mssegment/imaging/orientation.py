"""The orientation that EXIF notes in PNG, WebP and TIFF files; JPEG is left to the decoder."""

from __future__ import annotations

import struct

import numpy as np

from mssegment.imaging.pictures import StoredPicture

_TAG = 0x0112
_UPRIGHT = 1


def orientation(content: bytes) -> int:
    """The EXIF orientation, 1 to 8, in the bytes of a PNG, WebP or TIFF file; 1 for none."""
    try:
        if content.startswith(b"\x89PNG"):
            return _in_tiff(_png_exif(content))
        if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
            return _in_tiff(_webp_exif(content))
        if content[:4] in (b"II*\0", b"MM\0*"):
            return _in_tiff(content)
    except struct.error:  # a damaged note is no note
        pass
    return _UPRIGHT


def upright(picture: StoredPicture, orientation: int) -> StoredPicture:
    """The picture as it is to be shown, for an EXIF orientation of 1 to 8."""
    if orientation in (5, 6, 7, 8):
        picture = np.swapaxes(picture, 0, 1)
    if orientation in (3, 4, 7, 8):
        picture = picture[::-1]
    if orientation in (2, 3, 6, 7):
        picture = picture[:, ::-1]
    return np.ascontiguousarray(picture)


def _png_exif(content: bytes) -> bytes:
    start = 8
    while start + 8 <= len(content):
        length, name = struct.unpack_from(">I4s", content, start)
        if name == b"eXIf":
            return content[start + 8 : start + 8 + length]
        start += 12 + length
    return b""


def _webp_exif(content: bytes) -> bytes:
    start = 12
    while start + 8 <= len(content):
        name, length = struct.unpack_from("<4sI", content, start)
        if name == b"EXIF":
            return content[start + 8 : start + 8 + length].removeprefix(b"Exif\0\0")
        start += 8 + length + length % 2
    return b""


def _in_tiff(content: bytes) -> int:
    """The orientation in the first directory of TIFF data."""
    order = {b"II": "<", b"MM": ">"}.get(content[:2])
    if order is None:
        return _UPRIGHT
    (start,) = struct.unpack_from(order + "I", content, 4)
    (count,) = struct.unpack_from(order + "H", content, start)
    for i in range(count):
        tag, _, _, value = struct.unpack_from(order + "HHIH", content, start + 2 + 12 * i)
        if tag == _TAG:
            return value if 1 <= value <= 8 else _UPRIGHT
    return _UPRIGHT
