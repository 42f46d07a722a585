"""The small rotation of a camera that was meant to translate.

Half a degree between two frames moves a far background by several pixels and by more than the
noise across its epipolar lines, so that equation (25) holds for nothing any more. The rotation is
found from the matches themselves, robustly: most of them are the static world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from mssegment.motions.translation import Translation, rays, sampson
from mssegment.records import Camera, Coordinates, Floats

COARSE, FINE = 1.0, (0.3, 0.1, 0.05)
"""Scales of the Cauchy loss, pixels, one fit after the other: from all matches to the static
world, which a good tracker sees to a tenth of a pixel."""
SAMPLE = 400
"""Matches that the coarse fits look at."""
REFINED = 4
"""Coarse fits that are refined: a turn and a shift sideways look alike, so there are several."""
RESTARTS, RESTART_SIZE = 60, 10
NEAR = 1.0
"""Pixels from the epipolar line within which a match fits."""
LEAST_SHARE = 0.6
"""Share of the matches that the static world must explain: fewer could be a body's own motion."""
LARGEST = 10.0
"""Degrees; a camera that turns more was not meant to translate."""
STARTS = tuple(
    (x, y, z) for z in (0.0, 1.0) for x in (-1.0, 0.0, 1.0) for y in (-0.5, 0.0, 0.5) if x or z
)
"""Directions of translation to start from."""


@dataclass(frozen=True)
class Derotation:
    """``rotation`` [3, 3] turns rays of frame 2 into the orientation of frame 1; ``degrees``.

    ``share`` of the matches fit one translation within a pixel after it.
    """

    rotation: Floats
    degrees: float
    share: float


def find_rotation(points: Floats, camera: Camera, rng: np.random.Generator) -> Derotation | None:
    """The rotation of the camera between two views, from matches [P, 2, 2] (pixels).

    Fits translation direction and rotation together, Cauchy loss on the Sampson distance. None
    where no translation explains most of the matches, where the rotation is not small, or where it
    explains no more than a camera that did not turn.
    """
    model = Translation()
    coordinates = model.coordinates(points, camera)
    if len(points) < 8:
        return None
    observed = model.observe(points, coordinates)
    costs = {}
    for turn in (False, True):
        costs[turn] = min(_search(observed, coordinates, turn, rng), key=lambda fit: fit[1])
    parameters, cost = costs[True]
    residuals = np.abs(_residuals(parameters, observed, coordinates))
    found = Derotation(
        Rotation.from_rotvec(parameters[3:]).as_matrix(),
        float(np.degrees(np.linalg.norm(parameters[3:]))),
        float((residuals < NEAR).mean()),
    )
    # three more parameters must pay for themselves, in nats
    pays = costs[False][1] - cost > 1.5 * np.log(len(points))
    return found if pays and found.share >= LEAST_SHARE and found.degrees < LARGEST else None


def _residuals(parameters: Floats, observed: Floats, coordinates: Coordinates) -> Floats:
    """Sampson distances [P] in pixels for (t, rotation vector)."""
    turned = rays(observed[:, 1]) @ Rotation.from_rotvec(parameters[3:]).as_matrix().T
    both = np.stack([observed[:, 0], turned[:, :2] / turned[:, 2:]], axis=1)
    direction = parameters[None, :3] / np.linalg.norm(parameters[:3])
    return np.asarray(sampson(direction, both)[0][0] * coordinates.scale)


def _search(
    observed: Floats, coordinates: Coordinates, turn: bool, rng: np.random.Generator
) -> list[tuple[Floats, float]]:
    """The best of all starts, refined: parameters (t, rotation vector) and robust cost in nats."""
    some = observed[:: max(1, len(observed) // SAMPLE)]
    coarse = [
        _fit(some, coordinates, np.array([*t, 0.0, 0.0, 0.0]), turn, COARSE, 12) for t in STARTS
    ]
    coarse.sort(key=lambda fit: fit[1])
    refined = [_refined(observed, coordinates, fit[0], turn) for fit in coarse[:REFINED]]
    refined.sort(key=lambda fit: fit[1])
    # moving bodies drag the static world's motion along: start again from a few matches at a time
    best = refined[0][0]
    near = np.flatnonzero(np.abs(_residuals(best, observed, coordinates)) < NEAR)
    if len(near) < RESTART_SIZE:
        return refined
    restarts = []
    for _ in range(RESTARTS):
        some = observed[rng.choice(near, RESTART_SIZE, replace=False)]
        parameters, _ = _fit(some, coordinates, best, turn, FINE[0], 8)
        error = _residuals(parameters, observed, coordinates) / FINE[-1]
        restarts.append((parameters, 0.5 * float(np.log1p(error**2).sum())))
    restarts.sort(key=lambda fit: fit[1])
    refined += [_refined(observed, coordinates, fit[0], turn) for fit in restarts[:REFINED]]
    return refined


def _refined(
    observed: Floats, coordinates: Coordinates, parameters: Floats, turn: bool
) -> tuple[Floats, float]:
    """A robust fit to all matches, down to the finest scale."""
    cost = np.inf
    for scale in FINE:
        parameters, cost = _fit(observed, coordinates, parameters, turn, scale, 30)
    return parameters, cost


def _fit(
    observed: Floats, coordinates: Coordinates, start: Floats, turn: bool, scale: float, limit: int
) -> tuple[Floats, float]:
    """One robust fit: parameters (t, rotation vector) and cost over the squared scale (nats)."""
    free = 6 if turn else 3

    def residuals(x: Floats) -> Floats:
        return _residuals(np.concatenate([x, start[free:]]), observed, coordinates)

    # the rotation is of the order of a pixel over the focal length
    steps = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])[:free]
    found = least_squares(
        residuals, start[:free], x_scale=steps, loss="cauchy", f_scale=scale, max_nfev=limit
    )
    parameters = np.concatenate([found.x, start[free:]])
    parameters[:3] /= np.linalg.norm(parameters[:3])
    return parameters, float(found.cost) / scale**2
