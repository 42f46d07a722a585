"""A 2-D view of hypotheses on a manifold, with paths of mean shift.

Lines through the origin, G(3,1), are points of a hemisphere, which is drawn as its equal-area disc.
Any other manifold is projected from the tangent space at the densest mode onto the two directions
in which the hypotheses of the modes vary most; the share of the variance that they show is kept.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from mssegment.manifolds import Manifold, from_name
from mssegment.meanshift import KERNELS, Kernel, ascend
from mssegment.records import Floats, Integers, Record
from mssegment.rendering.report import Report

MAX_POINTS = 400
MAX_TANGENTS = 150
PATHS = 16
MAX_STEPS = 20
PATH_TOLERANCE = 1e-3
"""A path ends where the mean shift is shorter than this many bandwidths: too short to see."""
SMALL_MODE = 0.01
"""Modes with a smaller share of the hypotheses do not affect the choice of the view."""


class Projection(Record, frozen=True):
    """The view of one hypothesis set, in coordinates within [-1, 1].

    Attributes
    ----------
    manifold
        The name of the manifold.
    hemisphere
        Whether the view is the disc of a hemisphere.
    points
        The hypotheses [n, 2], NaN where one cannot be shown.
    chosen
        Their indices in the set [n].
    labels
        The motions of their modes [n], 0 for none.
    modes
        The modes [m, 2], NaN where one cannot be shown.
    mode_indices
        Their indices among the segmentation's modes.
    paths
        Paths of mean shift, each [steps, 2].
    path_labels
        Their motions.
    shown
        The share of the variance that the two directions show; None for the hemisphere.
    radius
        The length in the tangent space that is drawn as 1.
    origin
        Where the base point of the tangent space is drawn.
    hidden
        The number of hypotheses that are outside of the view or have no logarithm.
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
    hidden: int


def project(report: Report, index: int) -> Projection | None:
    """The view of hypothesis set ``index``.

    None where it has no hypotheses or modes, or points that do not fit its manifold.
    """
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
    step = -(-len(chosen_set.points) // MAX_POINTS)
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
            manifold, centres[0], _of_large_modes(report, index, chosen), _motions(report, modes)
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
    """The places [n, 2], NaN outside of the view, and the number of those."""
    inside = np.max(np.abs(np.nan_to_num(places, nan=np.inf)), axis=1, keepdims=True) <= 1.0
    return np.where(inside, places, np.nan), int(np.sum(~inside))


def _labels(report: Report, index: int, modes: list[int]) -> Integers:
    """The motion of the mode of each hypothesis of a set, 0 for none."""
    count = len(report.sets[index].points)
    if index >= len(report.segmentation.assignments):
        return np.zeros(count, dtype=np.int64)
    assignment = report.segmentation.assignments[index]
    if len(assignment) != count:
        return np.zeros(count, dtype=np.int64)
    motions = np.array([mode.motion for mode in report.segmentation.modes] + [0])
    inside = (assignment >= 0) & (assignment < len(motions) - 1)
    return np.asarray(motions[np.where(inside, assignment, -1)], dtype=np.int64)


def _of_large_modes(report: Report, index: int, chosen: Integers) -> Floats:
    """The chosen hypotheses whose mode is not a small one; all of them where there are none."""
    points = report.sets[index].points
    counts = np.array([mode.hypotheses for mode in report.segmentation.modes])
    if index >= len(report.segmentation.assignments):
        return points[chosen]
    assignment = report.segmentation.assignments[index][chosen]
    inside = (assignment >= 0) & (assignment < len(counts))
    sizes = np.where(inside, counts[np.where(inside, assignment, 0)], 0)
    large = points[chosen[sizes >= SMALL_MODE * len(points)]]
    return large if len(large) else points[chosen]


def _motions(report: Report, modes: list[int]) -> Floats:
    """The modes of a set that became motions, after the densest mode of the set."""
    return np.array(
        [
            report.segmentation.modes[i].point
            for k, i in enumerate(modes)
            if k == 0 or report.segmentation.modes[i].motion > 0
        ]
    )


def _starts(labels: Integers) -> npt.NDArray[np.int64]:
    """The indices of the hypotheses at which paths start."""
    return np.unique(np.round(np.linspace(0, len(labels) - 1, min(PATHS, len(labels)))).astype(int))


def _paths(
    report: Report,
    manifold: Manifold,
    index: int,
    chosen: Integers,
    starts: npt.NDArray[np.int64],
) -> list[Floats]:
    """The paths given with the report, else those of mean shift (10) from a few hypotheses."""
    if index < len(report.trajectories):
        return list(report.trajectories[index])[:PATHS]
    bandwidths, kernel = report.segmentation.bandwidths, _kernel(report)
    if index >= len(bandwidths) or not 0 < bandwidths[index] < np.inf or kernel is None:
        return []
    data = report.sets[index].points[chosen]
    found = ascend(
        manifold.prepare(data, bandwidths[index]),
        kernel,
        data[starts],
        tolerance=PATH_TOLERANCE,
        max_iterations=MAX_STEPS,
        accelerated=False,
        record=True,
    )
    return [np.stack(path) for path in found.paths()]


def _kernel(report: Report) -> Kernel | None:
    """The kernel in the last history entry that names one; None where it is unknown.

    A report without such an entry was not made by ``cluster``: the default kernel is assumed.
    """
    names = [stage.get("settings", {}).get("cluster.kernel", "") for stage in report.history]
    name = next((name for name in reversed(names) if name), "gaussian")
    return next((kernel for kernel in KERNELS.values() if kernel.name == name), None)


def _on_disc(points: Floats) -> Floats:
    """Lambert's equal-area projection of lines [n, 3, 1], the hemisphere z >= 0, to radius 1."""
    vectors = points.reshape(len(points), 3)
    vectors = np.where(vectors[:, 2:] < 0, -vectors, vectors)
    vectors = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return np.asarray(vectors[:, :2] / np.sqrt(1.0 + vectors[:, 2:]))


class _Tangent:
    """The two principal directions of ``points`` in the tangent space at ``base``.

    The view contains nearly all of ``points``, and all of ``motions``.
    """

    def __init__(self, manifold: Manifold, base: Floats, points: Floats, motions: Floats) -> None:
        self.manifold, self.base = manifold, base
        tangents = self._log(points)
        tangents = tangents[np.isfinite(tangents).reshape(len(tangents), -1).all(axis=1)]
        self.frame = tangents[:: max(1, -(-len(tangents) // MAX_TANGENTS))]
        gram = manifold.inner(base, self.frame[:, None], self.frame[None])
        values, vectors = np.linalg.eigh(gram) if len(self.frame) else (np.zeros(0), gram)
        values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
        self.axes = vectors[:, :2] / np.sqrt(np.maximum(values[:2], 1e-300))
        self.shown = float(values[:2].sum() / values.sum()) if values.sum() > 0 else 1.0
        self.centre, self.radius = np.zeros(2), 1.0
        places, required = self.place(points), self.place(motions)
        places = places[np.isfinite(places).all(axis=1)]
        required = np.concatenate([np.zeros((1, 2)), required[np.isfinite(required).all(axis=1)]])
        if len(places):
            low, high = np.quantile(places, [0.02, 0.98], axis=0)
            low = np.minimum(low, required.min(axis=0))
            high = np.maximum(high, required.max(axis=0))
            self.centre = (low + high) / 2
            self.radius = 0.6 * float((high - low).max()) or 1.0
        self.origin = (float(-self.centre[0]) / self.radius, float(-self.centre[1]) / self.radius)

    def _log(self, points: Floats) -> Floats:
        with np.errstate(all="ignore"):
            return self.manifold.log(np.broadcast_to(self.base, points.shape), points)

    def place(self, points: Floats) -> Floats:
        """Where points [n, ...] are drawn [n, 2]; NaN without a logarithm."""
        tangents = self._log(points)
        placed = np.full((len(points), 2), np.nan)
        valid = np.isfinite(tangents).reshape(len(points), -1).all(axis=1)
        if len(self.frame):
            products = self.manifold.inner(self.base, tangents[valid][:, None], self.frame[None])
            flat = products @ self.axes
            placed[valid, : flat.shape[1]] = flat
            placed[valid, flat.shape[1] :] = 0.0
        return (placed - self.centre) / self.radius
