"""What the description of data that is no picture costs: everything is measured in the data.

Of pictures it is known what they look like: points cost the area of the picture, and noise is a few
pixels. Here a point without a structure costs what the null of the a-contrario test makes expect
(``sampling.null_model``): the median over the modes of how dense the null is near them, so that a
point costs the same beside every structure. The noise is that of the modes, each with the inliers
that the test finds.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from mssegment.models import Flags
from mssegment.records import Floats, Normalization, replace
from mssegment.sampling.null_model import RESOLUTION, NullModel
from mssegment.sampling.observed import ObservedSet
from mssegment.segmentation.mdl.candidates import Candidates, Family
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.likelihood import Noise
from mssegment.segmentation.selection import SelectionProblem
from mssegment.special import median

MAX_POINTS = 4000
"""Points on which structures are selected; of more, a random sample."""
NOISE_ROUNDS = 10
"""Rounds of expectation and maximization of the noise of a mode."""
SCALE_RATIO = 2.0
"""The noise of a structure is at most this many times smaller or larger than that of the modes."""


def data_families(problem: SelectionProblem, degrees_of_freedom: float = math.inf) -> list[Family]:
    """The sets of ``problem`` in normalized coordinates, with costs and noise of the data."""
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
) -> Family:
    points = np.stack(modes)
    noise = max(measured_noise(observed_set, null, points), RESOLUTION)
    return Family(
        index,
        observed_set,
        Noise(
            dimension=observed_set.model.residual_dimension,
            residual_terms=observed_set.model.residual_terms,
            floor=noise / SCALE_RATIO,
            cap=noise * SCALE_RATIO,
            log_free_extent=0.0,
            outlier_cost=-median(null.log_density(points)),
            parallax=np.zeros(len(observed_set.observed)),
            degrees_of_freedom=degrees_of_freedom,
        ),
    )


def without_unit(problem: SelectionProblem) -> SelectionProblem:
    """The problem in normalized coordinates, so that the unit of the data changes nothing."""
    sets = []
    for one in problem.observed_sets:
        unit = Normalization(np.zeros(one.observed.shape[1:]), 1.0)
        sets.append(replace(one, hypotheses=replace(one.hypotheses, normalization=unit)))
    return replace(problem, points=sets[0].observed, observed_sets=tuple(sets))


def sample_of(problem: SelectionProblem) -> SelectionProblem:
    """The problem for a random sample of ``MAX_POINTS`` points, if there are more."""
    count = len(problem.points)
    if count <= MAX_POINTS:
        return problem
    rows = np.sort(problem.rng.choice(count, MAX_POINTS, replace=False))
    sampled = tuple(
        replace(one, tracks=np.arange(len(rows)), observed=one.observed[rows])
        for one in problem.observed_sets
    )
    return replace(
        problem, points=problem.points[rows], observed_sets=sampled, tracks=problem.tracks[rows]
    )


def on_all_points(
    problem: SelectionProblem, found: Candidates, description: Description
) -> tuple[Candidates, Description]:
    """Structures that were found on a sample, and their description, for all points."""
    count = len(problem.points)
    if found.residuals.shape[1] == count:
        return found, description
    families = []
    for family, observed_set in zip(description.families, problem.observed_sets, strict=True):
        noise = replace(family.noise, parallax=np.zeros(count))
        families.append(replace(family, observed_set=observed_set, noise=noise))
    residuals, gains = np.zeros((len(found), count)), np.zeros((len(found), count))
    for family in families:
        rows = np.flatnonzero(found.set_indices == family.index)
        if len(rows):
            points = np.stack([found.points[k] for k in rows])
            residuals[rows] = family.residuals(points)
            scales = found.scales[rows]
            gains[rows] = family.gains(points, residuals[rows], scales, np.zeros((0, 0)))
    whole = replace(found, residuals=residuals, gains=gains, lengths=residuals)
    return whole, replace(description, families=families, positions=problem.points[:, 0])


def measured_noise(observed_set: ObservedSet, null: NullModel, points: Floats) -> float:
    """Standard deviation of a residual coordinate, normalized: that of the most meaningful modes.

    The median over the modes ``points`` [B, ...], weighted by how meaningful they are.
    """
    model, observed = observed_set.model, observed_set.observed
    one = Normalization(np.zeros(observed.shape[1:]), 1.0)
    residuals = model.residuals(points, observed, one)
    inliers, log_nfa = null.inliers(points, residuals)
    scales = _noise_scales(null, points, residuals, inliers)
    weights = np.maximum(null.log_tests - log_nfa, 1e-9)
    order = np.argsort(scales)
    total = np.cumsum(weights[order])
    return float(scales[order][np.searchsorted(total, 0.5 * total[-1])])


def _noise_scales(null: NullModel, points: Floats, residuals: Floats, inliers: Flags) -> Floats:
    """Standard deviation [B] of normal noise in a uniform background, the null near a structure.

    By expectation and maximization from the ``inliers`` [B, P], which end before the noise does.
    """
    c = null.model.residual_dimension
    density = np.exp(null.log_density(points))[:, None]
    square = residuals**2
    share = inliers.mean(axis=1, keepdims=True)
    total = np.maximum(inliers.sum(axis=1, keepdims=True), 1)
    variance = (inliers * square).sum(axis=1, keepdims=True) / (c * total)
    largest = null.radii(points)[:, None] ** 2
    for _ in range(NOISE_ROUNDS):
        variance = np.clip(variance, RESOLUTION**2, largest)
        normal = np.exp(-0.5 * square / variance) / (2.0 * math.pi * variance) ** (0.5 * c)
        of_structure = share * normal / (share * normal + (1.0 - share) * density)
        total = np.maximum(of_structure.sum(axis=1, keepdims=True), 1e-9)
        share = np.minimum(total / residuals.shape[1], 1.0 - 1.0 / residuals.shape[1])
        variance = (of_structure * square).sum(axis=1, keepdims=True) / (c * total)
    return np.asarray(np.sqrt(np.clip(variance, RESOLUTION**2, largest))[:, 0])
