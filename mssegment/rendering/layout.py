"""Where things go on a picture: the photograph, the legend below it, the motion numbers on it."""

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

LONG_SIDE = 960
"""Smaller pictures are enlarged to this, so that marks do not cover what they mark."""
MAX_ENLARGEMENT = 2.0
LARGEST = 1920
"""Larger pictures are made smaller: a slide shows no more, and everything takes its time."""


class View(Record, frozen=True):
    """One frame as it is drawn: its photograph, muted, at ``scale`` times the frame's size.

    ``spacing`` is that of the inliers, in pixels of the frame.
    """

    index: int
    photograph: Picture
    scale: float
    spacing: float = math.inf

    @property
    def sizes(self) -> style.Sizes:
        """The sizes of what is drawn over the photograph."""
        height, width = self.photograph.shape[:2]
        return style.sizes(width, height, self.spacing * self.scale)

    @property
    def band(self) -> int:
        """Height of the legend below the photograph."""
        return round(2.2 * self.sizes.text)

    def place(self, points: Floats) -> Floats:
        """Frame coordinates [..., 2] in pixels of the picture."""
        return (points + 0.5) * self.scale - 0.5

    def scene(self, legend: bool) -> Scene:
        """A scene with the photograph, and room for a legend below."""
        height, width = self.photograph.shape[:2]
        full = height + (self.band if legend else 0)
        return Scene(width, full, [(0, 0, self.photograph)])

    def showing(self, photograph: Picture) -> View:
        """The same view of another photograph."""
        return replace(self, photograph=photograph)


def views_of(report: Report, indices: Sequence[int]) -> dict[int, View]:
    """The frames as they are drawn; a blank one where the picture is not at hand."""
    return {index: view_of(report, index) for index in indices}


def view_of(report: Report, index: int) -> View:
    """One frame as it is drawn."""
    frame = report.frames[index]
    longest = max(frame.width, frame.height)
    scale = min(MAX_ENLARGEMENT, max(1.0, LONG_SIDE / longest), LARGEST / longest)
    size = (max(1, round(frame.width * scale)), max(1, round(frame.height * scale)))
    picture = report.pictures(index)
    if picture is None:
        blank = np.full((size[1], size[0], 3), 236, dtype=np.uint8)
        words = f"frame {index + 1} is not at hand"
        where, font = (size[0] // 40, size[1] // 20), cv2.FONT_HERSHEY_SIMPLEX
        cv2.putText(blank, words, where, font, size[0] / 1600, style.MUTED, 1, cv2.LINE_AA)
        return View(index, blank, scale, typical_spacing(report))
    picture = np.ascontiguousarray(picture)  # the frame may be a view with its colours swapped
    if picture.shape[1::-1] != size:
        way = cv2.INTER_CUBIC if scale > 1 else cv2.INTER_AREA
        picture = np.asarray(cv2.resize(picture, size, interpolation=way), dtype=np.uint8)
    return View(index, mute(picture), scale, typical_spacing(report))


@lru_cache(maxsize=1)  # every frame and the page ask for it
def typical_spacing(report: Report) -> float:
    """How far the inliers of a motion lie from each other, in frame pixels; infinite without any.

    In the frame that shows most tracks, for the most crowded motion that matters.
    """
    if not len(report.labels) or not report.motions:
        return math.inf
    index = int(np.argmax(report.tracks.visible.sum(axis=0)))
    points = report.tracks.points[:, index]
    groups = [points[report.members(motion.label)] for motion in report.motions]
    groups = [group[np.isfinite(group).all(axis=1)] for group in groups]
    least = 0.1 * sum(map(len, groups))
    return min((spacing(g, 1) for g in groups if len(g) > max(2.0, least)), default=math.inf)


def mute(picture: Picture) -> Picture:
    """The photograph with less colour and contrast, so that marks stand out on it."""
    grey = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)
    return np.asarray(cv2.addWeighted(picture, 0.5, grey, 0.3, 26.0), dtype=np.uint8)


def caption(view: View, entries: Sequence[tuple[style.Mark, str]]) -> list[Item]:
    """The legend below the photograph, in one line, shrunk where it would not fit."""
    height, width = view.photograph.shape[:2]
    size = view.sizes.text
    needed = sum(_entry_width(text, size) for _, text in entries) + size
    shrink = min(1.0, width / needed)
    size *= shrink
    x, y = 0.8 * size, height + view.band / 2
    items: list[Item] = []
    for mark, text in entries:
        items.append(_key(mark, x + 0.4 * size, y, 0.4 * size))
        items.append(Label(x + 1.15 * size, y + 0.36 * size, size, text, style.INK))
        x += _entry_width(text, size)
    return items


def _entry_width(text: str, size: float) -> float:
    return (2.4 + TEXT_WIDTH * len(text)) * size


def _key(mark: style.Mark, x: float, y: float, radius: float) -> Item:
    return Markers(np.array([[x, y]]), mark.shape, radius, mark.colour)


def number_badges(report: Report, view: View) -> list[Item]:
    """The number of each motion on its object, moved apart where two would cover each other."""
    points = view.place(report.tracks.points[:, view.index])
    places, labels = [], []
    for motion in report.motions:
        own = points[report.members(motion.label)]
        own = own[np.isfinite(own).all(axis=1)]
        if len(own):
            # the inlier nearest to the median lies on the object, the median itself may not
            middle = np.median(own, axis=0)
            places.append(own[np.argmin(((own - middle) ** 2).sum(axis=1))])
            labels.append(motion.label)
    if not places:
        return []
    radius = view.sizes.badge
    height, width = view.photograph.shape[:2]
    spread = _apart(np.array(places), 2.3 * radius)
    spread = np.clip(spread, 1.2 * radius, np.array([width, height]) - 1.2 * radius)
    return [
        Badge(float(x), float(y), radius, style.mark(label).colour, str(label))
        for (x, y), label in zip(spread, labels, strict=True)
    ]


def _apart(places: Floats, distance: float) -> Floats:
    """Pushes points apart until they keep their distance, or 50 rounds have passed."""
    places = places.astype(np.float64).copy()
    for _ in range(50):
        offset = places[:, None] - places[None]
        gap = np.hypot(offset[..., 0], offset[..., 1])
        close = (gap < distance) & ~np.eye(len(places), dtype=bool)
        if not close.any():
            break
        # two numbers at the same place part along the diagonal of their order
        order = np.sign(np.arange(len(places))[:, None] - np.arange(len(places))[None])
        offset = np.where((gap < 1e-6)[..., None], order[..., None] * [0.6, 0.8], offset)
        unit = offset / np.maximum(gap, 1.0)[..., None]
        push = np.where(close, (distance - gap) / 2 + 0.5, 0.0)
        places += (unit * push[..., None]).sum(axis=1)
    return places


def stack_right(left: Scene, right: Scene, gap: int | None = None) -> Scene:
    """Two scenes beside each other."""
    gap = max(4, left.width // 100) if gap is None else gap
    shift = left.width + gap
    both = Scene(shift + right.width, max(left.height, right.height))
    both.photographs = left.photographs + [(x + shift, y, p) for x, y, p in right.photographs]
    both.items = left.items + [_moved(item, float(shift), 0.0) for item in right.items]
    return both


def stack_below(upper: Scene, lower: Scene, gap: int) -> Scene:
    """Two scenes, one below the other."""
    shift = upper.height + gap
    both = Scene(max(upper.width, lower.width), shift + lower.height)
    both.photographs = upper.photographs + [(x, y + shift, p) for x, y, p in lower.photographs]
    both.items = upper.items + [_moved(item, 0.0, float(shift)) for item in lower.items]
    return both


def _moved(item: Item, dx: float, dy: float) -> Item:
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
