"""The one place for colours, shapes and sizes: pictures, page, tables and videos all look here.

The seven motion colours are those of Okabe and Ito ("Color Universal Design", 2008), which people
with protanopia, deuteranopia or tritanopia can tell apart; every motion also has a shape and a
number, so that nothing depends on colour alone. Motion 8 repeats the colour of motion 1 with
another shape: there are 7 colours and 8 shapes, hence 56 combinations.
"""

from __future__ import annotations

import math

from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Record

Colour = tuple[int, int, int]
"""Red, green, blue, 0..255."""

PALETTE: tuple[Colour, ...] = (
    (230, 159, 0),  # orange
    (86, 180, 233),  # sky blue
    (0, 158, 115),  # bluish green
    (204, 121, 167),  # reddish purple
    (213, 94, 0),  # vermilion
    (0, 114, 178),  # blue
    (240, 228, 66),  # yellow
)
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

OUTLIER_COLOUR: Colour = (188, 188, 198)
BACKGROUND_COLOUR: Colour = (196, 200, 208)
PLAIN_COLOUR: Colour = (255, 214, 10)
"""Points before anything is known about them."""
INK: Colour = (22, 24, 29)
PAPER: Colour = (255, 255, 255)
MUTED: Colour = (95, 99, 109)

PATH_OPACITY = 0.62
REGION_OPACITY = 0.38
HULL_OPACITY = 0.20


class Mark(Record, frozen=True):
    """How one label looks: colour, shape, text glyph and name."""

    colour: Colour
    shape: str
    name: str

    @property
    def glyph(self) -> str:
        """The shape as one character."""
        return GLYPHS[self.shape]

    @property
    def hexadecimal(self) -> str:
        """The colour as ``#rrggbb``."""
        return hexadecimal(self.colour)


def mark(label: int) -> Mark:
    """The look of a label: a motion (1, 2, ...), an outlier, background, or not judged."""
    if label > 0:
        # shapes step on after each round of the colours, so that the pair repeats only after 56
        shape = SHAPES[(label - 1) % len(SHAPES)]
        return Mark(PALETTE[(label - 1) % len(PALETTE)], shape, f"motion {label}")
    if label == BACKGROUND:
        return Mark(BACKGROUND_COLOUR, "dot", "background")
    if label == NOT_JUDGED:
        return Mark(BACKGROUND_COLOUR, "ring", "not judged")
    if label == OUTLIER:
        return Mark(OUTLIER_COLOUR, "cross", "outliers")
    return Mark(BACKGROUND_COLOUR, "dot", "ignored")


def hexadecimal(colour: Colour) -> str:
    """A colour as ``#rrggbb``."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def bgr(colour: Colour) -> Colour:
    """A colour in OpenCV's order."""
    return colour[2], colour[1], colour[0]


def luminance(colour: Colour) -> float:
    """Relative luminance 0..1 (WCAG 2.1)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in _unit(colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def text_on(colour: Colour) -> Colour:
    """Ink or paper, whichever reads better on ``colour``."""
    light = luminance(colour) + 0.05
    return INK if light / (luminance(INK) + 0.05) >= 1.05 / light else PAPER


def _unit(colour: Colour) -> list[float]:
    return [channel / 255 for channel in colour]


class Sizes(Record, frozen=True):
    """Lengths in pixels of the finished picture, all from one unit that grows with the picture.

    ``spacing`` is how far markers typically lie from each other: they shrink where they would
    cover each other.
    """

    unit: float
    spacing: float = math.inf

    @property
    def marker(self) -> float:
        """Radius of a marker."""
        return min(4.2 * self.unit, max(2.4 * self.unit, 0.5 * self.spacing))

    @property
    def small(self) -> float:
        """Radius of an outlier's or background marker."""
        return 0.6 * self.marker

    @property
    def line(self) -> float:
        """Width of a displacement vector or a trail."""
        return 1.5 * self.unit

    @property
    def outline(self) -> float:
        """Width of a hull."""
        return 2.2 * self.unit

    @property
    def badge(self) -> float:
        """Radius of a motion number's disc."""
        return 12.0 * self.unit

    @property
    def text(self) -> float:
        """Height of legend text."""
        return 15.0 * self.unit


def sizes(width: int, height: int, spacing: float = math.inf) -> Sizes:
    """The sizes for a picture: unit 1 at 960 x 720, never below 0.6."""
    return Sizes(max(0.6, (width * width + height * height) ** 0.5 / 1200.0), spacing)
