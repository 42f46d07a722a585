"""Decode one picture file, of any kind that OpenCV reads, without letting it chatter on stderr."""

from __future__ import annotations

import contextlib
import hashlib
import os
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.errors import DataError

Grey = npt.NDArray[np.float32]
"""A grey picture [height, width], 0 (black) to 255 (white) whatever the depth of the file."""
Colour = npt.NDArray[np.uint8]
"""A colour picture [height, width, 3], red first, 8 bits."""
Pixels = npt.NDArray[np.generic]

PICTURE_SUFFIXES = frozenset(
    {".bmp", ".dib", ".gif", ".jp2", ".jpe", ".jpeg", ".jpg", ".pbm", ".pgm", ".png", ".pnm"}
    | {".ppm", ".tif", ".tiff", ".webp"}
)
"""What a folder's files must end with to be taken as pictures."""

_STDERR = threading.RLock()


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep what OpenCV, libpng and FFmpeg print on file descriptor 2 away from the user.

    They write there from C, past ``sys.stderr``; every failure they would report is raised by us
    as an error that names the file.
    """
    with _STDERR:
        sys.stderr.flush()
        try:
            kept = os.dup(2)
        except OSError:  # the process has no stderr: nothing to keep quiet
            yield
            return
        nowhere = os.open(os.devnull, os.O_WRONLY)
        try:
            os.dup2(nowhere, 2)
            yield
        finally:
            os.dup2(kept, 2)
            os.close(kept)
            os.close(nowhere)


def read_bytes(path: str) -> bytes:
    """The whole file; ``DataError`` that names it where it is missing, empty or not readable."""
    try:
        content = Path(path).read_bytes()
    except FileNotFoundError:
        raise DataError(f"{path}: no such file; check the path") from None
    except OSError as failure:
        raise DataError(f"{path}: cannot be read ({failure.strerror}); check the path") from None
    if not content:
        raise DataError(f"{path}: the file is empty (0 bytes), expected a picture or a video")
    return content


def sha256(path: str) -> str:
    """SHA-256 of a file in hexadecimal, read in pieces (a video may be large)."""
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError:
        raise DataError(f"{path}: no such file; check the path") from None
    except OSError as failure:
        raise DataError(f"{path}: cannot be read ({failure.strerror}); check the path") from None


def looks_like_picture(path: str, head: bytes) -> bool:
    """Whether the first bytes, or else the file's name, say that this is a picture."""
    signatures = (b"\x89PNG", b"\xff\xd8\xff", b"BM", b"II*\0", b"MM\0*", b"GIF8")
    return head.startswith(signatures) or Path(path).suffix.lower() in PICTURE_SUFFIXES


def decode(path: str, content: bytes) -> Pixels:
    """The picture in ``content`` as stored: [h, w] or [h, w, 3 or 4], 8 or 16 bits, blue first.

    The orientation that a camera notes in a JPEG file is applied. Raises ``DataError`` for a file
    that is no picture, is cut short, or has another depth.
    """
    if not _is_whole(content):
        raise DataError(f"{path}: the picture is cut short or damaged; copy or export it again")
    jpeg = content.startswith(b"\xff\xd8")
    how = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH if jpeg else cv2.IMREAD_UNCHANGED
    try:
        with quiet():
            picture = cv2.imdecode(np.frombuffer(content, np.uint8), how)
    except cv2.error:
        picture = None
    if picture is None or picture.size == 0:
        kind = "cut short or damaged" if looks_like_picture(path, content[:8]) else "no picture"
        raise DataError(
            f"{path}: {kind}, expected a whole PNG, JPEG, TIFF, BMP, PGM or WebP file; "
            "copy or export it again"
        )
    if picture.dtype not in (np.uint8, np.uint16):
        raise DataError(
            f"{path}: {picture.dtype} pixels, expected 8 or 16 bits a channel; convert the picture"
        )
    return np.asarray(picture)


def _is_whole(content: bytes) -> bool:
    """Whether a PNG or JPEG has its end marker: some decoders fill what is missing with grey."""
    if content.startswith(b"\x89PNG"):
        return content.find(b"IEND", len(content) // 2) >= 0 or b"IEND" in content
    if content.startswith(b"\xff\xd8\xff"):
        return b"\xff\xd9" in content[max(content.rfind(b"\xff\xda"), 0) :]
    return True


def white_level(picture: Pixels) -> float:
    """The value of full white: 255, or for 16 bits the least 2^b - 1 that nothing exceeds.

    Cameras store 10, 12 or 14 bits in 16; dividing them by 65535 would leave a black picture.
    """
    if picture.dtype == np.uint8:
        return 255.0
    return float(2 ** max(8, int(picture.max()).bit_length()) - 1)


def _opaque(picture: Pixels, white: float) -> npt.NDArray[np.float32]:
    """Colour (or grey) 0..255 with the transparent parts laid over white, as viewers show them."""
    values = np.asarray(picture, np.float32) * np.float32(255.0 / white)
    if values.ndim == 3 and values.shape[2] == 4:
        full = 255.0 if picture.dtype == np.uint8 else 65535.0
        alpha = np.asarray(picture[..., 3:], np.float32) / np.float32(full)
        values = values[..., :3] * alpha + 255 * (1 - alpha)
    return values


def to_grey(picture: Pixels, white: float | None = None) -> Grey:
    """Grey values 0..255 (float32) of a decoded picture; fractions of 16-bit values are kept."""
    values = _opaque(picture, white or white_level(picture))
    if values.ndim == 3:
        values = np.asarray(cv2.cvtColor(values, cv2.COLOR_BGR2GRAY), np.float32)
    return np.ascontiguousarray(values, np.float32)


def to_colour(picture: Pixels, white: float | None = None) -> Colour:
    """Red, green, blue, 8 bits each, of a decoded picture."""
    values = np.clip(np.rint(_opaque(picture, white or white_level(picture))), 0, 255)
    values = np.repeat(values[..., None], 3, axis=2) if values.ndim == 2 else values[..., ::-1]
    return np.ascontiguousarray(values, np.uint8)
