"""The first frame with its motions for browsers without JavaScript: a photograph and an SVG."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats
from mssegment.rendering.layout import typical_spacing
from mssegment.rendering.markup import escape
from mssegment.rendering.page.payload import label_class, shown_labels
from mssegment.rendering.report import Report
from mssegment.rendering.scene import OUTLINES
from mssegment.rendering.style import sizes
from mssegment.rendering.thinning import shown_displacements

MAX_MARKERS = 1500
"""More tracks than this are thinned in the still picture; the script shows all."""


def frames_html(report: Report, addresses: list[str]) -> str:
    """All photographs with the first one visible, and the markers of the first frame over it."""
    parts = []
    for i, (frame, address) in enumerate(zip(report.frames, addresses, strict=True)):
        name = f"Frame {i + 1} of {len(report.frames)}: {frame.path}"
        shown = "frame current" if i == 0 else "frame"
        size = f'width="{frame.width}" height="{frame.height}"'
        if address:
            parts.append(
                f'<img class="{shown}" {size} src="{address}" alt="{escape(name)}" '
                f'decoding="async">'
            )
        else:
            parts.append(
                f'<svg class="{shown} blank" {size} viewBox="0 0 {frame.width} {frame.height}" '
                f'role="img" aria-label="{escape(name)} (picture not available)"></svg>'
            )
    if report.frames:
        parts.append(markers_svg(report, 0))
    if not all(addresses):
        count = sum(not address for address in addresses)
        parts.append(
            f'<p class="absent">{count} of {len(addresses)} pictures are not available</p>'
        )
    return "\n".join(parts)


def markers_svg(report: Report, index: int) -> str:
    """The tracks of one frame as SVG, in pixels of the frame."""
    frame = report.frames[index]
    size = sizes(frame.width, frame.height, typical_spacing(report))
    thin = max(1, -(-len(report.labels) // MAX_MARKERS))
    shown = shown_displacements(report, index)
    groups, shapes = [], []
    for label in reversed(shown_labels(report)):
        members = report.members(label)[::thin]
        name = label_class(label)
        shapes.append(
            f'<path id="s-{name}" d="{_outline(report.style(label).shape, size.marker)}"/>'
        )
        tracks = report.tracks.points[members]
        visible = np.isfinite(tracks[:, index]).all(axis=1)
        places = np.round(tracks[visible, index] + 0.5, 1)
        uses = "".join(f'<use href="#s-{name}" x="{x:g}" y="{y:g}"/>' for x, y in places)
        groups.append(
            f'<g class="{name}"><path class="displacement" stroke-width="{size.line:.2f}" '
            f'd="{_displacements(tracks[visible & shown[members]])}"/>'
            f'<g class="marker">{uses}</g></g>'
        )
    return (
        f'<svg class="still" viewBox="0 0 {frame.width} {frame.height}" aria-hidden="true">'
        f"<defs>{''.join(shapes)}</defs>{''.join(groups)}</svg>"
    )


def _outline(shape: str, radius: float) -> str:
    """Path data of a marker."""
    corners = OUTLINES[shape] * radius
    return "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in corners) + "Z"


def _displacements(tracks: Floats) -> str:
    """Path data of the lines from the first to the last visible position of each track."""
    parts = []
    for track in tracks:
        visible = np.round(track[np.isfinite(track).all(axis=1)] + 0.5, 1)
        if len(visible) > 1:
            (x0, y0), (x1, y1) = visible[0], visible[-1]
            parts.append(f"M{x0:g} {y0:g}L{x1:g} {y1:g}")
    return "".join(parts)
