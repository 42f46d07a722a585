"""Description length of all tracks, given a set of motions.

It consists of the tracks (``likelihood``), their labels (``labelling``), and the parameters of the
motions. Everything is measured as what is saved, in nats, relative to the description without a
motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mssegment.models import Flags, MotionModel
from mssegment.records import Floats, Integers, Record
from mssegment.segmentation.mdl.candidates import Candidates, Family
from mssegment.segmentation.mdl.contact import contact_cost
from mssegment.segmentation.mdl.degrees import (
    PARAMETERS_OF_DEGREE,
    degree_cost,
    squares_by_degree,
)
from mssegment.segmentation.mdl.granularity import NOISE_SCALES
from mssegment.segmentation.mdl.labelling import (
    frequency_labels,
    mixture_labels,
    neighbour_cost,
    smooth_labels,
)
from mssegment.segmentation.mdl.precision import MIN_LENGTH, log_precision, scale_cost
from mssegment.segmentation.mdl.relief import misfit_across, relief_cost
from mssegment.special import median

SUBSETS_PER_MOTION = 2
"""A motion must have at least this many times the tracks of an elemental subset."""
RESIDUAL_CAP = 1e4
"""Residuals beyond this, in pixels, are treated as equal."""
LOOSE = 1.7
"""Largest median of the residuals of a motion, over that which its scale makes expect. On random
scenes: 1.4 rejects clouds of static points with depth, 2.0 takes mismatches in large pictures."""
ACROSS_RELIEF = 1 / 3
"""Largest misfit across the lines, over that along them, of relief that exceeds all noise; of
mismatches near a scene it is more than a half."""
PENALTY = 1e6
"""Nats per violated bound; more than any description saves."""


class Description(Record, frozen=True):
    """The description of tracks by a set of motions.

    Attributes
    ----------
    families : sequence of Family
        The sets of hypotheses.
    positions : ndarray [P, 2]
        Positions of the tracks in the first frame, in pixels.
    min_motions, max_motions : int
        Bounds of the number of motions.
    parameter_weight : float
        Factor of the cost of the parameters (for the ablation study).
    label_cost : bool
        Whether labels cost anything (for the ablation study).
    neighbours : ndarray [P, k] of int, optional
        Nearest neighbours of each track, if labels are coded by those of the neighbours; otherwise
        they are coded by frequency.
    by_contact : bool
        Whether labels are coded by neighbours only where motions do not touch (``contact``).
    displacements : ndarray [P, 2], optional
        Displacements of the tracks between two pictures, if motions predict points: the parameters
        may then be coded by degrees (``degrees``).
    relative_coding : bool
        Whether the parameters of a motion may be coded relative to those of a larger one.
    shared_points : bool
        Whether a point is described by all motions, each with its share, as by a mixture.
    noise : float
        Noise in pixels; misfit that it explains is no parallax. NaN: all misfit may be parallax.

    Notes
    -----
    Where residuals may vary smoothly, as parallax does, coherent labels are no evidence of two
    motions, and surfaces meet at edges, where a slight curvature must not look like two planes.
    There ``by_contact`` charges every track. Motions that leave parallax free are exact.

    Relative coding separates objects that move almost alike. It is not used where residuals vary
    smoothly within an object, or where parts of one surface move almost alike.
    """

    families: Sequence[Family]
    positions: Floats
    min_motions: int = 0
    max_motions: float = np.inf
    parameter_weight: float = 1.0
    label_cost: bool = True
    neighbours: Integers | None = None
    by_contact: bool = False
    displacements: Floats | None = None
    relative_coding: bool = False
    shared_points: bool = False
    noise: float = float("nan")

    def labels(self, motions: Candidates) -> Integers:
        """The labels [P] with which ``motions`` save most, 0 for outliers."""
        return self._label(motions)[0]

    def _label(self, motions: Candidates) -> tuple[Integers, float]:
        """The labels, and the nats saved before the cost of the parameters."""
        if self.shared_points and self.label_cost:
            return mixture_labels(motions.gains)
        common_frequency = self.neighbours is not None
        labels, saved = frequency_labels(motions.gains, self.label_cost, common_frequency)
        if self.neighbours is None or not self.label_cost or not len(motions):
            return labels, saved
        if self.by_contact:
            found = self._by_contact(motions, labels)
            if len(motions) > 1 and np.isfinite(self.noise):
                # pieces that are apart would touch by one match that another wins by chance
                smooth = smooth_labels(motions.gains, self.neighbours, labels)
                other = self._by_contact(motions, smooth)
                found = max(found, other, key=lambda each: each[1])
            return found
        if len(motions) > 1:
            labels = smooth_labels(motions.gains, self.neighbours, labels)
        assigned = labels > 0
        saved = float(motions.gains[labels[assigned] - 1, np.flatnonzero(assigned)].sum())
        return labels, saved - neighbour_cost(labels, self.neighbours)

    def _by_contact(self, motions: Candidates, labels: Integers) -> tuple[Integers, float]:
        """The labels, and the nats that they save, coded by contact."""
        assert self.neighbours is not None
        assigned = labels > 0
        saved = float(motions.gains[labels[assigned] - 1, np.flatnonzero(assigned)].sum())
        shares = self._smooth_shares(motions, labels)
        return labels, saved - contact_cost(labels, self.neighbours, shares)

    def _smooth_shares(self, motions: Candidates, labels: Integers) -> Floats:
        """The share of the squared misfit of each motion that is parallax, [m]."""
        shares = np.zeros(len(motions))
        for k in range(len(motions)):
            own = labels == k + 1
            if own.any():
                family = self.families[int(motions.set_indices[k])]
                square = float((family.noise.parallax[own] ** 2).mean())
                _, along, free = motions.shapes[k, :3].tolist()
                if np.isfinite(self.noise):
                    if not family.with_relief:
                        free = family.noise.free_scale(motions.residuals[k][own])
                    square = min(square, max(free**2 - (NOISE_SCALES[0] * self.noise) ** 2, 0.0))
                shares[k] = square / along**2
        return np.minimum(shares, 1.0)

    def saved(self, motions: Candidates) -> float:
        """Nats that ``motions`` save; far below zero if bounds are violated."""
        labels, saved = self._label(motions)
        count = np.bincount(labels, minlength=len(motions) + 1)[1:]
        least = [
            least_tracks(self.families[int(index)].observed_set.model)
            for index in motions.set_indices
        ]
        too_small = float((count < least).sum()) + self._too_loose(motions, labels)
        # motions without tracks do not count
        number = int((count > 0).sum())
        violation = max(self.min_motions - number, len(motions) - self.max_motions, 0.0)
        cost = self.parameter_cost(motions, labels)
        return saved - cost - PENALTY * (too_small + 1e3 * violation)

    def _too_loose(self, motions: Candidates, labels: Integers) -> int:
        """How many motions are no better than their largest scale: tracks without a motion.

        The scale is bounded, but the residuals of its tracks are not: where saying that a track is
        an outlier is expensive, a motion could take up all that are left.
        """
        found = 0
        for k in range(len(motions)):
            tracks = labels == k + 1
            own, shape = motions.residuals[k][tracks], motions.shapes[k]
            noise = self.families[int(motions.set_indices[k])].noise
            limit = LOOSE * noise.quantile(0.5) * float(motions.scales[k])
            loose = bool(len(own)) and median(own) > limit
            if len(own) and shape[1] > max(noise.cap, shape[3]):
                # what no isotropic noise explains is relief, across which there is noise, or little
                across = median(misfit_across(shape, own, motions.lengths[k][tracks]))
                across /= noise.median_of_coordinate
                loose |= across > max(LOOSE * noise.middle, ACROSS_RELIEF * float(shape[1]))
            found += loose
        return found

    def saved_without_bounds(self, motions: Candidates) -> float:
        """Nats that ``motions`` save, whether or not bounds are violated."""
        labels, saved = self._label(motions)
        return saved - self.parameter_cost(motions, labels)

    def parameter_cost(self, motions: Candidates, labels: Integers) -> float:
        """Nats to code the parameters of all motions that have tracks."""
        inliers = labels == np.arange(1, len(motions) + 1)[:, None]
        count = inliers.sum(axis=1)
        total = 0.0
        for k in np.flatnonzero(count).tolist():
            cost = self._absolute_cost(motions, k, inliers[k])
            if self.displacements is not None:
                # a map of the plane departs from a translation by degrees, epipolar geometry not
                model = self.families[int(motions.set_indices[k])].observed_set.model
                if not model.leaves_parallax_free:
                    by_degrees = self._cost_by_degrees(motions, k, inliers[k], self.displacements)
                    cost = min(cost, by_degrees)
                cost += self._scale_cost(motions, k, int(count[k]))
            larger = [j for j in range(len(motions)) if (count[j], -j) > (count[k], -k)]
            if self.relative_coding and larger:
                cost = min(cost, self._relative_cost(motions, k, inliers[k], larger))
            total += cost
        return self.parameter_weight * total

    def _absolute_cost(self, motions: Candidates, k: int, inliers: Flags) -> float:
        """Nats to code motion ``k``: each parameter to the precision that its inliers allow.

        As many parameters as the residual has dimensions shift the whole object, by up to the
        extent of the scene. The others change its shape and move its tracks by up to its diameter.
        """
        family = self.families[int(motions.set_indices[k])]
        model, noise = family.observed_set.model, family.noise
        positions = self.positions[inliers]
        count = len(positions)
        size = 2 * float(np.linalg.norm(positions - positions.mean(axis=0))) / math.sqrt(count)
        precision = log_precision(float(motions.scales[k]), count)
        shift = max(noise.log_extent - precision, 0.0)
        shape = max(math.log(max(size, MIN_LENGTH)) - precision, 0.0)
        shifts = min(noise.dimension, model.parameters)
        return shifts * shift + (model.parameters - shifts) * shape

    def _cost_by_degrees(
        self, motions: Candidates, k: int, inliers: Flags, displacements: Floats
    ) -> float:
        """Nats to code motion ``k`` as a translation and what departs from it.

        The variance of each degree has no scale of its own, as in ``_relative_cost``.
        """
        family = self.families[int(motions.set_indices[k])]
        parameters, noise = family.observed_set.model.parameters, family.noise
        residuals, scale = motions.residuals[k][inliers], float(motions.scales[k])
        weights = noise.weights(residuals[None], np.array([scale]))[0]
        squares = squares_by_degree(
            self.positions[inliers], displacements[inliers], motions.lengths[k][inliers], weights
        )
        precision = log_precision(scale, len(residuals))
        range_of_shift = max(noise.log_extent - precision, 0.0)
        shifts = min(noise.dimension, parameters)
        degrees = -(-(parameters - shifts) // PARAMETERS_OF_DEGREE)
        # which of the two codes it is costs ln 2
        total = math.log(2.0) + shifts * range_of_shift + degrees * math.log1p(range_of_shift)
        return total + sum(degree_cost(one, len(residuals), scale) for one in squares[:degrees])

    def _scale_cost(self, motions: Candidates, k: int, count: int) -> float:
        """Nats to code the scale of motion ``k`` within its bounds."""
        family = self.families[int(motions.set_indices[k])]
        noise, bounds = family.noise, (family.noise.floor, family.noise.cap)
        if not family.with_relief:
            return scale_cost(bounds, noise.dimension, count, noise.degrees_of_freedom)
        return relief_cost(motions.shapes[k], count, noise)

    def _relative_cost(
        self, motions: Candidates, k: int, inliers: Flags, others: Sequence[int]
    ) -> float:
        """Nats to code motion ``k`` by its difference from one of ``others``.

        Each parameter is within the root mean square distance by which the two motions move the
        tracks apart, on either side. This distance has no scale of its own (density 1 / distance).
        """
        family = self.families[int(motions.set_indices[k])]
        residuals, scale = motions.residuals[k][inliers], float(motions.scales[k])
        weights = family.noise.weights(residuals[None], np.array([scale]))[0]
        from_others = np.minimum(motions.residuals[list(others)][:, inliers], RESIDUAL_CAP)
        # the residuals of a least-squares fit are orthogonal to what another motion could add
        square = float(((from_others**2 - residuals**2) @ weights).min()) / float(weights.sum())
        distance = 0.5 * math.log(max(square, MIN_LENGTH**2))
        precision = log_precision(scale, len(residuals))
        magnitude = math.log1p(max(family.noise.log_extent - precision, 0.0))
        per_parameter = max(distance - precision, 0.0) + math.log(2.0)
        parameters = family.observed_set.model.parameters
        return parameters * per_parameter + magnitude + math.log(len(motions) - 1)


def least_tracks(model: MotionModel) -> int:
    """The fewest tracks that a motion of this model must have."""
    return SUBSETS_PER_MOTION * model.subset_size
