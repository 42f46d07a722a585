"""Are two groups of complete tracks two bodies? A split must pay for its border.

A body is a Student t distribution in the leading principal components of the tracks. Two groups are
two bodies when describing them apart saves more than the motion of the tracks on their border:
where one body is cut in two, the tracks along the cut are described as well by either side, and
what the split saves is no more than what is known about those tracks. The ratio of both is

    R = [L(A and B) - L(A) - L(B)] / [(2 sqrt(pi n) - pi) I contrast^(1/3)],

with description lengths L in nats, n tracks, of which 2 sqrt(pi n) - pi lie on the border of a
disc in a square grid, and I the information about the motion of one track, the sum over the
components from the third on of 1/2 ln(1 + lambda / (2 sigma)^2). The noise sigma is measured.
Groups are apart if R > 1.
"""

from __future__ import annotations

import numpy as np

from mssegment.geometry.flats import extent, local_residuals
from mssegment.geometry.robust import StudentTFit, geman_mcclure_weights
from mssegment.records import Floats, Integers
from mssegment.segmentation.consensus.border import border_contrast

FREEDOM = 5.0
"""Degrees of freedom of the Student t distribution."""
COMPONENTS = 12
"""Leading principal components of the tracks; a body spans 3, its perspective a few more."""
PLACE_COMPONENTS = 2
"""The first components are the places of the tracks, which say nothing about their motion."""
NOISE_UNIT = 2.0
"""The motion of a track is known to so many standard deviations of the noise."""
LEAST_SPREAD = 1 / 320
"""Standard deviation below which differences say nothing, over the extent of the tracks: half a
pixel where they spread over a picture of 640."""
MISFIT_FACTORS = {True: 3.0, False: 1.0}
"""Weight of the correlated misfit of one body (perspective, drift) in the least spread: three
standard deviations for the decision whether there is more than one body, else one."""
CURVED = 14
"""Smaller groups are not described with a quadratic surface, which has six coefficients."""
CURVATURE_ROUNDS = 6
FEWEST_FOR_BORDER = 5
"""Groups of fewer tracks have no border to speak of."""


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
        vectors = points.reshape(len(points), -1)
        centred = vectors - vectors.mean(axis=0)
        values, directions = np.linalg.eigh(centred.T @ centred / len(centred))
        directions = directions[:, : -COMPONENTS - 1 : -1]
        variances = np.maximum(values[: -COMPONENTS - 1 : -1], 0.0)
        misfits = local_residuals(vectors)
        free = max(vectors.shape[1] - 3, 1)
        noise = float(np.median(np.linalg.norm(misfits, axis=1) / np.sqrt(free)))
        self.noise = max(noise, 1e-9 * extent(points))
        in_components = (misfits @ directions)[:, PLACE_COMPONENTS:]
        correlated = float(np.median(np.sqrt((in_components**2).mean(axis=1))))
        systematic = np.sqrt(max(correlated**2 - self.noise**2, 0.0))
        least = float(np.hypot(self.noise, MISFIT_FACTORS[single] * systematic))
        self._least_spread = max(LEAST_SPREAD * extent(points), least)
        motion = variances[PLACE_COMPONENTS:] / (NOISE_UNIT * self.noise) ** 2
        self.information = float(0.5 * np.log1p(motion).sum())
        self._components = centred @ directions
        place = points.mean(axis=1)
        self._place = place - place.mean(axis=0)
        self._costs: dict[bytes, float] = {}

    def ratio(self, first: Integers, second: Integers) -> float:
        """R of two groups, indices of tracks [n] and [m]; above 1 they are two bodies."""
        return self.saved(first, second) / max(self.price(first, second), 1e-12)

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
        """Without the labels: the cheaper of a flat and of a curved body."""
        flat = self._student_t_cost(self._components[group])
        if len(group) < CURVED:
            return flat
        level = without_curvature(self._components[group], self._place[group], self._least_spread)
        return min(flat, self._student_t_cost(level))

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


def without_curvature(components: Floats, place: Floats, scale: float) -> Floats:
    """Components [n, D] of a group less what is quadratic in the mean place of its tracks.

    Perspective bends the flat of a body. The components from the fourth on are regressed robustly
    on 1, the first three, and x^2, xy, y^2 of ``place`` [n, 2]; only the quadratic part is taken
    out. ``scale`` is the residual (pixels) that is noise.
    """
    here = place - place.mean(axis=0)
    x, y = here[:, 0], here[:, 1]
    quadratic = np.stack([x * x, x * y, y * y], axis=1)
    bases = np.concatenate([np.ones((len(here), 1)), components[:, :3], quadratic], axis=1)
    bases = bases / np.maximum(np.abs(bases).max(axis=0), 1e-300)
    target = components[:, 3:]
    weights = np.ones(len(here))
    for _ in range(CURVATURE_ROUNDS):
        root = np.sqrt(weights)[:, None]
        coefficients = np.linalg.lstsq(root * bases, root * target, rcond=None)[0]
        squared = ((target - bases @ coefficients) ** 2).sum(axis=1)
        weights = geman_mcclure_weights(squared, 4 * float(np.median(squared)) + scale**2)
    level = target - bases[:, -3:] @ coefficients[-3:]
    return np.concatenate([components[:, :3], level], axis=1)
