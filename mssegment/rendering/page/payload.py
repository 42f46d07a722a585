"""The data of the page's scripts: photographs as JPEG, and numbers in a compact form."""

from __future__ import annotations

import base64
import json
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.evaluation import is_correct, is_counted
from mssegment.inputs.text import printable
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER
from mssegment.rendering.layout import typical_spacing
from mssegment.rendering.report import Picture, Report
from mssegment.rendering.scene import OUTLINES
from mssegment.rendering.style import hexadecimal, text_on
from mssegment.rendering.thinning import shown_displacements

MAX_PHOTOGRAPH_SIDE = 1600
"""Pixels; larger photographs are reduced."""
PHOTOGRAPH_BYTES = 4_200_000
"""Limit of all photographs of a page, before base64 adds a third."""
NOT_VISIBLE = -32768
"""Coordinate of a track in a frame in which it is not visible."""


def photographs(report: Report) -> list[str]:
    """The frames as ``data:`` URLs, within ``PHOTOGRAPH_BYTES``; empty if not available."""
    pictures = [
        _reduced(report.pictures(i), MAX_PHOTOGRAPH_SIDE) for i in range(len(report.frames))
    ]
    encoded = [_jpeg(picture, 82) for picture in pictures]
    total = sum(map(len, encoded))
    while total > PHOTOGRAPH_BYTES:
        # the size of a JPEG is roughly proportional to the area
        factor = max(0.5, 0.95 * (PHOTOGRAPH_BYTES / total) ** 0.5)
        pictures = [None if p is None else _reduced(p, max(p.shape[:2]) * factor) for p in pictures]
        encoded = [_jpeg(picture, 75) for picture in pictures]
        total = sum(map(len, encoded))
    return [
        "data:image/jpeg;base64," + base64.b64encode(content).decode() if content else ""
        for content in encoded
    ]


def _reduced(picture: Picture | None, longest: float) -> Picture | None:
    """The picture, reduced to ``longest`` pixels along its longer side if it is larger."""
    if picture is None:
        return None
    picture = np.ascontiguousarray(picture)
    height, width = picture.shape[:2]
    factor = longest / max(height, width)
    if factor >= 1:
        return picture
    size = (max(1, round(width * factor)), max(1, round(height * factor)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _jpeg(picture: Picture | None, quality: int) -> bytes:
    """The content of a JPEG file, empty without a picture."""
    if picture is None:
        return b""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    return bytes(cv2.imencode(".jpg", picture, options)[1].tobytes())


def shown_labels(report: Report) -> list[int]:
    """The labels of the page in order: motions, outliers, and the others that occur."""
    labels = [motion.label for motion in report.motions] + [OUTLIER]
    return labels + [lab for lab in (BACKGROUND, NOT_JUDGED) if len(report.members(lab))]


def label_class(label: int) -> str:
    """The CSS class of a label."""
    return {OUTLIER: "outlier", BACKGROUND: "background", NOT_JUDGED: "unjudged"}.get(
        label, f"motion{label}"
    )


def misclassified(report: Report) -> npt.NDArray[np.bool_]:
    """Which tracks are misclassified, [P]; none without true labels."""
    if report.truth is None or report.evaluation is None:
        return np.zeros(len(report.labels), dtype=bool)
    matching, world = report.evaluation.matching, report.evaluation.world
    counted = is_counted(report.labels, report.truth, world)
    return np.asarray(counted & ~is_correct(report.labels, report.truth, matching, world))


def zero_name(report: Report) -> str:
    """What the true label 0 is called."""
    world = None if report.evaluation is None else report.evaluation.world
    return "outlier" if world is None else "background"


def true_name(report: Report, label: int) -> str:
    """A true label in words where it is not the number of a motion."""
    return str(label) if label > 0 else zero_name(report) if label == OUTLIER else "ignored"


def inlier_limit(report: Report, label: int) -> float | None:
    """Largest residual in pixels of the inliers of a motion; None where there are no residuals."""
    index = residual_row(report, label)
    if index is None:
        return None
    own = report.segmentation.residuals[index][report.members(label)]
    own = own[np.isfinite(own)]
    return float(own.max()) if len(own) else None


def residual_row(report: Report, label: int) -> int | None:
    """Row of a motion in the residuals; None where there are no residuals."""
    residuals = report.segmentation.residuals
    rows = [i for i, motion in enumerate(report.segmentation.motions) if motion.label == label]
    if not rows or residuals.ndim != 2 or rows[0] >= len(residuals):
        return None
    return rows[0]


def numbers(report: Report) -> dict[str, Any]:
    """The numbers for the scripts; arrays are base64 of little-endian bytes."""
    points = report.tracks.points
    largest = max([1, *(max(frame.width, frame.height) for frame in report.frames)])
    finite = np.nan_to_num(points, nan=0.0)
    # fixed-point numbers in 16 bits; outliers far outside the picture are clipped
    steps = max(1, min(16, 16000 // largest))
    coded = np.clip(np.round(finite * steps), -32000, 32000)
    coded = np.where(np.isfinite(points), coded, NOT_VISIBLE)
    rows = [residual_row(report, motion.label) for motion in report.motions]
    residuals = [
        np.full(len(points), np.nan) if row is None else report.segmentation.residuals[row]
        for row in rows
    ]
    return {
        "frames": [
            {"name": printable(frame.path), "width": frame.width, "height": frame.height}
            for frame in report.frames
        ],
        "tracks": len(points),
        "unit": report.unit,
        "stepsPerPixel": steps,
        "spacing": min(1e6, typical_spacing(report)),
        "points": _base64(coded, "<i2"),
        "labels": _base64(np.clip(report.labels, -32000, 32000), "<i2"),
        "truth": None if report.truth is None else _base64(report.truth, "<i2"),
        "zero": zero_name(report),
        "displacements": _base64(
            shown_displacements(report, 0) if report.frames else np.zeros(0), "u1"
        ),
        "misclassified": _base64(misclassified(report), "u1"),
        "residuals": _base64(np.array(residuals), "<f4"),
        "styles": [
            {
                "label": label,
                "class": label_class(label),
                "colour": hexadecimal(report.style(label).colour),
                "ink": hexadecimal(text_on(report.style(label).colour)),
                "shape": report.style(label).shape,
                "glyph": report.style(label).glyph,
                "name": report.style(label).name,
                "quiet": report.style(label).is_quiet,
                "limit": inlier_limit(report, label) if label > 0 else None,
            }
            for label in shown_labels(report)
        ],
        "outlines": {
            shape: np.round(outline, 3).tolist()
            for shape, outline in OUTLINES.items()
            if shape in {report.style(label).shape for label in shown_labels(report)}
        },
    }


def _base64(array: npt.NDArray[Any], dtype: str) -> str:
    """The array as ``dtype`` in base64."""
    return base64.b64encode(np.ascontiguousarray(array).astype(dtype).tobytes()).decode()


def as_script(data: dict[str, Any]) -> str:
    """JSON that cannot end the script element that contains it."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
