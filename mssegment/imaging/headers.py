"""The size that a picture file states in its header, before anything is decoded.

OpenCV allocates what a header states, whatever the file holds. Formats: PNG (W3C, 3rd edition),
JPEG (ITU-T T.81, B.2.2), GIF89a, BMP, WebP (RFC 9649), TIFF 6.0, Netpbm, JPEG 2000 (ISO 15444-1).
"""

from __future__ import annotations

import re
import struct

from mssegment.errors import DataError
from mssegment.inputs import limits

_PNG = b"\x89PNG\r\n\x1a\n"
_NETPBM = re.compile(rb"P[1-6](?:\s+|#[^\n]*\n)+(\d+)(?:\s+|#[^\n]*\n)+(\d+)")
_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_MOST_PAGES = 100_000

Size = tuple[int, int]
"""Width and height in pixels."""


def check_size(path: str, content: bytes) -> None:
    """Check what a picture file states about its size.

    Parameters
    ----------
    path : str
        Name of the file, for errors.
    content : bytes
        The whole file.

    Raises
    ------
    DataError
        If the picture is larger than ``limits.picture_pixels``, or a chunk of a PNG is longer than
        the file.
    """
    if content.startswith(_PNG) and not _png_chunks_fit(content):
        raise DataError(f"{path}: the picture is cut short or damaged; copy or export it again")
    for width, height in sizes_of(content):
        limits.check("picture_pixels", width * height, f"{path}: {width}x{height}")


def check_stack(path: str, content: bytes, pictures: int) -> None:
    """Raises DataError if all pictures of a stack together exceed ``limits.stack_pixels``."""
    largest = max((width * height for width, height in sizes_of(content)), default=0)
    limits.check("stack_pixels", largest * pictures, f"{path}: {pictures} pictures")


def sizes_of(content: bytes) -> list[Size]:
    """The sizes that a file states: one, or that of each page of a TIFF; empty if unknown."""
    try:
        if content.startswith(_PNG):
            return [struct.unpack_from(">II", content, 16)]
        if content.startswith(b"\xff\xd8"):
            return _jpeg(content)
        if content.startswith(b"GIF8"):
            return [struct.unpack_from("<HH", content, 6)]
        if content.startswith(b"BM"):
            return [_bmp(content)]
        if content[:4] == b"RIFF" and content[8:12] == b"WEBP":
            return _webp(content)
        if content[:4] in (b"II*\0", b"MM\0*"):
            return _tiff(content)
        if content[4:8] == b"jP  " or content.startswith(b"\xff\x4f\xff\x51"):
            return _jpeg2000(content)
        found = _NETPBM.match(content[:4096])
        return [(int(found[1]), int(found[2]))] if found else []
    except (struct.error, ValueError):
        return []  # cut short: the decoder says so


def _png_chunks_fit(content: bytes) -> bool:
    """Whether every chunk up to the last one lies inside the file."""
    place = len(_PNG)
    while place + 8 <= len(content):
        length, name = struct.unpack_from(">I4s", content, place)
        place += 12 + length
        if name == b"IEND":
            return True
        if place > len(content):
            return False
    return True


def _jpeg(content: bytes) -> list[Size]:
    place = 2
    while place + 9 <= len(content):
        if content[place] != 0xFF:
            place += 1
            continue
        marker = content[place + 1]
        if marker in _START_OF_FRAME:
            height, width = struct.unpack_from(">HH", content, place + 5)
            return [(width, height)]
        if marker in (0x01, 0xFF) or 0xD0 <= marker <= 0xD8:
            place += 1 if marker == 0xFF else 2
            continue
        place += 2 + struct.unpack_from(">H", content, place + 2)[0]
    return []


def _bmp(content: bytes) -> Size:
    (header,) = struct.unpack_from("<I", content, 14)
    width, height = struct.unpack_from("<HH" if header == 12 else "<ii", content, 18)
    return abs(width), abs(height)


def _webp(content: bytes) -> list[Size]:
    kind = content[12:16]
    if kind == b"VP8X":
        width = int.from_bytes(content[24:27], "little")
        height = int.from_bytes(content[27:30], "little")
        return [(width + 1, height + 1)]
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", content, 21)
        return [((bits & 0x3FFF) + 1, (bits >> 14 & 0x3FFF) + 1)]
    if kind == b"VP8 ":
        width, height = struct.unpack_from("<HH", content, 26)
        return [(width & 0x3FFF, height & 0x3FFF)]
    return []


def _tiff(content: bytes) -> list[Size]:
    return [(tags.get(256, 0), tags.get(257, 0)) for tags in tiff_tags(content) if 256 in tags]


def tiff_tags(content: bytes) -> list[dict[int, int]]:
    """The tags of each page of a TIFF with their first values, as far as the file is whole."""
    order = "<" if content[:2] == b"II" else ">"
    pages: list[dict[int, int]] = []
    seen: set[int] = set()
    try:
        (start,) = struct.unpack_from(order + "I", content, 4)
        while start and start not in seen and len(pages) < _MOST_PAGES:
            seen.add(start)  # a damaged file may refer back to an earlier page
            (count,) = struct.unpack_from(order + "H", content, start)
            tags: dict[int, int] = {}
            for i in range(count):
                place = start + 2 + 12 * i
                tag, kind = struct.unpack_from(order + "HH", content, place)
                form = "H" if kind == 3 else "I"
                (tags[tag],) = struct.unpack_from(order + form, content, place + 8)
            pages.append(tags)
            (start,) = struct.unpack_from(order + "I", content, start + 2 + 12 * count)
    except struct.error:
        pass  # the decoder names what is damaged
    return pages


def _jpeg2000(content: bytes) -> list[Size]:
    place = content.find(b"\xff\x4f\xff\x51")  # start of the code stream, and its sizes
    if place < 0:
        return []
    right, bottom, left, top = struct.unpack_from(">IIII", content, place + 8)
    return [(max(right - left, 0), max(bottom - top, 0))]
