"""The manifolds on which mean shift runs: one file each, and the registry of their names."""

from __future__ import annotations

import re

from mssegment.errors import ConfigurationError
from mssegment.manifolds.affine import AffineGroup
from mssegment.manifolds.base import Array, KernelBlock, Manifold, PreparedPoints
from mssegment.manifolds.euclidean import Euclidean
from mssegment.manifolds.grassmann import Grassmann
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.se2 import SE2
from mssegment.manifolds.se3 import SE3
from mssegment.manifolds.sl3 import SL3

REGISTRY: dict[str, type[Manifold]] = {
    "euclidean": Euclidean,
    "grassmann": Grassmann,
    "affine": AffineGroup,
    "special_linear": SL3,
    "special_euclidean(2)": SE2,
    "special_euclidean(3)": SE3,
}
"""The families of manifolds by name, or by name and first argument where each has its own class.

Each knows ``examples`` of its members.
"""


def from_name(name: str) -> Manifold:
    """The manifold called ``name``, for instance ``grassmann(10,3)``; ``Manifold.name`` inverts it.

    Raises ConfigurationError when there is no such manifold.
    """
    parts = re.fullmatch(r"\s*(\w+)\s*\(([\w\s,]*)\)\s*", name)
    arguments = tuple(a.strip() for a in parts.group(2).split(",")) if parts else ()
    whole = f"{parts.group(1)}({arguments[0]})" if parts else ""
    family = REGISTRY.get(parts.group(1), REGISTRY.get(whole)) if parts else None
    if family is None:
        known = ", ".join(family.examples[0] for family in REGISTRY.values())
        raise ConfigurationError(f"no manifold is called {name!r}; names look like {known}")
    return family.from_arguments(arguments)


__all__ = [
    "REGISTRY",
    "SE2",
    "SE3",
    "SL3",
    "AffineGroup",
    "Array",
    "Euclidean",
    "Grassmann",
    "KernelBlock",
    "Manifold",
    "MatrixGroup",
    "PreparedPoints",
    "from_name",
]
