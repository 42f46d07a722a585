"""What the description of data that is no picture costs: everything is measured in the data.

Of pictures it is known what they look like: points cost the area of the picture, and noise is a few
pixels. Here a point without a structure costs what the null of the a-contrario test makes expect
(``sampling.null_model``), for each structure how dense the null is near it. The noise is that of
the modes, each with the inliers that the test finds.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.records import Floats, Normalization
from mssegment.sampling.null_model import RESOLUTION, NullModel
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.mdl.candidates import Family
from mssegment.segmentation.mdl.likelihood import Noise
from mssegment.segmentation.selection import SelectionProblem
from mssegment.special import median

SCALE_RATIO = 3.0
"""The noise of a structure is at most this many times smaller or larger than that of the modes."""


class DataFamily(Family, frozen=True):
    """A family whose points without a structure are described by the null."""

    null: NullModel

    def gains(self, points: Floats, residuals: Floats, scales: Floats, inliers: Floats) -> Floats:
        """Nats that each structure saves on each point, [B, P]."""
        del inliers
        gains = self.noise.gains(residuals, scales)
        return gains + (self.point_cost(points) - self.noise.outlier_cost)[:, None]

    def point_cost(self, points: Floats) -> Floats:
        """Nats [B] to say where a point near each structure is without it, across it."""
        return point_cost(self.null, points, self.observed_set.hypotheses.normalization.scale)


def data_families(problem: SelectionProblem, degrees_of_freedom: float) -> list[Family]:
    """The sets of ``problem``, with costs and noise measured in the data."""
    families: list[Family] = []
    for index, observed_set in enumerate(problem.observed_sets):
        modes = [mode.point for mode in problem.modes if mode.set_index == index]
        null = NullModel.of(observed_set.model, observed_set.observed, problem.rng)
        families.append(_family(index, observed_set, null, modes, degrees_of_freedom))
    return families


def _family(
    index: int,
    observed_set: ObservedSet,
    null: NullModel,
    modes: Sequence[Floats],
    degrees_of_freedom: float,
) -> DataFamily:
    points, unit = np.stack(modes), observed_set.hypotheses.normalization.scale
    noise = max(measured_noise(observed_set, null, points), RESOLUTION) * unit
    return DataFamily(
        index,
        observed_set,
        Noise(
            dimension=observed_set.model.residual_dimension,
            residual_terms=observed_set.model.residual_terms,
            floor=noise / SCALE_RATIO,
            cap=noise * SCALE_RATIO,
            log_free_extent=0.0,
            outlier_cost=median(point_cost(null, points, unit)),
            parallax=np.zeros(len(observed_set.observed)),
            degrees_of_freedom=degrees_of_freedom,
        ),
        null,
    )


def point_cost(null: NullModel, points: Floats, unit: float) -> Floats:
    """Minus the log density of the null near structures [B], per unit of volume of the data."""
    return np.asarray(null.model.residual_dimension * np.log(unit) - null.log_density(points))


def measured_noise(observed_set: ObservedSet, null: NullModel, points: Floats) -> float:
    """Standard deviation of a residual coordinate, normalized: that of the most meaningful modes.

    The median over the modes ``points`` [B, ...], weighted by how meaningful they are.
    """
    model, observed = observed_set.model, observed_set.observed
    one = Normalization(np.zeros(observed.shape[1:]), 1.0)
    residuals = model.residuals(points, observed, one)
    inliers, log_nfa = null.inliers(points, residuals)
    square = (inliers * residuals**2).sum(axis=1) / np.maximum(inliers.sum(axis=1), 1)
    scales = np.sqrt(square / model.residual_dimension)
    weights = np.maximum(-log_nfa, 1e-9)
    order = np.argsort(scales)
    total = np.cumsum(weights[order])
    return float(scales[order][np.searchsorted(total, 0.5 * total[-1])])
