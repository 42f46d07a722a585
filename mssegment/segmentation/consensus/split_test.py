"""Are two groups of complete tracks two bodies? A split must pay for its border.

A body is a Student t distribution of tracks, which are described by their mean places and the
leading principal components of their motion. Two groups are two bodies when describing them apart
saves more than the motion of the tracks on their border: where one body is cut in two, the tracks
along the cut are described as well by either side, and what the split saves is no more than what is
known about those tracks. The ratio of both is

    R = [L(A and B) - L(A) - L(B)] / [(2 sqrt(pi n) - pi) I contrast^(1/3)],

with description lengths L in nats, n tracks, of which 2 sqrt(pi n) - pi lie on the border of a
disc in a square grid, and I the information about the motion of one track beyond an affine map of
the picture, the sum over the components of 1/2 ln(1 + lambda / (2 sigma)^2). The noise sigma is
measured. R of 1 is where a split pays; the searches for the number of motions weigh R with rigid
motion, which it does not know: with epipolar geometry, and with N, the nats by which two rigid
bodies predict the tracks over all frames better than one does.

Perspective bends the flat of a rigid body. A group is described as an affine camera sees it, or
with the perspective taken out, whichever is shorter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mssegment.geometry.flats import extent, local_residuals
from mssegment.geometry.projective_flats import FLAT_DIMENSION, bent_flat
from mssegment.geometry.robust import StudentTFit
from mssegment.records import Floats, Integers
from mssegment.segmentation.consensus.border import border_contrast

FREEDOM = 5.0
"""Degrees of freedom of the Student t distribution."""
COMPONENTS = 10
"""Leading principal components of the motion; a body spans 3 with its places, perspective a few
more. (Of few frames these are all, and the misfit of one body is measured in the leading half: in
all directions together what is correlated cannot be told from noise.)"""
NOISE_UNIT = 2.0
"""The motion of a track is known to so many standard deviations of the noise."""
LEAST_SPREAD = 1 / 320
"""Standard deviation below which differences say nothing, over the extent of the tracks: half a
pixel where they spread over a picture of 640."""
MISFIT_FACTORS = {True: 3.0, False: 1.0}
"""Weight of the correlated misfit of one body (perspective, drift) in the least spread: three
standard deviations for the decision whether there is more than one body, else one."""
FEWEST_FOR_PERSPECTIVE = 14
"""Smaller groups are described as an affine camera sees them: with a depth for each track and a
linear form for each frame, they fit anything."""
FEWEST_FOR_BORDER = 5
"""Groups of fewer tracks have no border to speak of."""


@dataclass(frozen=True)
class GroupFlat:
    """A group as one rigid body.

    Attributes
    ----------
    level : ndarray [n, F, 2]
        The tracks as an affine camera would see them, pixels.
    residuals : ndarray [n]
        Of each track from the flat of the others, pixels.
    """

    level: Floats
    residuals: Floats


class SplitTest:
    """The ratio R of pairs of groups among the same tracks."""

    def __init__(self, points: Floats, agreement: Floats, gaps: Floats, *, single: bool) -> None:
        """For complete tracks [P, F, 2] in pixels.

        Parameters
        ----------
        points
            The tracks.
        agreement, gaps
            Coassociation and distance (pixels) of every two tracks, [P, P].
        single
            Whether the decision is that between one body and several.
        """
        self._agreement, self._gaps = agreement, gaps
        self._points = points
        vectors = points.reshape(len(points), -1)
        self._middle = vectors.mean(axis=0)
        centred = vectors - self._middle
        self._directions, variances = _place_and_motion(centred, points.shape[1])
        self._components = centred @ self._directions
        misfits = local_residuals(vectors)
        free = max(vectors.shape[1] - 3, 1)
        noise = float(np.median(np.linalg.norm(misfits, axis=1) / np.sqrt(free)))
        size = extent(points)
        self.noise = max(noise, 1e-9 * size)
        leading = min(COMPONENTS, points.shape[1] - 1)
        of_motion = (misfits @ self._directions)[:, 2 : 2 + leading]
        correlated = float(np.median(np.sqrt((of_motion**2).mean(axis=1))))
        self._systematic = float(np.sqrt(max(correlated**2 - self.noise**2, 0.0)))
        self._resolvable = LEAST_SPREAD * size
        self._flats: dict[bytes, GroupFlat] = {}
        resolved = variances / (NOISE_UNIT * self.noise) ** 2
        self.information = float(0.5 * np.log1p(resolved).sum())
        self._decide(single)

    def deciding(self, *, single: bool) -> SplitTest:
        """This test for the other decision; what both have in common is not computed again."""
        other = copy(self)
        other._decide(single)
        return other

    def _decide(self, single: bool) -> None:
        self._least_spread = self._least_spread_of(single=single)
        self._costs: dict[bytes, float] = {}

    def _least_spread_of(self, *, single: bool) -> float:
        return max(self._resolvable, self._misfit(single=single))

    def _misfit(self, *, single: bool) -> float:
        """The noise and the correlated misfit of one body, pixels."""
        return float(np.hypot(self.noise, MISFIT_FACTORS[single] * self._systematic))

    def ratio(self, first: Integers, second: Integers) -> float:
        """R of two groups, indices of tracks [n] and [m]."""
        return self.saved(first, second) / max(self.price(first, second), 1e-12)

    def rigid_evidence(self, first: Integers, second: Integers) -> float:
        """N: nats by which two rigid bodies predict two groups better than one does, at least 0.

        From the residuals of the tracks, each from the flat of the other tracks of its group or of
        both groups, in as many directions as components tell motions apart.
        """
        apart = np.concatenate([self._flat(first).residuals, self._flat(second).residuals])
        together = self._flat(np.concatenate([first, second])).residuals
        free = max(self._directions.shape[1] - FLAT_DIMENSION, 1)
        return nats_apart(apart, together, free, self.noise, self.rigid_spread)

    @property
    def rigid_spread(self) -> float:
        """The least spread of the residuals of a rigid body, pixels."""
        return self._least_spread_of(single=True)

    def _flat(self, group: Integers) -> GroupFlat:
        """The flat of a group [n]; it is the same for both decisions."""
        key = group.tobytes()
        if key not in self._flats:
            points, bent = self._points[group], len(group) >= FEWEST_FOR_PERSPECTIVE
            flat = bent_flat(points, self._misfit(single=True), perspective=bent)
            self._flats[key] = GroupFlat(flat.level, flat.own_residuals(points))
        return self._flats[key]

    def saved(self, first: Integers, second: Integers) -> float:
        """Nats that the descriptions of two groups save over that of their union, at least 0."""
        both = np.concatenate([first, second])
        total = len(both)
        parts = self.cost(first, total) + self.cost(second, total)
        return max(self.cost(both, total) - parts, 0.0)

    def price(self, first: Integers, second: Integers) -> float:
        """Nats that a split must save: the motion of the tracks at its border."""
        contrast = 1.0
        if min(len(first), len(second)) >= FEWEST_FOR_BORDER:
            contrast = border_contrast(self._agreement, self._gaps, first, second)
        border = 2 * np.sqrt(np.pi * (len(first) + len(second))) - np.pi
        return float(border * self.information * np.cbrt(contrast))

    def cost(self, group: Integers, total: int) -> float:
        """Description length of a group [n] among ``total`` tracks, nats, up to a constant."""
        key = group.tobytes()
        if key not in self._costs:
            self._costs[key] = self._described(group)
        return self._costs[key] - len(group) * float(np.log(len(group) / total))

    def _described(self, group: Integers) -> float:
        """Without the labels: the shorter description, by an affine or a perspective camera."""
        affine = self._student_t_cost(self._components[group])
        if len(group) < FEWEST_FOR_PERSPECTIVE:
            return affine
        level = self._flat(group).level
        vectors = level.reshape(len(group), -1) - self._middle
        components = vectors @ self._directions
        # three numbers for each frame that the components of the motion can tell apart
        forms = 3 * min(level.shape[1] - 1, components.shape[1] // 2 - 1)
        price = float(0.5 * forms * np.log(len(group)))
        return min(affine, price + self._student_t_cost(components))

    def _student_t_cost(self, components: Floats) -> float:
        """Of the tracks [n, D] and, as the Fisher information prices it, of the distribution.

        The effective dimension kappa = sum lambda / (lambda + spread^2) counts the directions in
        which the group is wider than the least spread; a covariance in kappa dimensions and its
        mean have kappa (kappa + 3) / 2 parameters, each known to 1/2 ln n nats.
        """
        count, dimensions = components.shape
        fit = StudentTFit(components, FREEDOM, self._least_spread)
        fitted = fit(np.ones((1, count)))
        tails = (dimensions + FREEDOM) * np.log1p(fitted.squared[0] / FREEDOM)
        variances = np.linalg.eigvalsh(fitted.scatter[0])
        effective = float(np.maximum(1 - self._least_spread**2 / variances, 0.0).sum())
        price = effective * (effective + 3) / 2 * np.log(count)
        return 0.5 * float(tails.sum() + count * fitted.log_det[0] + price)


def nats_apart(
    apart: Floats, together: Floats, free: Floats | int, noise: float, least: float
) -> float:
    """N of tracks with residuals [n] from their own group and from both groups, pixels.

    The logarithms of the residuals, no smaller than ``least``, in ``free`` directions. Where the
    least spread exceeds the noise, errors of neighbouring tracks are alike: the evidence is then
    worth less, by the ratio of their squares.
    """
    grown = 0.5 * (np.log(together**2 + least**2) - np.log(apart**2 + least**2))
    return max(float((noise / least) ** 2 * (free * grown).sum()), 0.0)


def _place_and_motion(centred: Floats, frames: int) -> tuple[Floats, Floats]:
    """Directions [2F, D] of the tracks, and the variances [D - 2] of the motion that is left.

    The first two directions are the mean place, the others the leading principal components of the
    motion about it. The variances are those of the motion less an affine map of the place.
    """
    place = np.tile(np.eye(2), (frames, 1)) / np.sqrt(frames)
    motion = centred - centred @ place @ place.T
    count = min(COMPONENTS, motion.shape[1] - 2)
    leading = np.linalg.eigh(motion.T @ motion)[1][:, : -count - 1 : -1]
    in_place, in_motion = centred @ place, motion @ leading
    rest = in_motion - in_place @ np.linalg.lstsq(in_place, in_motion, rcond=None)[0]
    variances = np.linalg.eigvalsh(rest.T @ rest / len(rest))
    return np.concatenate([place, leading], axis=1), np.maximum(variances, 0.0)


def nearest_of_each(
    groups: Sequence[Integers], separation: Callable[[Integers, Integers], float]
) -> list[float]:
    """The least separation of each group from another one; infinite for a single group."""
    least = [float("inf")] * len(groups)
    for i, j in combinations(range(len(groups)), 2):
        found = separation(groups[i], groups[j])
        least[i], least[j] = min(least[i], found), min(least[j], found)
    return least
