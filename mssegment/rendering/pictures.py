"""Annotated pictures: all tracks, the motions in each frame, side by side, and overlaid.

``encode_pictures`` gives files; the functions that end in ``_scene`` give one scene each, for
``raster.paint`` or ``svg.write_svg``.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from concurrent.futures import Future, ThreadPoolExecutor

import cv2
import numpy as np

from mssegment.errors import UsageError
from mssegment.progress import track
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Floats, Integers
from mssegment.rendering import style
from mssegment.rendering.layout import FrameView, add_legend, number_badges, stack_right, views_of
from mssegment.rendering.regions import Contours, dense_regions, hulls
from mssegment.rendering.report import Report
from mssegment.rendering.scene import Areas, Item, Lines, Markers, Scene
from mssegment.rendering.thinning import shown_displacements

FORMATS = ("png", "jpg", "svg")
KINDS = ("points", "frames", "side-by-side", "overlay", "regions")
USUAL = ("points", "frames", "overlay")
"""The kinds that are drawn by default."""
MAX_FRAMES = 8
"""Frames that are drawn of a longer sequence, evenly spaced from the first to the last."""
MAX_HULL_SHARE = 0.4
"""Share of the picture; a larger outline is that of the background and is not drawn."""


def encode_pictures(
    report: Report, file_format: str = "png", kinds: Collection[str] = USUAL
) -> Iterator[tuple[str, bytes]]:
    """Draw the pictures of a report.

    Parameters
    ----------
    report : Report
        What is drawn.
    file_format : str
        One of ``FORMATS``.
    kinds : collection of str
        Some of ``KINDS``: ``points``, all tracks without their labels; ``frames``, the motions in
        each frame, as ``frame-N``; ``side-by-side``, both (as figures 2-4 of the paper);
        ``overlay``, the motions over the blended first and last frame; ``regions``, dense regions
        of the motions.

    Yields
    ------
    name : str
        Name of the file.
    content : bytes
        Its content.

    Raises
    ------
    UsageError
        For another kind or format.
    """
    if file_format not in FORMATS:
        raise UsageError(f"picture format {file_format!r}: expected {', '.join(FORMATS)}")
    for kind in kinds:
        if kind not in KINDS:
            raise UsageError(f"picture {kind!r}: expected some of {', '.join(KINDS)}")
    with ThreadPoolExecutor(1) as pool:  # compresses one picture while the next is drawn
        waiting: Future[bytes] | None = None
        name = ""
        for following, scene in track(scenes_of(report, kinds), "pictures"):
            drawn = draw(scene, file_format, following)
            if waiting is not None:
                yield name, waiting.result()
            name, waiting = f"{following}.{file_format}", pool.submit(drawn)
        if waiting is not None:
            yield name, waiting.result()


def render_pictures(
    report: Report, file_format: str = "png", kinds: Collection[str] = USUAL
) -> dict[str, bytes]:
    """The pictures of ``encode_pictures`` as a dictionary from file name to content."""
    return dict(encode_pictures(report, file_format, kinds))


def encode(scene: Scene, file_format: str, title: str = "") -> bytes:
    """The content of a PNG, JPEG or SVG file of a scene; ``title`` is used in SVG."""
    return draw(scene, file_format, title)()


def draw(scene: Scene, file_format: str, title: str) -> Callable[[], bytes]:
    """Draw a scene now; the function that is returned compresses it, in any thread."""
    from mssegment.rendering.raster import paint
    from mssegment.rendering.svg import write_svg

    if file_format == "svg":
        return write_svg(scene, title).encode
    options = [cv2.IMWRITE_JPEG_QUALITY, 92] if file_format == "jpg" else []
    picture = paint(scene)
    return lambda: bytes(cv2.imencode(f".{file_format}", picture, options)[1].tobytes())


def scenes_of(report: Report, kinds: Collection[str] = USUAL) -> Iterator[tuple[str, Scene]]:
    """Yield name and scene of each picture of ``encode_pictures``."""
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
    """Indices of the frames that are drawn: all of ``count``, or ``limit`` evenly spaced ones."""
    if count <= limit:
        return list(range(count))
    return [int(i) for i in np.round(np.linspace(0, count - 1, limit))]


def points_scene(report: Report, view: FrameView) -> Scene:
    """All tracks in one frame with their displacements, without labels."""
    scene = view.scene()
    points = view.to_picture(report.tracks.points[:, view.index])
    points = points[np.isfinite(points).all(axis=1)]
    size, colour = view.sizes, style.PLAIN_COLOUR
    shown = np.flatnonzero(shown_displacements(report, view.index, ignore_labels=True))
    scene.add(_paths(report, view, shown, colour, size.line))
    scene.add([Markers(points, "circle", 0.75 * size.marker, colour, 0.2 * size.marker)])
    marker = style.LabelStyle(colour, "circle", report.things)
    add_legend(scene, view, [(marker, f"{len(report.labels)} {report.things}")])
    return scene


def frame_scene(
    report: Report,
    view: FrameView,
    areas: dict[int, Contours] | None = None,
    *,
    opacity: float = style.HULL_OPACITY,
    with_legend: bool = True,
) -> Scene:
    """The motions in one frame: inliers, displacements, areas and numbers.

    Parameters
    ----------
    report : Report
        The segmentation.
    view : FrameView
        The frame.
    areas : dict, optional
        Label of a motion -> outlines in pixels of the photograph.
    opacity : float
        Opacity of the areas.
    with_legend : bool
        Whether there is a legend below.
    """
    scene = view.scene()
    scene.add(_area_items(areas or {}, view, opacity))
    scene.add(_label_items(report, view))
    scene.add(number_badges(report, view))
    if with_legend:
        add_legend(scene, view, motion_entries(report))
    return scene


def motion_entries(report: Report) -> list[tuple[style.LabelStyle, str]]:
    """Entries of the legend: each label with its number of tracks."""
    entries = []
    for motion in report.motions:
        count = len(report.members(motion.label))
        marker = report.style(motion.label)
        entries.append((marker, f"{marker.name}: {count}"))
    for label in (OUTLIER, BACKGROUND, NOT_JUDGED):
        count = len(report.members(label))
        if count:
            entries.append((style.label_style(label), f"{style.label_style(label).name}: {count}"))
    return entries


def side_by_side_scene(
    report: Report, first: FrameView, last: FrameView, areas: dict[int, Contours] | None = None
) -> Scene:
    """All tracks in the ``first`` frame on the left, the motions in the ``last`` on the right."""
    return stack_right(points_scene(report, first), frame_scene(report, last, areas))


def overlay_scene(report: Report, first: FrameView, last: FrameView) -> Scene:
    """The motions over the blended ``first`` and ``last`` frame, with the displacements."""
    if first.photograph.shape == last.photograph.shape:
        mixed = cv2.addWeighted(first.photograph, 0.5, last.photograph, 0.5, 0)
        blend = np.asarray(mixed, dtype=np.uint8)
    else:
        blend = last.photograph
    view = first.with_photograph(blend)
    scene = view.scene()
    size = view.sizes
    shown = shown_displacements(report, last.index)
    for motion in sorted(report.motions, key=lambda m: m.label != report.camera_motion):
        marker, members = report.style(motion.label), report.members(motion.label)
        width, opacity = (0.6 * size.line, 0.38) if marker.is_quiet else (1.3 * size.line, 0.85)
        scene.add(_paths(report, view, members[shown[members]], marker.colour, width, opacity))
        radius = size.small if marker.is_quiet else 0.8 * size.marker
        ends = view.to_picture(report.tracks.points[members, last.index])
        ends = ends[np.isfinite(ends).all(axis=1)]
        scene.add([Markers(ends, marker.shape, radius, marker.colour, 0.25 * radius)])
    scene.add(number_badges(report, last))
    add_legend(scene, view, motion_entries(report))
    return scene


def motion_hulls(report: Report, view: FrameView) -> dict[int, Contours]:
    """Label of a motion -> outlines around its inliers, in pixels of the photograph of ``view``."""
    height, width = view.photograph.shape[:2]
    points = view.to_picture(report.tracks.points[:, view.index])
    return {
        motion.label: hulls(points[report.members(motion.label)], width, height)
        for motion in report.objects
    }


def _area_items(areas: dict[int, Contours], view: FrameView, opacity: float) -> list[Item]:
    """The areas of all motions that do not cover too much of the picture."""
    height, width = view.photograph.shape[:2]
    items: list[Item] = []
    for label, contours in areas.items():
        covered = sum(cv2.contourArea(c.astype(np.float32)) for c in contours)
        if 0 < covered <= MAX_HULL_SHARE * width * height:
            colour = style.label_style(label).colour
            items.append(Areas(contours, colour, opacity, view.sizes.outline))
    return items


def _label_items(report: Report, view: FrameView) -> list[Item]:
    """Markers and displacements of all tracks, those of motions last."""
    points = view.to_picture(report.tracks.points[:, view.index])
    visible = np.isfinite(points).all(axis=1)
    shown = shown_displacements(report, view.index)
    size = view.sizes
    items: list[Item] = []
    for label in report.quiet_labels:
        members = np.flatnonzero(visible & (report.labels == label))
        marker = report.style(label)
        if label not in (BACKGROUND, NOT_JUDGED):
            moved = members[shown[members]]
            items += _paths(report, view, moved, marker.colour, 0.6 * size.line, 0.38)
        items.append(Markers(points[members], marker.shape, size.small, marker.colour))
    for motion in report.objects:
        moved = np.flatnonzero(shown & (report.labels == motion.label))
        items += _paths(report, view, moved, report.style(motion.label).colour, size.line)
    for motion in report.objects:
        members = np.flatnonzero(visible & (report.labels == motion.label))
        marker = report.style(motion.label)
        rim = 0.28 * size.marker
        items.append(Markers(points[members], marker.shape, size.marker, marker.colour, rim))
    return items


def _paths(
    report: Report,
    view: FrameView,
    members: Integers,
    colour: style.Colour,
    width: float,
    opacity: float = style.PATH_OPACITY,
) -> list[Item]:
    """The paths of some tracks through all frames, with arrowheads at their ends."""
    tracks = view.to_picture(report.tracks.points[members])
    visible = np.asarray(np.isfinite(tracks).all(axis=2))
    moves = visible.sum(axis=1) > 1
    paths = tuple(path[v] for path, v in zip(tracks[moves], visible[moves], strict=True))
    return [Lines(paths, colour, width, _arrowheads(paths, 4.5 * width), opacity)]


def _arrowheads(paths: tuple[Floats, ...], size: float) -> tuple[Floats, ...]:
    """A triangle at the end of each path that is long enough for one."""
    if not paths:
        return ()
    ends = np.array([path[-1] for path in paths])
    # the overall direction: the last step of a noisy track has an arbitrary one
    overall = ends - np.array([path[0] for path in paths])
    length = np.hypot(overall[:, 0], overall[:, 1])
    keep = length >= 2.2 * size
    ends, along = ends[keep], overall[keep] / length[keep, None]
    side = 0.6 * size * np.stack([-along[:, 1], along[:, 0]], axis=1)
    back = ends - 1.1 * size * along
    return tuple(np.stack([ends + 0.4 * size * along, back + side, back - side], axis=1))
