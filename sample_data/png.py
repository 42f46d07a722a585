"""Write 8-bit grey and palette PNG files with zlib alone: the same whatever is installed."""

from __future__ import annotations

import struct
import zlib

import numpy as np
import numpy.typing as npt

Bytes = npt.NDArray[np.uint8]


def encode(picture: Bytes, palette: Bytes | None = None) -> bytes:
    """PNG of a picture [h, w]: grey values, or indices into ``palette`` [n, 3] (red first)."""
    height, width = picture.shape
    colour_type = 0 if palette is None else 3
    header = struct.pack(">IIBBBBB", width, height, 8, colour_type, 0, 0, 0)
    chunks = [(b"IHDR", header)]
    if palette is not None:
        chunks.append((b"PLTE", palette.astype(np.uint8).tobytes()))
    chunks.append((b"IDAT", zlib.compress(_filtered(picture).tobytes(), 9)))
    chunks.append((b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(_chunk(kind, data) for kind, data in chunks)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _filtered(picture: Bytes) -> Bytes:
    """Each row by the filter (none, sub, up, average, Paeth) with the least sum of magnitudes."""
    here = picture.astype(np.int16)
    left = np.pad(here, ((0, 0), (1, 0)))[:, :-1]
    above = np.pad(here, ((1, 0), (0, 0)))[:-1]
    corner = np.pad(here, ((1, 0), (1, 0)))[:-1, :-1]
    guess = left + above - corner
    away_left, away_above, away_corner = (abs(guess - p) for p in (left, above, corner))
    nearer_left = (away_left <= away_above) & (away_left <= away_corner)
    paeth = np.where(nearer_left, left, np.where(away_above <= away_corner, above, corner))
    predictions = np.stack([np.zeros_like(here), left, above, (left + above) // 2, paeth])
    rest = (here - predictions).astype(np.uint8)
    cost = np.abs(rest.astype(np.int8).astype(np.int64)).sum(axis=2)
    best = cost.argmin(axis=0)
    rows = rest[best, np.arange(len(best))]
    return np.concatenate([best[:, None].astype(np.uint8), rows], axis=1)
