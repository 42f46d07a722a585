"""The manifolds on which mean shift runs: one file each, named in ``registry.py``.

In Python code construct a manifold directly, ``Grassmann(10, 3)``; :func:`from_name` is for names
in documents and settings.
"""

from __future__ import annotations

import re

from mssegment.errors import ConfigurationError
from mssegment.manifolds.affine import AffineGroup as AffineGroup
from mssegment.manifolds.base import Array, KernelBlock, Manifold, PreparedPoints
from mssegment.manifolds.euclidean import Euclidean as Euclidean
from mssegment.manifolds.grassmann import Grassmann as Grassmann
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.se2 import SE2 as SE2
from mssegment.manifolds.se3 import SE3 as SE3
from mssegment.manifolds.sl3 import SL3 as SL3
from mssegment.registry import MANIFOLDS


def from_name(name: str) -> Manifold:
    """The manifold with this name; the inverse of ``Manifold.name``.

    Raises
    ------
    ConfigurationError
        Where there is no such manifold.

    Examples
    --------
    >>> from_name("grassmann(10,3)").dim
    21
    >>> from_name("special_euclidean(2)")
    <manifold special_euclidean(2)>
    """
    parts = re.fullmatch(r"\s*(\w+)\s*\(([\w\s,]*)\)\s*", name)
    arguments = tuple(a.strip() for a in parts.group(2).split(",")) if parts else ()
    member = f"{parts.group(1)}({arguments[0]})" if parts else ""
    found = MANIFOLDS.get(parts.group(1)) or MANIFOLDS.get(member) if parts else None
    if found is None:
        known = ", ".join(each.examples[0] for each in MANIFOLDS.values())
        raise ConfigurationError(f"no manifold is called {name!r}; names look like {known}")
    manifold: Manifold = found.from_arguments(arguments)
    return manifold


__all__ = [
    "MANIFOLDS",
    "Array",
    "KernelBlock",
    "Manifold",
    "MatrixGroup",
    "PreparedPoints",
    "from_name",
]
__all__ += ["SE2", "SE3", "SL3", "AffineGroup", "Euclidean", "Grassmann"]


def __getattr__(name: str) -> type[Manifold]:
    """The class of a registered manifold, also of those that are not imported above."""
    for each in MANIFOLDS.values():
        if each.__name__ == name:
            found: type[Manifold] = each
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
