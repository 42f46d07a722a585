"""Which groups of matches are one rigid body.

A group may have an epipole of its own, or that of the body. It belongs to the body if the epipole
of the body explains its parallax better than what it would cost to have one of its own. Groups that
translate without parallax, or whose parallax any epipole explains, give no evidence and are not
joined.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from mssegment.geometry.epipolar_fit import (
    EpipolarFit,
    compatible_plane,
    epipolar_fits,
    fit_epipolar,
    mapped_points,
)
from mssegment.geometry.robust import student_t_weights
from mssegment.geometry.rotations import skew
from mssegment.models import Flags
from mssegment.records import Floats, Record
from mssegment.segmentation.rigid_join.depths import (
    DepthEvidence,
    EpipolarCoordinates,
    middle_and_relief,
    slant_over_noise,
)
from mssegment.segmentation.rigid_join.epipoles import (
    FREEDOM,
    SCALE_OF_NOISE,
    EpipoleTable,
    Parallax,
)
from mssegment.segmentation.rigid_join.residuals import noise_of_groups
from mssegment.segmentation.selection import Body
from mssegment.special import quantile

MIN_MATCHES = 4
"""Fewest matches of a group: three do not say more than their affine map."""
MIN_EVIDENCE = 4.0
"""Nats that each member must add to the evidence for a body."""
INDEPENDENT_MATCHES = 50
"""The likelihood of more matches counts as that of so many: their errors are not independent, and
no surface is exactly flat."""
SAMPLED_MATCHES = 200
"""Matches of a group that are looked at."""
MOMENT_ROUNDS = 6
"""Rounds of reweighting of the moments of a misfit."""
OVERFIT = 0.5
"""Nats that a fitted parameter gains on noise."""
PARAMETERS_APART = 3.0
"""Parameters that a plane of its own has beyond the plane of the body with the same epipole."""


class _Group(Record, frozen=True):
    """The matches [n, 2] of a group (a sample), the size of the group, and its weight for each.

    ``plane`` is compatible with the epipolar geometry that fits the group alone, whose evidence is
    ``own``; ``misfits`` [n, 2] are those about it, zero if they are relief. ``rest`` is the
    homography of what does not move.
    """

    name: int
    first: Floats
    second: Floats
    size: int
    weight: float
    plane: Floats
    own: float
    misfits: Floats
    rest: Floats


class _Hypothesis(Record, frozen=True):
    """Members of a body (positions in the list of groups, the reference not among them)."""

    members: tuple[int, ...]
    evidence: float


def rigid_bodies(points: Floats, members: Sequence[Flags], noise: float) -> tuple[Body, ...]:
    """Join groups of matches that are one rigid body.

    Parameters
    ----------
    points : ndarray [P, 2, 2]
        Matches in pixels.
    members : sequence of ndarray [P] of bool
        The matches of each group. Groups of fewer than ``MIN_MATCHES`` are not joined.
    noise : float
        Noise of the matches in pixels (``preprocessing.noise``); less where the epipolar geometries
        of the groups leave less.

    Returns
    -------
    tuple of Body
        Every group in one of them, as its index; the body with the largest group first.
    """
    names = [k for k, own in enumerate(members) if own.sum() >= MIN_MATCHES]
    single = tuple(Body((k,)) for k in range(len(members)) if k not in names)
    if not names:
        return single
    noise = noise_of_groups(points, [members[k] for k in names], noise)
    left, scale = _groups(points, {k: members[k] for k in names}, noise)
    bodies = []
    while left:
        found = _body_of_first(left, scale)
        together = (0, *found.members)
        evidence = found.evidence if found.members else None
        bodies.append(Body(tuple(left[k].name for k in together), evidence))
        left = [group for k, group in enumerate(left) if k not in together]
    return (*bodies, *single)


def pair_evidence(points: Floats, one: Flags, other: Flags, noise: float) -> float:
    """The evidence, in nats, for two groups of matches to be one rigid body; negative against it.

    Parameters are those of ``rigid_bodies``. Each group has at least ``MIN_MATCHES``.
    """
    groups, scale = _groups(points, {0: one, 1: other}, noise)
    found = []
    for fit in _fits(groups, scale):
        table, apart = _table(groups, fit, scale)
        found.append(table.log_mean([0, 1]) - float(apart.sum()))
    return max(found)


def _fits(groups: Sequence[_Group], scale: float) -> list[EpipolarFit]:
    """The epipolar geometries of all matches of the groups."""
    return epipolar_fits(
        np.concatenate([group.first for group in groups]),
        np.concatenate([group.second for group in groups]),
        np.repeat([group.weight for group in groups], [len(group.first) for group in groups]),
        scale,
    )


def _groups(
    points: Floats, members: Mapping[int, Flags], noise: float
) -> tuple[list[_Group], float]:
    """The groups in coordinates of unit size, the largest first, and the scale of the noise."""
    matches = points[np.any(list(members.values()), axis=0)]
    centres = matches.mean(axis=0)
    unit = math.sqrt(float(((matches - centres) ** 2).sum(axis=-1).mean()) / 2)
    normalized, scale = (points - centres) / unit, SCALE_OF_NOISE * noise / unit
    rest = np.eye(3)
    rest[:2, 2] = (centres[0] - centres[1]) / unit
    groups = [_group(normalized[own], name, scale, rest) for name, own in members.items()]
    return sorted(groups, key=lambda group: -group.size), scale


def _group(matches: Floats, name: int, scale: float, rest: Floats) -> _Group:
    size = len(matches)
    sample = matches[np.linspace(0, size - 1, min(size, SAMPLED_MATCHES)).round().astype(int)]
    first, second = sample[:, 0], sample[:, 1]
    weight = min(1.0, INDEPENDENT_MATCHES / size) * size / len(sample)
    fit = fit_epipolar(first, second, np.ones(len(sample)), scale)
    plane = compatible_plane(fit.matrix, first, second, scale)
    places = mapped_points(plane, first)[0]
    same = np.zeros(len(sample), dtype=np.int64)
    shifts = second - places
    misfits = shifts if _is_flat(shifts, scale) else np.zeros_like(shifts)
    parallax = Parallax(places, shifts, same, np.array([weight]), scale, misfits)
    table = EpipoleTable.of(parallax, fit.epipole)
    return _Group(name, first, second, size, weight, plane, table.log_mean([0]), misfits, rest)


def _is_flat(misfits: Floats, scale: float) -> bool:
    """Whether misfits [n, 2] about a plane are no more than noise, by their robust moments."""
    moments = np.eye(2) * scale**2
    for _ in range(MOMENT_ROUNDS):
        regular = moments + 1e-6 * scale**2 * np.eye(2)
        square = ((misfits @ np.linalg.inv(regular)) * misfits).sum(axis=1)
        weights = student_t_weights(square, FREEDOM, 2)
        moments = (misfits * weights[:, None]).T @ misfits / len(misfits)
    return bool(np.linalg.eigvalsh(moments)[-1] <= scale**2)


def _body_of_first(groups: Sequence[_Group], scale: float) -> _Hypothesis:
    """The body of the first of the groups, by the best of several epipolar geometries."""
    count = len(groups)
    best = _Hypothesis((), 0.0)
    waiting: list[tuple[int, ...]] = [(), tuple(range(count))]
    if count > 2:
        waiting += [(0, k) for k in range(1, count)]
    if count > 3:
        waiting += [tuple(j for j in range(count) if j != k) for k in range(1, count)]
    tried: set[tuple[int, ...]] = set()
    while waiting and count > 1:
        fitted_to = waiting.pop(0)
        if fitted_to in tried:
            continue
        tried.add(fitted_to)
        found = _members(groups, fitted_to, scale)
        if found.members:
            waiting.append((0, *found.members))
        if found.evidence > best.evidence:
            best = found
    return best


def _table(
    groups: Sequence[_Group], fit: EpipolarFit | None, scale: float
) -> tuple[EpipoleTable, Floats]:
    """The likelihoods under one epipole, and the evidence [G] for each group as its own body.

    Parallax is relative to the plane of the first group with this epipolar geometry; without one,
    to infinity, where nothing moves unless the camera turns.
    """
    plane, epipole = groups[0].rest, np.array([1.0, 0.0, 0.0])
    if fit is not None:
        plane = compatible_plane(fit.matrix, groups[0].first, groups[0].second, scale)
        epipole = fit.epipole
    places = [mapped_points(plane, group.first)[0] for group in groups]
    parallax = Parallax(
        np.concatenate(places),
        np.concatenate([group.second for group in groups]) - np.concatenate(places),
        np.repeat(np.arange(len(groups)), [len(place) for place in places]),
        np.array([group.weight for group in groups]),
        scale,
        np.concatenate([group.misfits for group in groups]),
    )
    table = EpipoleTable.of(parallax, epipole)
    coordinates = EpipolarCoordinates(plane, epipole, 1.0)
    apart = []
    for k, (group, place) in enumerate(zip(groups, places, strict=True)):
        translates = table.log_mean([k])
        if k > 0 and fit is not None:
            translates -= _price_of_slant(group, coordinates, scale)
        apart.append(max(translates, _evidence_apart(group, place, scale)))
    return table, np.array(apart)


def _members(groups: Sequence[_Group], fitted_to: Sequence[int], scale: float) -> _Hypothesis:
    """The groups that belong to the first one with the epipolar geometry of some of them."""
    fit = None
    if fitted_to:
        fit = min(_fits([groups[k] for k in fitted_to], scale), key=lambda fit: fit.cost)
    table, apart = _table(groups, fit, scale)
    total = table.values[:, 0] + np.maximum(table.values[:, 1:], apart[1:]).sum(axis=1)
    at = int(total.argmax())
    if fit is None:
        fit = EpipolarFit(skew(table.epipoles[at]), 0.0)
    depths = _depths(groups, fit, scale)
    members = [k for k in range(1, len(groups)) if table.values[at, k] > apart[k]]
    while members:
        evidence = table.log_mean([0, *members])
        total_gain = evidence - float(apart[[0, *members]].sum())
        others = {k: [0, *(m for m in members if m != k)] for k in members}
        gains = [
            (total_gain if len(members) == 1 else evidence - table.log_mean(others[k]) - apart[k])
            + depths.gain(k, others[k])
            for k in members
        ]
        weakest = int(np.argmin(gains))
        if gains[weakest] > MIN_EVIDENCE:
            total_gain += depths.total([0, *members])
            return _Hypothesis(tuple(members) if total_gain > MIN_EVIDENCE else (), total_gain)
        members.pop(weakest)
    return _Hypothesis((), 0.0)


def _depths(groups: Sequence[_Group], fit: EpipolarFit, scale: float) -> DepthEvidence:
    """The depths of the groups under one epipolar geometry."""
    reference = groups[0]
    coordinates = EpipolarCoordinates.of(fit, reference.first, reference.second, scale)
    found = [
        middle_and_relief(group.first, coordinates.inverse_depth(group.first, group.second), scale)
        for group in groups
    ]
    middles, reliefs = np.array(found).T
    return DepthEvidence(middles, reliefs, scale)


def _price_of_slant(group: _Group, coordinates: EpipolarCoordinates, scale: float) -> float:
    """What it costs a group that translates by itself to have its parallax along lines.

    Only parallel planes leave parallax of one epipole when they translate by themselves. Where the
    planes are not parallel, the depths of one change relative to the other, and the parallax would
    be as much across the lines as along them: it is not, to the precision of its matches.
    """
    found = coordinates.inverse_depth(group.first, group.second)
    slant = slant_over_noise(group.first, found, scale)
    slant *= math.sqrt(min(group.size, INDEPENDENT_MATCHES))
    return float(np.log(np.maximum(slant, 1.0)).sum())


def _evidence_apart(group: _Group, places: Floats, scale: float) -> float:
    """The evidence for a group with epipole and plane of its own.

    The plane costs what it takes to say how far, to the precision of its matches, it is from the
    plane of the body.
    """
    difference = mapped_points(group.plane, group.first)[0] - places
    difference = difference - quantile(difference.T, 0.5)
    distance = math.sqrt(float((difference**2).sum(axis=1).mean()))
    precision = scale / math.sqrt(min(group.size, INDEPENDENT_MATCHES))
    orders = max(0.0, math.log(max(distance, 1e-300) / precision))
    return group.own - PARAMETERS_APART * (OVERFIT + orders)
