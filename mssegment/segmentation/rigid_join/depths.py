"""How likely the depths of several groups are those of one rigid scene.

Where one epipolar geometry holds, the displacement along the epipolar lines is inverse depth, up to
a factor and an offset. The pieces of a scene lie within the range of its depths; what moves by
itself along the epipolar lines seems to lie anywhere. The range is unknown: its prior is the same
for every order of magnitude, from the noise to the extent of the picture.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mssegment.geometry.epipolar_fit import EpipolarFit, compatible_plane, mapped_points
from mssegment.geometry.projective import homogeneous
from mssegment.geometry.robust import student_t_weights
from mssegment.records import Floats, Record
from mssegment.segmentation.rigid_join.epipoles import FREEDOM, PLANE_EXTENT
from mssegment.special import median, quantile

RANGES = 60
"""Ranges of depth, equally spaced in the logarithm, over which the likelihood is averaged."""
ROUNDS = 6
"""Rounds of reweighting of the plane of a group."""
NORMAL_DEVIATION = 1.4826
"""Standard deviation of normal noise over the median of its absolute value."""


class InverseDepth(Record, frozen=True):
    """What displacements along the epipolar lines say about depth.

    Attributes
    ----------
    values : ndarray [P]
        Displacement along the epipolar line from where the homography of ``EpipolarCoordinates``
        moves the point, over ``distances``: an affine function of the inverse depth.
    distances : ndarray [P]
        Distance from the epipole, over its median: one unit of ``values`` is so far.
    """

    values: Floats
    distances: Floats


class DepthEvidence:
    """The likelihood of the depths of groups as those of one rigid scene.

    Parameters
    ----------
    centres, reliefs : ndarray [G]
        Inverse depth of each group in the middle, and its standard deviation within the group.
    scale : float
        Scale of the noise.

    Notes
    -----
    A scene has a range, the standard deviation of its inverse depths. The middles of its groups
    are normal with this deviation; a group is flat or, as likely, its relief along the two axes of
    the picture has this deviation too. A body that moves by itself has a range of its own, and its
    middle may be anywhere: alike for every order of magnitude.
    """

    def __init__(self, centres: Floats, reliefs: Floats, scale: float) -> None:
        self._centres = centres
        self._noise = scale
        self._log_orders = math.log(max(PLANE_EXTENT / scale, math.e))
        variances = scale**2 * np.exp(2 * self._log_orders * np.linspace(0, 1, RANGES))
        self._variances = variances + scale**2
        self._reliefs = np.logaddexp(
            _log_relief(reliefs[:, None], np.array([scale**2])),
            _log_relief(reliefs[:, None], self._variances),
        ) - math.log(2.0)
        self._alone = np.array([_log_mean(terms) for terms in self._reliefs])

    def gain(self, group: int, others: Sequence[int]) -> float:
        """Nats for a group to be part of the scene of others, not a body that moves by itself."""
        others = list(others)
        together = self._log_likelihood([*others, group]) - self._log_likelihood(others)
        return together - self._log_free(group, others)

    def total(self, groups: Sequence[int]) -> float:
        """Nats for all groups to be one scene, not bodies that move by themselves."""
        first = [groups[0]]
        free = sum(self._log_free(group, first) for group in groups[1:])
        return self._log_likelihood(list(groups)) - self._log_likelihood(first) - free

    def _log_likelihood(self, groups: list[int]) -> float:
        """Log-likelihood of the groups as parts of one scene, at any place along the lines."""
        centres, count = self._centres[groups], len(groups)
        spread = float(((centres - centres.mean()) ** 2).sum())
        log_normal = -(count - 1) / 2 * np.log(2 * np.pi * self._variances)
        log_normal -= spread / (2 * self._variances) + 0.5 * math.log(count)
        return _log_mean(log_normal + self._reliefs[groups].sum(axis=0))

    def _log_free(self, group: int, others: list[int]) -> float:
        """Log-likelihood of a group by itself."""
        distance = abs(float(self._centres[group] - self._centres[others].mean()))
        density = 2 * max(distance, self._noise) * (1 + self._log_orders)
        return float(self._alone[group]) - math.log(density)


def _log_relief(relief: Floats, variance: Floats) -> Floats:
    """Log-density of the root mean square of two normal variables, up to a constant."""
    return np.asarray(np.log(relief) - np.log(variance) - relief**2 / variance)


def _log_mean(terms: Floats) -> float:
    largest = float(terms.max())
    return largest + math.log(float(np.exp(terms - largest).mean()))


class EpipolarCoordinates(Record, frozen=True):
    """A homography [3, 3] from which displacements are measured, and the epipole [3].

    The homography is compatible with the epipolar geometry and the nearest such one to a
    similarity: a rotation of the camera and a change of its focal length. ``distance`` is the
    median distance of the matches from the epipole.
    """

    homography: Floats
    epipole: Floats
    distance: float

    @classmethod
    def of(
        cls, fit: EpipolarFit, first: Floats, second: Floats, noise: float
    ) -> EpipolarCoordinates:
        """The coordinates for an epipolar geometry and matches [P, 2] that it fits."""
        similar = _similarity(fit.matrix, first, second)
        homography = compatible_plane(fit.matrix, first, similar, noise)
        unscaled = cls(homography, fit.epipole, 1.0).inverse_depth(first, second)
        return cls(homography, fit.epipole, median(unscaled.distances))

    def inverse_depth(self, first: Floats, second: Floats) -> InverseDepth:
        """The inverse depths of matches [P, 2]."""
        places = mapped_points(self.homography, first)[0]
        direction = self.epipole[:2] - self.epipole[2] * places
        distance = np.hypot(direction[:, 0], direction[:, 1]) + 1e-12
        direction /= distance[:, None]
        shift = second - places
        distance /= self.distance
        return InverseDepth(
            (shift * direction).sum(axis=1) / distance,
            distance,
        )


def _similarity(matrix: Floats, first: Floats, second: Floats) -> Floats:
    """Images [P, 2] of points under the similarity that the epipolar lines imply.

    Lines correspond to lines, whatever the depth: how they turn and how their distances change is
    the rotation and the scale.
    """
    lines = [homogeneous(second) @ matrix, homogeneous(first) @ matrix.T]
    before, after = (line[:, 0] + 1j * line[:, 1] for line in lines)
    factor = -(after * before.conj()).sum() / max(float((np.abs(after) ** 2).sum()), 1e-300)
    centres = [quantile(view.T, 0.5) for view in (first, second)]
    turned = factor * ((first - centres[0]) @ [1.0, 1j])
    return np.stack([turned.real, turned.imag], axis=1) + centres[1]


class _Plane(Record, frozen=True):
    """Inverse depths of a group as an affine function of the place.

    ``coefficients`` [3] are of the ``rows`` [P, 3]; misfits [P], their scale, and weights [P].
    """

    rows: Floats
    coefficients: Floats
    misfit: Floats
    scale: float
    weights: Floats

    @classmethod
    def of(cls, places: Floats, found: InverseDepth, noise: float) -> _Plane:
        """Fitted robustly to matches at ``places`` [P, 2], whose origin is their mean."""
        rows = homogeneous(places)
        precision = np.minimum(found.distances, 1.0) ** 2
        weights = precision
        for _ in range(ROUNDS):
            normal = (rows * weights[:, None]).T @ rows
            normal += 1e-9 * np.trace(normal) * np.eye(3)
            solved = np.linalg.solve(normal, (rows * weights[:, None]).T @ found.values)
            misfit = np.abs(found.values - rows @ solved)
            scale = max(noise, NORMAL_DEVIATION * median(misfit))
            weights = precision * student_t_weights((misfit / scale) ** 2, FREEDOM, 1)
        return cls(rows, solved, misfit, scale, weights)


def middle_and_relief(first: Floats, found: InverseDepth, noise: float) -> tuple[float, float]:
    """Inverse depth of a group in its middle, and the standard deviation within it.

    A plane is fitted robustly to the group's matches [P, 2]; relief is that of the plane and, up to
    three scales of the misfit, that about it.
    """
    fit = _Plane.of(first - first.mean(axis=0), found, noise)
    plane = fit.rows @ fit.coefficients
    middle = float(np.average(plane, weights=fit.weights))
    square = (plane - middle) ** 2 + np.minimum(fit.misfit, 3 * fit.scale) ** 2
    return middle, max(math.sqrt(float(np.average(square, weights=fit.weights))), 1e-3 * noise)


def slant_over_noise(first: Floats, found: InverseDepth, noise: float) -> Floats:
    """How far inverse depth changes over a group along the axes of its places, over its scale [2].

    A plane parallel to that from which displacements are measured has none.
    """
    places = first - first.mean(axis=0)
    places = places @ np.linalg.eigh(places.T @ places)[1]
    distance = median(found.distances)
    about = InverseDepth(found.values * distance, found.distances / distance)
    fit = _Plane.of(places, about, noise)
    slant = np.abs(fit.coefficients[:2]) * np.sqrt((places**2).mean(axis=0))
    return np.asarray(slant / fit.scale)
