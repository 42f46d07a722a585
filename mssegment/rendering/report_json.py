"""The report in a stable form for other programs."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from mssegment.evaluation import Evaluation
from mssegment.records import BACKGROUND, NOT_JUDGED, OUTLIER, Floats, Motion
from mssegment.rendering.report import Report

SCHEMA = "mssegment/report/1"
IN_PIXELS = ("matrix", "direction", "epipole", "rotation", "coefficients")
"""The fields of a motion in pixels, or in the unit of the data, that ``report_json`` has."""


def report_json(report: Report) -> dict[str, Any]:
    """The report as lists, numbers and strings.

    Notes
    -----
    Stable keys: ``motions`` (count), ``misclassification`` (0..1, or None), ``confusion`` (rows are
    true motions, columns found ones, outliers last; or None), ``modes`` (with ``hypotheses`` and
    ``kde``), ``res`` and ``res_hat`` (per motion by label, or None).
    """
    evaluation, labels = report.evaluation, report.labels
    return {
        "schema": SCHEMA,
        "motions": len(report.motions),
        "misclassification": evaluation and _number(evaluation.misclassification),
        "confusion": evaluation and evaluation.confusion.tolist(),
        "modes": [
            {
                "hypotheses": int(mode.hypotheses),
                "kde": _number(mode.kde),
                "motion": int(mode.motion),
                "set": int(mode.set_index),
                "model": report.sets[mode.set_index].model
                if mode.set_index < len(report.sets)
                else None,
            }
            for mode in report.segmentation.modes
        ],
        "res": None if report.res is None else [_number(value) for value in report.res],
        "res_hat": None if report.res_hat is None else [_number(v) for v in report.res_hat],
        "counted": evaluation and evaluation.counted,
        "adjusted_rand": evaluation and _number(evaluation.adjusted_rand),
        "world": evaluation and evaluation.world,
        "objects": evaluation and _objects_json(report, evaluation),
        "true_motions": evaluation and list(evaluation.true_motions),
        "found_motions": evaluation and list(evaluation.found_motions),
        "camera_motion": report.camera_motion,
        "motion_list": [_motion_json(report, motion) for motion in report.motions],
        "tracks": len(labels),
        "outliers": int((labels == OUTLIER).sum()),
        "background": int((labels == BACKGROUND).sum()),
        "not_judged": int((labels == NOT_JUDGED).sum()),
        "labels": labels.tolist(),
        "true_labels": None if report.truth is None else report.truth.tolist(),
        "bandwidths": [_number(value) for value in report.segmentation.bandwidths],
        "hypotheses": sum(len(chosen.points) for chosen in report.sets),
        "notes": list(report.notes),
        "frames": [
            {"path": f.path, "width": f.width, "height": f.height, "index": f.index}
            for f in (report.frames if report.of_pictures else ())
        ],
        "history": [dict(stage) for stage in report.history],
    }


def report_bytes(report: Report) -> bytes:
    """``report_json`` as indented JSON that ends with a newline."""
    return msgspec.json.format(msgspec.json.encode(report_json(report)), indent=1) + b"\n"


def _objects_json(report: Report, evaluation: Evaluation) -> list[dict[str, Any]]:
    """The true objects of ``report_json``: how well tracks and masks agree with them."""
    back = {true: found for found, true in evaluation.matching.items()}
    masks = {quality.true: quality for quality in report.mask_quality}
    return [
        {
            "true": true,
            "motion": back.get(true),
            "iou": _number(evaluation.iou.get(true)),
            "J": _number(masks[true].region) if true in masks else None,
            "F": _number(masks[true].contour) if true in masks else None,
        }
        for true in sorted({*evaluation.true_motions, *masks})
    ]


def _motion_json(report: Report, motion: Motion) -> dict[str, Any]:
    """One motion of ``report_json``."""
    modes = report.modes_of(motion.label)
    return {
        "label": int(motion.label),
        "model": motion.model,
        "inliers": int((report.labels == motion.label).sum()),
        "hypotheses": sum(int(mode.hypotheses) for mode in modes),
        "kde": _number(modes[0].kde) if modes else None,
        "scale": _number(motion.scale),
        "rms": _number(motion.rms),
        "cost_saved": _number(motion.cost_saved),
        "log_nfa": _number(motion.log_nfa),
        "separation": _number(motion.separation),
        "rigid_evidence": _number(motion.rigid_evidence),
        "parts": [
            {
                "model": part.model,
                "inliers": len(part.inliers),
                "rms": _number(part.rms),
                "parameters": _numbers(part.parameters),
            }
            for part in motion.parts
        ],
        "true_motion": report.true_motion(motion.label),
        "parameters": _numbers(motion.parameters),
        **{name: _array(getattr(motion, name)) for name in IN_PIXELS},
        **({} if report.of_pictures else _flat_json(motion)),
    }


def _flat_json(motion: Motion) -> dict[str, Any]:
    """``origin`` and ``basis`` of a line or subspace, as vectors of the data."""
    if motion.basis is None or motion.origin is None:
        return {}
    return {"origin": _numbers(motion.origin[0]), "basis": _numbers(motion.basis[0])}


def _number(value: float | None) -> float | None:
    """The value for JSON, which has neither NaN nor infinity."""
    return None if value is None or not np.isfinite(value) else float(value)


def _array(values: Floats | None) -> list[Any] | None:
    """An array as nested lists, None where there is none."""
    return None if values is None else _numbers(values)


def _numbers(values: Floats) -> list[Any]:
    """An array as nested lists."""
    return [_numbers(row) if isinstance(row, np.ndarray) else _number(float(row)) for row in values]
