"""The plots of the page as SVG: hypotheses on their manifold, and residual distributions."""

from __future__ import annotations

import numpy as np

from mssegment.records import Floats
from mssegment.rendering.markup import escape
from mssegment.rendering.page.payload import inlier_limit, label_class, residual_row
from mssegment.rendering.page.projection import Projection
from mssegment.rendering.report import Report
from mssegment.rendering.scene import OUTLINES
from mssegment.rendering.tables import density, number

MANIFOLD_SIDE = 480.0
"""Side of the plot of a manifold, in units of its view box."""
MARGIN_SHARE = 0.92
"""Half side of the plotted square, or radius of the disc, relative to half the side of the plot."""
OTHER_MODES = 3
"""Modes that are named besides those of motions."""


def manifold_svg(report: Report, view: Projection) -> str:
    """Plot the hypotheses of one set, their modes and trajectories of mean shift."""
    half = MANIFOLD_SIDE / 2
    parts = [_disc() if view.hemisphere else _axes(view)]
    parts.append(_trajectories(view))
    points = half + MARGIN_SHARE * half * view.points
    order = np.argsort(view.labels > 0, kind="stable")  # those of motions last, on top
    model = report.sets[report.segmentation.modes[view.mode_indices[0]].set_index]
    for i in order:
        if not np.isfinite(points[i]).all():
            continue
        hypothesis = int(view.chosen[i])
        label = int(view.labels[i])
        subset = ", ".join(str(int(track) + 1) for track in model.subsets[hypothesis])
        parts.append(
            f'<circle class="hypothesis {label_class(label)}" cx="{points[i, 0]:.1f}" '
            f'cy="{points[i, 1]:.1f}" r="3.2"><title>hypothesis {hypothesis + 1}, '
            f"tracks {subset}</title></circle>"
        )
    parts += _modes(report, view)
    title = "Hemisphere in equal-area projection" if view.hemisphere else "Tangent space"
    return (
        f'<svg class="chart manifold" viewBox="0 0 {MANIFOLD_SIDE:g} {MANIFOLD_SIDE:g}" role="img" '
        f'aria-label="{escape(title)}, {escape(view.manifold)}: {len(view.points)} hypotheses, '
        f'{len(view.mode_indices)} modes">{"".join(parts)}</svg>'
    )


def _trajectories(view: Projection) -> str:
    """The paths of mean shift, cut off at the frame of the plot."""
    half, reach = MANIFOLD_SIDE / 2, MARGIN_SHARE * MANIFOLD_SIDE / 2
    paths = []
    for path, label in zip(view.paths, view.path_labels, strict=False):
        steps = _polyline(half + reach * path, broken=view.hemisphere)
        paths.append(f'<path class="path {label_class(label)}" d="{steps}"/>')
    low, side = f"{half - reach:.1f}", f"{2 * reach:.1f}"
    # an inner svg element clips what lies outside
    return (
        f'<svg x="{low}" y="{low}" width="{side}" height="{side}" '
        f'viewBox="{low} {low} {side} {side}">{"".join(paths)}</svg>'
    )


def _modes(report: Report, view: Projection) -> list[str]:
    """Markers and names of the modes, those of motions last."""
    half = MANIFOLD_SIDE / 2
    parts: list[str] = []
    named: list[Floats] = []
    modes = [report.segmentation.modes[index] for index in view.mode_indices]
    # those of motions and the strongest few others: more names would overlap
    rest = [i for i, mode in enumerate(modes) if not mode.motion][:OTHER_MODES]
    for i in [*(i for i, mode in enumerate(modes) if mode.motion), *rest]:
        place = half + MARGIN_SHARE * half * view.modes[i]
        if not np.isfinite(place).all():
            continue
        mode = modes[i]
        marker, name = report.style(mode.motion), label_class(mode.motion)
        shape = OUTLINES[marker.shape] * (9.0 if mode.motion else 5.0) + place
        corners = "L".join(f"{x:.1f} {y:.1f}" for x, y in shape)
        title = f"mode M{view.mode_indices[i] + 1}, {mode.hypotheses} hypotheses, "
        title += f"kernel density {density(mode.kde)}"
        text = ""
        if all(abs(x - place[0]) > 36 or abs(y - place[1]) > 15 for x, y in named):
            named.append(place)
            text = f'<text x="{place[0] + 13:.1f}" y="{place[1] + 4:.1f}">'
            text += f"M{view.mode_indices[i] + 1}</text>"
        drawn = f'<title>{escape(title)}</title><path d="M{corners}Z"/>{text}'
        parts.append(f'<g class="mode {name}">{drawn}</g>')
    return parts[::-1]


def _disc() -> str:
    """The rim, circles 30 and 60 degrees from the optical axis, and the camera's x and y axes."""
    half = MANIFOLD_SIDE / 2
    parts = [f'<circle class="rim" cx="{half}" cy="{half}" r="{MARGIN_SHARE * half:.1f}"/>']
    for degrees in (30, 60):
        radius = MARGIN_SHARE * half * np.sqrt(2) * np.sin(np.deg2rad(degrees) / 2)
        parts.append(f'<circle class="grid" cx="{half}" cy="{half}" r="{radius:.1f}"/>')
        parts.append(
            f'<text class="tick" x="{half + 0.71 * radius + 3:.1f}" '
            f'y="{half - 0.71 * radius - 3:.1f}">{degrees}°</text>'
        )
    low, high = half - MARGIN_SHARE * half, half + MARGIN_SHARE * half
    parts.append(
        f'<path class="grid" d="M{low:.1f} {half}H{high:.1f}M{half} {low:.1f}V{high:.1f}"/>'
    )
    parts.append(f'<text class="tick" x="{half + 4}" y="{half - 5}">optical axis</text>')
    parts.append(
        f'<text class="tick end" x="{high - 4:.1f}" y="{half - 5}">x</text>'
        f'<text class="tick" x="{half + 5}" y="{high - 6:.1f}">y</text>'
    )
    return "".join(parts)


def _axes(view: Projection) -> str:
    """The frame of the tangent space, the axes through its base point, and a scale bar."""
    half, reach = MANIFOLD_SIDE / 2, MARGIN_SHARE * MANIFOLD_SIDE / 2
    low, high = half - reach, half + reach
    x, y = half + reach * view.origin[0], half + reach * view.origin[1]
    length = 10.0 ** np.floor(np.log10(view.radius))
    length *= max(f for f in (0.5, 1.0, 2.0, 5.0) if f * length <= view.radius)
    scale_bar = reach * length / view.radius
    return (
        f'<rect class="rim" x="{low:.1f}" y="{low:.1f}" width="{2 * reach:.1f}" '
        f'height="{2 * reach:.1f}" rx="6"/>'
        f'<path class="grid" d="M{low:.1f} {y:.1f}H{high:.1f}M{x:.1f} {low:.1f}V{high:.1f}"/>'
        f'<path class="scale" d="M{low + 12:.1f} {high - 12:.1f}h{scale_bar:.1f}"/>'
        f'<text class="tick" x="{low + 12:.1f}" y="{high - 18:.1f}">{length:g}</text>'
    )


def _polyline(path: Floats, broken: bool) -> str:
    """Path data; on the disc a path that crosses the rim continues on the opposite side."""
    finite = path[np.isfinite(path).all(axis=1)]
    if len(finite) < 2:
        return ""
    jumps = np.hypot(*np.diff(finite, axis=0).T) > MANIFOLD_SIDE / 3
    parts = [f"M{finite[0, 0]:.1f} {finite[0, 1]:.1f}"]
    for (x, y), jump in zip(finite[1:], jumps, strict=True):
        parts.append(f"{'M' if jump and broken else 'L'}{x:.1f} {y:.1f}")
    return "".join(parts)


RESIDUAL_DECADES = (-2.0, 3.0)
"""Decimal logarithms of the smallest and the largest residual on the axis, pixels."""
RESIDUAL_WIDTH, RESIDUAL_HEIGHT = 360.0, 150.0
"""Size of a plot of residuals, in units of its view box."""


def residual_svg(report: Report, label: int) -> str:
    """Plot the distribution of the residuals to a motion: all tracks, inliers, and their largest.

    The horizontal axis is logarithmic. Empty without residuals.
    """
    row = residual_row(report, label)
    if row is None:
        return ""
    residuals = report.segmentation.residuals[row]
    edges = np.linspace(*RESIDUAL_DECADES, 101)
    all_tracks = _smoothed(residuals, edges)
    inliers = _smoothed(residuals[report.members(label)], edges)
    top = max(float(all_tracks.max()), 1e-9)
    limit = inlier_limit(report, label)
    parts = [_decades(report.unit)]
    parts.append(f'<path class="all" d="{_area(all_tracks / top)}"/>')
    parts.append(f'<path class="own" d="{_area(inliers / top)}"/>')
    if limit is not None:
        x = _x_of(float(np.log10(max(limit, 1e-9))))
        side = "end" if x > RESIDUAL_WIDTH - 90 else ""
        shift = -5 if side else 5
        parts.append(
            f'<path class="limit" d="M{x:.1f} 8V{RESIDUAL_HEIGHT - 22:g}"/>'
            f'<text class="tick {side}" x="{x + shift:.1f}" y="16">'
            f"{f'{number(limit, 2)} {report.unit}'.rstrip()}</text>"
        )
    marker = report.style(label)
    title = f"Residuals to {marker.name}; largest of an inlier: {number(limit, 2)} {report.unit}"
    return (
        f'<figure class="{label_class(label)}"><figcaption><span class="key" aria-hidden="true">'
        f"{marker.glyph}</span> {marker.name}</figcaption>"
        f'<svg class="chart" viewBox="0 0 {RESIDUAL_WIDTH:g} {RESIDUAL_HEIGHT:g}" role="img" '
        f'aria-label="{escape(title)}"><g class="{label_class(label)}">{"".join(parts)}</g></svg>'
        f"</figure>"
    )


def _smoothed(residuals: Floats, edges: Floats) -> Floats:
    """Kernel density estimate: histogram counts smoothed by a Gaussian of 0.08 decades."""
    logs = np.log10(np.maximum(residuals[np.isfinite(residuals)], 1e-9))
    counts, _ = np.histogram(np.clip(logs, *RESIDUAL_DECADES), bins=edges)
    width = edges[1] - edges[0]
    reach = np.arange(-8, 9) * width
    kernel = np.exp(-0.5 * (reach / 0.08) ** 2)
    return np.asarray(np.convolve(counts, kernel / kernel.sum(), mode="same"))


def _x_of(decade: float) -> float:
    """Horizontal position of a decimal logarithm, clipped to the axis."""
    share = (decade - RESIDUAL_DECADES[0]) / (RESIDUAL_DECADES[1] - RESIDUAL_DECADES[0])
    return 6 + (RESIDUAL_WIDTH - 12) * min(1.0, max(0.0, share))


def _area(heights: Floats) -> str:
    """Path data of the area under a curve of heights 0 to 1."""
    base, height = RESIDUAL_HEIGHT - 22, RESIDUAL_HEIGHT - 46
    x = np.linspace(_x_of(RESIDUAL_DECADES[0]), _x_of(RESIDUAL_DECADES[1]), len(heights))
    line = "L".join(f"{a:.1f} {base - height * h:.1f}" for a, h in zip(x, heights, strict=True))
    return f"M{x[0]:.1f} {base:g}L{line}L{x[-1]:.1f} {base:g}Z"


def _decades(unit: str) -> str:
    """The logarithmic axis, with the unit at its end."""
    base = RESIDUAL_HEIGHT - 22
    parts = [f'<path class="grid" d="M6 {base:g}H{RESIDUAL_WIDTH - 6:g}"/>']
    for decade in range(int(RESIDUAL_DECADES[0]), int(RESIDUAL_DECADES[1]) + 1):
        x = _x_of(decade)
        name = f"{10.0**decade:g}" + (f" {unit}" if decade == 3 and unit else "")
        side = {-2: "", 3: " end"}.get(decade, " middle")
        parts.append(f'<path class="grid" d="M{x:.1f} {base:g}v4"/>')
        parts.append(
            f'<text class="tick{side}" x="{x:.1f}" y="{RESIDUAL_HEIGHT - 6:g}">{name}</text>'
        )
    return "".join(parts)
