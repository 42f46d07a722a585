"""Layout of annotated pictures: the frame, the legend below it, the numbers of the motions."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import cv2
import numpy as np

from mssegment.records import Floats, Record, replace
from mssegment.rendering import style
from mssegment.rendering.regions import spacing
from mssegment.rendering.report import Picture, Report
from mssegment.rendering.scene import (
    TEXT_WIDTH,
    Areas,
    Badge,
    Item,
    Label,
    Lines,
    Markers,
    Scene,
)

MIN_LONG_SIDE = 960
"""Pixels; smaller pictures are enlarged to this, so that markers do not cover the objects."""
MAX_ENLARGEMENT = 2.0
MAX_LONG_SIDE = 1920
"""Pixels; larger pictures are reduced to this: screens show no more, and drawing takes longer."""
BLANK = 236
"""Grey value where there is no picture."""


class FrameView(Record, frozen=True):
    """One frame as it is drawn.

    Parameters
    ----------
    index : int
        Number of the frame.
    photograph : uint8 array [height, width, 3]
        The frame in BGR order, enlarged or reduced, with less colour and contrast.
    scale : float
        Pixels of the photograph per pixel of the frame.
    spacing : float
        Typical distance between inliers, pixels of the frame.
    """

    index: int
    photograph: Picture
    scale: float
    spacing: float = math.inf

    @property
    def sizes(self) -> style.Sizes:
        """Sizes of markers, lines and text on the photograph."""
        height, width = self.photograph.shape[:2]
        return style.sizes(width, height, self.spacing * self.scale)

    @property
    def legend_height(self) -> int:
        """Height of a legend of one line below the photograph, pixels."""
        return round(2.2 * self.sizes.text)

    def to_picture(self, points: Floats) -> Floats:
        """Positions [..., 2] in the frame as positions in the photograph, pixels."""
        return (points + 0.5) * self.scale - 0.5

    def scene(self) -> Scene:
        """A scene of the photograph."""
        height, width = self.photograph.shape[:2]
        return Scene(width, height, [(0, 0, self.photograph)])

    def with_photograph(self, photograph: Picture) -> FrameView:
        """The same view with another photograph."""
        return replace(self, photograph=photograph)


def views_of(report: Report, indices: Sequence[int]) -> dict[int, FrameView]:
    """The views of several frames by index, as ``view_of``."""
    return {index: view_of(report, index) for index in indices}


def view_of(report: Report, index: int, scale: float | None = None) -> FrameView:
    """The view of one frame; blank, with a message, if its picture is not available.

    ``scale`` is its enlargement, by default the one that suits a screen.
    """
    frame = report.frames[index]
    longest = max(frame.width, frame.height)
    if scale is None:
        scale = min(MAX_ENLARGEMENT, max(1.0, MIN_LONG_SIDE / longest), MAX_LONG_SIDE / longest)
    size = (max(1, round(frame.width * scale)), max(1, round(frame.height * scale)))
    picture = report.pictures(index)
    if picture is None:
        blank = np.full((size[1], size[0], 3), BLANK, dtype=np.uint8)
        words = f"frame {index + 1}: picture not available"
        where, font = (size[0] // 40, size[1] // 20), cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(blank, words, where, font, size[0] / 1600, style.MUTED, 1, cv2.LINE_AA)
        return FrameView(index, blank, scale, typical_spacing(report))
    picture = np.ascontiguousarray(picture)  # channels may be reversed by a stride
    if picture.shape[1::-1] != size:
        interpolation = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
        picture = np.asarray(cv2.resize(picture, size, interpolation=interpolation), dtype=np.uint8)
    return FrameView(index, muted(picture), scale, typical_spacing(report))


@lru_cache(maxsize=1)  # used for every frame and by the page
def typical_spacing(report: Report) -> float:
    """Typical distance between the inliers of a motion, in pixels of a frame.

    Of the motion with the closest inliers, among those with a tenth of all inliers, in the frame
    with most visible tracks. Infinite without motions.
    """
    if not len(report.labels) or not report.motions:
        return math.inf
    index = int(np.argmax(report.tracks.visible.sum(axis=0)))
    points = report.tracks.points[:, index]
    groups = [points[report.members(motion.label)] for motion in report.motions]
    groups = [group[np.isfinite(group).all(axis=1)] for group in groups]
    least = 0.1 * sum(map(len, groups))
    return min((spacing(g, 1) for g in groups if len(g) > max(2.0, least)), default=math.inf)


def muted(picture: Picture) -> Picture:
    """The picture with less colour and contrast, so that markers stand out."""
    grey = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    return np.asarray(cv2.addWeighted(picture, 0.5, grey, 0.3, 26.0), dtype=np.uint8)


Entry = tuple[style.LabelStyle, str]
"""A marker and its text."""


def add_legend(scene: Scene, view: FrameView, entries: Sequence[Entry]) -> None:
    """Extend a scene of a photograph by the legend below it: as many lines as it takes."""
    height, width = view.photograph.shape[:2]
    size = view.sizes.text
    longest = max((_entry_width(text, size) for _, text in entries), default=size)
    size *= min(1.0, width / (longest + size))
    line = 1.7 * size
    rows = _rows(entries, size, width)
    scene.height = height + max(view.legend_height, round(line * len(rows) + 0.5 * size))
    top = (height + scene.height - line * (len(rows) - 1)) / 2
    for number, row in enumerate(rows):
        x, y = 0.8 * size, top + number * line
        for marker, text in row:
            scene.add([_key(marker, x + 0.4 * size, y, 0.4 * size)])
            scene.add([Label(x + 1.15 * size, y + 0.36 * size, size, text, style.INK)])
            x += _entry_width(text, size)


def _rows(entries: Sequence[Entry], size: float, width: float) -> list[list[Entry]]:
    """The entries in lines that fit the width."""
    rows: list[list[Entry]] = [[]]
    used = size
    for entry in entries:
        needed = _entry_width(entry[1], size)
        if rows[-1] and used + needed > width:
            rows.append([])
            used = size
        rows[-1].append(entry)
        used += needed
    return rows


def _entry_width(text: str, size: float) -> float:
    """Width of a marker, its text and the gap after it."""
    return (2.4 + TEXT_WIDTH * len(text)) * size


def _key(marker: style.LabelStyle, x: float, y: float, radius: float) -> Item:
    """The marker of a legend entry."""
    return Markers(np.array([[x, y]]), marker.shape, radius, marker.colour)


def number_badges(report: Report, view: FrameView) -> list[Item]:
    """The number of each object on one of its points, moved where numbers would overlap."""
    points = view.to_picture(report.tracks.points[:, view.index])
    radius = view.sizes.badge
    places: list[Floats] = []
    labels = []
    for motion in report.objects:
        own = points[report.members(motion.label)]
        own = own[np.isfinite(own).all(axis=1)]
        if len(own):
            places.append(_badge_place(own, places, 2.3 * radius))
            labels.append(motion.label)
    if not places:
        return []
    height, width = view.photograph.shape[:2]
    separate = _pushed_apart(np.array(places), 2.3 * radius)
    separate = np.clip(separate, 1.2 * radius, np.array([width, height]) - 1.2 * radius)
    return [
        Badge(float(x), float(y), radius, report.style(label).colour, str(label))
        for (x, y), label in zip(separate, labels, strict=True)
    ]


def _badge_place(own: Floats, taken: Sequence[Floats], distance: float) -> Floats:
    """The point nearest to the median of its motion that is not too near to other badges.

    The median itself may be off the object. Without such a point, the nearest one.
    """
    middle = np.median(own, axis=0)
    order = np.argsort(((own - middle) ** 2).sum(axis=1), kind="stable")
    for place in own[order]:
        if all(np.hypot(*(place - other)) >= distance for other in taken):
            return np.asarray(place)
    return np.asarray(own[order[0]])


def _pushed_apart(places: Floats, distance: float) -> Floats:
    """Points [n, 2] moved until no two are closer than ``distance``, for at most 50 rounds."""
    places = places.astype(np.float64).copy()
    for _ in range(50):
        offset = places[:, None] - places[None]
        gap = np.hypot(offset[..., 0], offset[..., 1])
        close = (gap < distance) & ~np.eye(len(places), dtype=bool)
        if not close.any():
            break
        # points at the same position are moved apart in a fixed direction, by their order
        order = np.sign(np.arange(len(places))[:, None] - np.arange(len(places))[None])
        offset = np.where((gap < 1e-6)[..., None], order[..., None] * [0.6, 0.8], offset)
        unit = offset / np.maximum(gap, 1.0)[..., None]
        push = np.where(close, (distance - gap) / 2 + 0.5, 0.0)
        places += (unit * push[..., None]).sum(axis=1)
    return places


def stack_right(left: Scene, right: Scene, gap: int | None = None) -> Scene:
    """Two scenes side by side, ``gap`` pixels apart (by default about 1 % of the width)."""
    gap = max(4, left.width // 100) if gap is None else gap
    shift = left.width + gap
    both = Scene(shift + right.width, max(left.height, right.height))
    both.photographs = left.photographs + [(x + shift, y, p) for x, y, p in right.photographs]
    both.items = left.items + [_moved(item, float(shift), 0.0) for item in right.items]
    return both


def stack_below(upper: Scene, lower: Scene, gap: int) -> Scene:
    """Two scenes one below the other, ``gap`` pixels apart."""
    shift = upper.height + gap
    both = Scene(max(upper.width, lower.width), shift + lower.height)
    both.photographs = upper.photographs + [(x, y + shift, p) for x, y, p in lower.photographs]
    both.items = upper.items + [_moved(item, 0.0, float(shift)) for item in lower.items]
    return both


def _moved(item: Item, dx: float, dy: float) -> Item:
    """The item shifted by (dx, dy)."""
    shift = np.array([dx, dy])
    match item:
        case Markers():
            return replace(item, points=item.points + shift)
        case Lines():
            moved = tuple(path + shift for path in item.paths)
            return replace(item, paths=moved, heads=tuple(head + shift for head in item.heads))
        case Areas():
            return replace(item, contours=tuple(c + shift for c in item.contours))
        case Badge() | Label():
            return replace(item, x=item.x + dx, y=item.y + dy)
