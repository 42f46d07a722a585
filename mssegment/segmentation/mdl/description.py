"""How long the description of all tracks is when a set of motions is used.

It consists of the tracks (``likelihood``), their labels (``labelling``), and the parameters of the
motions. All is measured as what is saved against the description without any motion, in nats.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Integers, Record
from mssegment.segmentation.mdl.candidates import Candidates, Family
from mssegment.segmentation.mdl.labelling import (
    frequency_cost,
    frequency_labels,
    neighbour_cost,
    smooth_labels,
)

QUANTUM = 0.5 * float(np.log(12.0)) - 0.5
"""Nats that the best precision saves per parameter (Wallace and Freeman, 1987)."""
CONFIRMED = 2
"""A motion needs so many times the tracks of an elemental subset: as many again confirm it."""
LEAST_LENGTH = 1e-12
"""Pixels; tracks in one place must not make a logarithm infinite."""
FARTHEST = 1e4
"""Pixels; a residual beyond is no longer told apart."""
FORBIDDEN = 1e6
"""Nats; more than any description saves."""


class Description(Record, frozen=True):
    """The description of tracks that lie at ``places`` [P, 2] (pixels, first frame).

    ``fewest`` and ``most`` bound the number of motions; ``price`` multiplies what the parameters
    cost and ``label_cost`` says whether labels cost anything (both for the ablation).

    Labels are coded by frequency where a misfit may be smooth, as parallax is: then coherent labels
    are no evidence of two bodies. Else they are coded by those of the tracks ``nearest`` [P, k] to
    each, and bodies that lie apart are told apart more easily. ``trust`` below 1 pools both
    predictions, with this weight on that of the neighbours: walls meet at an edge, where a slight
    bend must not pass for two planes.

    With ``differences`` a motion may be stated by its difference from a larger one, so that bodies
    that move almost alike are not taken for one. (Not where misfits are smooth inside a body, or
    the parts of one wall move almost alike.)
    """

    families: Sequence[Family]
    places: Floats
    fewest: int = 0
    most: float = np.inf
    price: float = 1.0
    label_cost: bool = True
    nearest: Integers | None = None
    trust: float = 1.0
    differences: bool = False

    def labels(self, chosen: Candidates) -> Integers:
        """The labels [P] that the motions ``chosen`` give, 0 for outliers."""
        return self._labelled(chosen)[0]

    def _labelled(self, chosen: Candidates) -> tuple[Integers, float]:
        """The labels, and what they save without the price of the motions."""
        labels, value = frequency_labels(chosen.gains, self.label_cost, self.nearest is not None)
        if self.nearest is None or not self.label_cost or not len(chosen):
            return labels, value
        if self.trust < 1:
            bent = frequency_cost(labels) - neighbour_cost(labels, self.nearest)
            return labels, value + self.trust * bent
        if len(chosen) > 1:
            labels = smooth_labels(chosen.gains, self.nearest, labels)
        won = labels > 0
        value = float(chosen.gains[labels[won] - 1, np.flatnonzero(won)].sum())
        return labels, value - neighbour_cost(labels, self.nearest)

    def saved(self, chosen: Candidates) -> float:
        """Nats that the motions ``chosen`` save altogether; less than nothing where forbidden."""
        labels, value = self._labelled(chosen)
        count = np.bincount(labels, minlength=len(chosen) + 1)[1:]
        least = [
            CONFIRMED * self.families[int(v)].observed_set.model.subset_size
            for v in chosen.set_indices
        ]
        forbidden = float((count < least).sum())
        # a motion that wins no track is none, whatever the user asked for
        motions = int((count > 0).sum())
        violation = max(self.fewest - motions, len(chosen) - self.most, 0.0)
        price = self._prices(chosen, labels)
        return value - price - FORBIDDEN * (forbidden + 1e3 * violation)

    def worth(self, chosen: Candidates) -> float:
        """Nats that the motions ``chosen`` save, allowed or not."""
        labels, value = self._labelled(chosen)
        return value - self._prices(chosen, labels)

    def _prices(self, chosen: Candidates, labels: Integers) -> float:
        won = labels == np.arange(1, len(chosen) + 1)[:, None]
        count = won.sum(axis=1)
        price = 0.0
        for k in np.flatnonzero(count).tolist():
            stated = self._price(chosen, k, won[k])
            larger = [j for j in range(len(chosen)) if (count[j], -j) > (count[k], -k)]
            if self.differences and larger:
                stated = min(stated, self._difference(chosen, k, won[k], larger))
            price += stated
        return self.price * price

    def _price(self, chosen: Candidates, k: int, inliers: Flags) -> float:
        """Nats to state motion ``k``: each parameter to the precision that its inliers give.

        As many parameters as the residual has dimensions shift the whole body, by up to the extent
        of the scene; the others change its shape and move its tracks by up to its own diameter.
        """
        family = self.families[int(chosen.set_indices[k])]
        model, noise = family.observed_set.model, family.noise
        body = self.places[inliers]
        size = 2 * float(np.linalg.norm(body - body.mean(axis=0))) / math.sqrt(len(body))
        precision = _precision(float(chosen.scales[k]), len(body))
        shift = max(noise.extent - precision, 0.0)
        shape = max(math.log(max(size, LEAST_LENGTH)) - precision, 0.0)
        shifts = min(noise.dimension, model.parameters)
        return shifts * shift + (model.parameters - shifts) * shape

    def _difference(
        self, chosen: Candidates, k: int, inliers: Flags, others: Sequence[int]
    ) -> float:
        """Nats to state motion ``k`` by its difference from one of ``others``.

        Each parameter lies within the root mean square distance that both motions move the tracks
        apart, on either side. This distance has no scale of its own (density 1 / distance).
        """
        family = self.families[int(chosen.set_indices[k])]
        own, scale = chosen.residuals[k][inliers], float(chosen.scales[k])
        weights = family.noise.weights(own[None], np.array([scale]))[0]
        foreign = np.minimum(chosen.residuals[list(others)][:, inliers], FARTHEST)
        # the fit of k makes its residuals orthogonal to what a motion could add
        square = float(((foreign**2 - own**2) @ weights).min()) / float(weights.sum())
        distance = 0.5 * math.log(max(square, LEAST_LENGTH**2))
        precision = _precision(scale, len(own))
        magnitude = math.log1p(max(family.noise.extent - precision, 0.0))
        deviation = max(distance - precision, 0.0) + math.log(2.0)
        return (
            family.observed_set.model.parameters * deviation + magnitude + math.log(len(chosen) - 1)
        )


def _precision(scale: float, count: int) -> float:
    """Log of the precision (pixels) to which ``count`` tracks of this scale give a parameter."""
    return math.log(scale) - 0.5 * math.log(count) + QUANTUM
