"""Products of manifolds: the squared distances of the factors add."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import reduce

import numpy as np

from mssegment.errors import ConfigurationError
from mssegment.manifolds.base import Manifold
from mssegment.manifolds.prepared import Array, KernelBlock, PreparedPoints
from mssegment.records import Floats


class Product(Manifold):
    """The product of manifolds, with d^2 = sum of (weight_i d_i)^2.

    A point is one vector: the entries of a point of the first factor, row by row, then those of the
    second, and so on (:meth:`join` and :meth:`split`). A weight is one over the distance in its
    factor that counts as 1.

    Parameters
    ----------
    factors
        The manifolds, at least one.
    weights
        A positive factor on the distance of each; 1 by default.

    Raises
    ------
    ConfigurationError
        For no factors, another number of weights, or weights that are not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from mssegment.manifolds import Euclidean, Rotations
    >>> poses = Product([Rotations(3), Euclidean(3)], weights=[1.0, 0.1])
    >>> here = poses.join(np.eye(3), np.zeros(3))
    >>> there = poses.join(np.eye(3), np.array([0.0, 0.0, 5.0]))
    >>> poses.dist(here, there).item()
    0.5
    """

    examples = (
        "product(special_orthogonal(3),euclidean(3),weights=1.0:0.5)",
        "product(sphere(2),spd(2))",
        "product(grassmann(3,1),special_euclidean(2))",
    )

    def __init__(self, factors: Sequence[Manifold], weights: Sequence[float] | None = None) -> None:
        self.factors = tuple(factors)
        self.weights = tuple(float(w) for w in (weights or [1.0] * len(self.factors)))
        if not self.factors or len(self.weights) != len(self.factors):
            raise ConfigurationError(
                f"a product needs one weight for each of its factors, found {len(self.factors)} "
                f"factors and {len(self.weights)} weights"
            )
        if not all(0 < w < np.inf for w in self.weights):
            raise ConfigurationError(f"weights of a product must be positive, found {self.weights}")
        self.is_metric = all(f.is_metric for f in self.factors)
        self.is_compact = all(f.is_compact for f in self.factors)
        self.dist_is_geodesic = all(f.dist_is_geodesic for f in self.factors)
        self.exact_gradient = all(f.exact_gradient for f in self.factors)
        sizes = [int(np.prod(f.point_shape)) for f in self.factors]
        self._ends = np.cumsum(sizes).tolist()

    @classmethod
    def from_arguments(cls, arguments: tuple[str, ...]) -> Product:
        """From the names of the factors, and last ``weights=1.0:0.5``."""
        from mssegment.manifolds import from_name  # which imports this module

        weights = None
        if arguments and arguments[-1].startswith("weights="):
            text = arguments[-1].removeprefix("weights=")
            try:
                weights = [float(w) for w in text.split(":")]
            except ValueError:
                raise ConfigurationError(
                    f"weights of a product look like weights=1.0:0.5, found {text!r}"
                ) from None
            arguments = arguments[:-1]
        return cls([from_name(argument) for argument in arguments if argument], weights)

    @property
    def name(self) -> str:
        """``product(FACTOR,FACTOR,...)``, with ``weights=NUMBER:NUMBER`` unless all are 1."""
        names = [f.name for f in self.factors]
        if any(w != 1.0 for w in self.weights):
            names.append("weights=" + ":".join(repr(w) for w in self.weights))
        return f"product({','.join(names)})"

    @property
    def dim(self) -> int:
        """The sum of the dimensions."""
        return sum(f.dim for f in self.factors)

    @property
    def point_shape(self) -> tuple[int, ...]:
        """The shape of a point, one axis with the entries of all factors."""
        return (self._ends[-1],)

    @property
    def floats_per_prepared_point(self) -> int:
        """The sum over the factors."""
        return sum(f.floats_per_prepared_point for f in self.factors)

    def split(self, x: Floats) -> tuple[Floats, ...]:
        """The points [..., *shape] of each factor of the points ``x`` [..., D]."""
        parts = np.split(np.asarray(x, dtype=np.float64), self._ends[:-1], axis=-1)
        return tuple(
            part.reshape(*part.shape[:-1], *f.point_shape)
            for f, part in zip(self.factors, parts, strict=True)
        )

    def join(self, *parts: Floats) -> Floats:
        """The points [..., D] whose factors are ``parts``, each [..., *shape]."""
        flat = []
        for f, part in zip(self.factors, parts, strict=True):
            batch = np.shape(part)[: np.ndim(part) - len(f.point_shape)]
            flat.append(np.reshape(part, (*batch, int(np.prod(f.point_shape)))))
        batch = np.broadcast_shapes(*(part.shape[:-1] for part in flat))
        return np.concatenate(
            [np.broadcast_to(part, (*batch, part.shape[-1])) for part in flat], axis=-1
        )

    def _each(self, method: str, *arrays: Floats) -> list[Floats]:
        """A method of every factor, applied to the parts of ``arrays``."""
        parts = zip(*(self.split(array) for array in arrays), strict=True)
        return [getattr(f, method)(*own) for f, own in zip(self.factors, parts, strict=True)]

    def _squares(self, values: Sequence[Floats]) -> Floats:
        """The sum of the values [...] times the squared weights."""
        weighted = [w * w * value for w, value in zip(self.weights, values, strict=True)]
        return np.asarray(reduce(np.add, weighted))

    def exp(self, x: Floats, v: Floats) -> Floats:
        """The exponential maps of the factors."""
        return self.join(*self._each("exp", x, v))

    def log(self, x: Floats, y: Floats) -> Floats:
        """The logarithms of the factors; NaN where one has none."""
        log = self.join(*self._each("log", x, y))
        return np.where(np.isnan(log).any(axis=-1, keepdims=True), np.nan, log)

    def inner(self, x: Floats, u: Floats, v: Floats) -> Floats:
        """The sum of the inner products times the squared weights."""
        return self._squares(self._each("inner", x, u, v))

    def dist(self, x: Floats, y: Floats) -> Floats:
        """The root of the sum of the squared weighted distances."""
        return np.sqrt(self._squares([d**2 for d in self._each("dist", x, y)]))

    def neg_half_grad_sq_dist(self, x: Floats, y: Floats) -> Floats:
        """Those of the factors: the weights of distance and metric cancel."""
        return self.join(*self._each("neg_half_grad_sq_dist", x, y))

    def project(self, x: Floats) -> Floats:
        """The projections of the factors."""
        self.check_finite(x)
        return self.join(*self._each("project", x))

    def project_tangent(self, x: Floats, v: Floats) -> Floats:
        """The projections of the factors."""
        return self.join(*self._each("project_tangent", x, v))

    def random_point(self, rng: np.random.Generator, size: int) -> Floats:
        """Random points of the factors [size, D]."""
        return self.join(*(f.random_point(rng, size) for f in self.factors))

    def constraint_violation(self, x: Floats) -> Floats:
        """The largest of the factors."""
        return np.asarray(reduce(np.maximum, self._each("constraint_violation", x)))

    def prepare(
        self, y: Floats, bandwidth: float = 1.0, precise: bool = True, cutoff: float = np.inf
    ) -> PreparedPoints:
        """The points ``y`` [n, D], prepared by each factor with the bandwidth over its weight."""
        return _ProductPoints(self, np.asarray(y, dtype=np.float64), bandwidth, precise, cutoff)


class _ProductPoints(PreparedPoints):
    """The prepared points of the factors: scaled squared distances add, sums are concatenated."""

    def __init__(
        self, manifold: Product, y: Floats, bandwidth: float, precise: bool, cutoff: float
    ) -> None:
        self.manifold, self.size, self.bandwidth = manifold, len(y), bandwidth
        self.split: Callable[[Floats], tuple[Floats, ...]] = manifold.split
        self.join = manifold.join
        self.parts = [
            f.prepare(part, bandwidth / w, precise, cutoff)
            for f, part, w in zip(
                manifold.factors, manifold.split(y), manifold.weights, strict=True
            )
        ]
        self.block_rows = min(part.block_rows for part in self.parts)

    def block(self, x: Floats) -> KernelBlock:
        return _ProductBlock(self, x)


class _ProductBlock(KernelBlock):
    def __init__(self, prepared: _ProductPoints, x: Floats) -> None:
        pairs = zip(prepared.parts, prepared.split(x), strict=True)
        self._blocks = [part.block(own) for part, own in pairs]
        self._join = prepared.join
        self.scaled_sq_dist = reduce(np.add, [block.scaled_sq_dist for block in self._blocks])

    def weighted_sum(self, weights: Array) -> tuple[Floats, Floats]:
        sums = [block.weighted_sum(weights)[0] for block in self._blocks]
        return self._join(*sums), weights.sum(axis=1, dtype=np.float64)
