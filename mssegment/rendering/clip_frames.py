"""The frames of the video of a long clip: objects with trails, and their numbers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import Floats, Record
from mssegment.rendering import style
from mssegment.rendering.raster import paint
from mssegment.rendering.report import Picture
from mssegment.rendering.scene import Badge, Item, Lines, Markers, Scene

TRAIL_FRAMES = 12
"""Frames that a trail covers."""
TRAIL_OPACITY = 0.6


class ShownObject(Record, frozen=True):
    """An object in one frame.

    Attributes
    ----------
    identity : int
        Its number.
    points : ndarray [n, 2]
        The positions of its tracks in pixels.
    trails : tuple of ndarray [k, 2]
        The positions of these tracks in the frames before, up to this one.
    is_resting : bool
        Whether it stands still.
    """

    identity: int
    points: Floats
    trails: tuple[Floats, ...] = ()
    is_resting: bool = False


def draw_frame(picture: Picture, background: Floats, objects: Sequence[ShownObject]) -> Picture:
    """Draw objects on a frame.

    Parameters
    ----------
    picture : uint8 array [height, width, 3]
        The frame in BGR order.
    background : ndarray [n, 2]
        The positions of the tracks of the static world, drawn small.
    objects : sequence of ShownObject
        The objects.

    Returns
    -------
    uint8 array [height, width, 3]
        With even sides, as codecs need them.
    """
    height, width = (side - side % 2 for side in picture.shape[:2])
    size = style.sizes(width, height)
    scene = Scene(width, height, [(0, 0, np.ascontiguousarray(picture[:height, :width]))])
    scene.add([Markers(background, "dot", size.small, style.BACKGROUND_COLOUR)])
    for one in objects:
        scene.add([Lines(one.trails, _colour(one), size.line, (), TRAIL_OPACITY)])
    for one in objects:
        look = style.label_style(one.identity)
        shape = "ring" if one.is_resting else look.shape
        scene.add([Markers(one.points, shape, 0.8 * size.marker, look.colour, 0.2 * size.marker)])
    scene.add([_badge(one, 0.8 * size.badge, width, height) for one in objects])
    return paint(scene)


def _colour(one: ShownObject) -> style.Colour:
    return style.label_style(one.identity).colour


def _badge(one: ShownObject, radius: float, width: int, height: int) -> Item:
    """The number of an object, above its tracks."""
    x, y = np.median(one.points[:, 0]), one.points[:, 1].min() - 1.5 * radius
    return Badge(
        float(np.clip(x, radius, width - radius)),
        float(np.clip(y, radius, height - radius)),
        radius,
        _colour(one),
        str(one.identity),
    )
