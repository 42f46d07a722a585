"""The final fit: each track to one motion, least squares, and the bodies that motions form."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mssegment.models import Flags, MotionModel
from mssegment.records import OUTLIER, Floats, Integers, Motion, Part, Record, replace
from mssegment.segmentation.selection import (
    Body,
    SelectedMotion,
    SelectionProblem,
    SelectionResult,
)
from mssegment.special import chi_square_quantile, median

REFIT_ROUNDS = 3
"""Rounds of the final least squares."""
REFIT_TAIL = 1e-4
"""Share of the true inliers that the final least squares may exclude."""


class Fit(Record, frozen=True):
    """The final motions, largest first, with ``residuals`` [m, n] and ``labels`` [n] of tracks."""

    motions: tuple[Motion, ...]
    residuals: Floats
    labels: Integers


def final_fit(problem: SelectionProblem, selected: SelectionResult) -> Fit:
    """Assign each track to one motion, refit the motions, and number the bodies by size."""
    owner = _owners(selected.motions, _residuals(problem, selected.motions))
    refitted = selected.motions
    if not selected.refitted:
        refitted = _refit(problem, selected.motions, owner)
    residuals = _residuals(problem, refitted)
    owner = _in_front(owner, residuals)
    bodies = selected.bodies
    if bodies is None:
        bodies = tuple(Body((j,)) for j in range(len(refitted)))
    members = [np.isin(owner, body.members) for body in bodies]
    sizes = np.array([own.sum() for own in members], dtype=np.int64)
    order = [int(j) for j in np.argsort(-sizes, kind="stable") if sizes[j] > 0]
    labels = np.full(len(owner), OUTLIER, dtype=np.int64)
    motions, rows = [], []
    for label, j in enumerate(order, start=1):
        labels[members[j]] = label
        row = _residuals_of_body(bodies[j], residuals, owner)
        motions.append(_motion(problem, refitted, bodies[j], label, owner, row))
        rows.append(row)
    found = np.stack(rows) if rows else np.zeros((0, len(owner)))
    return Fit(tuple(motions), found, labels)


def joined_remarks(motions: Sequence[Motion]) -> tuple[str, ...]:
    """Notes for the user on the motions that were joined."""
    return tuple(
        f"motion {motion.label} is one rigid body: {len(motion.parts)} motions agree with one "
        f"epipolar geometry (evidence {motion.rigid_evidence or 0.0:.0f} nats); "
        "segment.granularity none keeps them apart"
        for motion in motions
        if motion.parts
    )


def _motion(
    problem: SelectionProblem,
    refitted: Sequence[SelectedMotion],
    body: Body,
    label: int,
    owner: Integers,
    residuals: Floats,
) -> Motion:
    """The motion of a body, given the ``residuals`` [n] of the tracks from it."""
    own = np.isin(owner, body.members)
    used = [j for j in body.members if (owner == j).any()]
    used.sort(key=lambda j: -int((owner == j).sum()))
    parts = [_part(problem, refitted[j], owner == j, residuals) for j in used]
    saved = [refitted[j].cost_saved for j in used]
    scales = np.array([refitted[j].scale for j in used])
    sizes = np.array([len(part.inliers) for part in parts])
    return Motion(
        label=label,
        set_index=parts[0].set_index,
        model=parts[0].model,
        parameters=parts[0].parameters,
        inliers=problem.tracks[own].astype(np.int64),
        scale=float(np.sqrt((scales**2 @ sizes) / sizes.sum())),
        rms=float(np.sqrt(np.mean(residuals[own] ** 2))),
        cost_saved=None if None in saved else float(sum(s for s in saved if s is not None)),
        parts=tuple(parts) if len(parts) > 1 else (),
        rigid_evidence=body.evidence if len(parts) > 1 else None,
    )


def _part(problem: SelectionProblem, motion: SelectedMotion, own: Flags, residuals: Floats) -> Part:
    return Part(
        set_index=motion.set_index,
        model=problem.observed_sets[motion.set_index].model.name,
        parameters=motion.point,
        inliers=problem.tracks[own].astype(np.int64),
        rms=float(np.sqrt(np.mean(residuals[own] ** 2))),
    )


def _residuals_of_body(body: Body, residuals: Floats, owner: Integers) -> Floats:
    """Residuals [n]: of its own tracks from their part, of the others from the nearest part."""
    found = residuals[list(body.members)].min(axis=0)
    for j in body.members:
        found = np.where(owner == j, residuals[j], found)
    return np.asarray(found)


def _refit(
    problem: SelectionProblem, selected: Sequence[SelectedMotion], owner: Integers
) -> tuple[SelectedMotion, ...]:
    """Final least squares of each motion to its tracks.

    Tracks with residuals beyond the noise of the others are excluded, because a few mismatches
    would bias the fit. Invalid fits are rejected.
    """
    points = [motion.point for motion in selected]
    for index, observed_set in enumerate(problem.observed_sets):
        active = [j for j, motion in enumerate(selected) if motion.set_index == index]
        before = np.zeros((len(active), len(owner)), dtype=bool)
        for _ in range(REFIT_ROUNDS):
            if not active:
                break
            residuals = observed_set.residuals(np.stack([points[j] for j in active]))
            members = owner == np.array(active)[:, None]
            limits = _noise_limits(residuals, members, observed_set.model)
            inliers = members & (residuals <= limits[:, None])
            fitted, valid = observed_set.fit(inliers.astype(np.float64))
            accepted = (
                valid
                & (inliers.sum(axis=1) > observed_set.model.subset_size)
                & (inliers != before).any(axis=1)
            )
            for row in np.flatnonzero(accepted).tolist():
                points[active[row]] = fitted[row]
            active = [active[row] for row in np.flatnonzero(accepted)]
            before = inliers[accepted]
    return tuple(
        replace(motion, point=point) for motion, point in zip(selected, points, strict=True)
    )


def _noise_limits(residuals: Floats, members: Flags, model: MotionModel) -> Floats:
    """Residuals in pixels [m] that a share ``REFIT_TAIL`` of normal noise exceeds.

    The noise of each motion is estimated by the median of ``residuals`` [m, P] of its ``members``
    [m, P].
    """
    tail, half = (
        chi_square_quantile(model.residual_dimension, share) for share in (1 - REFIT_TAIL, 0.5)
    )
    medians = [
        median(row[own]) if own.any() else 0.0 for row, own in zip(residuals, members, strict=True)
    ]
    return np.asarray(np.array(medians) * np.sqrt(tail / half), dtype=np.float64)


def _residuals(problem: SelectionProblem, selected: Sequence[SelectedMotion]) -> Floats:
    """Residuals [m, n] in pixels of the tracks of the problem from the selected motions."""
    residuals = np.zeros((len(selected), len(problem.points)))
    for index, observed_set in enumerate(problem.observed_sets):
        rows = [j for j, motion in enumerate(selected) if motion.set_index == index]
        if rows:
            residuals[rows] = observed_set.residuals(np.stack([selected[j].point for j in rows]))
    return residuals


def _in_front(owner: Integers, residuals: Floats) -> Integers:
    """The owners, -1 for tracks that a plane which the fit has turned puts behind the camera."""
    if not len(residuals):
        return owner
    own = residuals[owner, np.arange(len(owner))]
    return np.where(np.isfinite(own), owner, -1)


def _owners(selected: Sequence[SelectedMotion], residuals: Floats) -> Integers:
    """Index of the motion of each track, -1 for none; the nearest of several."""
    if not selected:
        return np.full(residuals.shape[1], -1, dtype=np.int64)
    distance = np.where(np.stack([motion.inliers for motion in selected]), residuals, np.inf)
    nearest = distance.argmin(axis=0)
    return np.where(np.isfinite(distance.min(axis=0)), nearest, -1).astype(np.int64)
