"""What tracks can agree on: the kinds of hypotheses that consensus draws, each on its manifold.

Consensus only asks which hypotheses fit a track *best*, so a kind of evidence needs no threshold:
a minimal fit, and squared residuals that can be compared between hypotheses of one set.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from mssegment import models
from mssegment.models import Flags
from mssegment.records import Floats, Normalization


class Evidence(ABC):
    """One kind of hypothesis, on two frames or on all of them."""

    name: ClassVar[str]
    subset_size: int
    near: ClassVar[int]
    """The subset comes from a seed and so many of its nearest tracks."""
    share: ClassVar[float]
    """The share of the hypotheses of a set that a track marks: the ones that fit it best."""

    @abstractmethod
    def manifold(self, frames: int) -> str:
        """Where the hypotheses on ``frames`` frames live."""

    @abstractmethod
    def fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Elemental subsets [B, k, F, 2] (coordinates) to points [B, ...], and which are sound."""

    @abstractmethod
    def squared_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared distance of the tracks [P, F, 2] from the hypotheses [B, ...], [P, B]."""

    def normalization(self, points: Floats) -> Normalization:
        """Each view centred, all divided by their common rms radius; ``points`` [P, F, 2]."""
        return models.make("affine").normalization(points)


class Flat(Evidence):
    """A planar patch under an affine camera: its matches (x, y, x', y') lie on a 2-flat of R^4.

    In homogeneous coordinates an affine k-flat of R^n is a (k+1)-dimensional subspace of R^(n+1):
    three matches make a point of G(5,3).
    """

    name: ClassVar[str] = "flat"
    subset_size = 3
    near: ClassVar[int] = 12
    share: ClassVar[float] = 0.1

    def manifold(self, frames: int) -> str:
        """G(5,3)."""
        return "grassmann(5,3)"

    def fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """Orthonormal bases of the spans of the homogeneous matches."""
        matches = samples.reshape(len(samples), 3, 4)
        raised = np.concatenate([matches, np.ones((len(matches), 3, 1))], axis=2)
        basis, triangle = np.linalg.qr(np.swapaxes(raised, 1, 2))
        sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
        return basis, np.asarray(sizes.min(axis=1) > 1e-6 * sizes.max(axis=1))

    def squared_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared distance to the flat in R^4."""
        matches = observed.reshape(len(observed), 4)
        foot, directions = _flat_of_subspace(points)
        apart = (matches**2).sum(axis=1)[:, None] + (foot**2).sum(axis=1) - 2 * matches @ foot.T
        for k in range(directions.shape[2]):
            axis = directions[:, :, k]
            along = matches @ axis.T - (foot * axis).sum(axis=1)
            apart -= along**2
        return np.asarray(np.maximum(apart, 0.0))


class Subspace(Evidence):
    """A body under an affine camera over all frames: a point of G(2F,4), of G(2F,3) if planar."""

    name: ClassVar[str] = "factorization"
    near: ClassVar[int] = 12
    share: ClassVar[float] = 0.05

    def __init__(self, rank: int = 4) -> None:
        """``rank`` 3 planar, 4 general; hypotheses of any rank can be read."""
        self.subset_size = rank

    def manifold(self, frames: int) -> str:
        """G(2F,rank)."""
        return f"grassmann({2 * frames},{self.subset_size})"

    def normalization(self, points: Floats) -> Normalization:
        """One origin for all frames, as the motion model ``factorization`` has it."""
        return models.make(
            "factorization", frames=points.shape[1], rank=self.subset_size
        ).normalization(points)

    def fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The span of the tracks of each subset."""
        vectors = np.swapaxes(samples.reshape(len(samples), self.subset_size, -1), 1, 2)
        basis, triangle = np.linalg.qr(vectors)
        sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
        return basis, np.asarray(sizes.min(axis=1) > 1e-6 * sizes.max(axis=1))

    def squared_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared distance to the subspace in R^2F."""
        vectors = observed.reshape(len(observed), -1)
        apart = np.repeat((vectors**2).sum(axis=1)[:, None], len(points), axis=1)
        for k in range(points.shape[2]):
            apart -= (vectors @ points[:, :, k].T) ** 2
        return np.asarray(np.maximum(apart, 0.0))


class AffineMap(Evidence):
    """A body that hardly turns, far away: an affine motion between two frames, a point of A(2)."""

    name: ClassVar[str] = "affine"
    subset_size = 3
    near: ClassVar[int] = 12
    share: ClassVar[float] = 0.1

    def manifold(self, frames: int) -> str:
        """A(2)."""
        return models.make("affine").manifold.name

    def fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """As the motion model ``affine``."""
        return models.make("affine").minimal_fit(samples)

    def squared_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared transfer errors in the second frame."""
        ends = np.einsum("bij,pj->bpi", points[:, :2], _raised(observed[:, 0]), optimize=True)
        return np.asarray(((ends - observed[:, 1]) ** 2).sum(axis=2).T)


class PlaneMap(Evidence):
    """A plane under a perspective camera: a homography between two frames, a point of SL(3)."""

    name: ClassVar[str] = "homography"
    subset_size = 4
    near: ClassVar[int] = 14
    share: ClassVar[float] = 0.1

    def manifold(self, frames: int) -> str:
        """SL(3)."""
        return models.make("homography").manifold.name

    def fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """As the motion model ``homography``."""
        return models.make("homography").minimal_fit(samples)

    def squared_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared transfer errors both ways; infinite where a point is sent behind a camera."""
        first, second = observed[:, 0], observed[:, 1]
        return np.asarray(
            _transfer(points, first, second)
            + _transfer(np.asarray(np.linalg.inv(points)), second, first)
        )


class Epipolar(Evidence):
    """A rigid body under a perspective camera: a fundamental matrix up to scale, on G(9,1)."""

    name: ClassVar[str] = "fundamental"
    subset_size = 8
    near: ClassVar[int] = 24
    share: ClassVar[float] = 0.1

    def manifold(self, frames: int) -> str:
        """G(9,1): the nine entries, a line through the origin."""
        return "grassmann(9,1)"

    def fit(self, samples: Floats) -> tuple[Floats, Flags]:
        """The eight-point algorithm: the one vector orthogonal to the eight equations."""
        first, second = _raised(samples[:, :, 0]), _raised(samples[:, :, 1])
        equations = (second[..., :, None] * first[..., None, :]).reshape(len(samples), 8, 9)
        orthogonal, triangle = np.linalg.qr(np.swapaxes(equations, 1, 2), mode="complete")
        sizes = np.abs(np.diagonal(triangle, axis1=1, axis2=2))
        return orthogonal[:, :, -1:], np.asarray(sizes.min(axis=1) > 1e-9 * sizes.max(axis=1))

    def squared_residuals(self, points: Floats, observed: Floats) -> Floats:
        """Squared Sampson distances."""
        first, second = _raised(observed[:, 0]), _raised(observed[:, 1])
        matrices = points.reshape(-1, 3, 3)
        lines2 = np.einsum("bij,pj->ibp", matrices, first, optimize=True)
        lines1 = np.einsum("bji,pj->ibp", matrices[:, :, :2], second, optimize=True)
        gap = lines2[0] * second[:, 0] + lines2[1] * second[:, 1] + lines2[2]
        slope = lines2[0] ** 2 + lines2[1] ** 2 + lines1[0] ** 2 + lines1[1] ** 2
        return np.asarray((gap**2 / np.maximum(slope, 1e-30)).T)


EVIDENCE: dict[str, Evidence] = {
    kind.name: kind for kind in (Flat(), Subspace(), AffineMap(), PlaneMap(), Epipolar())
}
"""Name of a hypothesis set's model -> how consensus reads it."""


def _raised(x: Floats) -> Floats:
    return np.concatenate([x, np.ones((*x.shape[:-1], 1))], axis=-1)


def _flat_of_subspace(points: Floats) -> tuple[Floats, Floats]:
    """The flats of subspaces [B, n+1, k+1]: a point [B, n] and orthonormal directions [B, n, k]."""
    heights = points[:, -1]
    square = np.maximum((heights**2).sum(axis=1), 1e-30)
    foot = np.einsum("bik,bk->bi", points[:, :-1], heights) / square[:, None]
    # directions: the combinations of the basis whose last coordinate is zero
    level, _ = np.linalg.qr(heights[:, :, None], mode="complete")
    directions, _ = np.linalg.qr(points[:, :-1] @ level[:, :, 1:])
    return foot, directions


def _transfer(points: Floats, start: Floats, end: Floats) -> Floats:
    """Squared distance of the images of ``start`` [P, 2] from ``end``, [P, B]."""
    x, y, depth = np.einsum("bij,pj->ibp", points, _raised(start), optimize=True)
    front = depth > 1e-9
    inverse = 1.0 / np.where(front, depth, 1.0)
    squared = (x * inverse - end[:, 0]) ** 2 + (y * inverse - end[:, 1]) ** 2
    return np.asarray(np.where(front, squared, np.inf).T)
