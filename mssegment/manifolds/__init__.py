"""The manifolds on which mean shift runs: one file each, named in ``registry.py``.

In Python code construct a manifold directly, ``Grassmann(10, 3)``; :func:`from_name` is for names
in documents and settings.
"""

from __future__ import annotations

import re

from mssegment.errors import ConfigurationError
from mssegment.manifolds.affine import AffineGroup as AffineGroup
from mssegment.manifolds.base import Manifold
from mssegment.manifolds.essential import Essential as Essential
from mssegment.manifolds.euclidean import Euclidean as Euclidean
from mssegment.manifolds.grassmann import Grassmann as Grassmann
from mssegment.manifolds.matrix_group import MatrixGroup
from mssegment.manifolds.prepared import Array, KernelBlock, PreparedPoints
from mssegment.manifolds.product import Product as Product
from mssegment.manifolds.rotations import Rotations as Rotations
from mssegment.manifolds.se2 import SE2 as SE2
from mssegment.manifolds.se3 import SE3 as SE3
from mssegment.manifolds.sl3 import SL3 as SL3
from mssegment.manifolds.spd import SPD as SPD
from mssegment.manifolds.sphere import Sphere as Sphere
from mssegment.manifolds.stiefel import Stiefel as Stiefel
from mssegment.registry import MANIFOLDS

ALIASES = {
    "so2": ("special_orthogonal", "2"),
    "so3": ("special_orthogonal", "3"),
    "se2": ("special_euclidean", "2"),
    "se3": ("special_euclidean", "3"),
    "sim2": ("similarity", "2"),
    "a2": ("affine", "2"),
    "sl3": ("special_linear", "3"),
}
"""Short names: ``se3`` is ``special_euclidean(3)``, ``se3(exact)`` is ``...(3,exact)``."""


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
    >>> from_name("se3(length_scale=2)")
    <manifold special_euclidean(3,length_scale=2.0)>
    """
    parts = re.fullmatch(r"\s*(\w+)\s*(?:\((.*)\))?\s*", name, flags=re.DOTALL)
    family, inside = (parts.group(1), parts.group(2)) if parts else ("", None)
    arguments = split_arguments(inside) if inside is not None else ()
    if family in ALIASES:
        family, order = ALIASES[family]
        arguments = (order, *arguments)
    elif inside is None:
        arguments = ("",)
    found = MANIFOLDS.get(family) or MANIFOLDS.get(f"{family}({arguments[0]})")
    if found is None:
        known = ", ".join(each.examples[0] for each in MANIFOLDS.values())
        raise ConfigurationError(f"no manifold is called {name!r}; names look like {known}")
    manifold: Manifold = found.from_arguments(arguments)
    return manifold


def split_arguments(text: str) -> tuple[str, ...]:
    """The arguments in a name: parts between commas that are not in parentheses.

    Examples
    --------
    >>> split_arguments("grassmann(3,1), euclidean(2)")
    ('grassmann(3,1)', 'euclidean(2)')
    """
    parts, depth = [""], 0
    for character in text:
        depth += {"(": 1, ")": -1}.get(character, 0)
        if character == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return tuple(part.strip() for part in parts)


__all__ = [
    "MANIFOLDS",
    "Array",
    "KernelBlock",
    "Manifold",
    "MatrixGroup",
    "PreparedPoints",
    "from_name",
]
__all__ += ["SE2", "SE3", "SL3", "AffineGroup", "Euclidean", "Grassmann", "Rotations"]
__all__ += ["SPD", "Essential", "Product", "Sphere", "Stiefel"]


def __getattr__(name: str) -> type[Manifold]:
    """The class of a registered manifold, also of those that are not imported above."""
    for each in MANIFOLDS.values():
        if each.__name__ == name:
            found: type[Manifold] = each
            return found
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
