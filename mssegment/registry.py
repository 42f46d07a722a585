"""The names of manifolds, kernels, models, selections and readers: one line each.

Nothing is imported before a name is looked up, so that option choices and help texts, which are
made from the names, cost no start-up time.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any, Generic, TypeVar

from mssegment.plugins import entry_points

T = TypeVar("T")


class Registry(Mapping[str, T], Generic[T]):
    """Names and where the things they name are defined, ``package.module:attribute``.

    With a ``group`` other packages register further names as entry points of it.
    """

    def __init__(self, kind: str, places: Mapping[str, str], group: str = "") -> None:
        self.kind = kind
        self._own = dict(places)
        self._group = group
        self._found: dict[str, T] = {}

    @cached_property
    def _places(self) -> dict[str, str]:
        """The names of this package, then those of others, which may not replace them."""
        others = entry_points(self._group) if self._group else {}
        return self._own | {name: place for name, place in others.items() if name not in self._own}

    def __getitem__(self, name: str) -> T:
        """Import and return what ``name`` names; raises KeyError for an unknown name."""
        if name not in self._found:
            module, _, attribute = self._places[name].partition(":")
            self._found[name] = getattr(importlib.import_module(module), attribute)
        return self._found[name]

    def __contains__(self, name: object) -> bool:
        """Whether the name is registered; imports nothing."""
        return name in self._own or name in self._places

    def __iter__(self) -> Iterator[str]:
        """The names in the order in which a user sees them."""
        return iter(self._places)

    def __len__(self) -> int:
        """The number of names."""
        return len(self._places)


MANIFOLDS: Registry[Any] = Registry(
    "manifold",
    {
        "euclidean": "mssegment.manifolds.euclidean:Euclidean",
        "grassmann": "mssegment.manifolds.grassmann:Grassmann",
        "sphere": "mssegment.manifolds.sphere:Sphere",
        "stiefel": "mssegment.manifolds.stiefel:Stiefel",
        "spd": "mssegment.manifolds.spd:SPD",
        "essential": "mssegment.manifolds.essential:Essential",
        "product": "mssegment.manifolds.product:Product",
        "affine": "mssegment.manifolds.affine:AffineGroup",
        "similarity": "mssegment.manifolds.sim2:Sim2",
        "special_linear": "mssegment.manifolds.sl3:SL3",
        "special_orthogonal": "mssegment.manifolds.rotations:Rotations",
        "special_euclidean(2)": "mssegment.manifolds.se2:SE2",
        "special_euclidean(3)": "mssegment.manifolds.se3:SE3",
    },
    "mssegment.manifolds",
)
"""The manifolds by the name of their family, or by name and first argument where the members of a
family have classes of their own."""

KERNELS: Registry[Any] = Registry(
    "kernel",
    {
        "gaussian": "mssegment.meanshift.kernels:GAUSSIAN",
        "truncated": "mssegment.meanshift.kernels:TRUNCATED",
        "epanechnikov": "mssegment.meanshift.kernels:EPANECHNIKOV",
    },
)
"""The kernels of mean shift (``cluster.kernel``)."""

SELECTIONS: Registry[Any] = Registry(
    "selection",
    {
        "mdl": "mssegment.segmentation.mdl:mdl",
        "dominance": "mssegment.segmentation.dominant_modes:dominance",
    },
)
"""How modes become motions (``segment.selection``)."""

MODELS: Registry[Any] = Registry(
    "motion model",
    {
        "affine": "mssegment.models.affine:Affine",
        "similarity": "mssegment.models.similarity:Similarity",
        "rigid2d": "mssegment.models.rigid2d:Rigid2D",
        "homography": "mssegment.models.homography:Homography",
        "translation": "mssegment.models.translation:Translation",
        "essential": "mssegment.models.essential:Essential",
        "factorization": "mssegment.models.factorization:Factorization",
        "hyperplane": "mssegment.models.hyperplane:Hyperplane",
        "subspace": "mssegment.models.subspace:Subspace",
        "line": "mssegment.models.line:Line",
        "plane": "mssegment.models.plane:Plane",
        "quadric": "mssegment.models.quadric:Quadric",
        "rigid3d": "mssegment.models.rigid3d:Rigid3D",
    },
    "mssegment.models",
)
"""The motion models that a user may choose (``hypothesize.model``)."""

EVIDENCE: Registry[Any] = Registry(
    "evidence model",
    {
        "flat": "mssegment.models.flat:Flat",
        "fundamental": "mssegment.models.fundamental:Fundamental",
    },
)
"""Further models whose hypotheses group the tracks of long sequences."""

DATASETS: Registry[Any] = Registry(
    "data set",
    {
        "hopkins155": "mssegment.datasets.hopkins155:HOPKINS155",
        "adelaidermf": "mssegment.datasets.adelaidermf:ADELAIDERMF",
        "kt3dmoseg": "mssegment.datasets.kt3dmoseg:KT3DMOSEG",
        "track_layouts": "mssegment.datasets.track_layouts:TRACK_LAYOUTS",
        "deeplabcut": "mssegment.datasets.deeplabcut:DEEPLABCUT",
        "trackmate": "mssegment.datasets.trackmate:TRACKMATE",
        "boxes": "mssegment.datasets.boxes:BOXES",
        "sightings": "mssegment.datasets.sightings:SIGHTINGS",
        "timelines": "mssegment.datasets.timelines:TIMELINES",
        "matches": "mssegment.datasets.matches:MATCHES",
        "flows": "mssegment.datasets.flows:FLOWS",
        "keypoints": "mssegment.datasets.keypoints:KEYPOINTS",
        "vectors": "mssegment.datasets.vectors:VECTORS",
        "track_lists": "mssegment.datasets.track_lists:TRACK_LISTS",
        "arrays": "mssegment.datasets.arrays:ARRAYS",
        "measurements": "mssegment.datasets.measurements:MEASUREMENTS",
        "hloc": "mssegment.datasets.hloc:HLOC",
        "colmap": "mssegment.datasets.colmap:COLMAP",
    },
    "mssegment.datasets",
)
"""The formats of tracks that ``import`` and ``run`` read, in the order in which they are tried."""

CAMERAS: Registry[Any] = Registry(
    "camera format",
    {
        "kitti": "mssegment.cameras.kitti:KITTI",
        "named_text": "mssegment.cameras.named_text:NAMED_TEXT",
        "colmap": "mssegment.cameras.colmap:COLMAP",
        "colmap_binary": "mssegment.cameras.colmap_binary:COLMAP_BINARY",
        "centred": "mssegment.cameras.centred:CENTRED",
        "lists": "mssegment.cameras.lists:LISTS",
        "camodocal": "mssegment.cameras.camodocal:CAMODOCAL",
        "bare_matrix": "mssegment.cameras.bare_matrix:BARE_MATRIX",
        "matrix_keys": "mssegment.cameras.matrix_keys:MATRIX_KEYS",
        "intrinsics": "mssegment.cameras.intrinsics:INTRINSICS",
        "named_values": "mssegment.cameras.named_values:NAMED_VALUES",
    },
)
"""The formats of camera files, in the order in which they are tried."""

EXPORTS: Registry[Any] = Registry(
    "export",
    {
        "tracks": "mssegment.export.tracks:TRACKS",
        "objects": "mssegment.export.objects:OBJECTS",
        "mot": "mssegment.export.mot:MOT",
        "npz": "mssegment.export.arrays:ARRAYS",
        "points": "mssegment.export.points:POINTS",
    },
)
"""The formats of trajectories that ``report.export`` writes."""

MASK_STYLES: Registry[Any] = Registry(
    "mask style",
    {
        "davis": "mssegment.export.mask_styles:davis",
        "colmap": "mssegment.export.mask_styles:colmap",
        "binary": "mssegment.export.mask_styles:binary",
        "coco": "mssegment.export.mask_styles:coco",
    },
)
"""The forms in which masks are written (``report.mask_style``)."""

ANNOTATIONS: Registry[Any] = Registry(
    "format of labelled shapes",
    {
        "labelme": "mssegment.annotations.labelme:LABELME",
        "coco": "mssegment.annotations.coco:COCO",
        "cvat": "mssegment.annotations.cvat:CVAT",
        "via": "mssegment.annotations.via:VIA",
        "voc": "mssegment.annotations.voc:VOC",
        "yolo": "mssegment.annotations.yolo:YOLO",
        "mots": "mssegment.annotations.mots:MOTS",
    },
)
"""The formats of labelled shapes that ``--labels`` reads, beside mask images and tables."""
