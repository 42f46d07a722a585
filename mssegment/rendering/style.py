"""Colours, shapes and sizes of pictures, page, tables and videos.

The seven motion colours are those of Okabe and Ito ("Color Universal Design", 2008), which people
with protanopia, deuteranopia or tritanopia can tell apart. Every motion also has a shape and a
number, so that nothing depends on colour alone. With 7 colours and 8 shapes, 56 motions have
different combinations; motion 8 has the colour of motion 1 and another shape.
"""

from __future__ import annotations

import math

from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Record

Colour = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""

PALETTE: tuple[Colour, ...] = (
    (230, 159, 0),  # orange
    (86, 180, 233),  # sky blue
    (0, 158, 115),  # bluish green
    (204, 121, 167),  # reddish purple
    (213, 94, 0),  # vermilion
    (0, 114, 178),  # blue
    (240, 228, 66),  # yellow
)
"""Colours of motions 1 to 7."""
SHAPES: tuple[str, ...] = (
    "circle",
    "square",
    "triangle",
    "diamond",
    "wedge",
    "star",
    "hexagon",
    "plus",
)
"""Marker shapes of motions 1 to 8."""
GLYPHS = {
    "circle": "●",
    "square": "■",
    "triangle": "▲",
    "diamond": "◆",
    "wedge": "▼",
    "star": "★",
    "hexagon": "⬢",
    "plus": "✚",
    "cross": "✕",
    "dot": "·",
    "ring": "○",
}
"""Shape -> the character that shows it in text."""

OUTLIER_COLOUR: Colour = (188, 188, 198)
BACKGROUND_COLOUR: Colour = (196, 200, 208)
CAMERA_COLOUR: Colour = (148, 163, 184)
"""The static world under a moving camera: a quiet slate."""
PLAIN_COLOUR: Colour = (255, 214, 10)
"""Tracks in pictures that do not show labels."""
INK: Colour = (22, 24, 29)
"""Text."""
PAPER: Colour = (255, 255, 255)
"""Background, and rims of markers."""
MUTED: Colour = (95, 99, 109)
"""Secondary text."""

PATH_OPACITY = 0.45
REGION_OPACITY = 0.38
HULL_OPACITY = 0.20


class LabelStyle(Record, frozen=True):
    """How a label is shown: colour, marker shape and name."""

    colour: Colour
    shape: str
    name: str
    is_quiet: bool = False
    """Drawn small and thin, behind the motions."""

    @property
    def glyph(self) -> str:
        """The shape as one character."""
        return GLYPHS[self.shape]

    @property
    def hexadecimal(self) -> str:
        """The colour as ``#rrggbb``."""
        return hexadecimal(self.colour)


def label_style(label: int) -> LabelStyle:
    """The style of a label: motion 1, 2, ..., or a special label of ``records``.

    Examples
    --------
    >>> label_style(1).hexadecimal, label_style(1).shape, label_style(0).name
    ('#e69f00', 'circle', 'outliers')
    """
    if label > 0:
        # 7 and 8 have no common factor: a pair of colour and shape repeats only after 56 motions
        shape = SHAPES[(label - 1) % len(SHAPES)]
        return LabelStyle(PALETTE[(label - 1) % len(PALETTE)], shape, f"motion {label}")
    if label == BACKGROUND:
        return LabelStyle(BACKGROUND_COLOUR, "dot", "background", is_quiet=True)
    if label == NOT_JUDGED:
        return LabelStyle(BACKGROUND_COLOUR, "ring", "not judged", is_quiet=True)
    if label == OUTLIER:
        return LabelStyle(OUTLIER_COLOUR, "cross", "outliers", is_quiet=True)
    return LabelStyle(BACKGROUND_COLOUR, "dot", "ignored", is_quiet=True)


def camera_style(label: int) -> LabelStyle:
    """The style of the motion of the static world under a moving camera."""
    return LabelStyle(CAMERA_COLOUR, "dot", f"camera (motion {label})", is_quiet=True)


def hexadecimal(colour: Colour) -> str:
    """The colour as ``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def bgr(colour: Colour) -> Colour:
    """The colour in OpenCV's order."""
    return colour[2], colour[1], colour[0]


def luminance(colour: Colour) -> float:
    """Relative luminance, 0 to 1 (WCAG 2.1)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in _unit(colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def text_on(colour: Colour) -> Colour:
    """The text colour of higher contrast on ``colour``: ``INK`` or ``PAPER``."""
    light = luminance(colour) + 0.05
    return INK if light / (luminance(INK) + 0.05) >= 1.05 / light else PAPER


def _unit(colour: Colour) -> list[float]:
    """The channels as 0 to 1."""
    return [channel / 255 for channel in colour]


class Sizes(Record, frozen=True):
    """Sizes of markers, lines and text, in pixels of the finished picture.

    Parameters
    ----------
    unit : float
        Size of the picture relative to 960 x 720; all other sizes are multiples of it.
    spacing : float
        Typical distance between markers, which shrink where they would overlap.
    """

    unit: float
    spacing: float = math.inf

    @property
    def marker(self) -> float:
        """Radius of a marker."""
        return min(4.2 * self.unit, max(2.4 * self.unit, 0.5 * self.spacing))

    @property
    def small(self) -> float:
        """Radius of a marker of an outlier or a background track."""
        return 0.6 * self.marker

    @property
    def line(self) -> float:
        """Width of a displacement vector or a trail."""
        return 1.5 * self.unit

    @property
    def outline(self) -> float:
        """Width of the outline of a hull."""
        return 2.2 * self.unit

    @property
    def badge(self) -> float:
        """Radius of the disc with the number of a motion."""
        return 12.0 * self.unit

    @property
    def text(self) -> float:
        """Height of legend text."""
        return 15.0 * self.unit


def sizes(width: int, height: int, spacing: float = math.inf) -> Sizes:
    """Sizes for a picture of ``width`` x ``height`` pixels: unit 1 at 960 x 720, at least 0.6."""
    return Sizes(max(0.6, (width * width + height * height) ** 0.5 / 1200.0), spacing)
