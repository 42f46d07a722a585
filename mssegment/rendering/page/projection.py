"""An honest 2-D view of hypotheses on a manifold, with the paths of mean shift.

Lines through the origin, G(3,1), lie on a hemisphere and are drawn on its equal-area disc. Any
other manifold is seen from the tangent space at the strongest mode, along the two directions in
which the hypotheses of the modes spread most; how much of the spread that shows is said.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.manifolds import Manifold, from_name
from mssegment.records import Floats, Integers, Record
from mssegment.rendering.report import Report

MOST_POINTS = 400
MOST_AXES = 150
PATHS = 16
STEPS = 20
SMALL_MODE = 0.01
"""A mode with less than this share of the hypotheses has no say in what the view shows."""


class Projection(Record, frozen=True):
    """Points [n, 2] of one hypothesis set, NaN where one cannot be shown, within [-1, 1].

    ``chosen`` [n] are the indices of the hypotheses, ``labels`` [n] the motions of their modes;
    ``modes`` [m, 2] with ``mode_indices`` into the segmentation's modes; ``shown`` is the share of
    the spread that the two axes show, None for the hemisphere, which shows all; ``radius`` is
    what 1 stands for in the tangent space.
    """

    manifold: str
    hemisphere: bool
    points: Floats
    chosen: Integers
    labels: Integers
    modes: Floats
    mode_indices: tuple[int, ...]
    paths: tuple[Floats, ...]
    path_labels: tuple[int, ...]
    shown: float | None
    radius: float
    origin: tuple[float, float]
    """Where the base of the tangent space appears."""
    hidden: int
    """How many hypotheses lie outside of the view or have no logarithm."""


def project(report: Report, index: int) -> Projection | None:
    """The view of hypothesis set ``index``; None where there is nothing on its manifold to show."""
    chosen_set = report.sets[index]
    modes = [i for i, mode in enumerate(report.segmentation.modes) if mode.set_index == index]
    if not len(chosen_set.points) or not modes:
        return None
    manifold = from_name(chosen_set.manifold)
    shapes = {
        chosen_set.points.shape[1:],
        *(report.segmentation.modes[i].point.shape for i in modes),
    }
    if shapes != {manifold.point_shape}:
        return None
    step = -(-len(chosen_set.points) // MOST_POINTS)
    chosen = np.arange(0, len(chosen_set.points), step)
    labels = _labels(report, index, modes)[chosen]
    points = chosen_set.points[chosen]
    centres = np.array([report.segmentation.modes[i].point for i in modes])
    starts = _starts(labels)
    paths = _paths(report, manifold, index, chosen, starts)
    path_labels = tuple(int(labels[start]) for start in starts)
    hemisphere = manifold.point_shape == (3, 1)
    if hemisphere:
        placed, at_modes = _on_disc(points), _on_disc(centres)
        drawn = tuple(_on_disc(path) for path in paths)
        shown, radius, origin = None, 1.0, (0.0, 0.0)
    else:
        flat = _Tangent(
            manifold, centres[0], _crowd(report, index, chosen), _motions(report, modes)
        )
        placed, at_modes = flat.place(points), flat.place(centres)
        drawn = tuple(flat.place(path) for path in paths)
        shown, radius, origin = flat.shown, flat.radius, flat.origin
    placed, hidden = _within(placed)
    return Projection(
        manifold=chosen_set.manifold,
        hemisphere=hemisphere,
        points=placed,
        chosen=chosen,
        labels=labels,
        modes=_within(at_modes)[0],
        mode_indices=tuple(modes),
        paths=drawn,
        path_labels=path_labels,
        shown=shown,
        radius=radius,
        origin=origin,
        hidden=hidden,
    )


def _within(places: Floats) -> tuple[Floats, int]:
    """Places [n, 2] with NaN where they are outside of the view, and how many those are."""
    inside = np.max(np.abs(np.nan_to_num(places, nan=np.inf)), axis=1, keepdims=True) <= 1.0
    return np.where(inside, places, np.nan), int(np.sum(~inside))


def _labels(report: Report, index: int, modes: list[int]) -> Integers:
    """The motion of the mode that each hypothesis of a set shifts to, 0 for none."""
    count = len(report.sets[index].points)
    if index >= len(report.segmentation.assignments):
        return np.zeros(count, dtype=np.int64)
    assignment = report.segmentation.assignments[index]
    if len(assignment) != count:
        return np.zeros(count, dtype=np.int64)
    motions = np.array([mode.motion for mode in report.segmentation.modes] + [0])
    inside = (assignment >= 0) & (assignment < len(motions) - 1)
    return np.asarray(motions[np.where(inside, assignment, -1)], dtype=np.int64)


def _crowd(report: Report, index: int, chosen: Integers) -> Floats:
    """The chosen hypotheses without those that shift to a mode of hardly any."""
    points = report.sets[index].points
    counts = np.array([mode.hypotheses for mode in report.segmentation.modes])
    if index >= len(report.segmentation.assignments):
        return points[chosen]
    assignment = report.segmentation.assignments[index][chosen]
    inside = (assignment >= 0) & (assignment < len(counts))
    sizes = np.where(inside, counts[np.where(inside, assignment, 0)], 0)
    crowd = points[chosen[sizes >= SMALL_MODE * len(points)]]
    return crowd if len(crowd) else points[chosen]


def _motions(report: Report, modes: list[int]) -> Floats:
    """The modes of a set that became motions, the strongest mode first in any case."""
    return np.array(
        [
            report.segmentation.modes[i].point
            for k, i in enumerate(modes)
            if k == 0 or report.segmentation.modes[i].motion > 0
        ]
    )


def _starts(labels: Integers) -> npt.NDArray[np.int64]:
    return np.unique(np.round(np.linspace(0, len(labels) - 1, min(PATHS, len(labels)))).astype(int))


def _paths(
    report: Report,
    manifold: Manifold,
    index: int,
    chosen: Integers,
    starts: npt.NDArray[np.int64],
) -> list[Floats]:
    """The paths given with the report, else those of mean shift (9)-(10) from a few hypotheses."""
    if index < len(report.trajectories):
        return list(report.trajectories[index])[:PATHS]
    bandwidths = report.segmentation.bandwidths
    if index >= len(bandwidths) or not 0 < bandwidths[index] < np.inf:
        return []
    prepared, h = report.sets[index].points[chosen], bandwidths[index]
    x = prepared[starts]
    steps = [x]
    for _ in range(STEPS):
        weights = np.exp(-0.5 * manifold.pairwise_dist2(x, prepared) / h**2)
        x = manifold.exp(x, manifold.mean_tangent(x, prepared, weights))
        steps.append(x)
    return list(np.stack(steps, axis=1))


def _on_disc(points: Floats) -> Floats:
    """Lambert's equal-area map of lines [n, 3, 1] on the half sphere z >= 0, radius 1."""
    vectors = points.reshape(len(points), 3)
    vectors = np.where(vectors[:, 2:] < 0, -vectors, vectors)
    vectors = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return np.asarray(vectors[:, :2] / np.sqrt(1.0 + vectors[:, 2:]))


class _Tangent:
    """The two directions of widest spread in the tangent space at ``base``.

    The view holds nearly all of ``points``, and all of ``motions``.
    """

    def __init__(self, manifold: Manifold, base: Floats, points: Floats, motions: Floats) -> None:
        self.manifold, self.base = manifold, base
        tangents = self._log(points)
        tangents = tangents[np.isfinite(tangents).reshape(len(tangents), -1).all(axis=1)]
        self.frame = tangents[:: max(1, -(-len(tangents) // MOST_AXES))]
        gram = manifold.inner(base, self.frame[:, None], self.frame[None])
        values, vectors = np.linalg.eigh(gram) if len(self.frame) else (np.zeros(0), gram)
        values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
        self.axes = vectors[:, :2] / np.sqrt(np.maximum(values[:2], 1e-300))
        self.shown = float(values[:2].sum() / values.sum()) if values.sum() > 0 else 1.0
        self.centre, self.radius = np.zeros(2), 1.0
        places, must = self.place(points), self.place(motions)
        places = places[np.isfinite(places).all(axis=1)]
        must = np.concatenate([np.zeros((1, 2)), must[np.isfinite(must).all(axis=1)]])
        if len(places):
            low, high = np.quantile(places, [0.02, 0.98], axis=0)
            low, high = np.minimum(low, must.min(axis=0)), np.maximum(high, must.max(axis=0))
            self.centre = (low + high) / 2
            self.radius = 0.6 * float((high - low).max()) or 1.0
        self.origin = (float(-self.centre[0]) / self.radius, float(-self.centre[1]) / self.radius)

    def _log(self, points: Floats) -> Floats:
        with np.errstate(all="ignore"):
            return self.manifold.log(np.broadcast_to(self.base, points.shape), points)

    def place(self, points: Floats) -> Floats:
        """Where points [n, ...] appear, [n, 2]; NaN without a logarithm."""
        tangents = self._log(points)
        placed = np.full((len(points), 2), np.nan)
        fine = np.isfinite(tangents).reshape(len(points), -1).all(axis=1)
        if len(self.frame):
            products = self.manifold.inner(self.base, tangents[fine][:, None], self.frame[None])
            flat = products @ self.axes
            placed[fine, : flat.shape[1]] = flat
            placed[fine, flat.shape[1] :] = 0.0
        return (placed - self.centre) / self.radius
