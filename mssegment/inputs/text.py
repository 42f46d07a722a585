"""Text of others made fit to be shown: no control characters, no direction marks, not too long."""

from __future__ import annotations

import unicodedata

_HIDDEN = frozenset({"Cc", "Cf", "Cn", "Co", "Cs", "Zl", "Zp"})
"""Unicode categories that a terminal obeys, does not show, or cannot know."""


def printable(text: str, longest: int | None = None) -> str:
    r"""The text with control characters and direction marks as escapes, cut in the middle.

    Parameters
    ----------
    text : str
        Any text; tabs and line feeds are control characters too.
    longest : int, optional
        Where it is longer than this, its middle becomes ``...``: what an error tells to do stands
        at its end.

    Returns
    -------
    str

    Examples
    --------
    >>> print(printable("red: \x1b[31m"))
    red: \u001b[31m
    >>> printable("0123456789", longest=7)
    '012...9'
    """
    if not (text.isascii() and text.isprintable()):
        text = "".join(
            _escaped(letter) if unicodedata.category(letter) in _HIDDEN else letter
            for letter in text
        )
    if longest is None or len(text) <= longest:
        return text
    tail = (longest - 3) // 3
    return f"{text[: longest - 3 - tail]}...{text[len(text) - tail :]}"


def printable_lines(text: str) -> str:
    """As ``printable``, but keeps line feeds and tabs."""
    if text.isascii() and text.replace("\n", "").isprintable():
        return text
    kept = (line.split("\t") for line in text.split("\n"))
    return "\n".join("\t".join(printable(part) for part in line) for line in kept)


def _escaped(letter: str) -> str:
    code = ord(letter)  # the form of JSON, which stays valid
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"
