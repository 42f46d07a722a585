"""Affine Lucas-Kanade with gain and offset projected out, for many windows at once.

Inverse compositional: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004. The light between
two views changes by a gain and an offset; the part of each steepest-descent image that these two
can explain is taken out beforehand, so they need no parameters of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mssegment.imaging.matching.descriptors import grid
from mssegment.imaging.matching.views import Indices, Singles, sample
from mssegment.imaging.pyramid import Level
from mssegment.records import Floats

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


@dataclass(frozen=True)
class Windows:
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


@dataclass(frozen=True)
class Registered:
    """Outcome: refined centres in view 2 [n, 2], linear parts [n, 2, 2], correlation [n]."""

    second: Floats
    affines: Floats
    correlation: Floats


class _Templates:
    """What view 1 says about windows, and how a difference from it turns into a step.

    The steepest-descent images are the gradient times 1, u and v, so every sum that the normal
    equations need is a matrix product of gradients, or their products, with monomials of u, v.
    """

    def __init__(self, patch: Singles, radius: int) -> None:
        self.offsets = grid(2 * radius + 1, 1.0)
        weights = np.exp(-2.0 * ((self.offsets / radius) ** 2).sum(axis=1))
        self.weights = (weights / weights.sum()).astype(np.float32)
        u, v = self.offsets.T
        self.first_order = np.column_stack([np.ones_like(u), u, v]) * self.weights[:, None]
        count = len(patch)
        self.gx = ((patch[:, 1:-1, 2:] - patch[:, 1:-1, :-2]) * np.float32(0.5)).reshape(count, -1)
        self.gy = ((patch[:, 2:, 1:-1] - patch[:, :-2, 1:-1]) * np.float32(0.5)).reshape(count, -1)
        self.shape, self.norms = self.standardise(patch[:, 1:-1, 1:-1].reshape(count, -1))

    def standardise(self, values: Singles) -> tuple[Singles, Singles]:
        """Zero weighted mean and unit weighted norm; the norms."""
        centred = values - (values @ self.weights)[:, None]
        norms = np.sqrt(np.maximum((centred * centred) @ self.weights, 1e-12))
        centred /= norms[:, None]
        return centred, norms

    def prepare(self, affine: bool) -> None:
        """The normal equations, with gain and offset projected out of them."""
        self.order = ORDER if affine else ORDER[:2]
        u, v = self.offsets.T
        second_order = np.column_stack([self.first_order, (self.first_order[:, 1:] * u[:, None])])
        second_order = np.column_stack([second_order, self.first_order[:, 2] * v])
        blocks = [
            (a * b) @ second_order
            for a, b in ((self.gx, self.gx), (self.gx, self.gy), (self.gy, self.gy))
        ]
        table = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])
        xx, xy, yy = (block[:, table].astype(np.float64) for block in blocks)
        hessian = np.concatenate(
            [np.concatenate([xx, xy], axis=2), np.concatenate([xy, yy], axis=2)], axis=1
        )[:, self.order][:, :, self.order]
        self.offset_part = self.project(np.ones_like(self.gx), np.arange(len(self.gx)))
        self.gain_part = self.project(self.shape, np.arange(len(self.gx)))
        for part in (self.offset_part, self.gain_part):
            hessian -= part[:, :, None] * part[:, None, :]
        diagonal = np.einsum("npp->np", hessian)
        hessian += np.eye(len(self.order)) * (RIDGE * np.abs(diagonal) + 1e-6)[:, None, :]
        self.inverse = np.linalg.inv(hessian)

    def project(self, values: Singles, rows: Indices) -> Floats:
        """Inner products [n, 6 or 2] of the steepest-descent images with values [n, K]."""
        along_x = (self.gx[rows] * values) @ self.first_order
        along_y = (self.gy[rows] * values) @ self.first_order
        return np.column_stack([along_x, along_y])[:, self.order].astype(np.float64)

    def step(self, standard: Singles, likeness: Singles, rows: Indices) -> Floats:
        """The change of the parameters that a standardised view of the windows asks for.

        Its mean is zero already; its gain against the template is ``likeness``.
        """
        difference = self.project(standard, rows)
        difference -= likeness[:, None] * self.gain_part[rows]
        scale = (self.norms[rows] / np.maximum(likeness, LEAST_GAIN)).astype(np.float64)
        solved = np.einsum("nij,nj->ni", self.inverse[rows], difference)
        return np.asarray(solved * scale[:, None])


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
    where = (windows.second + 0.5) / ratio2 - 0.5
    linear = windows.affines * ratio1[:, None, :] / ratio2[:, :, None]
    templates = _templates(first, (windows.first + 0.5) / ratio1 - 0.5, windows.levels, radius)
    if steps:
        templates.prepare(affine)
    correlation = np.full(len(where), -1.0)
    active = np.arange(len(where))
    for step in range(steps + 1):
        position = templates.offsets @ linear[active].transpose(0, 2, 1).astype(np.float32)
        position += where[active, None, :].astype(np.float32)
        seen = sample(second, windows.levels_second[active], position[..., 0], position[..., 1])
        standard, _ = templates.standardise(seen)
        likeness = (standard * templates.shape[active]) @ templates.weights
        correlation[active] = likeness
        if step == steps:
            break
        change = templates.step(standard, likeness, active)
        alive = _advance(where, linear, active, change, radius)
        correlation[active[~alive]] = -1.0
        moved = np.abs(change[:, :2]).max(axis=1, initial=0.0)
        moved = np.maximum(moved, np.abs(change[:, 2:]).max(axis=1, initial=0.0) * radius)
        active = active[alive & (moved > STILL)]
        if not len(active):
            break
    return Registered(
        second=(where + 0.5) * ratio2 - 0.5,
        affines=linear * ratio2[:, :, None] / ratio1[:, None, :],
        correlation=correlation,
    )


def _templates(pyramid: list[Level], centres: Floats, levels: Indices, radius: int) -> _Templates:
    wide = grid(2 * radius + 3, 1.0)
    x, y = centres.astype(np.float32).T[:, :, None]
    patch = sample(pyramid, levels, x + wide[:, 0], y + wide[:, 1])
    return _Templates(patch.reshape(-1, 2 * radius + 3, 2 * radius + 3), radius)


def _advance(
    where: Floats, linear: Floats, active: Indices, change: Floats, radius: int
) -> npt.NDArray[np.bool_]:
    """Compose the inverse of each step onto the maps, in place; which steps were sane."""
    sane = np.isfinite(change).all(axis=1) & (np.abs(change[:, :2]).max(axis=1) < radius)
    rows = active[sane]
    if change.shape[1] == 6:
        sane &= np.abs(change[:, 2:]).max(axis=1) < LARGEST_STRETCH
        rows = active[sane]
        linear[rows] = linear[rows] @ np.linalg.inv(np.eye(2) + change[sane, 2:].reshape(-1, 2, 2))
    where[rows] -= np.einsum("nij,nj->ni", linear[rows], change[sane, :2])
    return np.asarray(sane)
