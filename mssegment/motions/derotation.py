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

SCALES = (4.0, 1.0, 0.3)
"""Scales of the Cauchy loss, pixels, one fit after the other: from all matches to the static
world."""
NEAR = 1.0
"""Pixels from the epipolar line within which a match fits."""
LEAST_SHARE = 0.5
"""Share of the matches that the static world must explain: fewer could be a body's own motion."""
LARGEST = 10.0
"""Degrees; a camera that turns more was not meant to translate."""
STARTS = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 0.0, 1.0), (-1.0, 0.0, 1.0))


@dataclass(frozen=True)
class Derotation:
    """``rotation`` [3, 3] turns rays of frame 2 into the orientation of frame 1; ``degrees``.

    ``share`` of the matches fit one translation within a pixel after it.
    """

    rotation: Floats
    degrees: float
    share: float


def find_rotation(points: Floats, camera: Camera) -> Derotation | None:
    """The rotation of the camera between two views, from matches [P, 2, 2] (pixels).

    Fits translation direction and rotation together, Cauchy loss on the Sampson distance. None
    where no translation explains half of the matches, where the rotation is not small, or where it
    explains no more than a camera that did not turn.
    """
    model = Translation()
    coordinates = model.coordinates(points, camera)
    if len(points) < 8:
        return None
    observed = model.observe(points, coordinates)
    still = [_fit(observed, coordinates, np.array([*t, 0.0, 0.0, 0.0]), turn=False) for t in STARTS]
    best_still = min(still, key=lambda fit: fit[1])
    turned = [_fit(observed, coordinates, start[0], turn=True) for start in still]
    parameters, cost = min(turned, key=lambda fit: fit[1])
    residuals = np.abs(_residuals(parameters, observed, coordinates))
    found = Derotation(
        Rotation.from_rotvec(parameters[3:]).as_matrix(),
        float(np.degrees(np.linalg.norm(parameters[3:]))),
        float((residuals < NEAR).mean()),
    )
    # three more parameters must pay for themselves, in nats
    pays = best_still[1] - cost > 1.5 * np.log(len(points))
    return found if pays and found.share >= LEAST_SHARE and found.degrees < LARGEST else None


def _residuals(parameters: Floats, observed: Floats, coordinates: Coordinates) -> Floats:
    """Sampson distances [P] in pixels for (t, rotation vector)."""
    turned = rays(observed[:, 1]) @ Rotation.from_rotvec(parameters[3:]).as_matrix().T
    both = np.stack([observed[:, 0], turned[:, :2] / turned[:, 2:]], axis=1)
    direction = parameters[None, :3] / np.linalg.norm(parameters[:3])
    return np.asarray(sampson(direction, both)[0][0] * coordinates.scale)


def _fit(
    observed: Floats, coordinates: Coordinates, start: Floats, turn: bool
) -> tuple[Floats, float]:
    """Parameters (t, rotation vector) and robust cost in nats, annealed over SCALES."""
    free = 6 if turn else 3
    parameters = start.copy()
    cost = np.inf

    def residuals(x: Floats) -> Floats:
        return _residuals(np.concatenate([x, parameters[free:]]), observed, coordinates)

    for scale in SCALES:
        # the rotation is of the order of a pixel over the focal length
        steps = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])[:free]
        found = least_squares(
            residuals, parameters[:free], x_scale=steps, loss="cauchy", f_scale=scale, max_nfev=40
        )
        parameters = np.concatenate([found.x, parameters[free:]])
        parameters[:3] /= np.linalg.norm(parameters[:3])
        cost = float(found.cost) / scale**2
    return parameters, cost
