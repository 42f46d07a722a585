"""Which text is laid out in blocks, track by track or frame by frame, from its beginning."""

from __future__ import annotations

import re

HEAD = 3000
"""Bytes of a file from which its layout is determined."""
_NUMBER = r"[-+]?\d[\d.eE+-]*"
_PICTURE = r"\S+\.(?i:jpe?g|png|tiff?|bmp)"
_LAYOUTS = {
    "after_effects": r"Adobe After Effects [\d.]+ Keyframe Data",
    "mtrackj": r"MTrackJ [\d.]+ Data File",
    "klt": r"[\s\S]*?KLT Feature Table\s*\n",
    "colmap_images": r"(#.*\n)*# *IMAGE_ID, QW, QX",
    "colmap_points": r"(#.*\n)*# *POINT3D_ID, X, Y, Z",
    "colmap_matches": rf"{_PICTURE} {_PICTURE}\s*\n\d+ \d+\s*\n",
    "brox": rf"\d+\s*\n\d+\s*\n\d+(\s*\n| +)\d+\s*\n{_NUMBER} +{_NUMBER} +\d+\s*\n",
    "equalizer": rf"\d+\s*\n.+\n\d+\s*\n\d+\s*\n\d+ +{_NUMBER} +{_NUMBER}\s*\n",
    "nuke": r"(#!.*\n|set cut_paste_input.*\n|version [\d.]+ v\d+\n|[\s\S]{0,500}?^Tracker[34] \{)",
    "mots": r"\d+ \d+ \d+ \d+ \d+ \S*[^\d\s.+-]\S*\s*\n",
}
"""How the text of each layout begins."""
_BINARY_MODELS = ("images.bin", "points3d.bin", "cameras.bin", "frames.bin", "rigs.bin")


def layout_of(head: str) -> str:
    """The layout of a text from its first lines; empty for any other text.

    Examples
    --------
    >>> layout_of("MTrackJ 1.5.1 Data File\\n")
    'mtrackj'
    >>> layout_of("x1,y1,x2,y2\\n")
    ''
    """
    text = head.replace("\r\n", "\n").lstrip("\ufeff\n ")
    return next((name for name, start in _LAYOUTS.items() if re.match(start, text)), "")


def is_binary_model(name: str, content: bytes) -> bool:
    """Whether a file is one of COLMAP's binary models, which only its name tells."""
    base = re.split(r"[\\/]", name.lower())[-1]
    return base in _BINARY_MODELS and b"\0" in content[:64]
