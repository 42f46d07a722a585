"""Affine Lucas-Kanade with gain and offset projected out, for many windows at once.

Inverse compositional: Baker and Matthews, Lucas-Kanade 20 years on, IJCV 2004. The light between
two views changes by a gain and an offset; the part of each steepest-descent image that these two
can explain is taken out beforehand, so they need no parameters of their own.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from mssegment.imaging.matching.views import Indices, Singles, grid, seen
from mssegment.imaging.pyramid import Level
from mssegment.records import Floats, Record

RADIUS = 9
STEPS = 12
STILL = 0.03
"""A window whose corners move less than this (pixels) in a step has converged."""
RIDGE = 1e-3
LEAST_GAIN = 0.05
LARGEST_STRETCH = 0.3
"""Entries of one step; larger ones overshoot, and above a half it need not have an inverse."""
LIMITS = np.array([RADIUS, LARGEST_STRETCH, LARGEST_STRETCH])
REACH = np.array([1, RADIUS, RADIUS])
"""How far a shift, or a stretch by 1, moves what is at the edge of a window."""
BLOCK = 256
"""Windows at a time, so that what each step works on stays in the cache."""
OFFSETS = grid(2 * RADIUS + 1, 1.0)


def _monomials() -> Singles:
    """1, u, v, u^2, uv, v^2 at the offsets, times their Gaussian weights, [K, 6]."""
    u, v = OFFSETS.T.astype(np.float64)
    weights = np.exp(-2.0 * (u * u + v * v) / RADIUS**2)
    weights /= weights.sum()
    powers = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    return np.asarray(powers * weights[:, None], np.float32)


MONOMIALS = _monomials()
WEIGHTS = MONOMIALS[:, 0].copy()


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

    def __init__(self, patch: Singles, terms: int) -> None:
        """``patch`` [n, side, side] is a pixel wider all around; ``terms`` 3: 1, u, v; 1: 1."""
        count = len(patch)
        self.images = np.empty((count, 3, len(OFFSETS)), np.float32)
        half = np.float32(0.5)
        across = half * (patch[:, 1:-1, 2:] - patch[:, 1:-1, :-2])
        down = half * (patch[:, 2:, 1:-1] - patch[:, :-2, 1:-1])
        shape, self.norms = _centred(patch[:, 1:-1, 1:-1].reshape(count, -1))
        self.images[:, 0] = across.reshape(count, -1)
        self.images[:, 1] = down.reshape(count, -1)
        self.images[:, 2] = shape / self.norms[:, None]
        self.first_order = MONOMIALS[:, :terms].copy()
        self._prepare(terms)

    def _prepare(self, terms: int) -> None:
        """The normal equations, with gain and offset projected out of them."""
        count = len(self.images)
        table = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])[:terms, :terms]
        gx, gy, shape = (self.images[:, i] for i in range(3))
        xx, xy, yy = (
            ((a * b) @ MONOMIALS)[:, table].astype(np.float64)
            for a, b in ((gx, gx), (gx, gy), (gy, gy))
        )
        hessian = np.block([[xx, xy], [xy, yy]])
        offset = self._sums(self.images)[:, :2].reshape(count, -1)
        self.gain = self._sums(self.images * shape[:, None])[:, :2].reshape(count, -1)
        for part in (offset.astype(np.float64), self.gain.astype(np.float64)):
            hessian -= part[:, :, None] * part[:, None, :]
        diagonal = np.einsum("npp->np", hessian)
        hessian += np.eye(2 * terms) * (RIDGE * np.abs(diagonal) + 1e-6)[:, None, :]
        self.inverse = np.linalg.inv(hessian)

    def _sums(self, images: Singles) -> Singles:
        """Weighted sums [n, 3, terms] of images [n, 3, K] times 1, u and v."""
        flat = images.reshape(-1, images.shape[2])
        return np.asarray((flat @ self.first_order).reshape(len(images), 3, -1))

    def take(self, rows: npt.NDArray[np.bool_]) -> None:
        """Only some of the windows from here on."""
        self.images, self.norms = self.images[rows], self.norms[rows]
        self.gain, self.inverse = self.gain[rows], self.inverse[rows]

    def compare(self, samples: Singles) -> tuple[Singles, Floats]:
        """The correlation [n] of ``samples`` [n, K], and the step [n, 2, terms] it asks for."""
        values, norms = _centred(samples)
        sums = self._sums(self.images * values[:, None])
        sums /= norms[:, None, None]
        likeness = sums[:, 2, 0]
        difference = sums[:, :2].reshape(len(samples), -1) - likeness[:, None] * self.gain
        difference *= (self.norms / np.maximum(likeness, LEAST_GAIN))[:, None]
        step = self.inverse @ difference.astype(np.float64)[:, :, None]
        return likeness, step.reshape(len(samples), 2, -1)


def register(
    first: list[Level],
    second: list[Level],
    windows: Windows,
    *,
    affine: bool = True,
) -> Registered:
    """Refine each window's map until picture 2 under it looks like picture 1 up to the light.

    ``affine`` refines position and linear part, otherwise the position alone. The correlation is
    Gaussian weighted; it is -1 where the window came to nothing (left its picture, inverted).
    """
    upright, maps = _maps(first, second, windows)
    correlation = np.empty(len(maps))
    for rows in _blocks(windows):
        patch = seen(first, windows.levels[rows], upright[rows], grid(2 * RADIUS + 3, 1.0))
        side = 2 * RADIUS + 3
        templates = _Templates(patch.reshape(-1, side, side), 3 if affine else 1)
        maps[rows], correlation[rows] = _align(
            templates, second, windows.levels_second[rows], maps[rows]
        )
    return _registered(first, second, windows, maps, correlation)


def likeness(first: list[Level], second: list[Level], windows: Windows) -> Floats:
    """The correlation [n] of windows as they are, measured as ``register`` does it."""
    upright, maps = _maps(first, second, windows)
    correlation = np.empty(len(maps))
    for rows in _blocks(windows):
        one, norms = _centred(seen(first, windows.levels[rows], upright[rows], OFFSETS))
        two, others = _centred(seen(second, windows.levels_second[rows], maps[rows], OFFSETS))
        correlation[rows] = ((one * two) @ WEIGHTS) / (norms * others)
    return correlation


def _maps(first: list[Level], second: list[Level], windows: Windows) -> tuple[Floats, Floats]:
    """Windows as maps [n, 2, 3] from offsets (u, v, 1) to positions on their levels, both views."""
    ratio1 = np.array([level.ratio for level in first])[windows.levels]
    ratio2 = np.array([level.ratio for level in second])[windows.levels_second]
    upright, maps = np.empty((2, len(ratio1), 2, 3))
    upright[:, :, :2] = np.eye(2)
    upright[:, :, 2] = (windows.first + 0.5) / ratio1 - 0.5
    maps[:, :, :2] = windows.affines * ratio1[:, None, :] / ratio2[:, :, None]
    maps[:, :, 2] = (windows.second + 0.5) / ratio2 - 0.5
    return upright, maps


def _registered(
    first: list[Level], second: list[Level], windows: Windows, maps: Floats, correlation: Floats
) -> Registered:
    """The outcome in pixels of the pictures."""
    ratio1 = np.array([level.ratio for level in first])[windows.levels]
    ratio2 = np.array([level.ratio for level in second])[windows.levels_second]
    return Registered(
        second=(maps[:, :, 2] + 0.5) * ratio2 - 0.5,
        affines=maps[:, :, :2] * ratio2[:, :, None] / ratio1[:, None, :],
        correlation=correlation,
    )


def _blocks(windows: Windows) -> Iterator[Indices]:
    """Rows of windows, at most BLOCK, those of the same levels next to each other."""
    order = np.lexsort((windows.levels, windows.levels_second))
    for start in range(0, len(order), BLOCK):
        yield order[start : start + BLOCK]


def _centred(values: Singles) -> tuple[Singles, Singles]:
    """Values [n, K] with zero weighted mean, and their weighted norms."""
    values = values - (values @ WEIGHTS)[:, None]
    return values, np.sqrt(np.maximum((values * values) @ WEIGHTS, 1e-12))


def _align(
    templates: _Templates, second: list[Level], levels: Indices, maps: Floats
) -> tuple[Floats, Floats]:
    """Maps and correlations of windows after as many steps as each needs."""
    correlation = np.full(len(maps), -1.0)
    active = np.arange(len(maps))
    for step in range(STEPS + 1):
        now = seen(second, levels[active], maps[active], OFFSETS)
        likeness, change = templates.compare(now)
        correlation[active] = likeness
        if step == STEPS:
            break
        size = np.abs(change)
        terms = change.shape[2]
        sane = (size < LIMITS[:terms]).all(axis=(1, 2))
        correlation[active[~sane]] = -1.0
        moving = sane & ((size * REACH[:terms]).max(axis=(1, 2)) > STILL)
        rows = active[sane]
        maps[rows] = _composed(maps[rows], change[sane])
        active = active[moving]
        if not len(active):
            break
        templates.take(moving)
    return maps, correlation


def _composed(maps: Floats, change: Floats) -> Floats:
    """Maps [n, 2, 3] after the inverses of the steps ``change`` [n, 2, terms]."""
    linear, shift = maps[:, :, :2], change[:, :, :1]
    if change.shape[2] > 1:
        (a, b), (c, d) = np.moveaxis(change[:, :, 1:] + np.eye(2), 0, -1)
        undone = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
        linear = linear @ np.moveaxis(undone, -1, 0)
    return np.concatenate([linear, maps[:, :, 2:] - linear @ shift], axis=2)
