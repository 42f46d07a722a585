"""Affine Lucas-Kanade registration of many windows at once, invariant to gain and offset.

Inverse compositional (Baker and Matthews, "Lucas-Kanade 20 years on", IJCV 2004). The part of each
steepest-descent image that a gain and an offset can explain is projected out beforehand, so that
these two need no parameters.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from mssegment.imaging.matching.resampling import Floats32, Indices, sample_windows, window_grid
from mssegment.imaging.pyramid import Level
from mssegment.records import Floats, Record

WINDOW_RADIUS = 9
"""Pixels of the level; a window has 19 x 19 samples."""
MAX_ITERATIONS = 12
CONVERGED_STEP = 0.03
"""Pixels; a window has converged when a step moves its corners by less."""
DAMPING = 1e-3
"""Share of the Hessian's diagonal that is added to it (Levenberg)."""
MIN_STEP_CORRELATION = 0.05
"""Least correlation by which a step is divided: a smaller one is no gain between the views."""
MAX_STRETCH = 0.3
"""Largest entry of one step's linear part: larger steps overshoot, and above 1/2 the step may have
no inverse."""
STEP_LIMITS = np.array([WINDOW_RADIUS, MAX_STRETCH, MAX_STRETCH])
"""Largest entries of a step: shift (pixels), and the two columns of the linear part."""
EDGE_MOTION = np.array([1, WINDOW_RADIUS, WINDOW_RADIUS])
"""Pixels by which a unit of each entry of a step moves the edge of a window."""
WINDOWS_PER_BLOCK = 256
"""Windows at a time, whose data then stay in the cache."""
OFFSETS = window_grid(2 * WINDOW_RADIUS + 1, 1.0)
"""Offsets (u, v) [K, 2] of the samples of a window."""


def _monomials() -> Floats32:
    """1, u, v, u^2, uv, v^2 at the offsets, times their Gaussian weights, [K, 6]."""
    u, v = OFFSETS.T.astype(np.float64)
    weights = np.exp(-2.0 * (u * u + v * v) / WINDOW_RADIUS**2)
    weights /= weights.sum()
    powers = np.column_stack([np.ones_like(u), u, v, u * u, u * v, v * v])
    return np.asarray(powers * weights[:, None], np.float32)


MONOMIALS = _monomials()
WEIGHTS = MONOMIALS[:, 0].copy()


class Windows(Record, frozen=True):
    """Windows in view 1, each with a map that takes it to view 2.

    Parameters
    ----------
    first, second : float array [n, 2]
        Centres in views 1 and 2, pixels of the pictures.
    affines : float array [n, 2, 2]
        Linear parts of the maps.
    levels, levels_second : int array [n]
        Pyramid levels on which views 1 and 2 are sampled.
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
    """Registered windows: centres in view 2 [n, 2], linear parts [n, 2, 2], correlation [n]."""

    second: Floats
    affines: Floats
    correlation: Floats


class _Templates:
    """The windows in view 1, prepared so that samples of view 2 give a Gauss-Newton step.

    The steepest-descent images are the gradient times 1, u and v, so every sum in the normal
    equations is a matrix product of gradients, or of their products, with monomials of u and v.
    """

    def __init__(self, patch: Floats32, terms: int) -> None:
        """``patch`` [n, side, side] with a margin of a pixel; ``terms`` 3 affine, 1 translation."""
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
        hessian += np.eye(2 * terms) * (DAMPING * np.abs(diagonal) + 1e-6)[:, None, :]
        self.inverse = np.linalg.inv(hessian)

    def _sums(self, images: Floats32) -> Floats32:
        """Weighted sums [n, 3, terms] of images [n, 3, K] times 1, u and v."""
        flat = images.reshape(-1, images.shape[2])
        return np.asarray((flat @ self.first_order).reshape(len(images), 3, -1))

    def take(self, rows: npt.NDArray[np.bool_]) -> None:
        """Keep only some of the windows."""
        self.images, self.norms = self.images[rows], self.norms[rows]
        self.gain, self.inverse = self.gain[rows], self.inverse[rows]

    def compare(self, samples: Floats32) -> tuple[Floats32, Floats]:
        """Correlation [n] and step [n, 2, terms] of each window; ``samples`` [n, K] of view 2."""
        values, norms = _centred(samples)
        sums = self._sums(self.images * values[:, None])
        sums /= norms[:, None, None]
        correlation = sums[:, 2, 0]
        difference = sums[:, :2].reshape(len(samples), -1) - correlation[:, None] * self.gain
        difference *= (self.norms / np.maximum(correlation, MIN_STEP_CORRELATION))[:, None]
        step = self.inverse @ difference.astype(np.float64)[:, :, None]
        return correlation, step.reshape(len(samples), 2, -1)


def register(
    first: list[Level],
    second: list[Level],
    windows: Windows,
    *,
    affine: bool = True,
) -> Registered:
    """Refine the map of each window until view 2 under it matches view 1 up to gain and offset.

    Parameters
    ----------
    first, second : list of Level
        Pyramids of the two views.
    windows : Windows
        The n windows with the maps to start from.
    affine : bool
        Refine position and linear part; otherwise the position alone.

    Returns
    -------
    Registered
        The refined maps. The correlation is Gaussian weighted; -1 where registration diverged.
    """
    upright, maps = _maps(first, second, windows)
    correlation = np.empty(len(maps))
    for rows in _blocks(windows):
        patch = sample_windows(
            first, windows.levels[rows], upright[rows], window_grid(2 * WINDOW_RADIUS + 3, 1.0)
        )
        side = 2 * WINDOW_RADIUS + 3
        templates = _Templates(patch.reshape(-1, side, side), 3 if affine else 1)
        maps[rows], correlation[rows] = _align(
            templates, second, windows.levels_second[rows], maps[rows]
        )
    return _registered(first, second, windows, maps, correlation)


def correlations(first: list[Level], second: list[Level], windows: Windows) -> Floats:
    """Correlation [n] of windows under their present maps, weighted as in ``register``."""
    upright, maps = _maps(first, second, windows)
    correlation = np.empty(len(maps))
    for rows in _blocks(windows):
        one, norms = _centred(sample_windows(first, windows.levels[rows], upright[rows], OFFSETS))
        two, others = _centred(
            sample_windows(second, windows.levels_second[rows], maps[rows], OFFSETS)
        )
        correlation[rows] = ((one * two) @ WEIGHTS) / (norms * others)
    return correlation


def _maps(first: list[Level], second: list[Level], windows: Windows) -> tuple[Floats, Floats]:
    """Maps [n, 2, 3] from offsets (u, v, 1) to pixels of the windows' levels, for both views."""
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
    """Maps on the levels as maps in pixels of the pictures."""
    ratio1 = np.array([level.ratio for level in first])[windows.levels]
    ratio2 = np.array([level.ratio for level in second])[windows.levels_second]
    return Registered(
        second=(maps[:, :, 2] + 0.5) * ratio2 - 0.5,
        affines=maps[:, :, :2] * ratio2[:, :, None] / ratio1[:, None, :],
        correlation=correlation,
    )


def _blocks(windows: Windows) -> Iterator[Indices]:
    """Rows of windows, at most WINDOWS_PER_BLOCK, those of the same levels adjacent."""
    order = np.lexsort((windows.levels, windows.levels_second))
    for start in range(0, len(order), WINDOWS_PER_BLOCK):
        yield order[start : start + WINDOWS_PER_BLOCK]


def _centred(values: Floats32) -> tuple[Floats32, Floats32]:
    """Values [n, K] minus their weighted mean, and their weighted norms [n]."""
    values = values - (values @ WEIGHTS)[:, None]
    return values, np.sqrt(np.maximum((values * values) @ WEIGHTS, 1e-12))


def _align(
    templates: _Templates, second: list[Level], levels: Indices, maps: Floats
) -> tuple[Floats, Floats]:
    """Maps and correlations of one block of windows after convergence."""
    correlation = np.full(len(maps), -1.0)
    active = np.arange(len(maps))
    for step in range(MAX_ITERATIONS + 1):
        samples = sample_windows(second, levels[active], maps[active], OFFSETS)
        value, change = templates.compare(samples)
        correlation[active] = value
        if step == MAX_ITERATIONS:
            break
        size = np.abs(change)
        terms = change.shape[2]
        bounded = (size < STEP_LIMITS[:terms]).all(axis=(1, 2))
        correlation[active[~bounded]] = -1.0
        moving = bounded & ((size * EDGE_MOTION[:terms]).max(axis=(1, 2)) > CONVERGED_STEP)
        rows = active[bounded]
        maps[rows] = _composed(maps[rows], change[bounded])
        active = active[moving]
        if not len(active):
            break
        templates.take(moving)
    return maps, correlation


def _composed(maps: Floats, change: Floats) -> Floats:
    """Maps [n, 2, 3] composed with the inverses of the steps ``change`` [n, 2, terms]."""
    linear, shift = maps[:, :, :2], change[:, :, :1]
    if change.shape[2] > 1:
        (a, b), (c, d) = np.moveaxis(change[:, :, 1:] + np.eye(2), 0, -1)
        undone = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
        linear = linear @ np.moveaxis(undone, -1, 0)
    return np.concatenate([linear, maps[:, :, 2:] - linear @ shift], axis=2)
