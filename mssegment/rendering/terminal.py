"""Pictures in the terminal, where it can show them: kitty's protocol, iTerm2's, or sixel.

What the terminal can do is read from its environment, never asked for with escape sequences, so
that a pipe or a plain terminal does not receive bytes that it does not understand.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping

import cv2
import numpy as np

from mssegment.records import Integers
from mssegment.rendering.report import Picture

PROTOCOLS = ("kitty", "iterm", "sixel")
_KITTY_CHUNK = 4096
"""Bytes of base64 in one escape sequence, the limit of the protocol."""
_SIXEL_LEVELS = 6
"""Levels per channel: 216 colours, which every sixel terminal can show."""


def protocol_of(environment: Mapping[str, str]) -> str | None:
    """The protocol of the terminal with these environment variables, or None.

    One of ``PROTOCOLS``. None inside tmux or screen, which do not pass pictures on.
    """
    term = environment.get("TERM", "")
    program = environment.get("TERM_PROGRAM", "")
    if "TMUX" in environment or term.startswith(("screen", "tmux", "dumb")):
        return None
    if "KITTY_WINDOW_ID" in environment or term in ("xterm-kitty", "xterm-ghostty"):
        return "kitty"
    if program in ("ghostty", "WezTerm"):
        return "kitty"
    if program == "iTerm.app":
        return "iterm"
    if term.startswith(("mlterm", "foot", "yaft", "contour")) or "sixel" in term:
        return "sixel"
    return None


def show(picture: Picture, protocol: str, width: int = 800) -> bytes:
    """Encode a picture for a terminal.

    Parameters
    ----------
    picture : uint8 array [height, width, 3]
        In BGR order.
    protocol : str
        One of ``PROTOCOLS``.
    width : int
        A wider picture is reduced to this width in pixels.

    Returns
    -------
    bytes
        Escape sequences to write to the terminal.

    Raises
    ------
    ValueError
        For another protocol.
    """
    height, full = picture.shape[:2]
    if full > width:
        size = (width, max(1, round(height * width / full)))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    if protocol == "kitty":
        return _kitty(_png(picture))
    if protocol == "iterm":
        encoded = base64.b64encode(_png(picture))
        return b"\x1b]1337;File=inline=1;preserveAspectRatio=1:" + encoded + b"\x07\n"
    if protocol == "sixel":
        return _sixel(picture)
    raise ValueError(f"protocol {protocol!r}: expected {', '.join(PROTOCOLS)}")


def _png(picture: Picture) -> bytes:
    return bytes(cv2.imencode(".png", picture)[1].tobytes())


def _kitty(png: bytes) -> bytes:
    encoded = base64.b64encode(png)
    chunks = [encoded[i : i + _KITTY_CHUNK] for i in range(0, len(encoded), _KITTY_CHUNK)]
    parts = []
    for i, chunk in enumerate(chunks):
        control = b"a=T,f=100," if i == 0 else b""
        more = b"m=1" if i < len(chunks) - 1 else b"m=0"
        parts.append(b"\x1b_G" + control + more + b";" + chunk + b"\x1b\\")
    return b"".join(parts) + b"\n"


def _sixel(picture: Picture) -> bytes:
    """Sixel data: bands of six rows, with one line for every colour in a band."""
    height, width = picture.shape[:2]
    levels = np.round(picture[..., ::-1].astype(np.float64) / 255 * (_SIXEL_LEVELS - 1))
    colours = levels.astype(np.int64) @ np.array([_SIXEL_LEVELS**2, _SIXEL_LEVELS, 1])
    parts = [f'\x1bP0;1q"1;1;{width};{height}']
    for colour in np.unique(colours):
        red, rest = divmod(int(colour), _SIXEL_LEVELS**2)
        shares = (red, *divmod(rest, _SIXEL_LEVELS))
        percent = ";".join(str(round(100 * share / (_SIXEL_LEVELS - 1))) for share in shares)
        parts.append(f"#{int(colour)};2;{percent}")
    for top in range(0, height, 6):
        parts.append(_sixel_band(colours[top : top + 6]))
    return ("".join(parts) + "\x1b\\\n").encode("ascii")


def _sixel_band(band: Integers) -> str:
    bits = 1 << np.arange(len(band))
    lines = []
    for colour in np.unique(band):
        column = bits @ (band == colour)
        lines.append(f"#{int(colour)}{_run_lengths(column)}")
    return "$".join(lines) + "-"


def _run_lengths(values: Integers) -> str:
    starts = np.flatnonzero(np.r_[True, np.diff(values) != 0])
    lengths = np.diff(np.r_[starts, len(values)])
    return "".join(
        f"!{length}{chr(63 + values[start])}" if length > 3 else chr(63 + values[start]) * length
        for start, length in zip(starts.tolist(), lengths.tolist(), strict=True)
    )
