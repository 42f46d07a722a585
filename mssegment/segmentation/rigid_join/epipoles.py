"""The likelihood of parallax over all directions of the epipole.

Relative to a plane, the points of a rigid body move along lines through the epipole. Its direction
is unknown: evidence for a body is a mean over the half-sphere of all directions, computed on a grid
of cells of equal area that is refined where the likelihood is large.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers, Record

FREEDOM = 2.5
"""Degrees of freedom of the Student t distribution of the parallax across the epipolar lines."""
SCALE_OF_NOISE = 1.16
"""Scale of that distribution, over the noise."""
FIRST_CELLS = (8, 32)
"""Cells of the first grid, in height and longitude."""
ROUNDS = 4
"""Rounds of reweighting of the epipole of a group."""
LEVELS = 8
"""How many times cells are divided into four."""
DIVIDED = 16
"""Most cells that are divided at a time for each group."""
NEGLIGIBLE = 8.0
"""Cells whose share of the integral is by this many nats below the largest are not divided."""
SMALLEST = 2.0**-12
"""Cells of this height are not divided."""
PLANE_EXTENT = 2.8
"""Extent of the picture in units of the rms radius of its matches: the focal length at which the
half-sphere is cut into cells."""


class Parallax(Record, frozen=True):
    """Parallax of matches relative to a plane.

    Attributes
    ----------
    places : ndarray [P, 2]
        Images of the points under the homography of the plane.
    shifts : ndarray [P, 2]
        Parallax: where the points are, relative to the ``places``.
    groups : ndarray [P] of int
        Group of each match, 0 to G - 1.
    weights : ndarray [G]
        Exponent of the likelihood of each group.
    scale : float
        Scale of the noise.
    misfits : ndarray [P, 2]
        Where the points are, relative to the plane of their own group; zero in groups with relief.
    """

    places: Floats
    shifts: Floats
    groups: Integers
    weights: Floats
    scale: float
    misfits: Floats

    def log_likelihood(self, epipoles: Floats) -> Floats:
        """Log-likelihood [E, G] of each group with epipoles [E, 3], relative to no parallax.

        Along the lines, relief is free, but a flat group has noise as it has across them. Without
        its code the epipole would be in the direction across which there is least noise by chance.
        Both together have a Student t distribution of two dimensions, which prefers no direction,
        whatever the noise of the group is like.
        """
        direction = epipoles[:, None, :2] - epipoles[:, None, 2:] * (self.places / PLANE_EXTENT)
        square = direction[..., 0] ** 2 + direction[..., 1] ** 2 + 1e-18
        square *= FREEDOM * self.scale**2
        across = direction[..., 0] * self.shifts[:, 1] - direction[..., 1] * self.shifts[:, 0]
        along = direction[..., 0] * self.misfits[:, 0] + direction[..., 1] * self.misfits[:, 1]
        terms = np.log1p((across**2 + along**2) / square)
        dimensions = 1 + (self.misfits != 0).any(axis=1)
        member = self.groups[:, None] == np.arange(len(self.weights))
        exponents = member * ((FREEDOM + dimensions) / 2)[:, None]
        return np.asarray(-self.weights * (terms @ exponents))

    def best_epipole(self, group: int) -> Floats:
        """The epipole [3] that explains the parallax of a group best, in homogeneous coordinates.

        Reweighted least squares of the distances from the lines, which are linear in the epipole.
        """
        own = self.groups == group
        places, shifts = self.places[own] / PLANE_EXTENT, self.shifts[own]
        moment = places[:, 0] * shifts[:, 1] - places[:, 1] * shifts[:, 0]
        lines = np.stack([shifts[:, 1], -shifts[:, 0], -moment], axis=1)
        weights = np.ones(len(lines))
        for _ in range(ROUNDS):
            epipole = np.linalg.eigh((lines * weights[:, None]).T @ lines)[1][:, 0]
            direction = epipole[:2] - epipole[2] * places
            square = (direction**2).sum(axis=1) + 1e-18
            across = (lines @ epipole) ** 2 / square
            weights = 1 / (square * (FREEDOM * self.scale**2 + across))
        return np.asarray(epipole / [1.0, 1.0, PLANE_EXTENT])


class EpipoleTable(Record, frozen=True):
    """Log-likelihood [E, G] of groups in cells of the half-sphere, and logs [E] of their shares.

    ``epipoles`` [E, 3] are the centres of the cells, in homogeneous coordinates of the places.
    """

    values: Floats
    log_shares: Floats
    epipoles: Floats

    @classmethod
    def of(cls, parallax: Parallax, epipole: Floats) -> EpipoleTable:
        """Evaluate the likelihood on a grid refined for every group and for all together.

        It is also refined about an ``epipole`` [3], in homogeneous coordinates of the places, and
        about that of each group: precise parallax has so narrow a peak that a coarse grid misses
        it.
        """
        own = [parallax.best_epipole(k) for k in range(len(parallax.weights))]
        known = np.stack([_cell_coordinates(each) for each in [epipole, *own]])
        cells = _first_cells()
        values = parallax.log_likelihood(_directions(cells))
        for _ in range(LEVELS):
            divided = _to_divide(cells, values)
            near = np.asarray(np.abs(cells[:, None, :2] - known) <= cells[:, None, 2:] / 2)
            divided |= np.any(np.all(near, axis=2), axis=1)
            new = _children(cells[divided])
            cells = np.concatenate([cells[~divided], new])
            fresh = parallax.log_likelihood(_directions(new))
            values = np.concatenate([values[~divided], fresh])
        epipoles = _directions(cells) / [1.0, 1.0, PLANE_EXTENT]
        return cls(values, np.log(cells[:, 2] * cells[:, 3] / (2 * np.pi)), epipoles)

    def log_mean(self, groups: list[int]) -> float:
        """Log of the mean, over all epipoles, of the likelihood of these groups together."""
        terms = self.values[:, groups].sum(axis=1) + self.log_shares
        largest = float(terms.max())
        return largest + math.log(float(np.exp(terms - largest).sum()))


def _first_cells() -> Floats:
    """Cells [n, 4]: height z, longitude, and their widths; equal widths are equal areas."""
    rows, columns = FIRST_CELLS
    z, longitude = np.meshgrid(
        (np.arange(rows) + 0.5) / rows,
        (np.arange(columns) + 0.5) * 2 * np.pi / columns,
        indexing="ij",
    )
    widths = np.full((z.size, 2), [1 / rows, 2 * np.pi / columns])
    return np.concatenate([z.reshape(-1, 1), longitude.reshape(-1, 1), widths], axis=1)


def _cell_coordinates(epipole: Floats) -> Floats:
    """Height and longitude [2] of an epipole [3] on the half-sphere."""
    direction = epipole * [1.0, 1.0, PLANE_EXTENT]
    direction = direction / np.linalg.norm(direction) * (1.0 if direction[2] >= 0 else -1.0)
    longitude = np.arctan2(direction[1], direction[0]) % (2 * np.pi)
    return np.array([direction[2], longitude])


def _directions(cells: Floats) -> Floats:
    """Unit vectors [n, 3] at the centres of cells."""
    radius = np.sqrt(np.maximum(1 - cells[:, 0] ** 2, 0.0))
    x, y = radius * np.cos(cells[:, 1]), radius * np.sin(cells[:, 1])
    return np.stack([x, y, cells[:, 0]], axis=1)


def _children(cells: Floats) -> Floats:
    """The four quarters of each cell."""
    quarters = []
    for up in (-0.25, 0.25):
        for right in (-0.25, 0.25):
            centre = cells[:, :2] + cells[:, 2:] * [up, right]
            quarters.append(np.concatenate([centre, cells[:, 2:] / 2], axis=1))
    return np.concatenate(quarters)


def _to_divide(cells: Floats, values: Floats) -> Flags:
    """Which cells hold most of the integral, of any group or of all together."""
    columns = np.concatenate([values, values.sum(axis=1, keepdims=True)], axis=1)
    columns = columns + np.log(cells[:, 2] * cells[:, 3])[:, None]
    columns[cells[:, 2] <= SMALLEST] = -np.inf
    largest = columns.max(axis=0)
    count = min(DIVIDED, len(columns))
    threshold = np.partition(columns, -count, axis=0)[-count]
    limit = np.maximum(threshold, largest - NEGLIGIBLE)
    above, equal = columns > limit, columns == limit
    # where the likelihood is the same for all epipoles, so are all cells
    equal &= np.cumsum(equal, axis=0) <= count - above.sum(axis=0)
    return np.asarray(((above | equal) & np.isfinite(columns)).any(axis=1))
