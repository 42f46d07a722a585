"""Decode a picture file of any kind that OpenCV reads."""

from __future__ import annotations

import hashlib
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.errors import DataError
from mssegment.imaging.headers import check_size
from mssegment.inputs.files import check_kind, read_file
from mssegment.inputs.standard_error import quiet

GreyPicture = npt.NDArray[np.float32]
"""Grey values [height, width], 0 (black) to 255 (white) whatever the bit depth of the file."""
RgbPicture = npt.NDArray[np.uint8]
"""Red, green, blue [height, width, 3], 8 bits each."""
StoredPicture = npt.NDArray[np.generic]
"""A decoded file: [height, width] or BGR(A) [height, width, 3 or 4], 8 or 16 bits a channel."""

PICTURE_SUFFIXES = frozenset(
    {".bmp", ".dib", ".gif", ".jp2", ".jpe", ".jpeg", ".jpg", ".pbm", ".pgm", ".png", ".pnm"}
    | {".apng", ".ppm", ".tif", ".tiff", ".webp"}
)
"""Files in a folder with one of these suffixes are taken as pictures."""
MOTION_JPEG_SUFFIXES = (".mjpeg", ".mjpg")
"""Streams of JPEG pictures, one after the other."""

_MISSING = "no such file; check the path"
_NO_MEMORY = -4
"""OpenCV's code of an allocation that failed (``cv::Error::StsNoMem``)."""


def read_bytes(path: str) -> bytes:
    """The content of a file; raises DataError if it is missing, unreadable or empty."""
    content = read_file(path, expected="a picture or a video", missing=_MISSING, may_be_pipe=False)
    if not content:
        raise DataError(
            f"{path}: the file is empty (0 bytes), expected a picture or a video; "
            "copy or export it again"
        )
    return content


def sha256(path: str) -> str:
    """SHA-256 of a file in hexadecimal; raises DataError if it is missing or unreadable."""
    check_kind(path, expected="a picture or a video", missing=_MISSING)
    try:
        with Path(path).open("rb") as file:
            # in pieces: a video may not fit into memory
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as failure:
        raise DataError(f"{path}: cannot be read ({failure.strerror}); check the path") from None


def looks_like_picture(path: str, head: bytes) -> bool:
    """Whether the first bytes of a file, or else its suffix, are those of a picture."""
    signatures = (b"\x89PNG", b"\xff\xd8\xff", b"BM", b"II*\0", b"MM\0*", b"GIF8")
    is_webp = head[:4] == b"RIFF" and head[8:12] == b"WEBP"
    suffix = Path(path).suffix.lower()
    return head.startswith(signatures) or is_webp or suffix in PICTURE_SUFFIXES


def is_motion_jpeg(path: str, head: bytes) -> bool:
    """Whether a file that begins as a JPEG picture is a stream of them.

    Only its name tells it from a photo with a thumbnail or a second view behind it.
    """
    return head.startswith(b"\xff\xd8\xff") and path.lower().endswith(MOTION_JPEG_SUFFIXES)


def decode(path: str, content: bytes) -> StoredPicture:
    """Decode a picture, applying the orientation that EXIF notes.

    Parameters
    ----------
    path : str
        Name of the file, for errors.
    content : bytes
        The whole file.

    Returns
    -------
    uint8 or uint16 array [height, width] or [height, width, 3 or 4]
        Grey, BGR or BGRA values as stored.

    Raises
    ------
    DataError
        If the content is no picture, is truncated, is larger than ``limits.picture_pixels``, or
        has pixels of another kind than 8 bits, 16 bits or numbers with a fraction.
    """
    if content.startswith(b"version https://git-lfs"):
        raise DataError(f"{path}: a pointer of Git LFS; `git lfs pull` fetches the picture itself")
    check_size(path, content)
    if not _has_end(content):
        raise DataError(f"{path}: the picture is cut short or damaged; copy or export it again")
    jpeg = content.startswith(b"\xff\xd8")
    flags = cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH if jpeg else cv2.IMREAD_UNCHANGED
    try:
        with quiet():
            picture = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except (cv2.error, MemoryError) as failure:
        check_memory(failure, path)
        picture = None
    if picture is None or picture.size == 0:
        fault = "cut short or damaged" if looks_like_picture(path, content[:8]) else "not a picture"
        raise DataError(
            f"{path}: {fault}, expected a complete PNG, JPEG, TIFF, BMP, PGM or WebP file; "
            "copy or export it again"
        )
    found = check_depth(np.asarray(picture), path)
    if jpeg:
        return found
    from mssegment.imaging.orientation import orientation, upright

    turned = orientation(content)
    return found if turned == 1 else upright(found, turned)


def check_memory(failure: Exception, path: str) -> None:
    """Raises DataError if a decoder failed for lack of memory: the file may be whole."""
    if isinstance(failure, MemoryError) or getattr(failure, "code", 0) == _NO_MEMORY:
        raise DataError(
            f"{path}: there is not enough memory to decode it; use smaller pictures"
        ) from None


def check_depth(picture: StoredPicture, path: str) -> StoredPicture:
    """The picture with 8 or 16 bits per channel.

    Numbers with a fraction (scientific TIFF) are mapped from 0 and their largest value to 16 bits,
    or from their smallest value if that is negative.

    Raises DataError for pixels of another kind, or that are not finite.
    """
    if picture.dtype in (np.uint8, np.uint16):
        return picture
    if picture.dtype not in (np.float32, np.float64):
        raise DataError(
            f"{path}: {picture.dtype} pixels, expected 8 or 16 bits per channel; "
            "convert the picture"
        )
    values = np.asarray(picture, np.float32)
    if not np.isfinite(values).all():
        raise DataError(f"{path}: pixels that are NaN or infinite; convert the picture to 16 bits")
    low = min(float(values.min()), 0.0)
    high = 1.0 if low == 0 and values.max() <= 1 else float(values.max())
    scaled = (values - low) * np.float32(65535 / max(high - low, 1e-12))
    return np.asarray(np.rint(scaled), np.uint16)


def _has_end(content: bytes) -> bool:
    """Whether a PNG or JPEG has its end marker: some decoders fill what is missing with grey."""
    if content.startswith(b"\x89PNG"):
        return content.find(b"IEND", len(content) // 2) >= 0 or b"IEND" in content
    if content.startswith(b"\xff\xd8\xff"):
        return b"\xff\xd9" in content[max(content.rfind(b"\xff\xda"), 0) :]
    return True


def white_level(picture: StoredPicture) -> float:
    """The value of white: 255 for 8 bits, else the least 2**b - 1 that no value exceeds.

    Cameras store 10, 12 or 14 bits in 16; dividing them by 65535 would give a black picture.
    """
    if picture.dtype == np.uint8:
        return 255.0
    return float(2 ** max(8, int(picture.max()).bit_length()) - 1)


def is_invisible(picture: StoredPicture) -> bool:
    """Whether a picture is transparent everywhere, so that viewers show nothing of it."""
    return picture.ndim == 3 and picture.shape[2] == 4 and not picture[..., 3].any()


def _opaque(picture: StoredPicture, white: float) -> npt.NDArray[np.float32]:
    """Values 0 to 255, with transparent parts blended over white as viewers show them.

    A picture that is transparent everywhere is taken as opaque: renderers and cameras write such
    channels without meaning.
    """
    if is_invisible(picture):
        picture = picture[..., :3]
    values = np.asarray(picture, np.float32) * np.float32(255.0 / white)
    if values.ndim == 3 and values.shape[2] == 4:
        full = 255.0 if picture.dtype == np.uint8 else 65535.0
        alpha = np.asarray(picture[..., 3:], np.float32) / np.float32(full)
        values = values[..., :3] * alpha + 255 * (1 - alpha)
    return values


def to_grey(picture: StoredPicture, white: float | None = None) -> GreyPicture:
    """Grey values [height, width], 0 to 255, without rounding 16-bit values.

    ``white`` is the value of white, by default that of ``white_level``.
    """
    values = _opaque(picture, white or white_level(picture))
    if values.ndim == 3:
        values = np.asarray(cv2.cvtColor(values, cv2.COLOR_BGR2GRAY), np.float32)
    return np.ascontiguousarray(values, np.float32)


def to_rgb(picture: StoredPicture, white: float | None = None) -> RgbPicture:
    """Red, green and blue [height, width, 3], 8 bits each; ``white`` as in ``to_grey``."""
    if picture.dtype == np.uint8 and picture.ndim == 3 and picture.shape[2] == 3:
        return np.asarray(cv2.cvtColor(np.asarray(picture, np.uint8), cv2.COLOR_BGR2RGB), np.uint8)
    values = np.clip(np.rint(_opaque(picture, white or white_level(picture))), 0, 255)
    values = np.repeat(values[..., None], 3, axis=2) if values.ndim == 2 else values[..., ::-1]
    return np.ascontiguousarray(values, np.uint8)
