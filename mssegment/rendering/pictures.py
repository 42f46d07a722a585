"""Annotated pictures: all points, the motions in each frame, side by side, and overlaid.

``encode_pictures`` gives the files by name; the functions that end in ``_scene`` give one scene
each, for ``raster.paint`` or ``svg.write_svg``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import cv2
import numpy as np

from mssegment.errors import UsageError
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Floats, Integers
from mssegment.rendering import style
from mssegment.rendering.layout import View, caption, number_badges, stack_right, views_of
from mssegment.rendering.regions import Contours, dense_regions, hulls
from mssegment.rendering.report import Report
from mssegment.rendering.scene import Areas, Item, Lines, Markers, Scene
from mssegment.rendering.thinning import carriers

FORMATS = ("png", "jpg", "svg")
KINDS = ("points", "frames", "side-by-side", "overlay", "regions")
USUAL = ("points", "frames", "overlay")
MAX_FRAMES = 8
"""A longer sequence shows this many frames, evenly spaced, the first and the last among them."""
MOST_COVERED = 0.4
"""An outline around more of the picture than this is the background, and only in the way."""


def encode_pictures(
    report: Report, file_format: str = "png", kinds: Collection[str] = USUAL
) -> Iterator[tuple[str, bytes]]:
    """The pictures of a report as (file name, content), one after the other.

    ``kinds`` are some of ``KINDS``: ``points``, all tracks before anything is known about them;
    ``frames``, the motions in each frame, as ``frame-N``; ``side-by-side``, both (the paper's
    figures 2-4); ``overlay``, the first and the last frame on top of each other; ``regions``, dense
    regions of the motions. Raises UsageError for another kind or a format not in ``FORMATS``.
    """
    if file_format not in FORMATS:
        raise UsageError(f"no picture format {file_format!r}, expected {', '.join(FORMATS)}")
    for kind in kinds:
        if kind not in KINDS:
            raise UsageError(f"no picture {kind!r}, expected some of {', '.join(KINDS)}")
    with ThreadPoolExecutor(1) as pool:  # one picture is compressed while the next is drawn
        waiting: Future[bytes] | None = None
        name = ""
        for following, scene in scenes_of(report, kinds):
            drawn = draw(scene, file_format, following)
            if waiting is not None:
                yield name, waiting.result()
            name, waiting = f"{following}.{file_format}", pool.submit(drawn)
        if waiting is not None:
            yield name, waiting.result()


def render_pictures(
    report: Report, file_format: str = "png", kinds: Collection[str] = USUAL
) -> dict[str, bytes]:
    """The same as ``encode_pictures``, all at once: file name -> content."""
    return dict(encode_pictures(report, file_format, kinds))


def encode(scene: Scene, file_format: str, title: str = "") -> bytes:
    """One scene as the content of a PNG, JPEG or SVG file."""
    return draw(scene, file_format, title)()


def draw(scene: Scene, file_format: str, title: str) -> Callable[[], bytes]:
    """Draws a scene now; the function that comes back compresses it, in any thread."""
    from mssegment.rendering.raster import paint
    from mssegment.rendering.svg import write_svg

    if file_format == "svg":
        return write_svg(scene, title).encode
    options = [cv2.IMWRITE_JPEG_QUALITY, 92] if file_format == "jpg" else []
    picture = paint(scene)
    return lambda: bytes(cv2.imencode(f".{file_format}", picture, options)[1].tobytes())


def scenes_of(report: Report, kinds: Collection[str] = USUAL) -> Iterator[tuple[str, Scene]]:
    """The scenes of ``encode_pictures`` by name."""
    if not report.frames:
        return
    shown = shown_frames(len(report.frames))
    views = views_of(report, shown)
    areas = {index: motion_hulls(report, views[index]) for index in shown}
    first, last = shown[0], shown[-1]
    if "points" in kinds:
        yield "points", points_scene(report, views[first])
    for index in shown if "frames" in kinds else ():
        yield f"frame-{index + 1}", frame_scene(report, views[index], areas[index])
    if "side-by-side" in kinds:
        yield "side-by-side", side_by_side_scene(report, views[first], views[last], areas[last])
    if "overlay" in kinds and last != first:
        yield "overlay", overlay_scene(report, views[first], views[last])
    if "regions" in kinds:
        dense = dense_regions(report, first, views[first].photograph)
        yield "regions", frame_scene(report, views[first], dense, opacity=style.REGION_OPACITY)


def shown_frames(count: int, limit: int = MAX_FRAMES) -> list[int]:
    """Indices of the frames of which a picture is drawn: all, or ``limit`` evenly spaced ones."""
    if count <= limit:
        return list(range(count))
    return [int(i) for i in np.round(np.linspace(0, count - 1, limit))]


def points_scene(report: Report, view: View) -> Scene:
    """All tracks in one frame with their displacements, before anything is known about them."""
    scene = view.scene(len(caption_points(report)) > 0)
    points = view.place(report.tracks.points[:, view.index])
    everyone = np.flatnonzero(np.isfinite(points).all(axis=1))
    size = view.sizes
    shown = np.flatnonzero(carriers(report, view.index, together=True))
    scene.add(_paths(report, view, shown, style.PLAIN_COLOUR, size.line))
    look = style.PLAIN_COLOUR
    scene.add([Markers(points[everyone], "circle", 0.75 * size.marker, look, 0.2 * size.marker)])
    scene.add(caption(view, caption_points(report)))
    return scene


def caption_points(report: Report) -> list[tuple[style.Mark, str]]:
    """The legend of a picture of all tracks."""
    mark = style.Mark(style.PLAIN_COLOUR, "circle", "tracks")
    return [(mark, f"{len(report.labels)} tracks")]


def frame_scene(
    report: Report,
    view: View,
    areas: dict[int, Contours] | None = None,
    *,
    opacity: float = style.HULL_OPACITY,
    legend: bool = True,
) -> Scene:
    """The motions in one frame: inliers in colour and shape, displacements, hulls, numbers."""
    scene = view.scene(legend)
    scene.add(_area_items(areas or {}, view, opacity))
    scene.add(_label_items(report, view))
    scene.add(number_badges(report, view))
    if legend:
        scene.add(caption(view, caption_motions(report)))
    return scene


def caption_motions(report: Report) -> list[tuple[style.Mark, str]]:
    """The legend of a picture of the motions: each with its number of inliers."""
    entries = []
    for motion in report.motions:
        count = len(report.members(motion.label))
        entries.append((style.mark(motion.label), f"motion {motion.label}: {count}"))
    for label in (OUTLIER, BACKGROUND, NOT_JUDGED):
        count = len(report.members(label))
        if count:
            entries.append((style.mark(label), f"{style.mark(label).name}: {count}"))
    return entries


def side_by_side_scene(
    report: Report, first: View, last: View, areas: dict[int, Contours] | None = None
) -> Scene:
    """All tracks in the first frame on the left, the motions in the last on the right."""
    return stack_right(points_scene(report, first), frame_scene(report, last, areas))


def overlay_scene(report: Report, first: View, last: View) -> Scene:
    """First and last frame blended, with where every inlier came from and went to."""
    if first.photograph.shape == last.photograph.shape:
        mixed = cv2.addWeighted(first.photograph, 0.5, last.photograph, 0.5, 0)
        blend = np.asarray(mixed, dtype=np.uint8)
    else:
        blend = last.photograph
    view = first.showing(blend)
    scene = view.scene(True)
    size = view.sizes
    shown = carriers(report, last.index)
    for motion in report.motions:
        look, members = style.mark(motion.label), report.members(motion.label)
        ways = members[shown[members]]
        scene.add(_paths(report, view, ways, look.colour, 1.3 * size.line, 0.85))
        places = view.place(report.tracks.points[members, last.index])
        places = places[np.isfinite(places).all(axis=1)]
        scene.add([Markers(places, look.shape, 0.8 * size.marker, look.colour, 0.2 * size.marker)])
    scene.add(number_badges(report, last))
    scene.add(caption(view, caption_motions(report)))
    return scene


def motion_hulls(report: Report, view: View) -> dict[int, Contours]:
    """Motion -> outline around its inliers in the frame of ``view``, in pixels of the picture."""
    height, width = view.photograph.shape[:2]
    points = view.place(report.tracks.points[:, view.index])
    return {
        motion.label: hulls(points[report.members(motion.label)], width, height)
        for motion in report.motions
    }


def _area_items(areas: dict[int, Contours], view: View, opacity: float) -> list[Item]:
    height, width = view.photograph.shape[:2]
    items: list[Item] = []
    for label, contours in areas.items():
        covered = sum(cv2.contourArea(c.astype(np.float32)) for c in contours)
        if 0 < covered <= MOST_COVERED * width * height:
            colour = style.mark(label).colour
            items.append(Areas(contours, colour, opacity, view.sizes.outline))
    return items


def _label_items(report: Report, view: View) -> list[Item]:
    """Markers and displacements of all labels, the motions over the rest."""
    points = view.place(report.tracks.points[:, view.index])
    seen = np.isfinite(points).all(axis=1)
    shown = carriers(report, view.index)
    size = view.sizes
    items: list[Item] = []
    for label in (BACKGROUND, NOT_JUDGED, OUTLIER):
        members = np.flatnonzero(seen & (report.labels == label))
        look = style.mark(label)
        if label == OUTLIER:
            ways = members[shown[members]]
            items += _paths(report, view, ways, look.colour, 0.6 * size.line, 0.38)
        items.append(Markers(points[members], look.shape, size.small, look.colour))
    for motion in report.motions:
        ways = np.flatnonzero(shown & (report.labels == motion.label))
        items += _paths(report, view, ways, style.mark(motion.label).colour, size.line)
    for motion in report.motions:
        members = np.flatnonzero(seen & (report.labels == motion.label))
        look = style.mark(motion.label)
        rim = 0.28 * size.marker
        items.append(Markers(points[members], look.shape, size.marker, look.colour, rim))
    return items


def _paths(
    report: Report,
    view: View,
    members: Integers,
    colour: style.Colour,
    width: float,
    opacity: float = style.PATH_OPACITY,
) -> list[Item]:
    """The ways of some tracks through all frames, with an arrow head at the end."""
    ways = view.place(report.tracks.points[members])
    seen = np.asarray(np.isfinite(ways).all(axis=2))
    moves = seen.sum(axis=1) > 1
    paths = tuple(way[s] for way, s in zip(ways[moves], seen[moves], strict=True))
    return [Lines(paths, colour, width, _arrow_heads(paths, 4.5 * width), opacity)]


def _arrow_heads(paths: tuple[Floats, ...], size: float) -> tuple[Floats, ...]:
    """A triangle at the end of each way that is long enough to carry one."""
    if not paths:
        return ()
    ends = np.array([path[-1] for path in paths])
    # the general direction: the last step of a jittering track points anywhere
    way = ends - np.array([path[0] for path in paths])
    length = np.hypot(way[:, 0], way[:, 1])
    keep = length >= 2.2 * size
    ends, along = ends[keep], way[keep] / length[keep, None]
    side = 0.6 * size * np.stack([-along[:, 1], along[:, 0]], axis=1)
    back = ends - 1.1 * size * along
    return tuple(np.stack([ends + 0.4 * size * along, back + side, back - side], axis=1))
