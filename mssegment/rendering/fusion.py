"""The tables and the JSON of a fusion."""

from __future__ import annotations

import json

import numpy as np

from mssegment.manifolds import Manifold
from mssegment.manifolds.rotations import quaternions
from mssegment.meanshift.fusion import FusedMode, Fusion
from mssegment.rendering.tables import Table, density, fixed, format_table, number
from mssegment.version import __version__

MAX_ENTRIES = 9
"""Points with more entries are not spelled out in tables; JSON has them all."""


def format_fusion(fusion: Fusion, form: str) -> str:
    """The modes as text, Markdown, LaTeX, CSV or JSON, ending with a newline."""
    if form == "json":
        return json.dumps(fusion_json(fusion), indent=1) + "\n"
    return format_table(fusion_table(fusion), form)


def fusion_table(fusion: Fusion) -> Table:
    """One row per mode: support, density, the point, standard deviations of one measurement."""
    names = _point_names(fusion.manifold)
    deviations = _deviation_names(fusion.manifold)
    header = ("mode", "support", "%", "kde", *names, *deviations)
    count = len(fusion.labels)
    rows = []
    for i, mode in enumerate(fusion.modes, start=1):
        share = 100.0 * len(mode.support) / count
        entries = [number(value, 5) for value in _entries(fusion.manifold, mode)] if names else []
        spread = [number(value) for value in _deviations(fusion.manifold, mode)]
        rows.append(
            (
                f"M{i}",
                str(len(mode.support)),
                fixed(share, 1),
                density(mode.density),
                *entries,
                *spread,
            )
        )
    return Table("Modes", header, tuple(rows))


def fusion_json(fusion: Fusion) -> dict[str, object]:
    """Everything: modes with points and covariances, and the mode of each measurement.

    ``labels`` are 1, 2, ... for modes and 0 for outliers; ``support`` are indices from 0.
    """
    return {
        "schema": "mssegment/fusion/1",
        "version": __version__,
        "manifold": fusion.manifold.name,
        "bandwidth": fusion.bandwidth,
        "measurements": len(fusion.labels),
        "coordinates": _coordinate_names(fusion.manifold),
        "modes": [
            {
                "label": i,
                "point": mode.point.tolist(),
                "support": mode.support.tolist(),
                "weight": mode.weight,
                "density": mode.density,
                "covariance": mode.covariance.tolist(),
            }
            for i, mode in enumerate(fusion.modes, start=1)
        ],
        "labels": (fusion.labels + 1).tolist(),
    }


def _coordinate_names(manifold: Manifold) -> list[str]:
    """The names of the coordinates of covariances."""
    family = manifold.name.partition("(")[0]
    known = {
        ("special_euclidean", 6): ["rx", "ry", "rz", "tx", "ty", "tz"],
        ("special_euclidean", 3): ["r", "tx", "ty"],
        ("special_orthogonal", 3): ["rx", "ry", "rz"],
        ("special_orthogonal", 1): ["r"],
    }
    return known.get((family, manifold.dim), [f"v{i}" for i in range(1, manifold.dim + 1)])


def _turns(manifold: Manifold) -> int:
    """How many of the coordinates are rotations, 0 where the names do not say."""
    return sum(name.startswith("r") for name in _coordinate_names(manifold))


def _point_names(manifold: Manifold) -> tuple[str, ...]:
    if _turns(manifold) == 3:
        position = ("tx", "ty", "tz") if manifold.dim == 6 else ()
        return (*position, "qx", "qy", "qz", "qw")
    if _turns(manifold) == 1:
        return ("tx", "ty", "angle") if manifold.dim == 3 else ("angle",)
    shape = manifold.point_shape
    if int(np.prod(shape)) > MAX_ENTRIES:
        return ()
    return tuple("x" + "".join(str(i + 1) for i in index) for index in np.ndindex(*shape))


def _entries(manifold: Manifold, mode: FusedMode) -> list[float]:
    point = mode.point
    if _turns(manifold) == 3:
        w, x, y, z = quaternions(point[:3, :3])
        position = point[:3, 3].tolist() if manifold.dim == 6 else []
        return [*position, float(x), float(y), float(z), float(w)]
    if _turns(manifold) == 1:
        angle = float(np.arctan2(point[1, 0], point[0, 0]))
        return [*(point[:2, 2].tolist() if manifold.dim == 3 else []), angle]
    return [float(value) for value in point.ravel()]


def _deviation_names(manifold: Manifold) -> tuple[str, ...]:
    if not _turns(manifold):
        return ("sd",)
    return ("sd deg", "sd t") if manifold.dim > _turns(manifold) else ("sd deg",)


def _deviations(manifold: Manifold, mode: FusedMode) -> list[float]:
    """Root mean squares over the coordinates: of rotations in degrees, of the others."""
    variances = np.diag(mode.covariance)
    turns = _turns(manifold)
    if not turns:
        return [float(np.sqrt(variances.mean()))]
    found = [float(np.degrees(np.sqrt(variances[:turns].mean())))]
    if len(variances) > turns:
        found.append(float(np.sqrt(variances[turns:].mean())))
    return found
