"""What the page's script gets: photographs as JPEG, and numbers as compact as they can be."""

from __future__ import annotations

import base64
import json
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.evaluation import is_counted
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Integers
from mssegment.rendering.layout import typical_spacing
from mssegment.rendering.report import Picture, Report
from mssegment.rendering.scene import OUTLINES
from mssegment.rendering.style import hexadecimal, mark, text_on
from mssegment.rendering.thinning import carriers

LONGEST_SIDE = 1600
"""Photographs on the page are not larger than this."""
PHOTOGRAPH_BYTES = 4_200_000
"""All photographs of a page together, before base64 makes a third more of them."""
UNSEEN = -32768
"""The coordinate of a track in a frame in which it is not seen."""


def photographs(report: Report) -> list[str]:
    """Each frame as a ``data:`` address, all within ``PHOTOGRAPH_BYTES``; empty if not at hand."""
    pictures = [_shrunk(report.pictures(i), LONGEST_SIDE) for i in range(len(report.frames))]
    encoded = [_jpeg(picture, 82) for picture in pictures]
    total = sum(map(len, encoded))
    while total > PHOTOGRAPH_BYTES:
        # bytes go about with the area
        factor = max(0.5, 0.95 * (PHOTOGRAPH_BYTES / total) ** 0.5)
        pictures = [None if p is None else _shrunk(p, max(p.shape[:2]) * factor) for p in pictures]
        encoded = [_jpeg(picture, 75) for picture in pictures]
        total = sum(map(len, encoded))
    return [
        "data:image/jpeg;base64," + base64.b64encode(content).decode() if content else ""
        for content in encoded
    ]


def _shrunk(picture: Picture | None, longest: float) -> Picture | None:
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
    if picture is None:
        return b""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality]
    return bytes(cv2.imencode(".jpg", picture, options)[1].tobytes())


def shown_labels(report: Report) -> list[int]:
    """The labels of the page in the order of its switches: motions, outliers, then the rest."""
    labels = [motion.label for motion in report.motions] + [OUTLIER]
    return labels + [lab for lab in (BACKGROUND, NOT_JUDGED) if len(report.members(lab))]


def label_class(label: int) -> str:
    """The CSS class of a label."""
    return {OUTLIER: "outlier", BACKGROUND: "background", NOT_JUDGED: "unjudged"}.get(
        label, f"motion{label}"
    )


def wrong_tracks(report: Report) -> npt.NDArray[np.bool_]:
    """Which tracks count as misclassified [P]; none without true labels."""
    if report.truth is None or report.evaluation is None:
        return np.zeros(len(report.labels), dtype=bool)
    found = matched_labels(report)
    return np.asarray(is_counted(report.labels, report.truth) & (found != report.truth))


def matched_labels(report: Report) -> Integers:
    """The found labels in the numbers of the truth; without partner 1 000 000 + the label."""
    matching = {} if report.evaluation is None else report.evaluation.matching
    found = report.labels.copy()
    for label in np.unique(report.labels[report.labels > 0]):
        found[report.labels == label] = matching.get(int(label), 1_000_000 + int(label))
    found[report.labels == BACKGROUND] = BACKGROUND
    return found


def inlier_limit(report: Report, label: int) -> float | None:
    """The largest residual (pixels) of a motion's inliers; None where nothing is known."""
    index = residual_row(report, label)
    if index is None:
        return None
    own = report.segmentation.residuals[index][report.members(label)]
    own = own[np.isfinite(own)]
    return float(own.max()) if len(own) else None


def residual_row(report: Report, label: int) -> int | None:
    """Which row of the residuals belongs to a motion; None where there are no residuals."""
    residuals = report.segmentation.residuals
    rows = [i for i, motion in enumerate(report.segmentation.motions) if motion.label == label]
    if not rows or residuals.ndim != 2 or rows[0] >= len(residuals):
        return None
    return rows[0]


def numbers(report: Report) -> dict[str, Any]:
    """The numbers for the script; arrays are base64 of little-endian bytes."""
    points = report.tracks.points
    largest = max([1, *(max(frame.width, frame.height) for frame in report.frames)])
    finite = np.nan_to_num(points, nan=0.0)
    # a wild outlier may lie outside of the picture: int16 must hold it, or its place is cut
    steps = max(1, min(16, 16000 // largest))
    coded = np.clip(np.round(finite * steps), -32000, 32000)
    coded = np.where(np.isfinite(points), coded, UNSEEN)
    rows = [residual_row(report, motion.label) for motion in report.motions]
    residuals = [
        np.full(len(points), np.nan) if row is None else report.segmentation.residuals[row]
        for row in rows
    ]
    return {
        "frames": [
            {"name": frame.path, "width": frame.width, "height": frame.height}
            for frame in report.frames
        ],
        "tracks": len(points),
        "steps": steps,
        "spacing": min(1e6, typical_spacing(report)),
        "points": _base64(coded, "<i2"),
        "labels": _base64(np.clip(report.labels, -32000, 32000), "<i2"),
        "truth": None if report.truth is None else _base64(report.truth, "<i2"),
        "carriers": _base64(carriers(report, 0) if report.frames else np.zeros(0), "u1"),
        "wrong": _base64(wrong_tracks(report), "u1"),
        "residuals": _base64(np.array(residuals), "<f4"),
        "looks": [
            {
                "label": label,
                "class": label_class(label),
                "colour": hexadecimal(mark(label).colour),
                "ink": hexadecimal(text_on(mark(label).colour)),
                "shape": mark(label).shape,
                "glyph": mark(label).glyph,
                "name": mark(label).name,
                "limit": inlier_limit(report, label) if label > 0 else None,
            }
            for label in shown_labels(report)
        ],
        "outlines": {
            shape: np.round(outline, 3).tolist()
            for shape, outline in OUTLINES.items()
            if shape in {mark(label).shape for label in shown_labels(report)}
        },
    }


def _base64(array: npt.NDArray[Any], dtype: str) -> str:
    return base64.b64encode(np.ascontiguousarray(array).astype(dtype).tobytes()).decode()


def as_script(data: dict[str, Any]) -> str:
    """JSON that cannot end the script element it stands in."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
