"""Affine Lucas-Kanade with gain and offset projected out, for many windows at once.

Inverse compositional: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004. The light between
two views changes by a gain and an offset; the part of each steepest-descent image that these two
can explain is taken out beforehand, so they need no parameters of their own.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.imaging.matching.descriptors import grid
from mssegment.imaging.matching.views import Indices, Singles
from mssegment.imaging.pictures import Grey
from mssegment.imaging.pyramid import Level
from mssegment.records import Floats, Record
from mssegment.special import distinct

RADIUS = 9
STEPS = 12
STILL = 0.03
"""A window whose corners move less than this (pixels) in a step has converged."""
RIDGE = 1e-3
LEAST_GAIN = 0.05
LARGEST_STRETCH = 0.3
"""Entries of one step; larger ones overshoot, and above a half it need not have an inverse."""
ORDER = np.array([0, 3, 1, 2, 4, 5])
"""From (gx, gx u, gx v, gy, gy u, gy v) to (gx, gy, gx u, gx v, gy u, gy v)."""
BLOCK = 1024
"""Windows at a time, so that what each step works on stays in the cache."""


class Windows(Record, frozen=True):
    """Windows between two pyramids: where each is in view 1, and the map that takes it to view 2.

    ``first`` and ``second`` [n, 2] are centres in pixels of the pictures, ``affines`` [n, 2, 2]
    the linear part; ``levels`` and ``levels_second`` [n] the pyramid levels to sample on.
    """

    first: Floats
    second: Floats
    affines: Floats
    levels: Indices
    levels_second: Indices

    def __getitem__(self, rows: npt.NDArray[np.bool_] | Indices) -> Windows:
        return Windows(
            self.first[rows],
            self.second[rows],
            self.affines[rows],
            self.levels[rows],
            self.levels_second[rows],
        )


class Registered(Record, frozen=True):
    """Outcome: refined centres in view 2 [n, 2], linear parts [n, 2, 2], correlation [n]."""

    second: Floats
    affines: Floats
    correlation: Floats


class _Templates:
    """What view 1 says about windows, and how a difference from it turns into a step.

    The steepest-descent images are the gradient times 1, u and v, so every sum that the normal
    equations need is a matrix product of gradients, or their products, with monomials of u, v.
    """

    def __init__(self, patch: Singles, radius: int, parameters: int) -> None:
        self.offsets = grid(2 * radius + 1, 1.0)
        weights = np.exp(-2.0 * ((self.offsets / radius) ** 2).sum(axis=1))
        self.weights = (weights / weights.sum()).astype(np.float32)
        count = len(patch)
        self.shape, self.norms = self.centred(patch[:, 1:-1, 1:-1].reshape(count, -1))
        self.shape /= self.norms[:, None]
        if parameters:
            u, v = self.offsets.T
            self.order = ORDER[:parameters]
            monomials = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
            self.monomials = monomials * self.weights[:, None]
            self.gx = _half(patch[:, 1:-1, 2:] - patch[:, 1:-1, :-2])
            self.gy = _half(patch[:, 2:, 1:-1] - patch[:, :-2, 1:-1])
            self._prepare()

    def _prepare(self) -> None:
        """The normal equations, with gain and offset projected out of them."""
        blocks = [
            (a * b) @ self.monomials
            for a, b in ((self.gx, self.gx), (self.gx, self.gy), (self.gy, self.gy))
        ]
        table = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
        xx, xy, yy = (block[:, table].astype(np.float64) for block in blocks)
        hessian = np.concatenate(
            [np.concatenate([xx, xy], axis=2), np.concatenate([xy, yy], axis=2)], axis=1
        )[:, self.order][:, :, self.order]
        first_order = self.monomials[:, :3]
        offset = np.column_stack([self.gx @ first_order, self.gy @ first_order])[:, self.order]
        self.gain = self._project(self.shape)
        for part in (offset.astype(np.float64), self.gain):
            hessian -= part[:, :, None] * part[:, None, :]
        diagonal = np.einsum("npp->np", hessian)
        hessian += np.eye(len(self.order)) * (RIDGE * np.abs(diagonal) + 1e-6)[:, None, :]
        self.inverse = np.linalg.inv(hessian)

    def _project(self, values: Singles) -> Floats:
        """Inner products [n, 6 or 2] of the steepest-descent images with values [n, K]."""
        first_order = self.monomials[:, :3]
        along_x, along_y = (self.gx * values) @ first_order, (self.gy * values) @ first_order
        return np.column_stack([along_x, along_y])[:, self.order].astype(np.float64)

    def centred(self, values: Singles) -> tuple[Singles, Singles]:
        """Values [n, K] with zero weighted mean, and their weighted norms."""
        values = values - (values @ self.weights)[:, None]
        return values, np.sqrt(np.maximum((values * values) @ self.weights, 1e-12))

    def take(self, rows: npt.NDArray[np.bool_]) -> None:
        """Only some of the windows from here on."""
        self.gx, self.gy, self.shape = self.gx[rows], self.gy[rows], self.shape[rows]
        self.norms, self.gain, self.inverse = self.norms[rows], self.gain[rows], self.inverse[rows]

    def compare(self, seen: Singles) -> tuple[Singles, Singles]:
        """What is seen [n, K] standardised, and its correlation [n] with the templates."""
        standard, norms = self.centred(seen)
        standard /= norms[:, None]
        return standard, (standard * self.shape) @ self.weights

    def step(self, standard: Singles, likeness: Singles) -> Floats:
        """The change of the parameters that a standardised view of the windows asks for.

        Its mean is zero already; its gain against the template is ``likeness``.
        """
        difference = self._project(standard)
        difference -= likeness[:, None] * self.gain
        scale = (self.norms / np.maximum(likeness, LEAST_GAIN)).astype(np.float64)
        solved = np.einsum("nij,nj->ni", self.inverse, difference)
        return np.asarray(solved * scale[:, None])


def _half(difference: Singles) -> Singles:
    difference *= np.float32(0.5)
    return difference.reshape(len(difference), -1)


def register(
    first: list[Level],
    second: list[Level],
    windows: Windows,
    *,
    radius: int = RADIUS,
    steps: int = STEPS,
    affine: bool = True,
) -> Registered:
    """Refine each window's map until picture 2 under it looks like picture 1 up to the light.

    ``affine`` refines position and linear part, otherwise the position alone. The correlation is
    Gaussian weighted; it is -1 where the window came to nothing (left its picture, inverted).
    """
    if not len(windows.first):
        return Registered(windows.second, windows.affines, np.zeros(0))
    ratio1 = np.array([level.ratio for level in first])[windows.levels]
    ratio2 = np.array([level.ratio for level in second])[windows.levels_second]
    start = (windows.first + 0.5) / ratio1 - 0.5
    where = (windows.second + 0.5) / ratio2 - 0.5
    linear = windows.affines * ratio1[:, None, :] / ratio2[:, :, None]
    correlation = np.empty(len(where))
    parameters = (6 if affine else 2) if steps else 0
    for rows, level in _blocks(windows.levels_second, windows.levels):
        patch = _patches(first, start[rows], windows.levels[rows], radius)
        templates = _Templates(patch, radius, parameters)
        where[rows], linear[rows], correlation[rows] = _align(
            templates, second[level].grey, where[rows], linear[rows], radius, steps
        )
    return Registered(
        second=(where + 0.5) * ratio2 - 0.5,
        affines=linear * ratio2[:, :, None] / ratio1[:, None, :],
        correlation=correlation,
    )


def _blocks(levels: Indices, then: Indices) -> Iterator[tuple[Indices, int]]:
    """Rows of one of ``levels`` each, at most BLOCK, ordered by the level ``then``; the level."""
    order = np.lexsort((then, levels))
    for level in distinct(levels):
        rows = order[levels[order] == level]
        for block in np.array_split(rows, -(-len(rows) // BLOCK)):
            yield block, int(level)


def _patches(pyramid: list[Level], centres: Floats, levels: Indices, radius: int) -> Singles:
    """Upright windows of view 1, a pixel wider all around; rows of one level come together."""
    side = 2 * radius + 3
    upright = np.broadcast_to(np.eye(2), (len(centres), 2, 2))
    offsets = _homogeneous(side)
    ends = [0, *(np.flatnonzero(np.diff(levels)) + 1).tolist(), len(levels)]
    parts = [
        _seen(pyramid[levels[a]].grey, centres[a:b], upright[a:b], offsets)
        for a, b in pairwise(ends)
    ]
    return np.concatenate(parts).reshape(-1, side, side)


def _homogeneous(side: int) -> Singles:
    """The offsets of a window as (u, v, 1), [3, side^2]."""
    offsets = grid(side, 1.0)
    return np.column_stack([offsets, np.ones_like(offsets[:, 0])]).T.copy()


def _seen(grey: Grey, centres: Floats, linear: Floats, offsets: Singles) -> Singles:
    """Bilinear samples [n, K] of a picture under windows; its border is repeated outside."""
    maps = np.concatenate([linear, centres[:, :, None]], axis=2).astype(np.float32)
    x, y = maps[:, 0] @ offsets, maps[:, 1] @ offsets
    return np.asarray(cv2.remap(grey, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))


def _align(
    templates: _Templates, grey: Grey, where: Floats, linear: Floats, radius: int, steps: int
) -> tuple[Floats, Floats, Floats]:
    """Centres, linear parts and correlations of windows in a picture after up to ``steps``."""
    offsets = _homogeneous(2 * radius + 1)
    correlation = np.full(len(where), -1.0)
    active = np.arange(len(where))
    for step in range(steps + 1):
        standard, likeness = templates.compare(_seen(grey, where[active], linear[active], offsets))
        correlation[active] = likeness
        if step == steps:
            break
        change = templates.step(standard, likeness)
        alive = _advance(where, linear, active, change, radius)
        correlation[active[~alive]] = -1.0
        moved = np.abs(change[:, :2]).max(axis=1, initial=0.0)
        moved = np.maximum(moved, np.abs(change[:, 2:]).max(axis=1, initial=0.0) * radius)
        moving = alive & (moved > STILL)
        active = active[moving]
        if not len(active):
            break
        if not moving.all():
            templates.take(moving)
    return where, linear, correlation


def _advance(
    where: Floats, linear: Floats, active: Indices, change: Floats, radius: int
) -> npt.NDArray[np.bool_]:
    """Compose the inverse of each step onto the maps, in place; which steps were sane."""
    sane = np.isfinite(change).all(axis=1) & (np.abs(change[:, :2]).max(axis=1) < radius)
    rows = active[sane]
    if change.shape[1] == 6:
        sane &= np.abs(change[:, 2:]).max(axis=1) < LARGEST_STRETCH
        rows = active[sane]
        a, b, c, d = (change[sane, 2:] + (1.0, 0.0, 0.0, 1.0)).T
        undone = np.stack([d, -b, -c, a], axis=-1) / (a * d - b * c)[:, None]
        linear[rows] = linear[rows] @ undone.reshape(-1, 2, 2)
    where[rows] -= np.einsum("nij,nj->ni", linear[rows], change[sane, :2])
    return np.asarray(sane)
