"""The most likely structures, each fitted to all points with the probability that they are its own.

Structures that are fitted to the points that they win, which end before the noise does, have too
small scales, and lose points. And a selection prices points by a null that holds the structures
themselves. Once they are selected, the points that no structure explains tell how dense others are.
"""

from __future__ import annotations

import math

import numpy as np

from mssegment.models import MotionModel
from mssegment.records import Floats, Integers
from mssegment.segmentation.mdl.candidates import Candidates
from mssegment.segmentation.mdl.description import Description
from mssegment.segmentation.mdl.refinement import refit_once
from mssegment.special import chi_square_quantile

ROUNDS, SAME = 50, 1e-3
"""Rounds of expectation and maximization, which end when no probability changes by more."""
NEAR_SHARE = 0.1
"""Share of the points, those nearest to a structure of the unexplained ones, that tell how dense
they are there; see ``sampling.null_model``."""
CORE = 0.99
"""Share of the points of a structure in its core, where others are not told from them."""


def shared_fit(description: Description, current: Candidates) -> Candidates:
    """The structures ``current``, refitted as a mixture."""
    members = np.zeros_like(current.gains)
    for _ in range(ROUNDS):
        before, members = members, memberships(description, current)
        if np.abs(members - before).max(initial=0.0) < SAME:
            break
        current = refit_once(description.families, current, members)
    return current


def shared_labels(description: Description, current: Candidates) -> Integers:
    """The labels [P], 0 where a point more likely belongs to no structure."""
    members = memberships(description, current)
    every = np.concatenate([1.0 - members.sum(axis=0, keepdims=True), members])
    return np.asarray(every.argmax(axis=0))


def memberships(description: Description, current: Candidates) -> Floats:
    """The probability [K, P] that a point belongs to each structure."""
    size = current.residuals.shape[1]
    members = np.exp(np.minimum(current.gains, 0.0))
    members /= 1.0 + members.sum(axis=0)
    log_normal = np.stack(
        [
            _log_normal(_model(description, current, k), current.residuals[k], current.scales[k])
            for k in range(len(current))
        ]
    )
    for _ in range(ROUNDS):
        free = np.maximum(1.0 - members.sum(axis=0), 0.0)
        others = [
            _density(_model(description, current, k), current.residuals[k], current.scales[k], free)
            for k in range(len(current))
        ]
        share = members.mean(axis=1)
        odds = np.log(np.maximum(share, 1.0 / size)) - np.log(others)
        relative = log_normal + odds[:, None]
        peak = np.maximum(relative.max(axis=0), 0.0)
        likely = np.exp(relative - peak)
        before, members = members, likely / (np.exp(-peak) + likely.sum(axis=0))
        if np.abs(members - before).max() < SAME:
            break
    return np.asarray(members)


def _model(description: Description, current: Candidates, k: int) -> MotionModel:
    return description.families[int(current.set_indices[k])].observed_set.model


def _log_normal(model: MotionModel, residuals: Floats, scale: float) -> Floats:
    """The log density of residuals [P] of the noise, per unit of volume of residual vectors."""
    c = model.residual_dimension
    squares = model.residual_terms * residuals**2 / scale**2
    return np.asarray(-0.5 * squares - c * math.log(scale) - 0.5 * c * math.log(2.0 * math.pi))


def _density(model: MotionModel, residuals: Floats, scale: float, free: Floats) -> float:
    """Share of all points that are unexplained, per unit of volume, beside a structure.

    ``free`` [P] is the probability of each point to be unexplained. There is at least one.
    """
    c, size = model.residual_dimension, len(residuals)
    lengths = np.sqrt(model.residual_terms) * residuals
    core = scale * math.sqrt(chi_square_quantile(c, CORE))
    outside = np.flatnonzero(lengths > core)
    if not outside.size:
        return 1.0 / size / _ball(c, core)
    order = outside[np.argsort(lengths[outside])]
    reached = np.cumsum(free[order])
    last = min(int(np.searchsorted(reached, NEAR_SHARE * size)), len(order) - 1)
    volume = _ball(c, float(lengths[order[last]])) - _ball(c, core)
    return max(float(reached[last]), 1.0) / size / max(volume, _ball(c, core))


def _ball(c: int, radius: float) -> float:
    """The volume of a ball."""
    return float(math.pi ** (0.5 * c) / math.gamma(0.5 * c + 1.0) * radius**c)
