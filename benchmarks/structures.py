"""Structures in data that is no picture: MultiModel beside an oracle and other programs.

The oracle has the true structures, fitted to their true inliers, and the distance threshold that
makes fewest errors. The others are given the number of structures; MultiModel is given the model.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import time
from collections.abc import Callable
from functools import partial

import numpy as np

from mssegment import MultiModel, models
from mssegment.evaluation import evaluate
from mssegment.records import Floats, Integers
from tests.structures import bodies, hyperplanes, subspaces

Data = tuple[Floats, Integers]


def room(
    rng: np.random.Generator,
    planes: int = 5,
    per: int = 150,
    clutter: int = 500,
    noise: float = 0.01,
) -> Data:
    """A room of 4 x 3 x 2.5 m, turned at random: some of its faces, and uniform clutter in it."""
    size = np.array([4.0, 3.0, 2.5])
    faces = [(2, 0), (0, 0), (1, 0), (2, 1), (0, 1)][:planes]
    parts, labels = [], []
    for k, (axis, side) in enumerate(faces):
        own = rng.uniform(0.0, 1.0, (per, 3)) * size
        own[:, axis] = size[axis] * side + noise * rng.standard_normal(per)
        parts.append(own)
        labels += [k + 1] * per
    parts.append(rng.uniform(0.0, 1.0, (clutter, 3)) * size)
    turn, _ = np.linalg.qr(rng.standard_normal((3, 3)))
    order = rng.permutation(planes * per + clutter)
    truth = np.array(labels + [0] * clutter)
    return (np.concatenate(parts) @ turn.T)[order], truth[order]


def range_image(rng: np.random.Generator, noise: float = 0.003) -> Data:
    """A sphere and a cylinder before a wall, as a range camera sees them, with stray points."""
    u, v = np.meshgrid(np.linspace(-1.0, 1.0, 32), np.linspace(-0.75, 0.75, 24))
    depth, label = 3.0 + 0.2 * u, np.zeros(u.shape, dtype=np.int64)
    ball = 0.35**2 - (u + 0.45) ** 2 - (v - 0.1) ** 2
    label[ball > 0.02] = 1
    depth = np.where(label == 1, 2.0 - np.sqrt(np.maximum(ball, 0.0)), depth)
    tube = 0.28**2 - (u - 0.45) ** 2
    label[tube > 0.012] = 2
    depth = np.where(label == 2, 2.2 - np.sqrt(np.maximum(tube, 0.0)), depth)
    points = np.stack([u, v, depth], axis=-1).reshape(-1, 3)
    points[:, 2] += noise * rng.standard_normal(len(points))
    truth = label.ravel()
    # the wall is no quadric of its own: a quarter of it is left, as clutter
    wall = np.flatnonzero(truth == 0)
    kept = np.concatenate([np.flatnonzero(truth > 0), rng.choice(wall, len(wall) // 4, False)])
    points, truth = points[kept], truth[kept]
    points[truth == 0, 2] = rng.uniform(1.5, 3.2, int((truth == 0).sum()))
    order = rng.permutation(len(points))
    return points[order], truth[order]


CASES: dict[str, tuple[str, int | None, Callable[[np.random.Generator], Data]]] = {
    "3 hyperplanes of R^5, 50 %": (
        "hyperplane",
        None,
        partial(hyperplanes, dimension=5, per=100, outliers=300),
    ),
    "hyperplanes, noise x 2": (
        "hyperplane",
        None,
        partial(hyperplanes, dimension=5, per=100, outliers=300, noise=0.02),
    ),
    "hyperplanes, noise x 4": (
        "hyperplane",
        None,
        partial(hyperplanes, dimension=5, per=100, outliers=300, noise=0.04),
    ),
    "3 subspaces G(6,2), 50 %": ("subspace", 2, partial(subspaces, per=100, outliers=300)),
    "subspaces, noise x 4": ("subspace", 2, partial(subspaces, per=100, outliers=300, noise=0.08)),
    "subspaces, 90 %": ("subspace", 2, partial(subspaces, per=100, outliers=2700)),
    "3 subspaces G(8,4), 50 %": (
        "subspace",
        4,
        partial(subspaces, dimension=8, rank=4, per=100, outliers=300),
    ),
    "room of 5 planes, 40 %": ("plane", None, room),
    "3 rigid motions, 40 %": ("rigid3d", None, partial(bodies, per=60, outliers=120)),
    "sphere and cylinder": ("quadric", None, range_image),
    "4 lines in the plane, no outliers": ("line", None, partial(hyperplanes, count=4, outliers=0)),
    "4 lines in the plane, 60 %": ("line", None, partial(hyperplanes, count=4, outliers=360)),
    "no hyperplane of R^5": (
        "hyperplane",
        None,
        partial(hyperplanes, count=0, dimension=5, outliers=600),
    ),
    "no line": ("line", None, partial(hyperplanes, count=0, outliers=300)),
    "no subspace G(6,2)": ("subspace", 2, partial(subspaces, count=0, outliers=300)),
    "one hyperplane of R^5, 50 %": (
        "hyperplane",
        None,
        partial(hyperplanes, count=1, dimension=5, per=150, outliers=150),
    ),
    "one line, no outliers": ("line", None, partial(hyperplanes, count=1, outliers=0)),
}
"""Model, rank and data of each row."""
_NAMES = list(CASES)


def oracle(name: str, rank: int | None, points: Floats, truth: Integers) -> float:
    """The error with the true structures and the best threshold."""
    if not truth.any():
        return 0.0
    data = points[:, None] if points.ndim == 2 else points
    model = models.make(name, frames=data.shape[1], rank=rank or 1, dimension=data.shape[2])
    normalization = model.normalization(data)
    observed = model.observe(data, normalization)
    members = (truth == np.arange(1, truth.max() + 1)[:, None]).astype(np.float64)
    residuals = model.residuals(model.fit(observed, members)[0], observed, normalization)
    nearest, least = residuals.argmin(axis=0) + 1, residuals.min(axis=0)
    limits = np.quantile(least, np.linspace(0.0, 1.0, 300))
    return min(float((np.where(least <= limit, nearest, 0) != truth).mean()) for limit in limits)


def sequential_ransac(points: Floats, count: int, seed: int, threshold: float | None) -> Integers:
    """scikit-learn's RANSACRegressor of the last coordinate on the rest, one after the other.

    ``threshold`` is along the last coordinate; None is the default, the MAD of that coordinate.
    """
    from sklearn.linear_model import RANSACRegressor

    labels, left = np.zeros(len(points), dtype=np.int64), np.arange(len(points))
    for k in range(count):
        peer = RANSACRegressor(random_state=seed, residual_threshold=threshold, max_trials=1000)
        try:
            peer.fit(points[left, :-1], points[left, -1])
        except ValueError:
            break
        labels[left[peer.inlier_mask_]] = k + 1
        left = left[~peer.inlier_mask_]
    return labels


def sequential_planes(points: Floats, count: int, seed: int, threshold: float) -> Integers:
    """pyransac3d's planes, one after the other, with a threshold for the distance."""
    import random

    from pyransac3d import Plane

    random.seed(seed)
    labels, left = np.zeros(len(points), dtype=np.int64), np.arange(len(points))
    for k in range(count):
        _, inliers = Plane().fit(points[left], thresh=threshold)
        labels[left[inliers]] = k + 1
        left = np.delete(left, inliers)
    return labels


def peers(name: str, points: Floats, truth: Integers, seed: int) -> dict[str, Integers]:
    """What other programs find, given the number of structures."""
    count, found = int(truth.max()), {}
    if name == "hyperplane" and count and importlib.util.find_spec("sklearn"):
        found["RANSACRegressor, default"] = sequential_ransac(points, count, seed, None)
        found["RANSACRegressor, 0.05"] = sequential_ransac(points, count, seed, 0.05)
    if name == "plane" and importlib.util.find_spec("pyransac3d"):
        found["pyransac3d, default (0.05)"] = sequential_planes(points, count, seed, 0.05)
        found["pyransac3d, 0.025 (true)"] = sequential_planes(points, count, seed, 0.025)
    return found


def measure(title: str, seeds: range, beside: bool) -> dict[str, object]:
    """One row: errors in per cent, how often the number is right, seconds of CPU."""
    name, rank, make = CASES[title]
    errors: dict[str, list[float]] = {"MultiModel": [], "oracle": []}
    right, seconds, worse = [], [], 0
    for seed in seeds:
        points, truth = make(np.random.default_rng([seed, _NAMES.index(title)]))
        start = time.process_time()
        found = MultiModel(name, rank=rank, random_state=seed).fit(points)
        seconds.append(time.process_time() - start)
        right.append(found.n_structures_ == truth.max())
        errors["MultiModel"].append(evaluate(found.labels_ + 1, truth).misclassification)
        errors["oracle"].append(oracle(name, rank, points, truth))
        worse += errors["MultiModel"][-1] > errors["oracle"][-1] + 0.01
        found_by = peers(name, points, truth, seed) if beside else {}
        for peer, labels in found_by.items():
            errors.setdefault(peer, []).append(evaluate(labels, truth).misclassification)
    return {
        "case": title,
        "errors": {who: round(100.0 * float(np.mean(e)), 2) for who, e in errors.items()},
        "number right": f"{sum(right)} of {len(right)}",
        "more than oracle + 1 point": f"{worse} of {len(right)}",
        "seconds": round(float(np.mean(seconds)), 2),
    }


def main() -> None:
    """Measure the chosen rows, each with the same seeds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="0:20", help="first:last, last excluded")
    parser.add_argument("--rows", nargs="*", default=[], help="words of the rows; default: all")
    parser.add_argument("--peers", action="store_true", help="also run the other programs; slow")
    parsed = parser.parse_args()
    first, last = map(int, parsed.seeds.split(":"))
    for title in CASES:
        if not parsed.rows or any(word in title for word in parsed.rows):
            print(json.dumps(measure(title, range(first, last), parsed.peers)), flush=True)


if __name__ == "__main__":
    main()
