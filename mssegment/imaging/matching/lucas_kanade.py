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
STILL = 0.01
"""A window whose corners move less than this (pixels) in a step has converged."""
RIDGE = 1e-3


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
    """What view 1 says about each window, and how a difference turns into a step."""

    def __init__(
        self, pyramid: list[Level], centres: Singles, levels: Indices, radius: int, affine: bool
    ) -> None:
        side = 2 * radius + 1
        self.offsets = grid(side, 1.0)
        weights = np.exp(-((self.offsets / radius) ** 2).sum(axis=1) * 2.0)
        self.weights = (weights / weights.sum()).astype(np.float32)
        wide = grid(side + 2, 1.0)
        patch = sample(pyramid, levels, centres[:, :1] + wide[:, 0], centres[:, 1:] + wide[:, 1])
        patch = patch.reshape(-1, side + 2, side + 2)
        gx: Singles = 0.5 * (patch[:, 1:-1, 2:] - patch[:, 1:-1, :-2])
        gy: Singles = 0.5 * (patch[:, 2:, 1:-1] - patch[:, :-2, 1:-1])
        self.shape, self.norms = self.standardise(patch[:, 1:-1, 1:-1].reshape(len(patch), -1))
        self.gain_to_pixels = self._solver(gx.reshape(len(gx), -1), gy.reshape(len(gy), -1), affine)

    def standardise(self, values: Singles) -> tuple[Singles, Singles]:
        """Zero weighted mean and unit weighted norm; the norms."""
        centred = values - (values @ self.weights)[:, None]
        norms = np.sqrt(np.maximum((centred * centred) @ self.weights, 1e-12))
        return centred / norms[:, None], norms

    def _solver(self, gx: Singles, gy: Singles, affine: bool) -> Singles:
        """The matrices [n, 6 or 2, K] that turn sampled windows into steps, (J'WJ)^-1 J'W."""
        u, v = self.offsets[:, 0], self.offsets[:, 1]
        images = [gx, gy] + ([gx * u, gx * v, gy * u, gy * v] if affine else [])
        steepest = np.stack(images, axis=1)
        steepest -= (steepest @ self.weights)[..., None]
        along = np.einsum("npk,nk->np", steepest, self.shape * self.weights)
        steepest -= along[..., None] * self.shape[:, None]
        weighted = steepest * self.weights
        hessian = (weighted @ steepest.transpose(0, 2, 1)).astype(np.float64)
        diagonal = np.einsum("npp->np", hessian)
        hessian += np.eye(len(images)) * (RIDGE * diagonal + 1e-6)[:, None, :]
        return np.asarray(np.linalg.solve(hessian, weighted), np.float32)


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
    count = len(windows.first)
    ratio1 = np.array([level.ratio for level in first])[windows.levels]
    ratio2 = np.array([level.ratio for level in second])[windows.levels_second]
    centres = ((windows.first + 0.5) / ratio1 - 0.5).astype(np.float32)
    where = (windows.second + 0.5) / ratio2 - 0.5
    linear = windows.affines * ratio1[:, None, :] / ratio2[:, :, None]
    templates = _Templates(first, centres, windows.levels, radius, affine)
    correlation = np.full(count, -1.0)
    active = np.arange(count)
    for step in range(steps + 1):
        if not len(active):
            break
        offsets = templates.offsets @ linear[active].transpose(0, 2, 1).astype(np.float32)
        position = offsets + where[active, None, :].astype(np.float32)
        seen = sample(second, windows.levels_second[active], position[..., 0], position[..., 1])
        standard, norms = templates.standardise(seen)
        shape = templates.shape[active]
        likeness = (standard * shape) @ templates.weights
        correlation[active] = likeness
        gain = likeness * norms / templates.norms[active]
        if step == steps:
            break
        change = np.einsum("npk,nk->np", templates.gain_to_pixels[active], seen)
        change /= np.maximum(gain, 1e-3)[:, None]
        alive = _advance(where, linear, active, change, radius)
        correlation[active[~alive]] = -1.0
        moved = np.abs(change[:, :2]).max(axis=1)
        if affine:
            moved = np.maximum(moved, np.abs(change[:, 2:]).max(axis=1) * radius)
        active = active[alive & (moved > STILL)]
    return Registered(
        second=(where + 0.5) * ratio2 - 0.5,
        affines=linear * ratio2[:, :, None] / ratio1[:, None, :],
        correlation=correlation,
    )


def _advance(
    where: Floats, linear: Floats, active: Indices, change: Singles, radius: int
) -> npt.NDArray[np.bool_]:
    """Compose the inverse of each step onto the maps, in place; which steps were sane."""
    step = change.astype(np.float64)
    sane = np.isfinite(step).all(axis=1) & (np.abs(step[:, :2]).max(axis=1) < radius)
    if step.shape[1] == 6:
        sane &= np.abs(step[:, 2:]).max(axis=1) < 0.5
        rows = active[sane]
        grown = np.eye(2) + step[sane, 2:].reshape(-1, 2, 2)
        linear[rows] = linear[rows] @ np.linalg.inv(grown)
    else:
        rows = active[sane]
    where[rows] -= np.einsum("nij,nj->ni", linear[rows], step[sane, :2])
    return np.asarray(sane)
