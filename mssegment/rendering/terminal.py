"""A picture in the terminal itself, where the terminal can show one: kitty's protocol, or sixel.

Nothing here asks the terminal anything; what it can do is read off its environment, so that a
pipe or a plain terminal never gets a byte that it does not understand.
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
_SIXEL_LEVELS = 6
"""Levels per channel: 216 colours, which every sixel terminal has."""


def protocol_of(environment: Mapping[str, str]) -> str | None:
    """What the terminal of this environment can show: one of ``PROTOCOLS``, or None.

    Inside of tmux or screen, which swallow pictures, None.
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
    """The bytes that make a terminal show a picture [h, w, 3] (blue first), at most ``width`` wide.

    Raises ValueError for a protocol that is not in ``PROTOCOLS``.
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
    raise ValueError(f"no protocol {protocol!r}, expected one of {', '.join(PROTOCOLS)}")


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
    """Six rows at a time; each colour that occurs in them gets a line of its own."""
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
